"""Ways from inner points of bundles to the edge of what passes, found by real rays; vision frame, mm.

That an edge holds all that passes is checked by rays all over the bound of a bundle, which must agree with it.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from pipeline.camera.boundary import even_angles, unit_vectors
from pipeline.camera.integrating import edge_kernels, edge_search
from pipeline.camera.integrating.edge_search import PASSES, Spokes
from pipeline.camera.tracing.records import CameraArrays
from pipeline.records.shapes import Float64, Int64

_POLYGON = 1 << 20
"""Labels from here on: an edge of the polygon, i.e. of the microlens aperture."""
_EDGE_STEPS = 24
"""Bisections of an edge: to 3e-8 of the way to the polygon, so that a weight errs by less than 1e-7 by it."""
_AROUND, _OUTWARDS = 256, np.append(np.arange(1, 24) / 24, 1 - 1e-6)
"""Directions, and shares of the way to the edge, of points all over a region: they miss what is hidden at its edge only
below a few hundred-thousandths of it, and a thousandth inside."""
PROBES = 3
"""Rays over the whole bound per direction of a quadrature."""
_STEPS = 12
"""Bisections of the edge in the direction of a ray that disagrees: to 1/4096 of the way to the polygon, and what
disagrees by less agrees."""
_CHANCE, _ERRORS = 3.0, 4.0
"""So many rays, and standard errors of their number, may pass beyond the chords of an edge for nothing."""


class WayEnds(NamedTuple):
    """Ends of ways: radius of the edge, its label, radius of the polygon, (m,) each; and rays traced."""

    radius: np.ndarray
    label: np.ndarray
    limit: np.ndarray
    rays: int


@dataclass(frozen=True, slots=True)
class Ways:
    """Regions that rays pass, for many sensor positions, each seen from an inner point."""

    arrays: CameraArrays
    # Sensor positions and their microlens
    positions: Float64[np.ndarray, "n 2"]
    microlens: Int64[np.ndarray, "n"]
    # Polygons that enclose what passes
    polygons: Float64[np.ndarray, "n MAX_VERTICES 2"]
    counts: Int64[np.ndarray, "n"]
    free_sr: Float64[np.ndarray, "n"]  # weight of all rays through the position's own microlens; 0 without one
    centres: Float64[np.ndarray, "n 2"]  # inner points; NaN where nothing passes

    @property
    def lit(self) -> np.ndarray:
        """Rows of the positions that have an inner point, ascending."""
        return np.flatnonzero(~np.isnan(self.centres[:, 0]))

    def spokes(self, count: int) -> tuple[np.ndarray, np.ndarray]:
        """Evenly spaced directions about every inner point: positions, ascending, and angles."""
        return np.repeat(self.lit, count), np.tile(even_angles(count), len(self.lit))

    def spread(self, rows: Int64[np.ndarray, "n"], count: int) -> np.ndarray:
        """So many points all over the polygons of some positions, (rows, count, 2)."""
        points = np.empty((len(rows), count, 2))
        edge_kernels.spread(self.polygons[rows], self.counts[rows], points)
        return points

    def probe(
        self, owner: Int64[np.ndarray, "n"], points: Float64[np.ndarray, "n 2"], is_named: bool = False
    ) -> np.ndarray:
        """Labels, as of `edge_kernels.probe`, of what blocks rays of positions, ascending, through points."""
        label, points = np.empty(len(owner), np.int64), np.ascontiguousarray(points)
        edge_kernels.probe(self.arrays, self.positions, self.microlens, owner, points, is_named, label)
        edge_kernels.probe.count(len(owner), len(self.arrays.table))
        return label

    def find(self, owner: Int64[np.ndarray, "n"], angle: Float64[np.ndarray, "n"], steps: int = _EDGE_STEPS) -> WayEnds:
        """Edges in directions sorted by owner, whose radius errs by less than 2^-(steps + 1) of the polygon's."""
        m = len(owner)
        spokes, label = Spokes(owner, angle, np.empty(m), np.empty((2, m))), np.empty(m, np.int64)
        edge_search.reach(self.polygons, self.counts, self.centres, spokes, label)
        label += _POLYGON
        radius = np.empty(m)
        way = self.positions, self.microlens, self.centres, spokes
        rays = edge_search.find_edges(self.arrays, *way, steps, radius, label)
        edge_search.find_edges.count(rays, len(self.arrays.table))
        return WayEnds(radius, label, spokes.limit, rays)

    def all_over(self, rows: Int64[np.ndarray, "n"]) -> np.ndarray:
        """Points of some regions up to their very edge, (rows, m, 2)."""
        owner, angle = np.repeat(rows, _AROUND), np.tile(even_angles(_AROUND), len(rows))
        way = self.find(owner, angle).radius[:, None] * unit_vectors(angle)
        return (self.centres[owner, None] + _OUTWARDS[:, None] * way[:, None]).reshape(len(rows), -1, 2)

    def nothing_beyond(
        self,
        owner: Int64[np.ndarray, "n"],
        along: Float64[np.ndarray, "n 2"],
        radius: Float64[np.ndarray, "n"],
        limit: Float64[np.ndarray, "n"],
    ) -> np.ndarray:
        """Whether no ray passes beyond the edge, (n,): one per direction is sent there, at four heights in turn."""
        number = np.arange(len(owner)) - np.searchsorted(owner, owner)  # among its own: no row depends on others
        height = 0.125 + 0.25 * (number % 4)
        open_ = radius < limit * (1 - 1e-9)
        points = self.centres[owner] + (radius + height * (limit - radius))[:, None] * along
        label = self.probe(owner[open_], points[open_])
        clear = np.ones(len(self.positions), bool)
        clear[owner[open_][label == PASSES]] = False
        return clear


def holds_all(
    ways: Ways,
    owner: Int64[np.ndarray, "m"],
    angle: Float64[np.ndarray, "m"],
    radius: Float64[np.ndarray, "m"],
    share: Float64[np.ndarray, "m"],
    count: int,
) -> tuple[np.ndarray, int]:
    """Whether `count` rays all over the bound of each position pass where an edge says so, (n,) bool; and rays traced.

    Between neighbouring directions the edge is taken for a chord. Where a ray says otherwise, the edge is sought in
    that ray's own direction and must agree with it: else what passes is in pieces, has a hole, or is not star-shaped.
    No more rays may pass beyond the chords than the area there accounts for: else the edge is drawn too short.

    `owner`, `angle`, `radius`, `share`: directions of a quadrature, sorted by owner; the distance of the edge, and the
        angle that each stands for.
    """
    n = len(ways.positions)
    live = np.flatnonzero(np.bincount(owner, minlength=n))
    if not len(live):
        return np.ones(n, bool), 0
    chords = _chords(owner, angle, radius, n)
    who, points = np.repeat(live, count), ways.spread(live, count).reshape(-1, 2)
    passed = ways.probe(who, points) == PASSES
    x, y = (points - ways.centres[who]).T
    towards = np.arctan2(y, x)
    surprise = np.flatnonzero(passed != chords.hold(who, towards, x, y))
    far = np.hypot(x[surprise], y[surprise])
    edge, _, limit, rays = ways.find(who[surprise], towards[surprise], _STEPS)
    off = np.where(passed[surprise], far - edge, edge - far)
    whole = np.ones(n, bool)
    whole[who[surprise][off > limit * 0.5**_STEPS]] = False

    outside = np.bincount(owner, 0.5 * share * radius**2, n) - chords.area()
    expected = count * np.maximum(outside[live], 0.0) / _areas(ways, live)
    beyond = np.bincount(who[surprise][passed[surprise]], minlength=n)[live]
    whole[live[beyond > expected + _CHANCE + _ERRORS * np.sqrt(expected)]] = False
    return whole, len(who) + rays


@dataclass(frozen=True, slots=True)
class _Chords:
    """Polygons through the ends of directions: keys that sort them by owner and angle, the first direction of each
    owner, the ends about the inner point, and the next direction."""

    key: np.ndarray
    first: np.ndarray
    x: np.ndarray
    y: np.ndarray
    following: np.ndarray

    def hold(self, owner: np.ndarray, angle: np.ndarray, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        """Whether points (x, y), about the inner points and in directions `angle`, lie before the chord, (k,) bool."""
        a = np.searchsorted(self.key, _key(owner, angle), side="right") - 1
        a = np.where(a < self.first[owner], self.first[owner + 1] - 1, a)
        b = self.following[a]
        ax, ay = self.x[a], self.y[a]
        return (self.x[b] - ax) * (y - ay) > (self.y[b] - ay) * (x - ax)

    def area(self) -> np.ndarray:
        """Area that the chords enclose, (n,)."""
        b, n = self.following, len(self.first) - 1
        owner = np.repeat(np.arange(n), np.diff(self.first))
        return np.bincount(owner, 0.5 * (self.x * self.y[b] - self.x[b] * self.y), n)


def _chords(owner: np.ndarray, angle: np.ndarray, radius: np.ndarray, n: int) -> _Chords:
    key = _key(owner, angle)
    order = np.argsort(key, kind="stable")  # nearly sorted already
    owner, angle, radius = owner[order], angle[order], radius[order]
    first = np.searchsorted(owner, np.arange(n + 1))
    following = np.arange(1, len(owner) + 1)
    last = np.append(owner[1:] != owner[:-1], True)
    following[last] = first[owner[last]]
    return _Chords(key[order], first, radius * np.cos(angle), radius * np.sin(angle), following)


def _key(owner: np.ndarray, angle: np.ndarray) -> np.ndarray:
    """Numbers that sort directions by their owner, then by their angle from 0 to 2 pi."""
    return owner * 8.0 + angle % (2 * np.pi)


def _areas(ways: Ways, rows: np.ndarray) -> np.ndarray:
    """Areas of the polygons that bound some positions."""
    x, y = np.moveaxis(ways.polygons[rows], -1, 0)
    number = np.arange(x.shape[1])
    following = np.where(number + 1 < ways.counts[rows, None], number + 1, 0)
    cross = x * np.take_along_axis(y, following, axis=1) - y * np.take_along_axis(x, following, axis=1)
    return 0.5 * np.sum(np.where(number < ways.counts[rows, None], cross, 0.0), axis=1)
