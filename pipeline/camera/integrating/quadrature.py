"""Integrals over bundles by quadrature within their traced boundary; vision frame, mm.

The boundary of the pupil is found by real rays, because only the trace knows which rays pass. About an interior point,
with R(phi) the radius of the boundary, an integral is

    I = integral over phi of integral over r from 0 to R(phi) of f(r, phi) r dr dphi

Gauss-Legendre nodes run along the radius. Over the angle they are evenly spaced where the boundary is one smooth curve,
for which the error falls faster than any power of their number, and Gauss-Legendre on each arc between two corners
otherwise. A corner is a direction in which the blocking aperture changes. All this requires a region that is
star-shaped about the point; one that is not is reported, not integrated.

A ring is not star-shaped about any point. But it is the region that passes without the obstruction, less the region
that the obstruction would block, and both are star-shaped: each is integrated about a point of its own.
"""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from pipeline.camera import boundary
from pipeline.camera.integrating import edge_kernels
from pipeline.camera.integrating.edge_kernels import Rule, Spans
from pipeline.camera.integrating.edge_search import PASSES
from pipeline.camera.integrating.radials import PROBES, StarRegions, agrees_with_probes
from pipeline.camera.parts.polygon import MAX_VERTICES
from pipeline.camera.tracing.microlens_kernels import AIM
from pipeline.camera.tracing.moments import COLUMNS, FREE_WEIGHT, VARIANCE, WEIGHT, mixed
from pipeline.camera.tracing.records import CameraArrays
from pipeline.camera.tracing.sampling_bounds import NO_MICROLENS, SKIP
from pipeline.optics.table import without_obstructions
from pipeline.records.shapes import Float64, Int64

EMPTY, INTEGRATED, NOT_STAR_SHAPED = range(3)
"""Outcomes of a bundle: nothing passes; integrated; its region is not star-shaped about an interior point."""

_FIRST_DIRECTIONS = 48
"""Directions of the first search for the boundary, before any corner is known: 7.5 degrees apart."""
_FIRST_STEPS = 8
"""Bisections of that search where only a centroid is needed: to 1/256 of the radius; any point well inside will do."""
_INNER_PROBES = 256
"""Points over the polygon that are tried where its middle is dark: a region of a few hundredths of it is found."""
_ROWS_AT_ONCE = 256
"""Regions whose points are tried together: bounds memory, and no result depends on it."""
_LEAST_PER_ARC = 4
"""Nodes on the shortest arc of a result: exact up to the seventh degree. Finer levels have more, and the coarser level
of an error estimate fewer: a difference does not show errors that both levels share."""
_LEAST = 1e-6
"""Share of the light behind obstructions below which a bundle is empty [1]: boundaries are known to 3e-8."""


@dataclass(frozen=True, slots=True)
class Effort:
    """Precision of the search for the boundary of bundles."""

    # Bisections of the direction of a corner, and of the boundary for each of them
    corner_steps: int
    corner_edge_steps: int
    edge_steps: int  # bisections of the boundary in the direction of a node


FINE = Effort(corner_steps=10, corner_edge_steps=18, edge_steps=24)
"""Effort for results: corners to 0.007 degrees, boundaries to 3e-8 of their radius."""
ROUGH = Effort(corner_steps=5, corner_edge_steps=12, edge_steps=20)
"""Effort for intermediate steps: corners to 0.2 degrees, boundaries to 5e-7 of their radius. Probes over the polygon
check these, too: a step that sees one piece of two goes far astray."""
STEADY = Effort(corner_steps=10, corner_edge_steps=18, edge_steps=44)
"""Effort for finite differences with a relative error of 1e-4: boundaries to rounding."""
SMOOTH = Effort(corner_steps=28, corner_edge_steps=44, edge_steps=44)
"""Effort for finite differences to rounding: if one of two rims moves, the boundary moves on one side of a corner only,
and an error of the corner becomes one of the difference."""


class Outcome(NamedTuple):
    """Moments (n, COLUMNS), as from `Tracer.moments`; EMPTY, INTEGRATED or NOT_STAR_SHAPED (n,); and rays traced."""

    moments: np.ndarray
    status: np.ndarray
    rays: int


class _Outline(NamedTuple):
    """The boundary of regions in the directions of a quadrature, and whether it encloses all of their light, (n,)."""

    spans: Spans
    encloses: np.ndarray


@dataclass(frozen=True, slots=True)
class Edges(StarRegions):
    """Regions with the corners of their boundaries, ready for integration."""

    corners: boundary.Corners
    rays: int  # traced
    effort: Effort
    # The last one, by nodes and `is_last`: it is found once for all planes
    _outlines: dict[tuple[tuple[int, int], bool], _Outline] = field(default_factory=dict, init=False, repr=False)

    def moments(self, planes: Float64[np.ndarray, "n 2 4 3"], nodes: tuple[int, int], is_last: bool = True) -> Outcome:
        """Integrate all bundles on two planes each.

        `nodes`: along the radius, and over the full circle.
        `is_last`: whether this is the finest level: its result is checked against probes over the polygon.
        """
        n = len(self.positions)
        result = np.full((n, COLUMNS), np.nan)
        status = np.full(n, EMPTY)
        rays = 0
        if (outline := self._outlines.get((nodes, is_last))) is None:
            self._outlines.clear()
            outline, rays = self._outline(nodes, is_last)
            self._outlines[nodes, is_last] = outline
        owner = outline.spans.owner
        if len(owner):
            # Sum moments over Gauss-Legendre nodes along each radius.
            rule = Rule(*boundary.unit_nodes(nodes[0]))
            star_shaped = np.zeros(n, bool)
            bundles = self.arrays, np.ascontiguousarray(planes), self.positions, self.microlens
            count = edge_kernels.integrate(*bundles, outline.spans, rule, result, star_shaped)
            edge_kernels.integrate.count(count, len(self.arrays.table))
            rays += count
            status[owner] = np.where(star_shaped & outline.encloses, INTEGRATED, NOT_STAR_SHAPED)[owner]
        # Quadrature has no variance; an empty bundle has weight 0.
        result[:, VARIANCE:] = 0.0
        result[:, FREE_WEIGHT] = self.free_sr
        result[status == EMPTY, WEIGHT] = 0.0
        return Outcome(result, status, rays)

    def _outline(self, nodes: tuple[int, int], is_last: bool) -> tuple[_Outline, int]:
        """The boundary in the directions of a quadrature, and the number of rays."""
        # Choose the directions, and find the boundary along each.
        least = max(nodes[0] // 2, _LEAST_PER_ARC if is_last else 0)
        owner, angle, angular_weight = boundary.directions(self.nonempty, self.corners, nodes[1], least)
        radius, _, polygon_radius, rays = self.edge_points(owner, angle, self.effort.edge_steps)
        along = boundary.unit_vectors(angle)
        spans = Spans(self.centres, owner, along, angular_weight, *self._pieces(owner, along, radius))
        # Test whether it encloses all of the light: by a ray beyond each boundary point, and by probes all over.
        encloses = self.nothing_beyond(owner, along, radius, polygon_radius)
        if is_last and len(owner):
            probes = PROBES * nodes[1]  # for each position
            agrees, probe_rays = agrees_with_probes(self, owner, angle, radius, angular_weight, probes)
            encloses &= agrees
            rays += probe_rays
        return _Outline(spans, encloses), rays + len(owner)

    def _pieces(self, owner: np.ndarray, along: np.ndarray, radius: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Starts and lengths of the pieces of each radius within which the weight is smooth, (m, pieces)."""
        # The acceptance of a cone has a kink where its roll-off begins: a circle about the foot of the sensor position.
        optics = self.arrays.optics
        microlenses = self.arrays.microlenses
        half_angle = self.arrays.acceptance.half_angle
        if not half_angle > 0.0:
            return np.zeros((len(owner), 1)), radius[:, None]
        height: float | np.ndarray = optics.sampling_z_mm - optics.sensor_z_mm
        if len(microlenses):
            height = microlenses[self.microlens[owner], AIM]
        # Cut each radius where it crosses the circle: half a chord before and behind the middle of the chord.
        from_foot = self.centres[owner] - self.positions[owner]
        chord_middle = -np.sum(from_foot * along, axis=1)
        squared = (height * np.tan(half_angle)) ** 2 - np.sum(from_foot**2, axis=1) + chord_middle**2
        half_chord = np.sqrt(np.maximum(squared, 0.0))
        cuts = np.stack([chord_middle - half_chord, chord_middle + half_chord], axis=1)
        ends = np.column_stack([np.zeros(len(owner)), np.clip(cuts, 0.0, radius[:, None]), radius])
        return np.ascontiguousarray(ends[:, :-1]), np.diff(ends, axis=1)  # or the kernel would be compiled once more


def edges(
    arrays: CameraArrays,
    positions_mm: Float64[np.ndarray, "n 2"],
    microlens: Int64[np.ndarray, "n"],
    effort: Effort = FINE,
    within: StarRegions | None = None,
) -> Edges:
    """Find interior points and corners of the regions of sensor positions (n, 2) behind their microlenses (n,).

    `within`: regions that contain them, in which interior points are searched.
    """
    return with_corners(replace(inner_points(arrays, positions_mm, microlens, within), effort=effort))


def with_corners(bundles: Edges) -> Edges:
    """The regions with the corners of their boundaries."""
    owner, angle = bundles.directions(_FIRST_DIRECTIONS)
    # Behind a lens alone a rim first cuts the pupil towards the axis or away from it: rotated to start there, the
    # directions catch an arc however short.
    turn = np.where(bundles.microlens == NO_MICROLENS, np.arctan2(*bundles.positions.T[::-1]), 0.0)
    # The obstacle far outside of the boundary need not be the one at it: corners need a sharp boundary.
    _, label, _, rays = bundles.edge_points(owner, angle + turn[owner], bundles.effort.corner_edge_steps)
    corners, rays_of_corners = _corners(bundles, label, turn)
    return replace(bundles, corners=corners, rays=bundles.rays + rays + rays_of_corners)


def inner_points(
    arrays: CameraArrays,
    positions_mm: Float64[np.ndarray, "n 2"],
    microlens: Int64[np.ndarray, "n"],
    within: StarRegions | None = None,
) -> Edges:
    """Find the interior points of the regions of sensor positions, without corners.

    `within`: regions that contain them, in which interior points are searched.
    """
    # Bound the regions, and find a lit point in each.
    bundles = bounded(arrays, positions_mm, microlens)
    rays = _find_centres(bundles, within)
    # Move it to the centroid of a coarse boundary.
    owner, angle = bundles.directions(_FIRST_DIRECTIONS)
    radius, _, _, rays_of_edge = bundles.edge_points(owner, angle, _FIRST_STEPS)
    return replace(bundles, rays=rays + rays_of_edge + _move_to_middle(bundles, owner, radius))


def bounded(arrays: CameraArrays, positions_mm: Float64[np.ndarray, "n 2"], microlens: Int64[np.ndarray, "n"]) -> Edges:
    """Regions with only the polygons that enclose them; interior points are NaN."""
    positions = np.ascontiguousarray(positions_mm, float)
    microlens = np.ascontiguousarray(microlens, np.int64)
    n = len(positions)
    polygons = np.zeros((n, MAX_VERTICES, 2))
    counts = np.zeros(n, np.int64)
    free_sr = np.zeros(n)
    edge_kernels.bounds(arrays, positions, microlens, polygons, counts, free_sr)
    no_corners = boundary.Corners(np.zeros(0, np.int64), np.zeros(0))
    return Edges(
        arrays,
        positions,
        microlens,
        polygons,
        counts,
        free_sr=free_sr,
        centres=np.full((n, 2), np.nan),
        corners=no_corners,
        rays=0,
        effort=FINE,
    )


def _find_centres(bundles: Edges, within: StarRegions | None) -> int:
    """Write an interior point of every region: the middle of its polygon if that is lit, else one of a search.

    Returns the number of rays.
    """
    candidates = np.flatnonzero(bundles.counts >= 3)
    is_vertex = np.arange(MAX_VERTICES) < bundles.counts[candidates, None]
    middle = (bundles.polygons[candidates] * is_vertex[..., None]).sum(axis=1) / bundles.counts[candidates, None]
    passed = bundles.probe(candidates, middle) == PASSES
    bundles.centres[candidates[passed]] = middle[passed]
    rays = len(candidates)
    rays += _probe_for_centres(bundles, candidates[~passed], lambda rows: bundles.spread(rows, _INNER_PROBES))
    if within is not None:
        rays += _probe_for_centres(bundles, candidates[np.isnan(bundles.centres[candidates, 0])], within.points_inside)
    return rays


def _probe_for_centres(bundles: Edges, rows: np.ndarray, points_of: Callable[[np.ndarray], np.ndarray]) -> int:
    """Write an interior point of some regions: the middle one of the lit points among (rows, m, 2).

    `points_of` returns these points for rows. Returns the number of rays.
    """
    rays = 0
    for first in range(0, len(rows), _ROWS_AT_ONCE):
        batch = rows[first : first + _ROWS_AT_ONCE]
        points = points_of(batch)
        label = bundles.probe(np.repeat(batch, points.shape[1]), points.reshape(-1, 2)).reshape(points.shape[:2])
        bundles.centres[batch] = boundary.inner_points(points, label == PASSES)
        rays += label.size
    return rays


def _move_to_middle(bundles: Edges, owner: np.ndarray, radius: np.ndarray) -> int:
    """Move interior points to the centroids of their regions, within the first directions, if those are lit.

    Returns the number of rays.
    """
    n = len(bundles.positions)
    # A thin sector has an area as r^2 / 2, and its centroid at 2 r / 3: the centroid of all, relative to the interior
    # point, is the sum of r^3 u over 3/2 of the sum of r^2.
    denominator = np.bincount(owner, 1.5 * radius**2, n)
    directions = boundary.unit_vectors(boundary.even_angles(_FIRST_DIRECTIONS))
    along = np.tile(directions, (len(owner) // _FIRST_DIRECTIONS, 1))
    numerator = np.stack([np.bincount(owner, radius**3 * component, n) for component in along.T], axis=1)
    nonempty = np.flatnonzero(denominator > 0)
    centroid = bundles.centres[nonempty] + numerator[nonempty] / denominator[nonempty, None]
    passed = bundles.probe(nonempty, centroid) == PASSES
    bundles.centres[nonempty[passed]] = centroid[passed]
    return len(nonempty)


def _corners(bundles: Edges, label: np.ndarray, turn: np.ndarray) -> tuple[boundary.Corners, int]:
    """Corners of all boundaries from their labels in the first directions, rotated by (n,), and the number of rays."""
    rays = 0

    def label_at(owner: np.ndarray, angle: np.ndarray) -> np.ndarray:
        """Labels of the obstacles at the boundary in other directions."""
        nonlocal rays
        points = bundles.edge_points(owner, angle, bundles.effort.corner_edge_steps)
        rays += points.rays
        return points.label

    labels = label.reshape(-1, _FIRST_DIRECTIONS)
    steps = bundles.effort.corner_steps
    return boundary.corners(label_at, bundles.nonempty, labels, steps, turn[bundles.nonempty]), rays


class Regions(NamedTuple):
    """Signed regions: first the one without obstructions, then those that obstructions would block."""

    parts: list[tuple[float, Edges]]

    @property
    def rays(self) -> int:
        """Number of rays traced."""
        return sum(part.rays for _, part in self.parts)

    def moments(self, planes: Float64[np.ndarray, "n 2 4 3"], nodes: tuple[int, int], is_last: bool = True) -> Outcome:
        """Integrate all bundles, as `Edges.moments`."""
        outcomes = [part.moments(planes, nodes, is_last) for _, part in self.parts]
        if len(outcomes) == 1:
            return outcomes[0]
        # Add and subtract the regions by their signs. The free weight is that of the first.
        moments = np.stack([outcome.moments for outcome in outcomes], axis=1)
        result = mixed(moments, np.array([sign for sign, _ in self.parts]))
        result[:, FREE_WEIGHT] = moments[:, 0, FREE_WEIGHT]
        # A bundle is empty if obstructions leave nothing of it, and not integrated if one of its regions is not.
        statuses = np.stack([outcome.status for outcome in outcomes], axis=1)
        status = statuses[:, 0].copy()
        status[~(result[:, WEIGHT] > _LEAST * moments[:, 0, WEIGHT])] = EMPTY
        status[(statuses == NOT_STAR_SHAPED).any(axis=1)] = NOT_STAR_SHAPED
        result[status == EMPTY, :WEIGHT] = np.nan
        result[status == EMPTY, WEIGHT] = 0.0
        return Outcome(result, status, sum(outcome.rays for outcome in outcomes))

    def next_to(
        self, arrays: CameraArrays, positions_mm: Float64[np.ndarray, "n 2"], microlens: Int64[np.ndarray, "n"]
    ) -> "Regions":
        """The regions of a neighbouring camera or of neighbouring positions, with interior points and corners frozen.

        Integrals over both differ smoothly; only boundaries are found again.
        """
        tables = [table for _, table in without_obstructions(arrays.table)]
        neighbours = []
        for (sign, part), table in zip(self.parts, tables, strict=True):
            behind = np.where(part.microlens == SKIP, SKIP, microlens)
            neighbour = bounded(arrays._replace(table=table), positions_mm, behind)
            frozen = replace(neighbour, centres=part.centres, corners=part.corners, effort=part.effort)
            neighbours.append((sign, frozen))
        return Regions(neighbours)


def regions(
    arrays: CameraArrays,
    positions_mm: Float64[np.ndarray, "n 2"],
    microlens: Int64[np.ndarray, "n"],
    effort: Effort = FINE,
) -> Regions:
    """Find the regions of sensor positions (n, 2) behind their microlenses (n,)."""
    (sign, table), *obstructed = without_obstructions(arrays.table)
    outer = edges(arrays._replace(table=table), positions_mm, microlens, effort)
    # A position that is dark without obstructions has nothing that they could block.
    lit_microlens = np.where(np.isnan(outer.centres[:, 0]), SKIP, microlens)
    blocked = [
        (sign_of_part, edges(arrays._replace(table=part), positions_mm, lit_microlens, effort, within=outer))
        for sign_of_part, part in obstructed
    ]
    return Regions([(sign, outer), *blocked])
