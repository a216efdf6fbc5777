"""Sampling bounds: positions all over an array, and whether rays outside of the bounds pass."""

import numpy as np
from laws.rigs import HEXAGON, reshaped

from pipeline.camera.micro_images.centres import micro_images
from pipeline.camera.parts.camera import Camera
from pipeline.camera.tracer import Tracer, parallel_planes
from pipeline.camera.tracing.sampling_bounds import NO_MICROLENS, bound, new_region
from pipeline.optics.kernels import trace_rays


def moments(tracer: Tracer, positions: np.ndarray, lens: np.ndarray, samples: int, first_pixel: int = 0) -> np.ndarray:
    """Of positions as if they belonged to pixels numbered from `first_pixel`: those decide the random numbers."""
    pixels = np.stack([np.arange(len(positions)) + first_pixel, np.zeros(len(positions), int)], axis=1)
    return tracer.moments(positions, lens, parallel_planes(374.0, 494.0), samples, pixels)


def plenoptic_positions(tracer: Tracer, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Positions all over the cells of microlenses all over the array, and the microlens of each."""
    images, rng = micro_images(tracer), np.random.default_rng(8)
    lens = rng.integers(0, len(images.centre_mm), count)
    positions = images.centre_mm[lens] + rng.uniform(-0.12, 0.12, (count, 2))
    return positions, images.owner(positions)


def sampling_region(tracer: Tracer, position: np.ndarray, lens: int) -> np.ndarray:
    """Vertices of the region that the tracer samples for a position, (n, 2)."""
    region = new_region()
    return region.polygon[: bound(tracer.arrays, lens, *position, 0.0, region).vertices]


def outside(polygon: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Whether points lie outside of a convex counter-clockwise polygon."""
    if len(polygon) < 3:
        return np.ones(len(points), bool)
    edge = np.roll(polygon, -1, axis=0) - polygon
    side = edge[:, 0] * (points[:, 1, None] - polygon[:, 1]) - edge[:, 1] * (points[:, 0, None] - polygon[:, 0])
    return (side < 0).any(axis=1)


def passing(tracer: Tracer, start_z: float, points: np.ndarray, direction: np.ndarray) -> np.ndarray:
    """Whether rays through points of the plane z = `start_z` pass the lens."""
    alive = np.ones(len(points))
    start = np.column_stack([points, np.full(len(points), start_z)])
    trace_rays(tracer.table, start, direction / np.linalg.norm(direction, axis=1, keepdims=True), alive)
    return alive > 0


def assert_bounds_hold(
    tracer: Tracer, positions: np.ndarray, rng: np.random.Generator, half_mm: float, rays: int
) -> np.ndarray:
    """No trial ray all over a square of the rear surface passes outside of the bounds; numbers of those that pass."""
    seen = []
    for position in positions:
        points = rng.uniform(-half_mm, half_mm, (rays, 2))
        way = np.column_stack([points - position, np.full(rays, tracer.table[0, 0] - tracer.sensor_z_mm)])
        passes = passing(tracer, tracer.table[0, 0], points, way)
        seen.append(passes.sum())
        assert not np.any(passes & outside(sampling_region(tracer, position, NO_MICROLENS), points))
    return np.array(seen)


def assert_bounds_hold_behind_microlenses(tracer: Tracer) -> None:
    """Trial rays all over the hexagons, from the middle of cells to beyond their edges, all over the array."""
    rng, seen, cut = np.random.default_rng(7), 0, 0
    angles = np.pi * np.arange(6) / 3
    for position, row in zip(*plenoptic_positions(tracer, 300), strict=True):
        vertex, focal = tracer.arrays.microlenses[row, :2], tracer.arrays.microlenses[row, 2]
        offsets = rng.uniform(-0.13, 0.13, (4000, 2))
        offsets = offsets[(offsets @ np.stack([np.cos(angles), np.sin(angles)]) < 0.2173 / 2).all(axis=1)]
        points = vertex + offsets
        slopes = (points - position) / 1.7 - offsets / focal
        passes = passing(tracer, tracer.film_z_mm, points, np.column_stack([slopes, np.ones(len(points))]))
        seen, cut = seen + passes.sum(), cut + int(0 < passes.sum() < len(passes))
        assert not np.any(passes & outside(sampling_region(tracer, position, row), points))
    assert seen > 100_000
    assert cut > 100


RECTANGLE = {"half_widths_mm": (4.0, 2.5), "aperture_rotation_deg": 20.0}
RING = {"inner_semi_diameter_mm": 2.0}
SHAPES = {"hexagon": HEXAGON, "rectangle": RECTANGLE, "ring": RING, "triangle": {"blades": 3}}


def with_shapes(camera: Camera, stop: dict[str, object], front: dict[str, object]) -> Camera:
    return reshaped(camera, {camera.prescription.stop_index: stop, 0: front})
