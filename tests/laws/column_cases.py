"""Targets before cameras with J of their points, for laws of other image positions."""

import dataclasses

import numpy as np
from laws import rigs

from pipeline.camera.parts.camera import Camera, Sensor
from pipeline.camera.rig import Rig
from pipeline.camera.tracer import Tracer
from pipeline.targets.patterns.checkerboard import Checkerboard
from pipeline.targets.target import Target
from pipeline.truth.direct.direct_rows import guesses, solve
from pipeline.truth.planes import tangent_planes
from pipeline.truth.positions.column_sets import column_set
from pipeline.truth.rows import Solutions


@dataclasses.dataclass(frozen=True)
class Case:
    """A target before a camera, and J of its points."""

    rig: Rig
    target: Target
    pose: np.ndarray
    planes: np.ndarray
    solutions: Solutions

    @property
    def j_px(self) -> np.ndarray:
        return self.solutions.xy_px


def case_of(camera: Camera, target: Target, pose: np.ndarray) -> Case:
    tracer = Tracer(camera)
    rig = Rig.of(tracer)
    points = target.points()
    planes = tangent_planes(pose, points.position_mm, points.plane_axes)
    solved = solve(rig, guesses(rig, planes)[0], planes, 1e-4, 0.05)
    return Case(rig, target, pose, planes, solved.solutions)


def board(square_mm: float = 1.5, white: float = 1.0, black: float = 0.0) -> Target:
    return Target(Checkerboard(columns=2, rows=1, square_mm=square_mm, white=white, black=black))


def off_axis(stop_semi_mm: float, pitch_mm: float = 0.005) -> Camera:
    """The double Gauss before a large sensor, near focus at 434 mm."""
    sensor = Sensor(width_px=4001, height_px=4001, pitch_mm=pitch_mm)
    return rigs.bare(rigs.tronnier(stop_semi_mm), sensor, 131.81, (400.0, 480.0))


def saddles(case: Case) -> np.ndarray:
    return column_set("saddle", case.rig, case.target, case.pose, case.planes, case.solutions).x_px
