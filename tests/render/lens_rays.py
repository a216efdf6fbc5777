"""Rays out of a lens, and the nearest of some quads that each meets, by NumPy."""

import numpy as np


def lens_rays(count: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Rays from the first vertex of a lens, 40 mm in front of the stop, into the field."""
    rng = np.random.default_rng(seed)
    origins = np.column_stack([rng.uniform(-25, 25, (count, 2)), np.full(count, 40.0)])
    aims = np.column_stack([rng.uniform(-120, 120, (count, 2)), np.full(count, 420.0)])
    return origins, aims - origins


def distance_along(quad: np.ndarray, origins: np.ndarray, directions: np.ndarray) -> np.ndarray:
    """By Cramer's rule on corner + u a + v b = origin + t direction, ray by ray: shares no step with the code."""
    columns = np.stack(
        [
            np.broadcast_to(quad[1] - quad[0], directions.shape),
            np.broadcast_to(quad[3] - quad[0], directions.shape),
            -directions,
        ],
        axis=-1,
    )
    u, v, t = np.linalg.solve(columns, (origins - quad[0])[..., None])[..., 0].T
    inside = (np.minimum(u, v) >= 0) & (np.maximum(u, v) <= 1) & (t > 0)
    return np.where(inside, t, np.inf)


def nearest(quads: list[np.ndarray], origins: np.ndarray, directions: np.ndarray) -> np.ndarray:
    distances = np.stack([distance_along(quad, origins, directions) for quad in quads])
    return np.where(np.isfinite(distances.min(axis=0)), distances.argmin(axis=0), -1)
