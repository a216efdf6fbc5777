"""Claim: blur is the covariance of a bundle mapped by the derivative of J at the row itself, also where J bends, and it
changes with the camera as that says.

Judged in closed form: behind an ideal lens rays are linear in where they cross it, so that of rays that weigh its area
and pass two round rims a mean is the centroid of where two discs overlap, which are two segments.
"""

import math
from dataclasses import dataclass, replace

import numpy as np
import pytest
from laws import rigs
from laws.solving import rig_of

from pipeline.camera.parts.camera import Camera, Sensor
from pipeline.camera.rig import Rig
from pipeline.optics.prescription import Prescription, Surface
from pipeline.truth.derivatives import Neighbour, SolvedRows, Variation, derivatives
from pipeline.truth.direct.direct_rows import guesses, solve, with_own_bundles
from pipeline.truth.planes import Planes, tangent_planes
from pipeline.truth.rows import Correspondences

CLAIM_PX = 1e-3
SAME = 1e-5
"""Of derivatives of the blur, relative to the largest: J bends between ends, where a rim begins to cut."""
AT_THE_RIM = 5
"""Point whose light a rim is about to cut: the derivative of its blur has no bound there."""

FOCAL_MM, STOP_MM, LENS_SEMI_MM = 50.0, 60.0, 6.0
"""Of the ideal lens, the stop before it, and its rim."""
TARGET_MM = 400.0
"""Of the target before the stop: in focus it would be at 40 mm."""


@dataclass(frozen=True)
class Sizes:
    """Semi-diameter of the stop, and distance of the sensor behind the lens [mm]."""

    stop: float = 2.0
    sensor: float = 100.0


def two_rims(sizes: Sizes) -> Camera:
    stop = Surface(thickness_mm=STOP_MM, semi_diameter_mm=sizes.stop, is_stop=True)
    lens = Prescription(surfaces=(stop, Surface(focal_length_mm=FOCAL_MM, semi_diameter_mm=LENS_SEMI_MM)))
    pixels, distance_mm = Sensor(width_px=81, height_px=61, pitch_mm=0.2), sizes.sensor + STOP_MM
    return replace(rigs.bare(lens, pixels, distance_mm, (50.0, 800.0)), weight="area")


def segment(radius_mm: float, cos: float) -> np.ndarray:
    """Integrals of 1, u, u^2 and v^2 over the part of a disc where u > radius cos, from its centre."""
    half, sin = math.acos(cos), math.sqrt(1 - cos**2)
    area, cap = half - sin * cos, sin**3 * cos
    terms = area, 2 / 3 * sin**3, (area + 2 * cap) / 4, (area - 2 / 3 * cap) / 4
    return np.array(terms) * radius_mm ** np.array([2, 3, 4, 4])


def overlap(apart_mm: float, first_mm: float, second_mm: float) -> tuple[float, float, float]:
    """Centroid, and variance along and across, of where a disc overlaps a larger first one, from the centre of that."""
    if apart_mm <= first_mm - second_mm:
        return apart_mm, second_mm**2 / 4, second_mm**2 / 4
    cut = (first_mm**2 - second_mm**2 + apart_mm**2) / (2 * apart_mm)
    zero, one, two, across = segment(first_mm, cut / first_mm)
    area, lever, along, high = segment(second_mm, (apart_mm - cut) / second_mm)  # to the other side
    zero, one, two = zero + area, one + apart_mm * area - lever, two + apart_mm * (apart_mm * area - 2 * lever) + along
    return one / zero, two / zero - (one / zero) ** 2, (across + high) / zero


def closed_form(x_mm: float, sizes: Sizes) -> tuple[float, np.ndarray, np.ndarray]:
    """J, its derivatives along and across, and the blur in mm^2 of the sensor along and across, at a height x."""
    of_lens, of_x = 1 / sizes.sensor - 1 / FOCAL_MM, -1 / sizes.sensor  # slopes of rays
    at_stop, hit = 1 + STOP_MM * of_lens, 1 + (STOP_MM + TARGET_MM) * of_lens
    drift, shift = -STOP_MM * of_x / at_stop, (STOP_MM + TARGET_MM) * of_x

    def seen(x: float) -> tuple[float, float, float]:
        return overlap(drift * x, LENS_SEMI_MM, sizes.stop / at_stop)

    (here, along, across), h = seen(x_mm), 1e-4
    slopes = hit * np.array([(seen(x_mm + h)[0] - seen(x_mm - h)[0]) / (2 * h), here / x_mm]) + shift
    return hit * here + shift * x_mm, slopes, hit**2 * np.array([along, across]) / slopes**2


@pytest.fixture(scope="module")
def rig() -> Rig:
    return rig_of(two_rims(Sizes()))


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
        j_mm, by_x, blur_mm2 = closed_form(x_mm, Sizes())
        assert abs((j_mm - planes[point, 0, 0]) / by_x[0]) < CLAIM_PX * pitch_mm
        radii_px = 2 * np.sqrt(np.diag(blur_px2))
        np.testing.assert_allclose(radii_px, 2 * np.sqrt(blur_mm2) / pitch_mm, rtol=0, atol=CLAIM_PX)


def test_the_radius_of_the_blur_is_as_exact_as_the_position_where_a_rim_begins_to_cut(rig, planes, rows):
    """By the derivative over a quarter of a pixel to both sides, which solves the row, it was 0.1 px off."""
    check(rows, rig, planes)


def test_so_it_is_for_rows_of_position_images_whatever_derivative_their_grid_has(rig, planes, rows):
    skewed = replace(rows.solutions, jacobian=rows.solutions.jacobian @ np.array([[1.1, 0.1], [0.0, 0.9]]))
    searched = replace(rows, solutions=skewed)
    check(with_own_bundles(rig, searched, planes, 0.05), rig, planes)


@pytest.mark.parametrize("name", ["stop", "sensor"])
def test_it_changes_along_the_row_as_that_of_rows_that_are_solved_again(rig, planes, rows, name):
    """By a rim and by a distance: differences of the closed form at its own solutions, extrapolated."""
    solutions, step, on = rows.solutions.only(rows.solutions.point != AT_THE_RIM), 1e-4, Planes(planes)
    sides = [Sizes(**{name: getattr(Sizes(), name) + by}) for by in (-step, step)]
    ends = (Neighbour(rig.tracer.next_to(two_rims(side)), on) for side in sides)
    solved = SolvedRows(solutions.point, solutions.cell, solutions.xy_px, on)
    rates = derivatives(rig, solved, [Variation(step, *ends)], with_blur=True).blur_px2[:, 0]
    pitch_mm, expected = rig.tracer.camera.sensor.pitch_mm, []

    def again(x_mm: float, j_mm: float, by: float) -> np.ndarray:
        sizes = Sizes(**{name: getattr(Sizes(), name) + by})
        for _ in range(4):
            j, slopes, blur_mm2 = closed_form(x_mm, sizes)
            x_mm -= (j - j_mm) / slopes[0]
        return blur_mm2 / pitch_mm**2

    for x_px in solutions.xy_px:
        x_mm = rig.tracer.positions_mm(*x_px[:, None])[0, 0]
        seen = x_mm, closed_form(x_mm, Sizes())[0]
        wide, narrow = ((again(*seen, h) - again(*seen, -h)) / (2 * h) for h in (1e-3, 5e-4))
        expected.append(narrow + (narrow - wide) / 3)

    assert np.abs(rates[:, 0, 1]).max() < SAME * np.abs(expected).max()
    np.testing.assert_allclose(rates[:, [0, 1], [0, 1]], expected, rtol=0, atol=SAME * np.abs(expected).max())
