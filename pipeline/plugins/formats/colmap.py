"""COLMAP: a sparse model as text. Every image sees the target as the world, so poses need no rig.

Cameras are OPENCV, or FULL_OPENCV where k3 is not 0. Numbers of cameras, images and points begin with 1.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pipeline.exports.material import ExportView, Material
from pipeline.formats import Board, Cameras, Centre, Format, Origin, Pose, Rotation, Targets, Unit

FORMAT = Format(
    consumer="COLMAP",
    note="the world is the target",
    source="run: pycolmap 4.2.1",
    cameras=Cameras.CONVENTIONAL,
    targets=Targets.ONE,
    files=("cameras.txt", "images.txt", "points3D.txt"),
    origin=Origin.HALF,
    board=Board.RIGHT_DOWN,
    pose=Pose.CAMERA_FROM_TARGET,
    centre=Centre.FITTED_TO_ROWS,
    rotation=Rotation.QUATERNION,
    unit=Unit.M,
)

_COLOUR = (128, 128, 128)
"""RGB of points, 0 to 255: grey, because a corner has no colour."""


@dataclass(frozen=True, slots=True)
class _Image:
    """An image with its numbers in the model."""

    number: int
    camera: int
    view: ExportView


def write(material: Material, folder: Path) -> None:
    """Write the three files of a model."""
    names = [camera.name for camera in material.cameras]
    images = [_Image(number, names.index(view.camera) + 1, view) for number, view in enumerate(material.views, 1)]
    material.write_text(folder / "cameras.txt", _camera_lines(material))
    material.write_text(folder / "images.txt", _image_lines(images))
    material.write_text(folder / "points3D.txt", _point_lines(material, images))


def _camera_lines(material: Material) -> Iterator[str]:
    yield "# CAMERA_ID, MODEL, WIDTH, HEIGHT, PARAMS[]"
    for number, camera in enumerate(material.cameras, 1):
        *numbers, k3 = camera.opencv
        name, more = ("FULL_OPENCV", [k3, 0.0, 0.0, 0.0]) if k3 else ("OPENCV", [])
        yield " ".join([str(number), name, *map(str, camera.size_px), *map(repr, [*numbers, *more])])


def _image_lines(images: list[_Image]) -> Iterator[str]:
    yield "# IMAGE_ID, QW, QX, QY, QZ, TX, TY, TZ, CAMERA_ID, NAME; then POINTS2D[] as X, Y, POINT3D_ID"
    for image in images:
        pose, observations = image.view.pose, image.view.observations
        assert pose is not None
        yield " ".join([str(image.number), *map(repr, pose.numbers), str(image.camera), image.view.image])
        rows = zip(observations.positions.tolist(), observations.ids.tolist(), strict=True)
        yield " ".join(f"{x!r} {y!r} {point + 1}" for (x, y), point in rows)


def _point_lines(material: Material, images: list[_Image]) -> Iterator[str]:
    """Points with their mean residuals [px]; -1, as in COLMAP, for points without observations."""
    yield "# POINT3D_ID, X, Y, Z, R, G, B, ERROR, TRACK[] as IMAGE_ID, POINT2D_IDX"
    points = material.only_target.points
    tracks: list[list[int]] = [[] for _ in points]
    total = np.zeros(len(points))
    for image in images:
        ids = image.view.observations.ids
        np.add.at(total, ids, material.residuals_px(image.view))
        for row, point in enumerate(ids.tolist()):
            tracks[point] += [image.number, row]
    count = np.array([len(track) // 2 for track in tracks])
    errors = np.where(count > 0, total / np.maximum(count, 1), -1)
    for number, (point, error, track) in enumerate(zip(points.tolist(), errors.tolist(), tracks, strict=True), 1):
        yield " ".join([str(number), *map(repr, point), *map(str, _COLOUR), repr(error), *map(str, track)])
