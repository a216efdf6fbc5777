"""Correspondences by `direct`, and J by quadrature, of cameras that laws are about."""

import dataclasses

import numpy as np
from laws import rigs

from pipeline.camera.integrating.quadrature import INTEGRATED, edges
from pipeline.camera.parts.camera import Camera, Sensor
from pipeline.camera.rig import Rig
from pipeline.camera.tracer import Tracer
from pipeline.camera.tracing.sampling_bounds import NO_MICROLENS
from pipeline.targets.patterns.checkerboard import Checkerboard
from pipeline.targets.target import AnyTarget, Target
from pipeline.truth.direct.direct_rows import guesses, solve
from pipeline.truth.grid.correspond import find, with_light
from pipeline.truth.grid.position_image import on_target
from pipeline.truth.grid.ray_grid import RayGrid
from pipeline.truth.judging import Rows
from pipeline.truth.planes import Exposed, Planes, tangent_planes
from pipeline.truth.positions.column_sets import column_set
from pipeline.truth.rows import Correspondences, Solutions, existing
from pipeline.truth.settings import TruthSettings

STEPS = np.array([[0.0, 0.0], [0.05, 0.0], [-0.05, 0.0], [0.0, 0.05], [0.0, -0.05]])


def rig_of(camera: Camera, seed: int = 0) -> Rig:
    return Rig.of(Tracer(camera, seed))


def solved(rig: Rig, board: Checkerboard, pose: np.ndarray, accuracy_px: float = 1e-4) -> Correspondences:
    planes = tangent_planes(pose, board.points_mm())
    return solve(rig, guesses(rig, planes)[0], planes, accuracy_px, 0.05)


def judged_rows(rows: Solutions, planes: np.ndarray, is_direct: bool) -> Rows:
    return Rows(Exposed.still(planes[rows.point]), rows.cell, rows.xy_px, is_direct)


UNFILTERED = TruthSettings(method="two-plane", filter="none")


def correspond(
    image: np.ndarray, points_mm: np.ndarray, grid: RayGrid, pose: np.ndarray, settings: TruthSettings
) -> Correspondences:
    """The points of one plane, in its frame: all rows that exist, with blur and error."""
    solutions, counts = find(image, points_mm, grid, settings)
    rows = with_light(solutions, grid, pose)
    return existing(dataclasses.replace(rows, counts=counts), grid, settings.min_hit_fraction)


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


@dataclasses.dataclass(frozen=True)
class Case:
    rig: Rig
    target: Target
    pose: np.ndarray
    planes: np.ndarray
    solutions: Solutions

    @property
    def j_px(self) -> np.ndarray:
        return self.solutions.xy_px


def planes_of(target: AnyTarget, pose: np.ndarray) -> np.ndarray:
    points = target.points()
    return tangent_planes(pose, points.position_mm, points.plane_axes)


def case_of(camera: Camera, target: Target, pose: np.ndarray) -> Case:
    rig, planes = rig_of(camera), planes_of(target, pose)
    solved = solve(rig, guesses(rig, planes)[0], planes, 1e-4, 0.05)
    return Case(rig, target, pose, planes, solved.solutions)


def board(square_mm: float = 1.5, white: float = 1.0, black: float = 0.0) -> Target:
    return Target(Checkerboard(columns=2, rows=1, square_mm=square_mm, white=white, black=black))


def off_axis(stop_semi_mm: float, pitch_mm: float = 0.005) -> Camera:
    """The double Gauss before a large sensor, near focus at 434 mm."""
    sensor = Sensor(width_px=4001, height_px=4001, pitch_mm=pitch_mm)
    return rigs.bare(rigs.tronnier(stop_semi_mm), sensor, 131.81, (400.0, 480.0))


def saddles(case: Case) -> np.ndarray:
    return column_set("saddle", case.rig, case.target, case.pose, Planes(case.planes), case.solutions).x_px
