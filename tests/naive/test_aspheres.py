"""Claim: the packet tracer and bisection agree on every ray that meets a strong asphere.

The twin brackets the intersection between two planes and halves the bracket to the last bit; the normal comes from
complex steps of the sag as it is defined. It knows neither the closed form of a conic nor Newton's method.
"""

import numpy as np
import pytest
from laws.surfaces import BENT
from naive.aspheres import PHONE
from naive.lenses import random_rays
from naive.textbook import _refract
from tolerances import BISECTED_MM

from pipeline.optics.kernels import trace_rays
from pipeline.optics.prescription import Prescription, Surface
from pipeline.optics.table import towards_scene

_REACH_MM = 6.0


def sag(surface: Surface, r: np.ndarray) -> np.ndarray:
    """As it is defined, for real and complex heights."""
    c = 1.0 / surface.radius_mm
    z = c * r**2 / (1 + np.sqrt(1 - (1 + surface.conic) * c**2 * r**2))
    for i, a in enumerate(surface.even_coefficients):
        z = z + a * r ** (2 * i + 2)
    for i, a in enumerate(surface.odd_coefficients):
        z = z + a * r ** (2 * i + 3)
    return z


def bisect(surface: Surface, vertex_mm: float, position: np.ndarray, direction: np.ndarray) -> np.ndarray:
    """Points on a surface whose sag points away from the scene, vision frame; NaN where the bracket holds no root."""

    def depth(t: np.ndarray) -> np.ndarray:
        point = position + t[:, None] * direction
        return point[:, 2] - vertex_mm + sag(surface, np.hypot(point[:, 0], point[:, 1]))

    low, high = ((vertex_mm + end - position[:, 2]) / direction[:, 2] for end in (-_REACH_MM, _REACH_MM))
    holds = (depth(low) < 0) & (depth(high) > 0)
    for _ in range(80):
        middle = (low + high) / 2
        behind = depth(middle) < 0
        low, high = np.where(behind, middle, low), np.where(behind, high, middle)
    return np.where(holds[:, None], position + high[:, None] * direction, np.nan)


def bisecting_trace(
    lens: Prescription, position: np.ndarray, direction: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Points on the front surface, directions behind it, and which rays pass."""
    passes = np.ones(len(position), bool)
    for i in reversed(range(len(lens.surfaces))):
        surface = lens.surfaces[i]
        position = bisect(surface, -lens.vertices_from_stop_mm[i], position, direction)
        r = np.hypot(position[:, 0], position[:, 1])
        passes &= r <= surface.semi_diameter_mm
        slope = sag(surface, r + 1e-30j).imag / 1e-30
        normal = -np.column_stack([position[:, :2] * (slope / r)[:, None], np.ones(len(r))])
        normal /= np.linalg.norm(normal, axis=1, keepdims=True)
        direction, refracted = _refract(direction, normal, surface.index / (lens.surfaces[i - 1].index if i else 1.0))
        passes &= refracted
    return position, direction, passes


@pytest.mark.parametrize("lens", [BENT, PHONE], ids=["laws", "phone"])
def test_packets_and_bisection_agree_on_every_ray_through_aspheres(lens: Prescription) -> None:
    """Also on which rays are blocked; some pass and some do not."""
    position, direction = random_rays(lens, 15.0, 8.0, 20_000)
    with np.errstate(invalid="ignore"):
        expected_position, expected_direction, passes = bisecting_trace(lens, position, direction)
    alive = np.ones(len(position))
    trace_rays(towards_scene(lens), position, direction, alive)
    assert 0.02 < passes.mean() < 0.98
    np.testing.assert_array_equal(alive > 0, passes)
    np.testing.assert_allclose(position[passes], expected_position[passes], rtol=0, atol=BISECTED_MM)
    np.testing.assert_allclose(direction[passes], expected_direction[passes], rtol=0, atol=BISECTED_MM)


def test_rays_do_not_know_the_packet_they_travel_in_through_aspheres() -> None:
    """Alone or together: the same bits, also from code that handles several rays at once."""
    position, direction = random_rays(PHONE, 15.0, 8.0, 300)
    together, alone = ([position.copy(), direction.copy(), np.ones(300)] for _ in range(2))
    table = towards_scene(PHONE)
    trace_rays(table, *together)
    for i in range(300):
        trace_rays(table, *(array[i : i + 1] for array in alone))
    for whole, single in zip(together, alone, strict=True):
        np.testing.assert_array_equal(whole, single)
