"""COLMAP: a sparse model as text. Every image sees the target as the world, so poses need no rig.

Cameras are OPENCV, or FULL_OPENCV where k3 is not 0. Numbers of cameras, images and points begin with 1.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pipeline.exports.cameras import ExportCamera
from pipeline.exports.material import ExportTarget, ExportView, Material
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
    centre=Centre.ROWS,
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

    @property
    def pose(self) -> list[float]:
        """w, x, y, z, then the translation."""
        pose = self.view.pose
        assert pose is not None
        return [*pose.rotation.tolist(), *pose.translation.tolist()]


def write(material: Material, folder: Path) -> None:
    """Write the three files of a model.

    Raises
    ------
    ExportError
        No pinhole fits a camera, or there are several targets.
    """
    target = material.only_target
    names = [camera.name for camera in material.cameras]
    images = [_Image(number, names.index(view.camera) + 1, view) for number, view in enumerate(material.views, 1)]
    tracks = _tracks(images, len(target.points))
    errors = _errors(material, images)
    remarks = [f"# {line}" for line in material.remarks]
    for name, lines in (
        ("cameras", _camera_lines(material)),
        ("images", _image_lines(images)),
        ("points3D", _point_lines(target, tracks, errors)),
    ):
        (folder / f"{name}.txt").write_text("\n".join([*remarks, *lines, ""]), encoding="utf-8")


def _parameters(camera: ExportCamera) -> tuple[str, list[float]]:
    """Model and its parameters."""
    model = camera.model
    f = model.principal_distance_px
    *four, k3 = model.distortion.tolist()
    pinhole = [f, f, *model.principal_point_px.tolist(), *four]
    return ("FULL_OPENCV", [*pinhole, k3, *([0.0] * 3)]) if k3 else ("OPENCV", pinhole)


def _tracks(images: list[_Image], count: int) -> list[list[tuple[int, int]]]:
    """Per point of the target the images that see it, and the row there."""
    tracks: list[list[tuple[int, int]]] = [[] for _ in range(count)]
    for image in images:
        for row, point in enumerate(image.view.observations.ids.tolist()):
            tracks[point].append((image.number, row))
    return tracks


def _errors(material: Material, images: list[_Image]) -> list[float]:
    """Mean residual of each point [px]; -1, as COLMAP has it: nothing sees it."""
    total, count = np.zeros((2, len(material.only_target.points)))
    for image in images:
        np.add.at(total, image.view.observations.ids, material.residuals_px(image.view))
        np.add.at(count, image.view.observations.ids, 1)
    errors: list[float] = np.where(count > 0, total / np.maximum(count, 1), -1).tolist()
    return errors


def _camera_lines(material: Material) -> Iterator[str]:
    yield "# CAMERA_ID, MODEL, WIDTH, HEIGHT, PARAMS[]"
    for number, camera in enumerate(material.cameras, 1):
        model, parameters = _parameters(camera)
        yield " ".join([str(number), model, *map(str, camera.size_px), *map(repr, parameters)])


def _image_lines(images: list[_Image]) -> Iterator[str]:
    yield "# IMAGE_ID, QW, QX, QY, QZ, TX, TY, TZ, CAMERA_ID, NAME; then POINTS2D[] as X, Y, POINT3D_ID"
    for image in images:
        yield " ".join([str(image.number), *map(repr, image.pose), str(image.camera), image.view.image])
        observations = image.view.observations
        rows = zip(observations.positions.tolist(), _numbers(observations.ids), strict=True)
        yield " ".join(f"{x!r} {y!r} {point}" for (x, y), point in rows)


def _point_lines(target: ExportTarget, tracks: list[list[tuple[int, int]]], errors: list[float]) -> Iterator[str]:
    yield "# POINT3D_ID, X, Y, Z, R, G, B, ERROR, TRACK[] as IMAGE_ID, POINT2D_IDX"
    points = zip(_numbers(np.arange(len(tracks))), target.points.tolist(), tracks, errors, strict=True)
    for number, place, track, error in points:
        seen = [str(value) for pair in track for value in pair]
        yield " ".join([str(number), *map(repr, place), *map(str, _COLOUR), repr(error), *seen])


def _numbers(ids: np.ndarray) -> list[int]:
    """Numbers of points in COLMAP."""
    return [number + 1 for number in ids.tolist()]
