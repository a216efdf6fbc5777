"""Claim: a saddle errs by no more than it states, in closed form: the light of a corner through polygonal holes is that
of polygons which the corner's edges cut.
"""

import dataclasses

import numpy as np
import pytest
from laws import rigs
from shorter import few_cases

from pipeline.camera.parts.camera import Sensor
from pipeline.camera.tracer import Tracer, parallel_planes
from pipeline.optics.prescription import Prescription, Surface
from pipeline.truth.positions.saddle import corner_plane, hessian_of, saddle

SENSOR_MM, TARGET_MM, PITCH_MM, MIDDLE_PX = 50.0, 400.0, 0.01, 19.5
"""Distances of the rear hole from the sensor and from the target; pixels, and the middle of 40 x 40 of them."""
NODES, WEIGHTS = np.polynomial.legendre.leggauss(48)
ALONE = ((0.0, 3, 0.015, 10.0),)
BEHIND = ((0.0, 5, 0.02, 20.0), (20.0, 4, 0.025, 10.0))
"""Holes: distance from the rear one, blades, semi-diameter [mm], rotation [deg]."""


def clipped(polygon: np.ndarray, normal: np.ndarray, most: float) -> np.ndarray:
    """The part of a convex polygon (n, 2) where normal . p <= most."""
    kept, over = [], polygon @ normal - most
    for p, q, a, b in zip(polygon, np.roll(polygon, -1, axis=0), over, np.roll(over, -1), strict=True):
        if a <= 0:
            kept.append(p)
        if (a <= 0) != (b <= 0):
            kept.append(p + a / (a - b) * (q - p))
    return np.reshape(kept, (-1, 2))


def area(polygon: np.ndarray) -> float:
    x, y = polygon.T
    return abs(float(x @ np.roll(y, -1) - y @ np.roll(x, -1))) / 2


def white_light(holes: tuple, x_px: np.ndarray, point_mm: np.ndarray, edges: np.ndarray) -> float:
    """Area of what passes the rear hole, and falls where both coordinates along a corner's edges have the same sign."""
    start = (MIDDLE_PX - x_px) * PITCH_MM
    lit = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
    for ahead, blades, semi, turn in holes:
        for middle in np.radians(turn) + (np.arange(blades) + 0.5) * 2 * np.pi / blades:
            normal = np.array([np.cos(middle), -np.sin(middle)])  # the lens frame's y points up
            most = semi * np.cos(np.pi / blades) * SENSOR_MM + normal @ start * ahead
            lit = clipped(lit, normal, most / (SENSOR_MM + ahead))
    hit = start + (lit - start) * (SENSOR_MM + TARGET_MM) / SENSOR_MM
    along = (hit - point_mm) @ np.linalg.inv(edges)
    first, second = np.eye(2)
    return sum(area(clipped(clipped(along, sign * first, 0.0), sign * second, 0.0)) for sign in (1, -1))


@pytest.mark.parametrize(
    ("holes", "turn_deg"), few_cases([(ALONE, 27), (BEHIND, 15)], (ALONE, 15), (ALONE, 39), (BEHIND, 27), (BEHIND, 51))
)
def test_behind_polygons_a_saddle_errs_by_less_than_it_states(holes: tuple, turn_deg: float) -> None:
    """With even directions, which cut off corners, and parabolas through a pixel within which another hole begins to
    cut, it erred by 0.7e-3 to 4e-3 px in these cases, and stated 3e-5 to 2e-4.
    """
    surfaces = [
        Surface(semi_diameter_mm=semi, blades=blades, aperture_rotation_deg=turn, thickness_mm=ahead, is_stop=not ahead)
        for ahead, blades, semi, turn in reversed(holes)
    ]
    sensor = Sensor(width_px=40, height_px=40, pitch_mm=PITCH_MM)
    camera = rigs.bare(Prescription(surfaces=tuple(surfaces)), sensor, SENSOR_MM, (300.0, 500.0))
    tracer = Tracer(dataclasses.replace(camera, weight="area"))
    angle, plane = np.radians([turn_deg, turn_deg + 102.0]), parallel_planes(TARGET_MM, TARGET_MM)[0]
    edges, point = np.stack([np.cos(angle), np.sin(angle)], axis=1), np.array([-0.04, -0.2])
    plane[0, :2] = point
    guess = MIDDLE_PX + point * SENSOR_MM / TARGET_MM / PITCH_MM
    solution = saddle(tracer, -1, guess, corner_plane(plane, np.pad(edges, ((0, 0), (0, 1)))), 1.0)

    def side(middle_px: np.ndarray, along: np.ndarray) -> float:
        places = middle_px + NODES[:, None] / 2 * along
        return sum(WEIGHTS / 2 * [white_light(holes, place, point, edges) for place in places])

    def gradient(x_px: np.ndarray) -> np.ndarray:
        axes = np.eye(2)
        return np.array([side(x_px + axis / 2, 1 - axis) - side(x_px - axis / 2, 1 - axis) for axis in axes])

    off_px = np.hypot(*np.linalg.solve(hessian_of(gradient, solution.x_px), gradient(solution.x_px)))
    assert off_px <= solution.error_px < 3e-3
