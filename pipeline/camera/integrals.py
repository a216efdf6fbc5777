"""Integrals over bundles to a requested accuracy: quadrature within the traced boundary, random rays where that fails.

Quadrature and random rays share the trace and nothing else, so that each can judge the other.
"""

import functools
from dataclasses import dataclass, replace

import numpy as np

from pipeline.camera.integrating.quadrature import EMPTY, FINE, INTEGRATED, NOT_STAR_SHAPED, ROUGH, Outcome, regions
from pipeline.camera.parts.camera import REPLICAS
from pipeline.camera.tracer import Tracer
from pipeline.camera.tracing.moments import COLUMNS, VARIANCE, mixed
from pipeline.camera.tracing.records import Starts
from pipeline.camera.tracing.sampling_bounds import SKIP
from pipeline.records.shapes import Bool, Float64, Int64

NODES = ((6, 16), (8, 32), (12, 64), (16, 128), (24, 256))
"""Levels of the quadrature: nodes along the radius and over the circle. The error of a level is its difference from the
one before."""
SQUARE_NODES = (2, 3, 5, 8, 12)
"""Nodes of each level along an edge of a square from which rays start: half as many again from level to level."""
RANDOM_RAYS = (1 << 12, 1 << 14, 1 << 16, 1 << 18, 1 << 20)
"""Random rays of each level, where a bundle is not star-shaped or they are requested: four times as many halve a
standard error at least."""
LEVELS = len(NODES)
"""Number of levels in the three lists above."""

_STREAM_PX = 1 << 24
"""Distance in pixels between streams of random numbers [px]: wider than any sensor."""
_ANCHORED_PX = 0.5
"""Farthest anchor [px]: half of the pixel within which a region serves other positions."""
_NODES_AT_ONCE = 1 << 22
"""Quadrature nodes of a batch of squares: bounds memory, and no result depends on it."""


@dataclass(frozen=True, slots=True)
class Bundles:
    """Bundles of image positions."""

    x_px: Float64[np.ndarray, "n 2"]  # image positions; NaN: no bundle
    microlens: Int64[np.ndarray, "n"]  # row of the microlens of each, or NO_MICROLENS
    planes: Float64[np.ndarray, "n 2 4 3"]  # two planes of each on which it has moments
    square_px: float = 0.0  # edge of the square around a position that rays start on; 0: the position itself
    # Positions whose random rays neighbours share: a search keeps its anchors, so that its integrals change smoothly
    # with the position. None: each position has its own.
    anchor_px: Float64[np.ndarray, "n 2"] | None = None

    @property
    def exists(self) -> np.ndarray:
        """Whether there is a bundle, (n,) bool."""
        return ~np.isnan(self.x_px).any(axis=1)

    def lit(self) -> "Bundles":
        """The bundles with finite positions in place of NaN, where the microlens is skipped."""
        x_px = np.where(self.exists[:, None], self.x_px, 0.0)
        return replace(self, x_px=x_px, microlens=np.where(self.exists, self.microlens, SKIP))

    def only(self, rows: Bool[np.ndarray, "n"] | Int64[np.ndarray, "m"] | slice) -> "Bundles":
        """The bundles of these rows."""
        anchor_px = None if self.anchor_px is None else self.anchor_px[rows]
        return Bundles(self.x_px[rows], self.microlens[rows], self.planes[rows], self.square_px, anchor_px)

    def at_nodes(self, level: int) -> tuple["Bundles", np.ndarray]:
        """Bundles at the nodes of the squares from which rays start, (n m,), and the weights of one square, (m,)."""
        if not self.square_px > 0:
            return self, np.ones(1)
        offset, share = square_nodes(SQUARE_NODES[level])
        x_px = (self.x_px[:, None] + self.square_px * offset).reshape(-1, 2)
        microlens, planes = (np.repeat(values, len(share), axis=0) for values in (self.microlens, self.planes))
        return Bundles(x_px, microlens, planes), share


@dataclass(frozen=True, slots=True)
class Integral:
    """Moments of bundles on two planes each."""

    moments: Float64[np.ndarray, "n COLUMNS"]  # moments as from `Tracer.moments`; NaN where the bundle is empty
    # Error of the mean on the first plane: difference of two levels of quadrature, or standard error of rays
    error_mm: Float64[np.ndarray, "n 2"]
    is_random: Bool[np.ndarray, "n"]  # whether random rays were used
    rays: int  # traced

    def only(self, rows: Int64[np.ndarray, "m"] | slice) -> "Integral":
        """The integrals of some bundles; `rays` stays that of all."""
        return Integral(self.moments[rows], self.error_mm[rows], self.is_random[rows], self.rays)


def integrals(tracer: Tracer, bundles: Bundles, level: int) -> Integral:
    """Integrate bundles at a level of quadrature.

    Level 0 is for intermediate steps: its boundaries are coarser, and its error is NaN for want of a coarser level.
    """
    levels = _over_light(tracer, bundles.lit(), [level - 1, level] if level > 0 else [level])
    moments, status, _ = levels[-1]
    rays = sum(outcome.rays for outcome in levels)
    error = np.full((len(bundles.x_px), 2), np.nan)
    if level > 0:
        error = np.abs(moments[:, :2] - levels[0].moments[:, :2])
    is_random = status == NOT_STAR_SHAPED
    if is_random.any():
        by_random_rays = random_integrals(tracer, bundles.only(is_random), RANDOM_RAYS[level])
        moments[is_random] = by_random_rays.moments
        error[is_random] = by_random_rays.error_mm
        rays = rays + by_random_rays.rays
    return Integral(moments, error, is_random, rays)


def _over_light(tracer: Tracer, bundles: Bundles, levels: list[int]) -> list[Outcome]:
    """Weighted sum over all wavelengths, at each level."""
    integrate = _over_squares if bundles.square_px > 0 else _over_points
    lights = tracer.lights
    by_light = [integrate(light.tracer, bundles, levels) for light in lights]
    if len(by_light) == 1:
        return by_light[0]
    shares = np.array([light.share for light in lights])
    result = []
    for outcomes in zip(*by_light, strict=True):
        moments = np.stack([outcome.moments for outcome in outcomes], axis=1)
        status = np.stack([outcome.status for outcome in outcomes], axis=1)
        result.append(Outcome(mixed(moments, shares), _worst(status), sum(outcome.rays for outcome in outcomes)))
    return result


def _over_points(tracer: Tracer, bundles: Bundles, levels: list[int], last: int | None = None) -> list[Outcome]:
    """Outcomes at each level of bundles that start at positions; `last` is the finest level, by default the last one.

    Rays of the search for regions, which all levels share, count for the first.
    """
    last = levels[-1] if last is None else last
    positions = tracer.positions_mm(*bundles.x_px.T)
    lit = regions(tracer.arrays, positions, bundles.microlens, FINE if last > 0 else ROUGH)
    first, *finer = (lit.moments(bundles.planes, NODES[level], level == last) for level in levels)
    return [first._replace(rays=first.rays + lit.rays), *finer]


def _over_squares(tracer: Tracer, bundles: Bundles, levels: list[int]) -> list[Outcome]:
    """Outcomes at each level of bundles that start on squares: weighted sums over nodes of the square."""
    result = []
    n = len(bundles.x_px)
    for level in levels:
        moments = np.empty((n, COLUMNS))
        status = np.empty(n, np.int64)
        rays = 0
        at_once = max(1, _NODES_AT_ONCE // (SQUARE_NODES[level] ** 2 * NODES[level][0] * NODES[level][1]))
        for first in range(0, n, at_once):
            batch = slice(first, first + at_once)
            nodes, share = bundles.only(batch).at_nodes(level)
            (outcome,) = _over_points(tracer, nodes, [level], levels[-1])
            moments[batch] = mixed(outcome.moments.reshape(-1, len(share), COLUMNS), share)
            status[batch] = _worst(outcome.status.reshape(-1, len(share)))
            rays += outcome.rays
        result.append(Outcome(moments, status, rays))
    return result


@functools.cache
def square_nodes(count: int) -> tuple[np.ndarray, np.ndarray]:
    """Gauss-Legendre nodes (count^2, 2) on the square of edge 1 about the origin, and their weights (count^2,)."""
    node, weight = np.polynomial.legendre.leggauss(count)
    x, y = (axis.ravel() for axis in np.meshgrid(node / 2, node / 2))
    return np.stack([x, y], axis=1), np.outer(weight / 2, weight / 2).ravel()


def _worst(status: np.ndarray) -> np.ndarray:
    """Outcomes of mixtures, (n,), from those of their parts, (n, m)."""
    outcome = np.where((status == INTEGRATED).any(axis=1), INTEGRATED, EMPTY)
    return np.where((status == NOT_STAR_SHAPED).any(axis=1), NOT_STAR_SHAPED, outcome)


def random_integrals(tracer: Tracer, bundles: Bundles, rays: int, stream: int = 0) -> Integral:
    """Integrals by scrambled Sobol points, whose random numbers depend on the anchor's pixel and the stream."""
    lit = bundles.lit()
    anchor_px = lit.x_px if bundles.anchor_px is None else bundles.anchor_px
    near = np.hypot(*(anchor_px - lit.x_px).T) <= _ANCHORED_PX
    anchor_px = np.where(near[:, None], anchor_px, lit.x_px)
    pixels = np.rint(anchor_px).astype(np.int64) + np.array([stream * _STREAM_PX, 0])
    starts = Starts(pixels, tracer.positions_mm(*anchor_px.T), tracer.positions_mm(*lit.x_px.T), lit.microlens)
    moments = tracer.moments_of(starts, bundles.planes, rays, bundles.square_px)
    error = np.sqrt(moments[:, VARIANCE : VARIANCE + 2])
    return Integral(moments, error, np.ones(len(error), bool), int(bundles.exists.sum()) * max(rays, REPLICAS))


def pooled(finer: Integral, coarser_mm: Float64[np.ndarray, "n 2"]) -> Integral:
    """The integrals with standard errors from all replicas of two levels of random rays.

    Four replicas alone estimate an error to within 40 %, and a search that stops at the first small estimate stops too
    early. The error of scrambled Sobol points at least halves with four times as many points.

    `coarser_mm`: standard errors of the level before; NaN where its rays were not random.
    """
    from_both = np.sqrt((finer.error_mm**2 + coarser_mm**2 / 4) / 2)
    has_both = finer.is_random[:, None] & ~np.isnan(coarser_mm)
    return replace(finer, error_mm=np.where(has_both, from_both, finer.error_mm))
