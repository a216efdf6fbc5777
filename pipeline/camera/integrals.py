"""Integrals over bundles to a wanted accuracy: quadrature over the traced edge, random rays where that fails.

Quadrature and random rays share the trace and nothing else, so that each can judge the other.
"""

from dataclasses import dataclass, replace

import numpy as np

from pipeline.camera.integrating import footprint
from pipeline.camera.integrating.quadrature import EMPTY, FINE, INTEGRATED, NOT_STAR_SHAPED, ROUGH, edges
from pipeline.camera.parts.camera import REPLICAS
from pipeline.camera.tracer import Tracer
from pipeline.camera.tracing.moments import COLUMNS, VARIANCE
from pipeline.camera.tracing.sampling_bounds import SKIP

NODES = ((6, 16), (8, 32), (12, 64), (16, 128), (24, 256))
"""Levels of the quadrature: nodes along the radius and over the circle. The error is that of the level before."""
SQUARE_NODES = (2, 3, 5, 8, 12)
"""Nodes of the same levels along each edge of a square that rays start on."""
RANDOM_RAYS = (1 << 12, 1 << 14, 1 << 16, 1 << 18, 1 << 20)
"""Rays of the same levels where a bundle is not star-shaped, or where random rays are asked for."""
LEVELS = len(NODES)
"""Number of levels, the same in the three lists above."""

_STREAM_PX = 1 << 24
"""Pixels of another stream lie so far off: no sensor is as wide."""
_ANCHORED_PX = 0.5
"""Regions of anchors farther away may miss rays that pass."""
_NODES_AT_ONCE = 1 << 22
"""Nodes of quadrature of a stretch of squares: what fits into memory."""


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


def integrals(
    tracer: Tracer,
    x_px: np.ndarray,
    lens: np.ndarray,
    planes: np.ndarray,
    level: int,
    square_px: float = 0.0,
    anchor_px: np.ndarray | None = None,
) -> Integral:
    """Integrate the bundles of image positions (n, 2) behind their microlenses (n,) on planes (n, 2, 4, 3).

    Level 0 is for steps on the way: its edges are rougher, and it states no error (NaN), because there is nothing to
    compare with. Rays start at the positions, or anywhere on squares of the edge `square_px` around them. Positions
    near their anchors (n, 2) have the random rays of these: a search keeps them, so that its integrals change smoothly
    with the position.
    """
    known = ~np.isnan(x_px).any(axis=1)
    x, lit = np.where(known[:, None], x_px, 0.0), np.where(known, lens, SKIP)
    over = _over_squares if square_px > 0 else _over_points
    levels, rays = over(tracer, x, lit, planes, [level - 1, level] if level > 0 else [level], square_px)
    moments, status = levels[-1]
    error = np.full((len(x_px), 2), np.nan)
    if level > 0:
        error = np.abs(moments[:, :2] - levels[0][0][:, :2])
    odd = status == NOT_STAR_SHAPED
    if odd.any():
        bundles = x_px[odd], lens[odd], planes[odd], RANDOM_RAYS[level], square_px
        other = random_integrals(tracer, *bundles, anchor_px=None if anchor_px is None else anchor_px[odd])
        moments[odd], error[odd], rays = other.moments, other.error_mm, rays + other.rays
    return Integral(moments, error, odd, rays)


_Levels = tuple[list[tuple[np.ndarray, np.ndarray]], int]
"""Moments and status of each level, and rays traced."""


def _over_points(
    tracer: Tracer, x_px: np.ndarray, lens: np.ndarray, planes: np.ndarray, levels: list[int], _: float
) -> _Levels:
    found = edges(tracer.arrays, tracer.positions_mm(*x_px.T), lens, FINE if levels[-1] > 0 else ROUGH)
    parts = [found.moments(planes, NODES[level], level == levels[-1]) for level in levels]
    return [(moments, status) for moments, status, _ in parts], found.rays + sum(rays for *_, rays in parts)


def _over_squares(
    tracer: Tracer, x_px: np.ndarray, lens: np.ndarray, planes: np.ndarray, levels: list[int], square_px: float
) -> _Levels:
    result, rays = [], 0
    for level in levels:
        offset, share = footprint.nodes(SQUARE_NODES[level])
        moments, status = np.empty((len(x_px), COLUMNS)), np.empty(len(x_px), np.int64)
        stretch = max(1, _NODES_AT_ONCE // (len(share) * NODES[level][0] * NODES[level][1]))
        for first in range(0, len(x_px), stretch):
            here = slice(first, first + stretch)
            x = (x_px[here, None] + square_px * offset).reshape(-1, 2)
            behind, on = (np.repeat(values[here], len(share), axis=0) for values in (lens, planes))
            ((found, state),), more = _over_points(tracer, x, behind, on, [level], 0.0)
            moments[here] = footprint.joined(found.reshape(-1, len(share), COLUMNS), share)
            status[here] = _worst(state.reshape(-1, len(share)))
            rays += more
        result.append((moments, status))
    return result, rays


def _worst(status: np.ndarray) -> np.ndarray:
    """Outcomes of squares, (n,), from those of their nodes, (n, m)."""
    some = np.where((status == INTEGRATED).any(axis=1), INTEGRATED, EMPTY)
    return np.where((status == NOT_STAR_SHAPED).any(axis=1), NOT_STAR_SHAPED, some)


def random_integrals(
    tracer: Tracer,
    x_px: np.ndarray,
    lens: np.ndarray,
    planes: np.ndarray,
    rays: int,
    square_px: float = 0.0,
    stream: int = 0,
    anchor_px: np.ndarray | None = None,
) -> Integral:
    """The same by so many scrambled Sobol points each; random numbers depend on the anchor's pixel and the stream."""
    known = ~np.isnan(x_px).any(axis=1)
    x_px = np.where(known[:, None], x_px, 0.0)
    anchor_px = x_px if anchor_px is None else anchor_px
    near = np.hypot(*(anchor_px - x_px).T) <= _ANCHORED_PX
    anchor_px = np.where(near[:, None], anchor_px, x_px)
    positions, anchors = tracer.positions_mm(*x_px.T), tracer.positions_mm(*anchor_px.T)
    numbers = np.rint(anchor_px).astype(np.int64) + np.array([stream * _STREAM_PX, 0])
    moments = tracer.moments(positions, np.where(known, lens, SKIP), planes, rays, numbers, square_px, anchors)
    error = np.sqrt(moments[:, VARIANCE : VARIANCE + 2])
    return Integral(moments, error, np.ones(len(x_px), bool), int(known.sum()) * max(rays, REPLICAS))


def pooled(found: Integral, coarser_mm: np.ndarray) -> Integral:
    """The same with standard errors from all replicas of two levels of random rays.

    Four replicas alone state an error that is itself wrong by 40 %, and who stops where it is small stops where it is
    too small. Scrambled Sobol points err by no more than half as much where there are four times as many.

    Parameters
    ----------
    coarser_mm : (n, 2) float64
        Standard errors of the level before; NaN where its rays were not random.
    """
    both = np.sqrt((found.error_mm**2 + coarser_mm**2 / 4) / 2)
    known = found.is_random[:, None] & ~np.isnan(coarser_mm)
    return replace(found, error_mm=np.where(known, both, found.error_mm))
