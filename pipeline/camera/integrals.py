"""Integrals over bundles to a wanted accuracy: quadrature over the traced edge, random rays where that fails.

Quadrature and random rays share the trace and nothing else, so that each can judge the other.
"""

from dataclasses import dataclass

import numpy as np

from pipeline.camera.camera import REPLICAS
from pipeline.camera.moments import VARIANCE
from pipeline.camera.quadrature import NOT_STAR_SHAPED, edges
from pipeline.camera.regions import SKIP
from pipeline.camera.tracer import Tracer

NODES = ((6, 16), (8, 32), (12, 64), (16, 128), (24, 256))
"""Levels of the quadrature: nodes along the radius and over the circle. The error is that of the level before."""
RANDOM_RAYS = (1 << 12, 1 << 14, 1 << 16, 1 << 18, 1 << 20)
"""Rays of the same levels where a bundle is not star-shaped, or where random rays are asked for."""
LEVELS = len(NODES)


@dataclass(frozen=True, slots=True)
class Integral:
    """Moments of bundles on two planes of each.

    Attributes
    ----------
    moments : (n, COLUMNS) float64
        As `Tracer.moments`; NaN where the bundle is empty.
    error_mm : (n, 2) float64
        Of the mean on the first plane: difference of two levels of quadrature, or standard error of random rays.
    is_random : (n,) bool
        Whether random rays were used.
    rays : int
        Traced for it.
    """

    moments: np.ndarray
    error_mm: np.ndarray
    is_random: np.ndarray
    rays: int


def integrals(tracer: Tracer, x_px: np.ndarray, lens: np.ndarray, planes: np.ndarray, level: int) -> Integral:
    """Integrate the bundles of image positions (n, 2) behind their microlenses (n,) on planes (n, 2, 4, 3).

    Level 0 states no error (NaN), because there is nothing to compare with.
    """
    known = ~np.isnan(x_px).any(axis=1)
    positions = tracer.positions_mm(*np.where(known[:, None], x_px, 0.0).T)
    found = edges(tracer.arrays, positions, np.where(known, lens, SKIP))
    moments, status, rays = found.moments(planes, NODES[level])
    error = np.full((len(x_px), 2), np.nan)
    if level > 0:
        before, _, more = found.moments(planes, NODES[level - 1])
        error, rays = np.abs(moments[:, :2] - before[:, :2]), rays + more
    odd = status == NOT_STAR_SHAPED
    if odd.any():
        other = random_integrals(tracer, x_px[odd], lens[odd], planes[odd], RANDOM_RAYS[level])
        moments[odd], error[odd], rays = other.moments, other.error_mm, rays + other.rays
    return Integral(moments, error, odd, rays + found.rays)


def random_integrals(tracer: Tracer, x_px: np.ndarray, lens: np.ndarray, planes: np.ndarray, rays: int) -> Integral:
    """The same by so many scrambled Sobol points each; random numbers depend on the pixel."""
    known = ~np.isnan(x_px).any(axis=1)
    somewhere = np.where(known[:, None], x_px, 0.0)
    positions = tracer.positions_mm(*somewhere.T)
    moments = tracer.moments(positions, np.where(known, lens, SKIP), planes, rays, np.rint(somewhere).astype(np.int64))
    error = np.sqrt(moments[:, VARIANCE : VARIANCE + 2])
    return Integral(moments, error, np.ones(len(x_px), bool), int(known.sum()) * max(rays, REPLICAS))
