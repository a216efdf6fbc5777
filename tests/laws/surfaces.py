"""A lens with every kind of surface, and beams through it."""

import dataclasses

import numpy as np

from pipeline.frames import VISION_FROM_CAMERA
from pipeline.optics.kernels import trace_rays
from pipeline.optics.prescription import Group, Prescription, Surface
from pipeline.optics.table import towards_scene, towards_sensor

BENT = Prescription(
    surfaces=(
        Surface(
            radius_mm=30.0,
            conic=-0.8,
            even_coefficients=(1e-3, 2e-6, -3e-9, 1e-12),
            thickness_mm=8.0,
            index=1.6,
            semi_diameter_mm=13.0,
        ),
        Surface(radius_mm=-80.0, conic=-2.5, thickness_mm=3.0, semi_diameter_mm=13.0),
        Surface(semi_diameter_mm=6.0, thickness_mm=4.0, is_stop=True),
        Surface(
            radius_mm=-60.0,
            conic=0.6,
            even_coefficients=(0.0, -4e-6, 0.0, 0.0, 0.0, 1e-14),
            odd_coefficients=(2e-5, 1e-7),
            thickness_mm=3.0,
            index=1.7,
            semi_diameter_mm=10.0,
        ),
        Surface(radius_mm=-50.0, semi_diameter_mm=10.0),
    )
)
"""Conics on both sides of the sphere, even and odd terms, none of them weak."""


def whole(lens: Prescription, **mount: object) -> Prescription:
    """A lens all of whose surfaces one group holds."""
    group = Group(name="all", first=0, count=len(lens.surfaces), **mount)
    return dataclasses.replace(lens, groups=(group,))


def beam(heights: np.ndarray, z_mm: float) -> tuple[np.ndarray, np.ndarray]:
    """Rays parallel to the axis, at an azimuth that favours no coordinate."""
    position = np.stack([0.6 * heights, 0.8 * heights, np.full_like(heights, z_mm)], axis=1)
    return position, np.tile([0.0, 0.0, 1.0], (len(heights), 1))


def oblique(count: int, half_mm: float, slope: float, z_mm: float) -> tuple[np.ndarray, np.ndarray]:
    """Rays from anywhere on a square, with any slope up to a limit."""
    rng = np.random.default_rng(11)
    position = np.column_stack([rng.uniform(-half_mm, half_mm, (count, 2)), np.full(count, z_mm)])
    way = np.column_stack([rng.uniform(-slope, slope, (count, 2)), np.ones(count)])
    return position, way / np.linalg.norm(way, axis=1, keepdims=True)


def traced(table: np.ndarray, position: np.ndarray, direction: np.ndarray) -> list[np.ndarray]:
    """Positions, directions and flags behind the last surface, by the kernels."""
    rays = [np.array(position), np.array(direction), np.ones(len(position))]
    trace_rays(table, *rays)
    return rays


def assert_returned(lens: Prescription, start: np.ndarray, way: np.ndarray, atol: float) -> int:
    """Rays towards the scene, turned round and sent back by the other table, end where they began; how many passed."""
    position, direction, alive = traced(towards_scene(lens), start, way)
    kept, turn = alive > 0, VISION_FROM_CAMERA[:3, :3]
    # Some millimetres further on, so that the first surface is met anew, wherever it is tilted to.
    back, homeward = (position + 3 * direction)[kept] @ turn.T, -direction[kept] @ turn.T
    back, homeward, alive = traced(towards_sensor(lens), back, homeward)
    assert alive.all()
    back, homeward = back @ turn.T, homeward @ turn.T
    np.testing.assert_allclose(homeward, -way[kept], rtol=0, atol=atol)
    arrival = back + ((start[kept, 2] - back[:, 2]) / homeward[:, 2])[:, None] * homeward
    np.testing.assert_allclose(arrival, start[kept], rtol=0, atol=atol)
    return int(kept.sum())


def orders(errors: list[float]) -> np.ndarray:
    """Observed orders of convergence of errors whose step halves each time."""
    return np.log2(np.abs(errors[:-1]) / np.abs(errors[1:]))
