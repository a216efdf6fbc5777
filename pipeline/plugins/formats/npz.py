"""Data frames: correspondences, poses and micro-images of each camera, as NumPy arrays of the columns."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from pipeline.exports.material import ExportCamera, Material
from pipeline.files.npy import write_npz
from pipeline.formats import Board, Cameras, Format, Microlenses, Origin, Pose, Rotation, Unit
from pipeline.results.rows import joined

FORMAT = Format(
    consumer="NumPy",
    note="an array per column",
    source="CONVENTIONS.md: nothing is converted",
    cameras=Cameras.ANY,
    files=("<camera>.correspondences.npz", "<camera>.poses.npz", "<plenoptic camera>.micro_images.npz"),
    origin=Origin.ZERO,
    board=Board.OURS,
    pose=Pose.CAMERA_FROM_TARGET,
    rotation=Rotation.VECTOR,
    unit=Unit.MM,
    microlenses=Microlenses.AXIAL,
)


def write(material: Material, folder: Path) -> None:
    """Write an array per column, and the remarks."""
    for name, rows in tables(material):
        columns = {column: rows[column] for column in rows.dtype.names or ()}
        write_npz(folder / f"{name}.npz", material.remarks, columns)


def tables(material: Material) -> Iterator[tuple[str, np.recarray]]:
    """Names of the data frames, and the rows of each."""
    for camera in material.cameras:
        yield f"{camera.name}.correspondences", _correspondences(material, camera)
        yield f"{camera.name}.poses", _poses(material, camera)
        if camera.built.micro_images is not None:
            yield f"{camera.name}.micro_images", camera.built.micro_images


def _correspondences(material: Material, camera: ExportCamera) -> np.recarray:
    """Rows of the build with the positions that are exported."""
    parts = []
    for view in material.of(camera):
        rows = view.built.correspondences[view.observations.rows].copy()
        rows["x_px"], rows["y_px"] = view.observations.positions.T
        parts.append(rows)
    return joined(parts)


def _poses(material: Material, camera: ExportCamera) -> np.recarray:
    """A row per frame and target; empty where no pinhole fits."""
    views = [view for view in material.of(camera) if view.pose]
    columns = {
        "frame": np.array([view.frame for view in views], dtype=np.int64),
        "camera": np.array([view.camera for view in views], dtype=str),
        "target": np.array([view.target for view in views], dtype=str),
    }
    numbers = np.array([view.pose.numbers for view in views if view.pose]).reshape(-1, 6)
    names = [f"rvec_{axis}_rad" for axis in "xyz"] + [f"t_{axis}_mm" for axis in "xyz"]
    columns |= dict(zip(names, numbers.T, strict=True))
    return np.rec.fromarrays(list(columns.values()), dtype=[(name, column.dtype) for name, column in columns.items()])
