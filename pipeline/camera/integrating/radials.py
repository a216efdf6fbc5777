"""Radial rays from an interior point to the vignetting boundary; vision frame, mm.

Probe rays all over the bounding polygon must agree with a boundary, which shows that it encloses all of the light.
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
"""Bisections of the boundary: to 3e-8 of the polygon's radius, so that a weight errs by less than 1e-7."""
_AROUND = 256
"""Directions of points that cover a region: a hidden part at its boundary is missed only below a few
hundred-thousandths of it."""
_OUTWARDS = np.append(np.arange(1, 24) / 24, 1 - 1e-6)
"""Fractions of the boundary's radius of these points: a hidden part inside is missed only below a thousandth."""
PROBES = 3
"""Probe rays over the polygon per direction of a quadrature."""
_STEPS = 12
"""Bisections of the boundary in the direction of a probe that disagrees: to 1/4096 of the polygon's radius, which is
also the tolerance."""
_CHANCE, _ERRORS = 3.0, 4.0
"""Tolerated number of probes beyond the chords of a boundary: a constant, and standard errors of the expected
number."""


class EdgePoints(NamedTuple):
    """Boundary points: radius [mm], label of the obstacle, radius of the polygon [mm], (m,) each; and rays traced."""

    radius: np.ndarray
    label: np.ndarray
    polygon_radius: np.ndarray
    rays: int


@dataclass(frozen=True, slots=True)
class StarRegions:
    """Regions of passing rays, one per sensor position, each star-shaped about an interior point."""

    arrays: CameraArrays
    # Sensor positions and their microlens
    positions: Float64[np.ndarray, "n 2"]
    microlens: Int64[np.ndarray, "n"]
    # Polygons that enclose the regions
    polygons: Float64[np.ndarray, "n MAX_VERTICES 2"]
    counts: Int64[np.ndarray, "n"]
    free_sr: Float64[np.ndarray, "n"]  # weight of all rays through the position's own microlens; 0 without one
    centres: Float64[np.ndarray, "n 2"]  # interior points; NaN where nothing passes

    @property
    def nonempty(self) -> np.ndarray:
        """Rows of the positions with an interior point, ascending."""
        return np.flatnonzero(~np.isnan(self.centres[:, 0]))

    def directions(self, count: int) -> tuple[np.ndarray, np.ndarray]:
        """Evenly spaced directions about every interior point: positions, ascending, and angles."""
        return np.repeat(self.nonempty, count), np.tile(even_angles(count), len(self.nonempty))

    def spread(self, rows: Int64[np.ndarray, "n"], count: int) -> np.ndarray:
        """Points that fill the polygons of some positions evenly, (rows, count, 2)."""
        points = np.empty((len(rows), count, 2))
        edge_kernels.spread(self.polygons[rows], self.counts[rows], points)
        return points

    def probe(
        self, owner: Int64[np.ndarray, "n"], points: Float64[np.ndarray, "n 2"], is_named: bool = False
    ) -> np.ndarray:
        """Labels, as from `edge_kernels.probe`, of the obstacles of rays from positions, ascending, through points."""
        label = np.empty(len(owner), np.int64)
        points = np.ascontiguousarray(points)
        edge_kernels.probe(self.arrays, self.positions, self.microlens, owner, points, is_named, label)
        edge_kernels.probe.count(len(owner), len(self.arrays.table))
        return label

    def edge_points(
        self, owner: Int64[np.ndarray, "n"], angle: Float64[np.ndarray, "n"], steps: int = _EDGE_STEPS
    ) -> EdgePoints:
        """Boundary points in directions sorted by owner; a radius errs by less than 2^-(steps + 1) of the polygon's."""
        m = len(owner)
        spokes = Spokes(owner, angle, np.empty(m), np.empty((2, m)))
        label = np.empty(m, np.int64)
        edge_search.reach(self.polygons, self.counts, self.centres, spokes, label)
        label += _POLYGON
        radius = np.empty(m)
        bundles = self.positions, self.microlens, self.centres
        rays = edge_search.find_edges(self.arrays, *bundles, spokes, steps, radius, label)
        edge_search.find_edges.count(rays, len(self.arrays.table))
        return EdgePoints(radius, label, spokes.polygon_radius, rays)

    def points_inside(self, rows: Int64[np.ndarray, "n"]) -> np.ndarray:
        """Points that cover regions up to their boundary, (rows, m, 2)."""
        owner = np.repeat(rows, _AROUND)
        angle = np.tile(even_angles(_AROUND), len(rows))
        radial = self.edge_points(owner, angle).radius[:, None] * unit_vectors(angle)
        return (self.centres[owner, None] + _OUTWARDS[:, None] * radial[:, None]).reshape(len(rows), -1, 2)

    def nothing_beyond(
        self,
        owner: Int64[np.ndarray, "n"],
        along: Float64[np.ndarray, "n 2"],
        radius: Float64[np.ndarray, "n"],
        polygon_radius: Float64[np.ndarray, "n"],
    ) -> np.ndarray:
        """Whether no ray passes beyond the boundary, (n,): one ray per direction, at four radii in turn."""
        # Number the directions of each position, so that no row depends on another, and alternate between four
        # fractions of the distance from the boundary to the polygon.
        direction = np.arange(len(owner)) - np.searchsorted(owner, owner)
        fraction = 0.125 + 0.25 * (direction % 4)
        ends_inside = radius < polygon_radius * (1 - 1e-9)
        points = self.centres[owner] + (radius + fraction * (polygon_radius - radius))[:, None] * along
        label = self.probe(owner[ends_inside], points[ends_inside])
        is_clear = np.ones(len(self.positions), bool)
        is_clear[owner[ends_inside][label == PASSES]] = False
        return is_clear


def agrees_with_probes(
    bundles: StarRegions,
    owner: Int64[np.ndarray, "m"],
    angle: Float64[np.ndarray, "m"],
    radius: Float64[np.ndarray, "m"],
    angular_weight: Float64[np.ndarray, "m"],
    count: int,
) -> tuple[np.ndarray, int]:
    """Whether `count` probes over the polygon of each position agree with a boundary, (n,) bool; and rays traced.

    Between neighbouring directions the boundary is approximated by a chord. Where a probe disagrees, the boundary is
    traced in the probe's own direction and must explain it: otherwise the region is in pieces, has a hole, or is not
    star-shaped. The number of probes that pass beyond the chords must not exceed what the area there accounts for:
    otherwise the boundary is too small.

    `owner`, `angle`, `radius`, `angular_weight`: directions of a quadrature, sorted by owner; the radius of the
    boundary along each [mm], and its weight [rad].
    """
    n = len(bundles.positions)
    nonempty = np.flatnonzero(np.bincount(owner, minlength=n))
    if not len(nonempty):
        return np.ones(n, bool), 0
    # Compare probes with the chords of the boundary.
    chords = _chords(owner, angle, radius, n)
    bundle = np.repeat(nonempty, count)
    points = bundles.spread(nonempty, count).reshape(-1, 2)
    passes = bundles.probe(bundle, points) == PASSES
    x, y = (points - bundles.centres[bundle]).T
    probe_angle = np.arctan2(y, x)
    disagrees = np.flatnonzero(passes != chords.hold(bundle, probe_angle, x, y))
    # Trace the boundary in the direction of each probe that disagrees.
    probe_radius = np.hypot(x[disagrees], y[disagrees])
    edge, _, polygon_radius, rays = bundles.edge_points(bundle[disagrees], probe_angle[disagrees], _STEPS)
    excess = np.where(passes[disagrees], probe_radius - edge, edge - probe_radius)
    agrees = np.ones(n, bool)
    agrees[bundle[disagrees][excess > polygon_radius * 0.5**_STEPS]] = False
    # Compare the number of probes beyond the chords with the area between chords and boundary.
    outside = np.bincount(owner, 0.5 * angular_weight * radius**2, n) - chords.area()
    expected = count * np.maximum(outside[nonempty], 0.0) / _areas(bundles, nonempty)
    beyond = np.bincount(bundle[disagrees][passes[disagrees]], minlength=n)[nonempty]
    agrees[nonempty[beyond > expected + _CHANCE + _ERRORS * np.sqrt(expected)]] = False
    return agrees, len(bundle) + rays


@dataclass(frozen=True, slots=True)
class _Chords:
    """Polygons through boundary points, in the order of owner and angle.

    `key`: of each point, for the order; `first`: number of the first point of each owner; `x`, `y`: relative to the
    interior point; `following`: number of the next point.
    """

    key: np.ndarray
    first: np.ndarray
    x: np.ndarray
    y: np.ndarray
    following: np.ndarray

    def hold(self, owner: np.ndarray, angle: np.ndarray, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        """Whether points (x, y), about interior points and in directions `angle`, lie within the chords, (k,) bool."""
        # The chord from a to b crosses the direction; before the first point of an owner it begins at the last one.
        a = np.searchsorted(self.key, _key(owner, angle), side="right") - 1
        a = np.where(a < self.first[owner], self.first[owner + 1] - 1, a)
        b = self.following[a]
        ax, ay = self.x[a], self.y[a]
        return (self.x[b] - ax) * (y - ay) > (self.y[b] - ay) * (x - ax)

    def area(self) -> np.ndarray:
        """Area that the chords enclose, (n,) [mm^2]."""
        following = self.following
        n = len(self.first) - 1
        owner = np.repeat(np.arange(n), np.diff(self.first))
        return np.bincount(owner, 0.5 * (self.x * self.y[following] - self.x[following] * self.y), n)


def _chords(owner: np.ndarray, angle: np.ndarray, radius: np.ndarray, n: int) -> _Chords:
    """Polygons through the boundary points of n regions, given by owner, angle and radius, (m,) each."""
    key = _key(owner, angle)
    order = np.argsort(key, kind="stable")  # nearly sorted already
    owner, angle, radius = owner[order], angle[order], radius[order]
    first = np.searchsorted(owner, np.arange(n + 1))
    following = np.arange(1, len(owner) + 1)
    last = np.append(owner[1:] != owner[:-1], True)
    following[last] = first[owner[last]]
    return _Chords(key[order], first, radius * np.cos(angle), radius * np.sin(angle), following)


def _key(owner: np.ndarray, angle: np.ndarray) -> np.ndarray:
    """Numbers that sort directions by owner, then by angle from 0 to 2 pi."""
    return owner * 8.0 + angle % (2 * np.pi)


def _areas(bundles: StarRegions, rows: np.ndarray) -> np.ndarray:
    """Areas of the bounding polygons of some regions, by the shoelace formula [mm^2]."""
    x, y = np.moveaxis(bundles.polygons[rows], -1, 0)
    vertex = np.arange(x.shape[1])
    following = np.where(vertex + 1 < bundles.counts[rows, None], vertex + 1, 0)
    cross = x * np.take_along_axis(y, following, axis=1) - y * np.take_along_axis(x, following, axis=1)
    return 0.5 * np.sum(np.where(vertex < bundles.counts[rows, None], cross, 0.0), axis=1)
