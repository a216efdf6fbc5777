"""Data frames: correspondences, poses and micro-images of each camera as Parquet, or as NumPy arrays of the columns."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from pipeline.exports.cameras import ExportCamera
from pipeline.exports.material import Material
from pipeline.results.rows import joined
from pipeline.results.rows import write_parquet as parquet


def write_parquet(material: Material, folder: Path) -> None:
    """Write Parquet files; their metadata hold the remarks (`attrs` of the data frame).

    Raises
    ------
    UsageError
        pandas or pyarrow is not installed.
    """
    for name, rows in _tables(material):
        parquet(folder / f"{name}.parquet", rows, material.remarks)


def write_npz(material: Material, folder: Path) -> None:
    """Write an array per column, and the remarks."""
    for name, rows in _tables(material):
        with (folder / f"{name}.npz").open("wb") as stream:
            columns: dict[str, Any] = {column: rows[column] for column in rows.dtype.names or ()}
            np.savez(stream, remarks=np.array(material.remarks), **columns)


def _tables(material: Material) -> Iterator[tuple[str, np.recarray]]:
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
    numbers = np.array([[*view.pose.rotation, *view.pose.translation] for view in views if view.pose]).reshape(-1, 6)
    names = [f"rvec_{axis}_rad" for axis in "xyz"] + [f"t_{axis}_mm" for axis in "xyz"]
    columns |= dict(zip(names, numbers.T, strict=True))
    return np.rec.fromarrays(list(columns.values()), dtype=[(name, column.dtype) for name, column in columns.items()])
