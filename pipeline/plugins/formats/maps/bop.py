"""BOP: poses of targets as objects, a scene per camera, with depth and masks by the ray of each pixel.

The number of an image is that of its frame. Scenes count from 0 and objects from 1; dataset_info.md has their names.
"""

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from pipeline.channel_names import folder_of
from pipeline.exports.material import ExportCamera, ExportView, Material
from pipeline.files.jsonfile import Json, write_json
from pipeline.files.png import write_png
from pipeline.formats import Board, Cameras, Format, Origin, Pose, Reads, Rotation, Unit
from pipeline.plugins.formats.maps.traced import distances_mm, traced

FORMAT = Format(
    consumer="BOP: bop_toolkit, estimators of poses of objects",
    note="a camera is a scene, a target an object; K knows no distortion",
    source="proof: inout.py and misc.py of thodan/bop_toolkit cea62d6. Read: bop_datasets_format.md, calc_gt_info.py",
    cameras=Cameras.CONVENTIONAL,
    reads=frozenset({Reads.CORNERS, Reads.RAYS, Reads.SCENE}),
    files=(
        "dataset_info.md",
        "<camera6>/scene_camera.json",
        "<camera6>/scene_gt.json",
        "<camera6>/scene_gt_info.json",
        "<camera6>/depth/<frame6>.png",
        "<camera6>/mask/<frame6>_<target6>.png",
        "<camera6>/mask_visib/<frame6>_<target6>.png",
    ),
    origin=Origin.ZERO,
    board=Board.OURS,
    pose=Pose.CAMERA_FROM_TARGET,
    rotation=Rotation.MATRIX,
    unit=Unit.MM,
)

_DEEPEST, _WHITE = 65535, 255
"""Largest pixel values of depth images and of masks."""
_NO_BOX = [-1] * 4
"""Box of an invisible object."""


def write(material: Material, folder: Path) -> None:
    """Write the scene of each camera, and the names of all."""
    (folder / "dataset_info.md").write_text("\n".join([*_info(material), ""]), encoding="utf-8")
    scene = material.scene()
    matrices = [_matrix(camera) for camera in material.cameras]  # refused ones before their rays are traced
    for scene_number, camera in enumerate(material.cameras):
        scene_folder = folder / f"{scene_number:06d}"
        for name in ("depth", "mask", "mask_visib"):
            (scene_folder / name).mkdir(parents=True)
        records: dict[str, Json] = {name: {} for name in ("scene_camera", "scene_gt", "scene_gt_info")}
        with traced(camera, scene_folder) as pixels:
            for frame in material.frames[camera.name]:
                views = [view for view in material.of(camera) if view.frame == frame]
                first_mm = distances_mm(camera, scene, frame, pixels.rays)
                scale = _write_depth(camera, pixels.rays, first_mm, scene_folder / f"depth/{frame:06d}.png")
                infos = []
                for number, view in enumerate(views):
                    alone_mm = distances_mm(camera, scene, frame, pixels.rays, view.target)
                    masks = np.isfinite(alone_mm), alone_mm <= first_mm
                    for name, mask in zip(("mask", "mask_visib"), masks, strict=True):
                        write_png(
                            scene_folder / f"{name}/{frame:06d}_{number:06d}.png", (mask * _WHITE).astype(np.uint8)
                        )
                    infos.append(_counts(*masks))
                records["scene_camera"][str(frame)] = {"cam_K": matrices[scene_number].ravel(), "depth_scale": scale}
                records["scene_gt"][str(frame)] = [_pose(number, view) for number, view in enumerate(views, 1)]
                records["scene_gt_info"][str(frame)] = infos
        for name, record in records.items():
            write_json(scene_folder / f"{name}.json", record)


def _info(material: Material) -> Iterator[str]:
    yield from (f"- {line}" for line in material.remarks)
    yield from (f"- object {number}: {target.name}" for number, target in enumerate(material.targets, 1))
    for number, camera in enumerate(material.cameras):
        path = f"frames/<number>/{folder_of(camera.name)}/image.png"
        yield f"- scene {number:06d}: {camera.name}, whose rgb/<number>.png is {path} of the build"


def _matrix(camera: ExportCamera) -> np.ndarray:
    """K of the pinhole without distortion; ExportError if none fits."""
    return (camera.plain_pinhole or camera.model).matrix


def _pose(number: int, view: ExportView) -> Json:
    assert view.pose is not None
    return {"cam_R_m2c": view.pose.rotation.ravel(), "cam_t_m2c": view.pose.translation, "obj_id": number}


def _write_depth(camera: ExportCamera, rays: np.ndarray, first_mm: np.ndarray, path: Path) -> float:
    """Write z before the centre of projection, 0 where there is nothing; returns the mm per step, the finest here."""
    z_mm = np.nan_to_num(rays[..., 2] + first_mm * rays[..., 5] - camera.model.centre_mm[2])
    scale = float(z_mm.max()) / _DEEPEST or 1.0
    write_png(path, np.round(z_mm / scale).astype(np.uint16))
    return scale


def _counts(silhouette: np.ndarray, visible: np.ndarray) -> Json:
    """Pixel counts and boxes of a silhouette and of its visible part; widths as in bop_toolkit."""
    count, visible_count = int(silhouette.sum()), int(visible.sum())
    boxes = {
        "bbox_obj": _box(silhouette) if visible_count else _NO_BOX,
        "bbox_visib": _box(visible) if visible_count else _NO_BOX,
    }
    counts = {"px_count_all": count, "px_count_valid": count, "px_count_visib": visible_count}
    return {**boxes, **counts, "visib_fract": visible_count / count if count else 0.0}


def _box(mask: np.ndarray) -> list[int]:
    rows, columns = np.nonzero(mask)
    x, y = int(columns.min()), int(rows.min())
    return [x, y, int(columns.max()) - x, int(rows.max()) - y]
