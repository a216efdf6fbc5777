"""Files written on the spot and what their readers say, and rays into the lenses that come out."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from naive import lens_files as naive
from places import ROOT
from pxr import Usd
from scipy.spatial.transform import Rotation

from pipeline.errors import UsageError
from pipeline.optics.first_order import first_order
from pipeline.optics.prescription import Prescription
from pipeline.optics.rays import traced
from pipeline.optics.table import displacements, towards_sensor, unbounded
from pipeline.scene.lens import read_prescription

LENSES = ROOT / "stages/lenses"


def read(reader: Callable[..., Any], folder: Path, name: str, text: str | bytes, **options: Any) -> Any:
    path = folder / name
    path.write_bytes(text.encode() if isinstance(text, str) else text)
    return reader(path, **options)


def refused(reader: Callable[..., Any], folder: Path, name: str, text: str | bytes, **options: Any) -> str:
    with pytest.raises(UsageError) as error:
        read(reader, folder, name, text, **options)
    return str(error.value).replace(f"{folder}/", "")


def stage_prescription(path: Path, wavelength_nm: float | None = None) -> Prescription:
    stage = Usd.Stage.Open(path.as_posix())
    return read_prescription(stage.GetDefaultPrim(), wavelength_nm)


def before(lens: Prescription, across_mm: np.ndarray, direction: np.ndarray) -> np.ndarray:
    """Starts (n, 3) 5 mm before a lens of rays that aim at points (n, 2) of its entrance pupil."""
    position = np.column_stack([across_mm, np.full(len(across_mm), -first_order(lens).entrance_pupil.z_mm)])
    start_mm = lens.vertices_from_stop_mm[0] - 5
    return position + direction * ((start_mm - position[:, 2]) / direction[:, 2])[:, None]


def bending(media: list[Any], focal_lengths: list[float | None], air: Any = 1.0) -> list[int]:
    """Places of surfaces that bend light, of the medium behind each."""
    before = [air, *media]
    return [i for i, f in enumerate(focal_lengths) if before[i] != before[i + 1] or f is not None]


def apart_mm(rows: list[naive.Row], indices: list[float], lens: Prescription) -> float:
    """Largest difference of surfaces, and of rays behind them, between a naive reader's lens and ours.

    Each has its own frame; ours is moved to where its surfaces are theirs.
    """
    theirs = [rows[i] for i in bending(indices, [row.focal_length for row in rows])]
    media = [surface.index for surface in lens.surfaces]
    ours = bending(media, [surface.focal_length_mm for surface in lens.surfaces])
    moves, z_mm = displacements(lens), lens.vertices_from_stop_mm
    frames = [(np.eye(4) if moves[i] is None else moves[i]) for i in ours]
    a = np.array([point for row in theirs for point in (row.vertex, row.vertex + row.turn[:, 2])])
    b = np.array([(frame @ [0, 0, z_mm[i] + z, 1])[:3] for i, frame in zip(ours, frames, strict=True) for z in (0, 1)])
    turn = Rotation.align_vectors(a - a.mean(axis=0), b - b.mean(axis=0))[0].as_matrix()
    first, rng = theirs[0], np.random.default_rng(7)
    reach_mm = 0.3 * lens.surfaces[ours[0]].semi_diameter_mm
    start = (
        first.vertex + np.column_stack([rng.uniform(-reach_mm, reach_mm, (40, 2)), np.full(40, -5.0)]) @ first.turn.T
    )
    way = np.column_stack([rng.uniform(-0.03, 0.03, (40, 2)), np.ones(40)]) @ first.turn.T
    way /= np.linalg.norm(way, axis=1)[:, None]
    point, direction = naive.follow(rows, indices, start, way)
    table = unbounded(towards_sensor(lens))
    rays = traced(table, (start - a.mean(axis=0)) @ turn + b.mean(axis=0), way @ turn)
    back, along = (rays.position - b.mean(axis=0)) @ turn.T + a.mean(axis=0), rays.direction @ turn.T
    lines = np.cross(back - point, direction)
    surfaces = a - a.mean(axis=0) - (b - b.mean(axis=0)) @ turn.T
    return max(np.abs(found).max() for found in (surfaces, lines, along - direction))
