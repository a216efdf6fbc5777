"""Claim: one ray at a time, as threads of a device trace it, has the bits that packets give it; so has plain Python."""

import numpy as np
import pytest
from laws import rigs

from pipeline.jit.binding import plain
from pipeline.optics.crossing import Ray
from pipeline.optics.kernels import trace_rays
from pipeline.optics.one_ray import trace_ray
from pipeline.optics.prescription import Prescription, Surface
from pipeline.optics.table import towards_scene

POWERS = (0.0, 2e-6, -3e-9, 1e-12, 1e-15, 1e-18, 1e-21)


def one(stop: dict[str, object] | None = None, **shape: object) -> Prescription:
    """A thick lens whose front face has a shape, and a stop that may be no disc."""
    front = Surface(radius_mm=40.0, thickness_mm=6.0, index=1.6, semi_diameter_mm=12.0, **shape)
    rear = Surface(radius_mm=-60.0, thickness_mm=3.0, semi_diameter_mm=12.0)
    return Prescription(surfaces=(front, rear, Surface(semi_diameter_mm=7.0, is_stop=True, **(stop or {}))))


LENSES = {
    "spheres": rigs.tronnier(9.0),
    "displaced": rigs.displaced(rigs.conventional(9.0)).prescription,
    "conic": one(conic=-0.8),
    "asphere": one(conic=-0.8, even_coefficients=POWERS[:5]),
    "high powers": one(conic=-0.8, even_coefficients=POWERS),
    "odd powers": one(even_coefficients=POWERS[:4], odd_coefficients=(1e-6, 1e-8)),
    "obstruction": one(stop={"inner_semi_diameter_mm": 2.0}),
    "thin lens": Prescription(surfaces=(Surface(focal_length_mm=80.0, semi_diameter_mm=7.0, is_stop=True),)),
    "distorting lens": Prescription(
        surfaces=(
            Surface(
                focal_length_mm=80.0,
                semi_diameter_mm=7.0,
                is_stop=True,
                distortion=(-0.2, 0.05, 0.002, -0.003, 0.01),
                image_distance_mm=60.0,
            ),
        )
    ),
    "rectangle": one(stop={"half_widths_mm": (5.0, 3.0)}),
}


def rays(table: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Rays from behind the rear surface through all of it and beyond, (n, 3) each."""
    rng = np.random.default_rng(5)
    rear, reach = table[0, 0], 1.2 * np.sqrt(table[0, 3])
    start = np.column_stack([rng.uniform(-20, 20, (count, 2)), np.full(count, rear - 60.0)])
    way = np.column_stack([rng.uniform(-reach, reach, (count, 2)), np.full(count, rear)]) - start
    return start, way / np.linalg.norm(way, axis=1, keepdims=True)


@pytest.mark.parametrize("name", LENSES)
def test_one_ray_has_the_bits_of_a_packet(name: str) -> None:
    """In plain Python, and which rays are blocked, too."""
    table = towards_scene(LENSES[name])
    position, direction = rays(table, 60)
    slow, alone = plain(trace_ray), []
    with np.errstate(all="ignore"):
        for start, way in zip(position, direction, strict=True):
            alone.append(slow(table, Ray(*start, *way, 1.0)))
    alive = np.ones(len(position))
    trace_rays(table, position, direction, alive)
    passes = alive > 0
    assert 0 < passes.sum() < len(passes)
    np.testing.assert_array_equal(np.array(alone)[:, 6], alive)
    np.testing.assert_array_equal(np.array(alone)[passes, :6], np.hstack([position, direction])[passes])
