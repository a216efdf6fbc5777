"""Correspondences by `direct`, and J by quadrature, of cameras that laws are about."""

import numpy as np

from pipeline.camera.integrating.quadrature import INTEGRATED, edges
from pipeline.camera.parts.camera import Camera
from pipeline.camera.rig import Rig
from pipeline.camera.tracer import Tracer
from pipeline.camera.tracing.sampling_bounds import NO_MICROLENS
from pipeline.targets.patterns.checkerboard import Checkerboard
from pipeline.truth.direct.direct_rows import guesses, solve
from pipeline.truth.grid.correspond import correspond
from pipeline.truth.grid.position_image import on_target
from pipeline.truth.grid.ray_grid import RayGrid
from pipeline.truth.judging.judges import Rows
from pipeline.truth.planes import tangent_planes
from pipeline.truth.rows import Correspondences, Solutions
from pipeline.truth.settings import TruthSettings

STEPS = np.array([[0.0, 0.0], [0.05, 0.0], [-0.05, 0.0], [0.0, 0.05], [0.0, -0.05]])


def rig_of(camera: Camera, seed: int = 0) -> Rig:
    tracer = Tracer(camera, seed)
    return Rig.of(tracer)


def solved(rig: Rig, board: Checkerboard, pose: np.ndarray, accuracy_px: float = 1e-4) -> Correspondences:
    planes = tangent_planes(pose, board.points_mm())
    return solve(rig, guesses(rig, planes)[0], planes, accuracy_px, 0.05)


def judged_rows(rows: Solutions, planes: np.ndarray, is_direct: bool) -> Rows:
    """Rows for a judge, all of one kind."""
    return Rows(planes[rows.point], rows.cell, rows.xy_px, np.full(len(rows.cell), is_direct))


UNFILTERED = TruthSettings(method="moments", filter="none")


def truth_of(
    grid: RayGrid, points_mm: np.ndarray, pose: np.ndarray, settings: TruthSettings = UNFILTERED
) -> Correspondences:
    """By two planes and the quad search."""
    image = on_target(grid.near, grid.far, grid.near_mm, grid.far_mm, pose)
    return correspond(image, points_mm, grid, pose, settings)


def by_quadrature(camera: Camera, positions: np.ndarray, planes: np.ndarray, nodes: tuple[int, int]) -> np.ndarray:
    lens = np.full(len(positions), NO_MICROLENS)
    moments, status, _ = edges(Tracer(camera).arrays, positions, lens).moments(
        np.repeat(planes[None], len(positions), axis=0), nodes
    )
    assert (status == INTEGRATED).all()
    return moments
