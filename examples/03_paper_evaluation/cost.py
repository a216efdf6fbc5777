"""What the paper's route costs on this machine, beside `direct` and the time that the paper states.

A strip across the sensor is traced and searched, and stands for all of it; `direct` solves all rows of all poses.
"""

import os
import platform
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from corners import MIN_HIT_FRACTION, camera_and_boards
from windows import position_grid

from pipeline.camera.rig import Rig
from pipeline.camera.tracer import Tracer, parallel_planes, target_plane
from pipeline.truth.direct.direct_rows import guesses, solve
from pipeline.truth.grid.correspond import find
from pipeline.truth.grid.position_image import on_target
from pipeline.truth.planes import tangent_planes
from pipeline.truth.settings import TruthSettings

PAPER_MIN = 1e-11
"""The paper: minutes per sample of an image I or J on two Titan X."""
CLAIMS_PX = 1e-3, 1e-4


@dataclass(frozen=True, slots=True, kw_only=True)
class Spent:
    """Seconds of processor time and by the clock."""

    cpu_s: float
    wall_s: float

    def __mul__(self, factor: float) -> "Spent":
        return Spent(cpu_s=self.cpu_s * factor, wall_s=self.wall_s * factor)


@dataclass(frozen=True, slots=True, kw_only=True)
class Cost:
    """Times on one core.

    Attributes
    ----------
    processor : str
    pixels, poses, points : int
        Of the whole sensor, and of the boards.
    planes, board : Spent
        A ray of J_near and J_far, and of J on a board.
    search : Spent
        A position of J, from J_near and J_far, with all points.
    direct : list of (claim [px], rows, rays, Spent)
        All poses together.
    """

    processor: str
    pixels: int
    poses: int
    points: int
    planes: Spent
    board: Spent
    search: Spent
    direct: list[tuple[float, int, int, Spent]]


def measured(rows: int = 8, samples: int = 64**2) -> Cost:
    """Times of a strip of so many rows of pixels with so many samples each."""
    camera, seed, poses, corners_mm = camera_and_boards()
    rig = Rig.of(Tracer(camera, seed))
    first = (camera.sensor.height_px - rows) // 2
    pixels = np.stack(np.meshgrid(np.arange(camera.sensor.width_px), first + np.arange(rows)), axis=-1)
    positions = rig.tracer.positions_mm(*pixels.reshape(-1, 2).T)
    cell, z_mm = rig.microlens_at(positions), (camera.near_mm, camera.far_mm)
    starts, given = (positions, cell), (samples, pixels.reshape(-1, 2), 1.0)
    planes, board = parallel_planes(*z_mm), np.stack([target_plane(poses[0])] * 2)
    rig.tracer.moments(*(part[:16] for part in starts), planes, samples, given[1][:16], 1.0)  # compiles
    bundles, by_planes = _spent(lambda: rig.tracer.moments(*starts, planes, *given))
    _, by_board = _spent(lambda: rig.tracer.moments(*starts, board, *given))
    near, far = bundles[:, :2].reshape(*pixels.shape), bundles[:, 2:4].reshape(*pixels.shape)
    grid = position_grid(1, cell.reshape(pixels.shape[:2]), np.stack([rig.axial[:, 0]] * 3, axis=1))

    def search() -> Any:
        image = on_target(near, far, *z_mm, poses[0])
        return find(image, corners_mm, grid, TruthSettings(method="two-plane"))

    search()
    _, searched = _spent(search)
    rays, positions_count = len(positions) * samples, len(positions)
    return Cost(
        processor=_processor(),
        pixels=camera.sensor.width_px * camera.sensor.height_px,
        poses=len(poses),
        points=len(corners_mm),
        planes=by_planes * (1 / rays),
        board=by_board * (1 / rays),
        search=searched * (1 / positions_count),
        direct=[_by_direct(rig, poses, corners_mm, claim_px) for claim_px in CLAIMS_PX],
    )


def _by_direct(
    rig: Rig, poses: list[np.ndarray], corners_mm: np.ndarray, claim_px: float
) -> tuple[float, int, int, Spent]:
    """All rows of all poses, found and solved."""

    def rows_and_rays() -> tuple[int, int]:
        rows = rays = 0
        for pose in poses:
            planes = tangent_planes(pose, corners_mm)
            guess, of_guesses = guesses(rig, planes)
            counts = solve(rig, guess, planes, claim_px, MIN_HIT_FRACTION).counts
            rows, rays = rows + counts["rows"], rays + counts["rays"] + of_guesses
        return rows, rays

    (rows, rays), spent = _spent(rows_and_rays)
    return claim_px, rows, rays, spent


def _spent(work: Callable[[], Any]) -> tuple[Any, Spent]:
    cpu_s, wall_s = time.process_time(), time.perf_counter()
    result = work()
    return result, Spent(cpu_s=time.process_time() - cpu_s, wall_s=time.perf_counter() - wall_s)


def _processor() -> str:
    """The processor as it names itself, and how many cores this machine has of it."""
    facts = Path("/proc/cpuinfo")
    lines = facts.read_text(encoding="utf-8").splitlines() if facts.exists() else []
    names = [line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")]
    return f"{names[0] if names else platform.machine()}, {os.cpu_count()} cores"
