"""Bundles without any cleverness: independent uniform points all over an aperture, traced by the textbook.

No sampling bounds, no Sobol points, no packets; each bundle comes with the weights cos(theta) d omega.
"""

import numpy as np
from laws import rigs
from naive import textbook

from pipeline.camera.parts.camera import Camera
from pipeline.camera.tracer import Tracer, target_plane
from pipeline.camera.tracing.moments import COVARIANCE, WEIGHT


def hexagon(count: int, pitch_mm: float, rng: np.random.Generator) -> np.ndarray:
    """Uniform points of a lattice cell whose edges face +x and every 60 degrees, by rejection, (count, 2)."""
    points = rng.uniform(-0.6 * pitch_mm, 0.6 * pitch_mm, (2 * count, 2))
    points = points[textbook.in_hexagon(points, pitch_mm)]
    assert len(points) >= count
    return points[:count]


def rays_through(
    camera: Camera,
    start_mm: np.ndarray,
    vertex_mm: np.ndarray | None,
    focal_mm: float | None,
    count: int,
    rng: np.random.Generator,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Rays from sensor points, (2,) or (count, 2), through one microlens, or through the rear surface if there is none.

    Positions and directions (count, 3), and weights, 0 for blocked rays: their sum is the integral of
    cos(theta) d omega [sr], or the area of the plane [mm^2].
    """
    if vertex_mm is None or focal_mm is None or camera.microlenses is None:
        lens = camera.prescription
        # A rear surface off its place is seen through more than its own circle on the plane of its nominal vertex.
        half = lens.surfaces[-1].semi_diameter_mm * (1.0 if lens.is_centred else 1.2)
        radius, angle = half * np.sqrt(rng.uniform(0, 1, count)), rng.uniform(0, 2 * np.pi, count)
        points, area = np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=1), np.pi * half**2
        bend = np.zeros((count, 2))
    else:
        array = camera.microlenses
        offset, area = hexagon(count, array.pitch_mm, rng), np.sqrt(3) / 2 * array.pitch_mm**2
        points, bend = vertex_mm + offset, offset / focal_mm
    position, direction, passes, light = textbook.sent(camera, start_mm, points, bend)
    share = area if camera.weight == "area" else area * light
    return position, direction, np.where(passes, share / count, 0.0)


POSES = rigs.facing(410.0, 20.0, 3.0, 1.0), rigs.facing(470.0, -35.0, -2.0, 4.0)


RAYS, GROUPS = 5_000, 16


def moments_of(position: np.ndarray, direction: np.ndarray, weight: np.ndarray) -> list[float]:
    """Mean (4), covariance (10) and weight of the crossings of rays with both poses' planes."""
    kept = weight > 0
    hits = [textbook.at_plane(position[kept], direction[kept], pose) for pose in POSES]
    crossing, share = np.concatenate(hits, axis=1), weight[kept] / weight[kept].sum()
    mean = share @ crossing
    covariance = (crossing - mean).T @ ((crossing - mean) * share[:, None])
    return [*mean, *covariance[np.triu_indices(4)], weight[kept].sum()]


def brute_moments(
    camera: Camera,
    start: np.ndarray,
    vertex: np.ndarray | None = None,
    focal: float | None = None,
    edge_mm: float = 0.0,
    rays: int = RAYS,
) -> np.ndarray:
    """Moments of random rays from a square about a place on the sensor, one row per group of rays."""
    rng, rows = np.random.default_rng(12), []
    for _ in range(GROUPS):
        starts = start + edge_mm * rng.uniform(-0.5, 0.5, (rays, 2))
        rows.append(moments_of(*rays_through(camera, starts, vertex, focal, rays, rng)))
    return np.array(rows)


def packed_moments(camera: Camera, start: np.ndarray, lens: int, edge_px: float = 0.0) -> np.ndarray:
    """The same from the tracer, one row per seed."""
    planes, pixel = np.stack([target_plane(pose) for pose in POSES]), np.zeros((1, 2))
    where = start[None], np.array([lens]), planes, 2048, pixel, edge_px
    rows = [Tracer(camera, seed).moments(*where) for seed in range(GROUPS)]
    return np.concatenate(rows)[:, [*range(COVARIANCE + 10), WEIGHT]]


def deviations(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    """Differences of column means over their standard error, each from its own repetitions."""
    error = np.sqrt((one.var(axis=0, ddof=1) + other.var(axis=0, ddof=1)) / GROUPS)
    return (one.mean(axis=0) - other.mean(axis=0)) / error
