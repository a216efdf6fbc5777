"""Claim: blur is the covariance of a bundle mapped by the derivative of J at the row itself, also where J bends.

Judged in closed form: behind an ideal lens rays are linear in where they cross it, so that of rays that weigh its area
and pass two round rims a mean is the centroid of where two discs overlap, and all its moments are single integrals.
"""

import math
from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from laws import rigs
from laws.solving import rig_of
from scipy.integrate import quad

from pipeline.camera.parts.camera import Camera, Sensor
from pipeline.camera.rig import Rig
from pipeline.optics.prescription import Prescription, Surface
from pipeline.truth.direct.direct_rows import guesses, solve, with_own_bundles
from pipeline.truth.planes import tangent_planes
from pipeline.truth.rows import Correspondences

CLAIM_PX = 1e-3

FOCAL_MM, SENSOR_MM, STOP_MM = 50.0, 100.0, 60.0
"""Of the ideal lens, the sensor behind it, and the stop before it."""
STOP_SEMI_MM, LENS_SEMI_MM = 2.0, 6.0
TARGET_MM = 400.0
"""Of the target before the stop: in focus it would be at 40 mm."""


def two_rims() -> Camera:
    stop = Surface(thickness_mm=STOP_MM, semi_diameter_mm=STOP_SEMI_MM, is_stop=True)
    lens = Prescription(surfaces=(stop, Surface(focal_length_mm=FOCAL_MM, semi_diameter_mm=LENS_SEMI_MM)))
    sensor = Sensor(width_px=81, height_px=61, pitch_mm=0.2)
    return Camera(
        prescription=lens,
        sensor=sensor,
        sensor_distance_mm=SENSOR_MM + STOP_MM,
        near_mm=50.0,
        far_mm=800.0,
        weight="area",
    )


def overlap(apart_mm: float, first_mm: float, second_mm: float) -> tuple[float, float, float]:
    """Centroid, and variance along and across, of where two discs overlap, from the centre of the first one."""

    def half(u: float) -> float:
        return math.sqrt(max(min(first_mm**2 - u**2, second_mm**2 - (u - apart_mm) ** 2), 0.0))

    ends = max(-first_mm, apart_mm - second_mm), min(first_mm, apart_mm + second_mm)
    cut = (first_mm**2 - second_mm**2 + apart_mm**2) / (2 * apart_mm)
    edges = sorted({*ends, float(np.clip(cut, *ends))})

    def integral(of: Callable[[float], float]) -> float:
        return sum(quad(of, *part, epsabs=1e-12, epsrel=1e-10)[0] for part in pairwise(edges))

    area = integral(half)
    mean = integral(lambda u: u * half(u)) / area
    along = integral(lambda u: (u - mean) ** 2 * half(u)) / area
    return mean, along, integral(lambda u: half(u) ** 3 / 3) / area


def closed_form(x_mm: float) -> tuple[float, np.ndarray, np.ndarray]:
    """J, its derivatives along and across, and the blur in mm^2 of the sensor along and across, at a height x."""
    slope_of_lens, slope_of_x = 1 / SENSOR_MM - 1 / FOCAL_MM, -1 / SENSOR_MM
    at_stop, hit = 1 + STOP_MM * slope_of_lens, 1 + (STOP_MM + TARGET_MM) * slope_of_lens
    drift, shift = -STOP_MM * slope_of_x / at_stop, (STOP_MM + TARGET_MM) * slope_of_x

    def mean(x: float) -> float:
        return overlap(drift * x, LENS_SEMI_MM, STOP_SEMI_MM / at_stop)[0]

    here, along, across = overlap(drift * x_mm, LENS_SEMI_MM, STOP_SEMI_MM / at_stop)
    h = 1e-4
    slopes = hit * np.array([(mean(x_mm + h) - mean(x_mm - h)) / (2 * h), here / x_mm]) + shift
    return hit * here + shift * x_mm, slopes, hit**2 * np.array([along, across]) / slopes**2


@pytest.fixture(scope="module")
def rig() -> Rig:
    return rig_of(two_rims())


@pytest.fixture(scope="module")
def planes() -> np.ndarray:
    """Points along a row, from where the lens cuts a third of the light to where all passes: first at -6.8 mm."""
    x_mm = np.array([-20.0, -12.0, -8.0, -7.2, -7.0, -6.8, -2.0])
    return tangent_planes(rigs.facing(TARGET_MM), np.stack([x_mm, 0 * x_mm, 0 * x_mm], axis=1))


@pytest.fixture(scope="module")
def rows(rig: Rig, planes: np.ndarray) -> Correspondences:
    return solve(rig, guesses(rig, planes)[0], planes, CLAIM_PX, 0.05)


def check(rows: Correspondences, rig: Rig, planes: np.ndarray) -> None:
    assert len(rows.solutions.point) == len(planes)
    for point, x_px, blur_px2 in zip(rows.solutions.point, rows.solutions.xy_px, rows.blur_px2, strict=True):
        (x_mm, _), pitch_mm = rig.tracer.positions_mm(*x_px[:, None])[0], rig.tracer.camera.sensor.pitch_mm
        j_mm, by_x, blur_mm2 = closed_form(x_mm)
        assert abs((j_mm - planes[point, 0, 0]) / by_x[0]) < CLAIM_PX * pitch_mm
        radii_px = 2 * np.sqrt(np.diag(blur_px2))
        np.testing.assert_allclose(radii_px, 2 * np.sqrt(blur_mm2) / pitch_mm, rtol=0, atol=CLAIM_PX)


def test_the_radius_of_the_blur_is_as_exact_as_the_position_where_a_rim_begins_to_cut(rig, planes, rows):
    """By the derivative over a quarter of a pixel to both sides, which solves the row, it was 0.1 px off."""
    check(rows, rig, planes)


def test_so_it_is_for_rows_of_position_images_whatever_derivative_their_grid_has(rig, planes, rows):
    skewed = replace(rows.solutions, jacobian=rows.solutions.jacobian @ np.array([[1.1, 0.1], [0.0, 0.9]]))
    searched = replace(rows, solutions=skewed, method=np.full(len(planes), "moments"))
    check(with_own_bundles(rig, searched, planes, 0.05), rig, planes)
