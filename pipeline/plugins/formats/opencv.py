"""OpenCV: arrays for `calibrateCamera` and `stereoCalibrate`, and FileStorage YAML.

Keys of the YAML files are those of OpenCV's own samples, calibration.cpp and stereo_calib.cpp.
"""

from pathlib import Path
from typing import Any

import numpy as np

from pipeline.exports.conversion import stated
from pipeline.exports.material import ExportCamera, ExportView, Material
from pipeline.files.npy import write_npz
from pipeline.formats import Board, Cameras, Centre, Format, Origin, Pose, Rotation, Unit, pairs
from pipeline.plugins.formats.filestorage import yaml_text

FORMAT = Format(
    consumer="OpenCV 4 and 5",
    note="stereo- of pairs of cameras",
    source="run: cv2 5.0.0. Read: opencv/opencv issues 10130, 24633 on the centres of pixels",
    cameras=Cameras.CONVENTIONAL,
    files=("<camera>.npz", "<camera>.yml", "stereo-<pair>.npz", "stereo-<pair>.yml"),
    origin=Origin.ZERO,
    board=Board.RIGHT_DOWN,
    pose=Pose.CAMERA_FROM_TARGET,
    centre=Centre.FITTED_TO_ROWS,
    rotation=Rotation.VECTOR,
    unit=Unit.MM,
)


def write(material: Material, folder: Path) -> None:
    """Write the files of all cameras, and of all pairs."""
    for camera in material.cameras:
        write_npz(folder / f"{camera.name}.npz", material.remarks, one_camera(material, camera))
        text = yaml_text(material.remarks, {**_model(camera), **_extrinsics(material.of(camera))})
        (folder / f"{camera.name}.yml").write_text(text, encoding="utf-8")
    named = {camera.name: camera for camera in material.cameras}
    for first, second in ((named[one], named[other]) for one, other in pairs(named, material.frames)):
        name = f"stereo-{first.name}-{second.name}"
        arrays = stereo(material, first, second)
        write_npz(folder / f"{name}.npz", material.remarks, arrays)
        text = yaml_text(material.remarks, {key: arrays[key] for key in ("M1", "D1", "M2", "D2", "R", "T")})
        (folder / f"{name}.yml").write_text(text, encoding="utf-8")


def one_camera(material: Material, camera: ExportCamera) -> dict[str, Any]:
    """Arrays for `calibrateCamera`: views one after the other, view i from starts[i] to starts[i + 1]."""
    views = [view for view in material.of(camera) if len(view.observations.ids)]
    counts = [len(view.observations.ids) for view in views]
    points = [material.target(view.target).points[view.observations.ids] for view in views]
    poses = [view.pose for view in views]
    arrays: dict[str, Any] = {
        "image_points": _single([view.observations.positions for view in views], 2),
        "object_points": _single(points, 3),
        "ids": np.concatenate([view.observations.ids for view in views]) if views else np.zeros(0, np.int64),
        "starts": np.concatenate([[0], np.cumsum(counts)]).astype(np.int64),
        "frames": np.array([view.frame for view in views], dtype=np.int64),
        "targets": np.array([view.target for view in views], dtype=str),
        "images": np.array([view.image for view in views], dtype=str),
        "image_size": np.array(camera.size_px),
    }
    if camera.pinhole is not None and all(poses):
        arrays |= {"camera_matrix": camera.pinhole.matrix, "dist_coeffs": camera.pinhole.distortion}
        numbers = np.array([pose.numbers for pose in poses if pose]).reshape(-1, 6)
        arrays |= {"rvecs": numbers[:, :3], "tvecs": numbers[:, 3:]}
    return arrays


def stereo(material: Material, first: ExportCamera, second: ExportCamera) -> dict[str, Any]:
    """Arrays for `stereoCalibrate`: points that both cameras see, and the true R and T."""
    left, right, points, frames, counts = [], [], [], [], []
    for a, b in material.together(first, second):
        ids, in_a, in_b = np.intersect1d(a.observations.ids, b.observations.ids, return_indices=True)
        if len(ids):
            left.append(a.observations.positions[in_a])
            right.append(b.observations.positions[in_b])
            points.append(material.target(a.target).points[ids])
            frames.append(a.frame)
            counts.append(len(ids))
    pose = stated(material.second_from_first(first, second), Rotation.MATRIX)
    return {
        "image_points1": _single(left, 2),
        "image_points2": _single(right, 2),
        "object_points": _single(points, 3),
        "starts": np.concatenate([[0], np.cumsum(counts)]).astype(np.int64),
        "frames": np.array(frames, dtype=np.int64),
        "image_size1": np.array(first.size_px),
        "image_size2": np.array(second.size_px),
        "R": pose.rotation,
        "T": pose.translation[:, None],
        "M1": first.model.matrix,
        "D1": np.atleast_2d(first.model.distortion),
        "M2": second.model.matrix,
        "D2": np.atleast_2d(second.model.distortion),
    }


def _model(camera: ExportCamera) -> dict[str, Any]:
    """Size of the image, and the pinhole if one fits."""
    width, height = camera.size_px
    head = {"image_width": width, "image_height": height}
    if camera.pinhole is None:
        return head
    distortion = np.atleast_2d(camera.pinhole.distortion)
    return {**head, "camera_matrix": camera.pinhole.matrix, "distortion_coefficients": distortion}


def _extrinsics(views: tuple[ExportView, ...]) -> dict[str, Any]:
    """A row per view: rotation vector and translation, as the sample writes them."""
    rows = [view.pose.numbers for view in views if view.pose]
    if not rows:
        return {}
    frames = np.array([[view.frame] for view in views if view.pose], dtype=np.int32)
    return {"nframes": len(rows), "extrinsic_parameters": np.array(rows), "frames": frames}


def _single(parts: list[np.ndarray], width: int) -> np.ndarray:
    """Points of all views, (n, 1, width) float32, as OpenCV takes them."""
    return np.concatenate([np.zeros((0, width)), *parts])[:, None].astype(np.float32)
