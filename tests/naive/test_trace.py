"""Claim: the packet tracer agrees on every ray with a textbook tracer, and with bisection where a strong asphere is
met: point, direction and clipping alike. The rays of checks, by NumPy, are those of the packet tracer.
"""

import dataclasses
import math
from collections.abc import Callable

import numpy as np
import pytest
from laws import rigs
from laws.surfaces import BENT
from naive import textbook
from naive.lenses import BALL, PHONE, SINGLET, bisecting_trace, random_rays
from tolerances import BISECTED_MM, TEXTBOOK_MM

from pipeline.optics.kernels import trace_rays
from pipeline.optics.prescription import Prescription, Surface
from pipeline.optics.rays import traced
from pipeline.optics.table import towards_scene

DISPLACED = rigs.displaced(rigs.conventional(17.1)).prescription
BLADES = dataclasses.replace(SINGLET.stop, blades=5, aperture_rotation_deg=20.0)
POLYGON = dataclasses.replace(SINGLET, surfaces=(*SINGLET.surfaces[:2], BLADES))
STOP = Surface(semi_diameter_mm=8.0, is_stop=True)
IDEAL = Prescription(surfaces=(Surface(focal_length_mm=50.0, thickness_mm=5.0, semi_diameter_mm=20.0), STOP))


@pytest.mark.parametrize(
    ("lens", "behind_mm", "field_mm"),
    [
        (rigs.tronnier(), 101.5, 40.0),
        (rigs.tronnier(5.0), 101.5, 15.0),
        (DISPLACED, 101.5, 40.0),
        (rigs.displaced(rigs.conventional(5.0)).prescription, 101.5, 15.0),
        (SINGLET, 70.0, 30.0),
        (BALL, 3.0, 8.0),
    ],
    ids=["double Gauss", "stopped down", "displaced", "displaced, stopped down", "singlet", "ball"],
)
def test_packets_and_textbook_agree_on_every_ray(lens: Prescription, behind_mm: float, field_mm: float) -> None:
    assert_agreed(lens, *random_rays(lens, behind_mm, field_mm, 20_000), textbook.trace, TEXTBOOK_MM)


@pytest.mark.parametrize("lens", [BENT, PHONE], ids=["laws", "phone"])
@pytest.mark.filterwarnings("ignore:invalid value:RuntimeWarning")
def test_packets_and_bisection_agree_on_every_ray_through_aspheres(lens: Prescription) -> None:
    assert_agreed(lens, *random_rays(lens, 15.0, 8.0, 20_000), bisecting_trace, BISECTED_MM)


@pytest.mark.parametrize(
    ("lens", "behind_mm", "field_mm"),
    [
        (rigs.tronnier(), 101.5, 40.0),
        (DISPLACED, 101.5, 40.0),
        (BALL, 3.0, 8.0),
        (POLYGON, 70.0, 30.0),
        (PHONE, 20.0, 5.0),
        (IDEAL, 60.0, 20.0),
    ],
    ids=["double Gauss", "displaced", "ball", "polygon", "aspheres", "ideal"],
)
def test_packets_and_numpy_agree_on_every_ray(lens: Prescription, behind_mm: float, field_mm: float) -> None:
    rays = random_rays(lens, behind_mm, field_mm, 5_000)
    assert_agreed(lens, *rays, lambda lens, start, way: traced(towards_scene(lens), start, way), TEXTBOOK_MM)


def assert_agreed(
    lens: Prescription, position: np.ndarray, direction: np.ndarray, trace: Callable, atol_mm: float
) -> None:
    """Also on which rays are blocked; some pass and some do not."""
    expected_position, expected_direction, passes = trace(lens, position, direction)
    alive = np.ones(len(position))
    trace_rays(towards_scene(lens), position, direction, alive)
    assert 0.02 < passes.mean() < 0.98
    np.testing.assert_array_equal(alive > 0, passes)
    np.testing.assert_allclose(position[passes], expected_position[passes], rtol=0, atol=atol_mm)
    np.testing.assert_allclose(direction[passes], expected_direction[passes], rtol=0, atol=atol_mm)


def test_a_ray_beyond_the_critical_angle_is_blocked() -> None:
    """From glass of index 1.5 into air the limit is arcsin(1 / 1.5): just below it passes, just above it does not."""
    slab = Prescription(
        surfaces=(
            Surface(semi_diameter_mm=1e3, index=1.5, thickness_mm=1.0),
            Surface(semi_diameter_mm=1e3, index=1.5, is_stop=True),
        )
    )
    critical = math.asin(1 / 1.5)
    for angle, passes in ((critical - 1e-9, 1.0), (critical + 1e-9, 0.0)):
        position, alive = np.array([[0.0, 0.0, -1.0]]), np.ones(1)
        trace_rays(towards_scene(slab), position, np.array([[math.sin(angle), 0.0, math.cos(angle)]]), alive)
        assert alive[0] == passes


@pytest.mark.parametrize(
    ("lens", "behind_mm", "field_mm"), [(rigs.tronnier(), 101.5, 20.0), (PHONE, 15.0, 8.0)], ids=["spheres", "aspheres"]
)
def test_rays_do_not_know_the_packet_they_travel_in(lens: Prescription, behind_mm: float, field_mm: float) -> None:
    position, direction = random_rays(lens, behind_mm, field_mm, 1000)
    together, alone, shuffled = ([position.copy(), direction.copy(), np.ones(1000)] for _ in range(3))
    order = np.random.default_rng(1).permutation(1000)
    shuffled = [array[order] for array in shuffled]
    table = towards_scene(lens)
    trace_rays(table, *together)
    trace_rays(table, *shuffled)
    for i in range(1000):
        trace_rays(table, *(array[i : i + 1] for array in alone))
    for whole, single, mixed in zip(together, alone, shuffled, strict=True):
        np.testing.assert_array_equal(whole, single)
        np.testing.assert_array_equal(whole[order], mixed)
