"""Integrals over bundles by quadrature over the traced edge of what passes; vision frame, mm.

The edge is found by real rays, because only the trace knows what passes. From an inner point, nodes of
Gauss and Legendre along the radius times nodes over the angle: evenly spaced ones where the edge is one smooth curve
(then their error falls faster than any power of their number), else those of Gauss and Legendre on each arc between two
corners. A corner is where the aperture that blocks changes. All of it needs a region that is star-shaped about the
point; one that is not is reported, not integrated.

A ring has no point from which all of it is seen. But it is what would pass without the obstruction, less what would
meet it, and both are star-shaped: so each is integrated by itself, about a point of its own.

Hits of single nodes are smooth functions of the sensor position, which random rays' are not, where nodes are polar:
about one inner point for all positions near each other, at shares of the way to the traced edge.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from pipeline.camera import boundary
from pipeline.camera.integrating import edge_kernels
from pipeline.camera.integrating.edge_kernels import Rule, Spans
from pipeline.camera.integrating.edge_search import PASSES
from pipeline.camera.integrating.ways import PROBES, Ways, holds_all
from pipeline.camera.parts.polygon import MAX_VERTICES
from pipeline.camera.tracing.microlens_kernels import AIM
from pipeline.camera.tracing.moments import COLUMNS, FREE_WEIGHT, VARIANCE, WEIGHT, mixed
from pipeline.camera.tracing.records import CameraArrays
from pipeline.camera.tracing.sampling_bounds import NO_MICROLENS, SKIP
from pipeline.optics.table import without_obstructions
from pipeline.records.shapes import Bool, Float64, Int64

EMPTY, INTEGRATED, NOT_STAR_SHAPED = range(3)
"""Outcomes of a bundle: nothing passes; integrated; its region is not star-shaped about an inner point."""

_FIRST_DIRECTIONS = 48
"""Directions in which the edge is looked at before any of its corners is known: 7.5 degrees apart."""
_FIRST_STEPS = 8
"""Bisections there, for the middle of what passes: to 1/256 of the way, and any point well inside will do."""
_INNER_PROBES = 256
"""Points all over the polygon that are tried where its middle is dark: a region of a few hundredths of it is found."""
_ROWS_AT_ONCE = 256
"""Regions of which such points are tried together: bounds memory, and no result depends on it."""
_LEAST_PER_ARC = 4
"""Nodes on the shortest arc of a result: exact up to the seventh degree. Finer levels have more, and the coarser one
that a result is compared with fewer: what all levels integrate alike, their differences do not show."""
_LEAST = 1e-6
"""Share of the light that obstructions leave below which a bundle is empty [1]: edges are known to 3e-8."""
_INSIDE = 1 - 1e-7
"""Place of the outermost rays over that of the edge [1]: they must pass, and edges are known to 3e-8 of the way."""


@dataclass(frozen=True, slots=True)
class Effort:
    """Work that an integral may cost."""

    # Bisections of the direction of a corner, and of the edge for each of them
    corner_steps: int
    corner_edge_steps: int
    edge_steps: int  # bisections of the edge in the direction of a node


FINE = Effort(corner_steps=10, corner_edge_steps=18, edge_steps=24)
"""Effort for results: corners to 0.007 degrees, edges to 3e-8 of their way."""
ROUGH = Effort(corner_steps=5, corner_edge_steps=12, edge_steps=20)
"""Effort for steps on the way to a result: corners to 0.2 degrees, edges to 5e-7 of their way. It is held against rays
over the whole bound, too: a step that sees one piece of two goes far astray."""
STEADY = Effort(corner_steps=10, corner_edge_steps=18, edge_steps=44)
"""Effort for differences of neighbours that may err by 1e-4 of themselves: edges to rounding."""
SMOOTH = Effort(corner_steps=28, corner_edge_steps=44, edge_steps=44)
"""Effort for differences of neighbours, to rounding: where one of two rims moves, the edge moves on one side of a
corner alone, and an error of the corner is one of the difference.
"""


class Outcome(NamedTuple):
    """Moments (n, COLUMNS), as of `Tracer.moments`; EMPTY, INTEGRATED or NOT_STAR_SHAPED (n,); and rays traced."""

    moments: np.ndarray
    status: np.ndarray
    rays: int


@dataclass(frozen=True, slots=True)
class Edges(Ways):
    """Regions that rays pass, and the means to integrate over them."""

    corners: boundary.Corners
    rays: int  # traced so far
    effort: Effort

    def moments(self, planes: Float64[np.ndarray, "n 2 4 3"], nodes: tuple[int, int], is_last: bool = True) -> Outcome:
        """Integrate all bundles on two planes of each.

        `nodes`: along the radius, and over the full circle.
        `is_last`: whether it is a result, and no finer level follows: rays over the whole bound are held against that.
        """
        n = len(self.positions)
        result, status = np.full((n, COLUMNS), np.nan), np.full(n, EMPTY)
        least = max(nodes[0] // 2, _LEAST_PER_ARC if is_last else 0)
        owner, angle, share = boundary.directions(self.lit, self.corners, nodes[1], least)
        radius, _, limit, rays = self.find(owner, angle, self.effort.edge_steps)
        if len(owner):
            along = boundary.unit_vectors(angle)
            ways = Spans(self.centres, owner, along, share, *self._pieces(owner, along, radius))
            whole, rule = np.zeros(n, bool), Rule(*boundary.unit_nodes(nodes[0]))
            given = self.arrays, np.ascontiguousarray(planes), self.positions, self.microlens
            count = edge_kernels.integrate(*given, ways, rule, result, whole)
            edge_kernels.integrate.count(count, len(self.arrays.table))
            rays += count + len(owner)
            whole &= self.nothing_beyond(owner, along, radius, limit)
            if is_last:
                held, more = holds_all(self, owner, angle, radius, share, PROBES * nodes[1])
                whole, rays = whole & held, rays + more
            status[owner] = np.where(whole, INTEGRATED, NOT_STAR_SHAPED)[owner]
        result[:, VARIANCE:] = 0.0
        result[:, FREE_WEIGHT] = self.free_sr
        result[status == EMPTY, WEIGHT] = 0.0
        return Outcome(result, status, rays)

    def _pieces(self, owner: np.ndarray, along: np.ndarray, radius: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Starts and lengths of the parts of each way to the edge, (m, parts), within which the weight is smooth."""
        # The acceptance of a cone has a kink where its roll-off begins: a circle about the foot of the sensor position.
        optics, microlenses, half_angle = self.arrays.optics, self.arrays.microlenses, self.arrays.acceptance.half_angle
        if not half_angle > 0.0:
            return np.zeros((len(owner), 1)), radius[:, None]
        height: float | np.ndarray = optics.sampling_z_mm - optics.sensor_z_mm
        if len(microlenses):
            height = microlenses[self.microlens[owner], AIM]
        away = self.centres[owner] - self.positions[owner]
        towards = -np.sum(away * along, axis=1)
        squared = (height * np.tan(half_angle)) ** 2 - np.sum(away**2, axis=1) + towards**2
        half = np.sqrt(np.maximum(squared, 0.0))
        marks = np.clip(np.stack([towards - half, towards + half], axis=1), 0.0, radius[:, None])
        marks = np.column_stack([np.zeros(len(owner)), marks, radius])
        return marks[:, :-1], np.diff(marks, axis=1)


def edges(
    arrays: CameraArrays,
    positions_mm: Float64[np.ndarray, "n 2"],
    microlens: Int64[np.ndarray, "n"],
    effort: Effort = FINE,
    within: Ways | None = None,
) -> Edges:
    """Find inner points and corners of what passes for sensor positions (n, 2) behind their microlenses (n,), of
    regions that lie within others, if given, all over those."""
    return _with_corners(replace(inner_points(arrays, positions_mm, microlens, within), effort=effort))


def _with_corners(bundles: Edges) -> Edges:
    owner, angle = bundles.spokes(_FIRST_DIRECTIONS)
    # Behind a lens alone a rim begins to cut towards the axis or away from it: an arc is seen there however short.
    turn = np.where(bundles.microlens == NO_MICROLENS, np.arctan2(*bundles.positions.T[::-1]), 0.0)
    # What blocks far outside of the edge need not be what cuts it: corners want sharp edges.
    _, label, _, fine = bundles.find(owner, angle + turn[owner], bundles.effort.corner_edge_steps)
    corners, again = _corners(bundles, label, turn)
    return replace(bundles, corners=corners, rays=bundles.rays + fine + again)


def inner_points(
    arrays: CameraArrays,
    positions_mm: Float64[np.ndarray, "n 2"],
    microlens: Int64[np.ndarray, "n"],
    within: Ways | None = None,
) -> Edges:
    """The same without corners."""
    bundles = bounded(arrays, positions_mm, microlens)
    rays = _settle_centres(bundles, within)
    owner, angle = bundles.spokes(_FIRST_DIRECTIONS)
    radius, _, _, more = bundles.find(owner, angle, _FIRST_STEPS)
    return replace(bundles, rays=rays + more + _move_to_middle(bundles, owner, radius))


def bounded(arrays: CameraArrays, positions_mm: Float64[np.ndarray, "n 2"], microlens: Int64[np.ndarray, "n"]) -> Edges:
    """Only the polygons that enclose what passes; inner points are NaN."""
    positions, microlens = np.ascontiguousarray(positions_mm, float), np.ascontiguousarray(microlens, np.int64)
    n = len(positions)
    polygons, counts, free = np.zeros((n, MAX_VERTICES, 2)), np.zeros(n, np.int64), np.zeros(n)
    edge_kernels.bounds(arrays, positions, microlens, polygons, counts, free)
    none = boundary.Corners(np.zeros(0, np.int64), np.zeros(0))
    return Edges(arrays, positions, microlens, polygons, counts, free, np.full((n, 2), np.nan), none, 0, FINE)


def _settle_centres(bundles: Edges, within: Ways | None) -> int:
    """Write an inner point of every region: the middle of its polygon where that is lit, else one of a search."""
    candidates = np.flatnonzero(bundles.counts >= 3)
    inside = np.arange(MAX_VERTICES) < bundles.counts[candidates, None]
    middle = (bundles.polygons[candidates] * inside[..., None]).sum(axis=1) / bundles.counts[candidates, None]
    passed = bundles.probe(candidates, middle) == PASSES
    bundles.centres[candidates[passed]] = middle[passed]
    rays = len(candidates) + _try(bundles, candidates[~passed], lambda rows: bundles.spread(rows, _INNER_PROBES))
    if within is not None:
        rays += _try(bundles, candidates[np.isnan(bundles.centres[candidates, 0])], within.all_over)
    return rays


def _try(bundles: Edges, rows: np.ndarray, points_of: Callable[[np.ndarray], np.ndarray]) -> int:
    """Write an inner point of some regions: the middle one of those points (rows, m, 2) that are lit."""
    rays = 0
    for first in range(0, len(rows), _ROWS_AT_ONCE):
        some = rows[first : first + _ROWS_AT_ONCE]
        points = points_of(some)
        label = bundles.probe(np.repeat(some, points.shape[1]), points.reshape(-1, 2)).reshape(points.shape[:2])
        bundles.centres[some], rays = boundary.inner_points(points, label == PASSES), rays + label.size
    return rays


def _move_to_middle(bundles: Edges, owner: np.ndarray, radius: np.ndarray) -> int:
    """Move inner points to the centroids of their regions, which the first directions enclose, where those pass."""
    n, angle = len(bundles.positions), boundary.even_angles(_FIRST_DIRECTIONS)
    area, lever, points = np.bincount(owner, 1.5 * radius**2, n), radius**3, len(owner) // len(angle)
    along = np.tile(np.cos(angle), points), np.tile(np.sin(angle), points)
    moved = np.stack([np.bincount(owner, lever * part, n) for part in along], axis=1)
    some = np.flatnonzero(area > 0)
    middle = bundles.centres[some] + moved[some] / area[some, None]
    passed = bundles.probe(some, middle) == PASSES
    bundles.centres[some[passed]] = middle[passed]
    return len(some)


def _corners(bundles: Edges, label: np.ndarray, turn: np.ndarray) -> tuple[boundary.Corners, int]:
    """Corners of all edges from their labels in the first directions, turned by (n,), and the number of rays."""
    rays = 0

    def label_at(owner: np.ndarray, angle: np.ndarray) -> np.ndarray:
        nonlocal rays
        _, label, _, more = bundles.find(owner, angle, bundles.effort.corner_edge_steps)
        rays += more
        return label

    each = label.reshape(-1, _FIRST_DIRECTIONS)
    return boundary.corners(label_at, bundles.lit, each, bundles.effort.corner_steps, turn[bundles.lit]), rays


class Regions(NamedTuple):
    """Regions with signs: what passes without obstructions, first, and what would meet them."""

    parts: list[tuple[float, Edges]]

    @property
    def rays(self) -> int:
        """Traced so far."""
        return sum(part.rays for _, part in self.parts)

    def moments(self, planes: Float64[np.ndarray, "n 2 4 3"], nodes: tuple[int, int], is_last: bool = True) -> Outcome:
        """Integrate all bundles, as `Edges.moments`."""
        each = [part.moments(planes, nodes, is_last) for _, part in self.parts]
        if len(each) == 1:
            return each[0]
        moments = np.stack([part.moments for part in each], axis=1)
        outcomes = np.stack([part.status for part in each], axis=1)
        result, outcome = mixed(moments, np.array([sign for sign, _ in self.parts])), outcomes[:, 0].copy()
        result[:, FREE_WEIGHT] = moments[:, 0, FREE_WEIGHT]
        outcome[~(result[:, WEIGHT] > _LEAST * moments[:, 0, WEIGHT])] = EMPTY
        outcome[(outcomes == NOT_STAR_SHAPED).any(axis=1)] = NOT_STAR_SHAPED
        result[outcome == EMPTY, :WEIGHT], result[outcome == EMPTY, WEIGHT] = np.nan, 0.0
        return Outcome(result, outcome, sum(part.rays for part in each))

    def next_to(
        self, arrays: CameraArrays, positions_mm: Float64[np.ndarray, "n 2"], microlens: Int64[np.ndarray, "n"]
    ) -> "Regions":
        """The regions of a camera and positions next to these: inner points and directions of corners stay, so that
        integrals over both differ smoothly, and only edges are found again.
        """
        tables = [table for _, table in without_obstructions(arrays.table)]
        moved = []
        for (sign, part), table in zip(self.parts, tables, strict=True):
            behind = np.where(part.microlens == SKIP, SKIP, microlens)
            there = bounded(arrays._replace(table=table), positions_mm, behind)
            moved.append((sign, replace(there, centres=part.centres, corners=part.corners, effort=part.effort)))
        return Regions(moved)


def regions(
    arrays: CameraArrays,
    positions_mm: Float64[np.ndarray, "n 2"],
    microlens: Int64[np.ndarray, "n"],
    effort: Effort = FINE,
) -> Regions:
    """Find the regions of sensor positions (n, 2) behind their microlenses (n,)."""
    (sign, table), *others = without_obstructions(arrays.table)
    whole = edges(arrays._replace(table=table), positions_mm, microlens, effort)
    lit = np.where(np.isnan(whole.centres[:, 0]), SKIP, microlens)
    taken = [(s, edges(arrays._replace(table=part), positions_mm, lit, effort, whole)) for s, part in others]
    return Regions([(sign, whole), *taken])


@dataclass(frozen=True, slots=True)
class Hits:
    """Rays of n positions at a directions and r shares of the radius."""

    on_plane: Float64[np.ndarray, "n a r 2"]  # coordinates on the plane of each position
    # Weight per area of the unit disc: the integral over a bundle is that of density times share d(share) d(angle)
    density_sr: Float64[np.ndarray, "n a r"]
    angle: Float64[np.ndarray, "a"]  # from each direction to the next [rad]
    # Whether every ray passes, none beyond the edge, and rays all over the bound where the edge says: the bundle is
    # star-shaped about its inner point, and all of it
    whole: Bool[np.ndarray, "n"]


class Polar(NamedTuple):
    """Nodes about an inner point."""

    shares: np.ndarray  # (r,) float64, shares of the way from the inner point to the edge
    directions: int  # evenly spaced: a multiple of 16
    has_corners: bool = False  # also directions of corners, as of `boundary.between`: at least as many
    about: int = 0  # the position whose inner point serves all of them


def bundle_hits(
    arrays: CameraArrays,
    positions_mm: Float64[np.ndarray, "n 2"],
    microlens: int,
    plane: Float64[np.ndarray, "4 3"],
    nodes: Polar,
) -> Hits:
    """Trace the bundles of neighbouring positions (n, 2) behind one microlens, or behind none, to a plane."""
    shares, directions, has_corners, about = nodes
    n, behind = len(positions_mm), np.full(len(positions_mm), microlens)
    home, ways = inner_points(arrays, positions_mm[[about]], behind[:1]), bounded(arrays, positions_mm, behind)
    if np.isnan(home.centres).any() or (ways.counts < 3).any():
        nothing = np.full((n, directions, len(shares)), np.nan)
        return Hits(np.stack([nothing, nothing], axis=-1), nothing, nothing[0, :, 0], np.zeros(n, bool))
    # Without a microlens what passes moves along with the position, by the drift of the outlines.
    drift = arrays.optics.drift if microlens == NO_MICROLENS else 0.0
    ways.centres[:] = home.centres + drift * (ways.positions - home.positions)
    corners = _with_corners(home).corners.angle if has_corners else np.zeros(0)
    angle, width = boundary.between(corners if len(corners) else np.zeros(1), directions)
    owner, directions = np.repeat(np.arange(n), len(angle)), len(angle)
    angle, share = np.tile(angle, n), np.tile((width + np.roll(width, 1)) / 2, n)
    radius, _, limit, _ = ways.find(owner, angle)
    held, _ = holds_all(ways, owner, angle, radius, share, PROBES * directions)
    along = boundary.unit_vectors(angle)
    points = ways.centres[owner, None] + (_INSIDE * radius[:, None] * shares)[..., None] * along[:, None]
    shape, hit = (n, directions, len(shares)), edge_kernels.empty_hits(n * directions * len(shares))
    planes = np.repeat(np.ascontiguousarray(plane)[None], n, axis=0)
    starts = ways.positions, behind, np.repeat(owner, len(shares)), points.reshape(-1, 2)
    edge_kernels.hits(arrays, planes, *starts, hit)
    edge_kernels.hits.count(len(hit.density), len(arrays.table))
    whole = held & hit.passes.reshape(shape).all(axis=(1, 2)) & ways.nothing_beyond(owner, along, radius, limit)
    density = hit.density.reshape(shape) * (radius**2).reshape(n, directions, 1)
    return Hits(hit.on_plane.reshape(*shape, 2), density, width, whole)


def single_hits(
    arrays: CameraArrays,
    positions_mm: Float64[np.ndarray, "n 2"],
    microlens: Int64[np.ndarray, "n"],
    aims_mm: Float64[np.ndarray, "n 2"],
    planes: Float64[np.ndarray, "n 4 3"],
) -> np.ndarray:
    """Hits of rays from positions towards aims of the sampling plane on a plane of each, (n, 2); NaN: none."""
    hit = edge_kernels.empty_hits(len(positions_mm))
    given = map(np.ascontiguousarray, (planes, positions_mm, microlens, np.arange(len(microlens)), aims_mm))
    edge_kernels.hits(arrays, *given, hit)
    edge_kernels.hits.count(len(positions_mm), len(arrays.table))
    return np.where(hit.passes[:, None], hit.on_plane, np.nan)
