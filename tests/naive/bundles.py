"""Moments of bundles on two tilted planes, by brute force and by the tracer; differences in units of their error."""

import numpy as np
from laws import rigs
from naive import brute, textbook

from pipeline.camera.parts.camera import Camera
from pipeline.camera.tracer import Tracer, target_plane
from pipeline.camera.tracing.moments import COVARIANCE, WEIGHT

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
        rows.append(moments_of(*brute.rays_through(camera, starts, vertex, focal, rays, rng)))
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
