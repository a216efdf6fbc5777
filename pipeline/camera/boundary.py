"""Search for the boundary of a lit region, given any predicate that traces rays.

Pupils, image circles, quadrature over bundles, micro-images and their contours all need the boundary of a region that
light fills. Each brings its own predicate and takes the rest from here: bracketing (the outer bound moves outwards
until it is dark) and bisection; an interior point; corners, where the blocking aperture changes; directions between
corners and the weight of each in an integral over the angle. All directions are searched side by side, so that a
predicate receives whole arrays of rays.

One search is of another kind, and says why: `camera.integrating.edge_search`.
"""

import functools
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from pipeline.records.shapes import Bool, Float64, Int64

_MOST_PER_ARC = 64
"""Most nodes on a piece of an arc: NumPy vouches for Gauss-Legendre nodes up to 100."""

_ARCS = 16
"""Parts of a circle to which an arc between corners is rounded up, so that doubling a number of directions keeps all of
them."""

Passes = Callable[[np.ndarray], np.ndarray]
"""Whether light passes at a distance along each direction, (...) float64 to (...) bool."""
LabelAt = Callable[[np.ndarray, np.ndarray], np.ndarray]
"""Labels of the obstacles that bound regions (m,) int64 in directions (m,) float64 [rad], (m,) int64."""


def widened(
    passes: Passes,
    low: Float64[np.ndarray, "..."],
    high: Float64[np.ndarray, "..."],
    farther: Callable[[np.ndarray], np.ndarray],
    limit: int,
) -> tuple[np.ndarray, np.ndarray]:
    """Brackets of the boundary, (...) each: `high` moves outwards by `farther` until it is dark, or `limit` times.

    `low` follows to the last lit point.
    """
    for _ in range(limit):
        lit = passes(high)
        if not lit.any():
            break
        low, high = np.where(lit, high, low), np.where(lit, farther(high), high)
    return low, high


def halved(
    passes: Passes, low: Float64[np.ndarray, "..."], high: Float64[np.ndarray, "..."], steps: int
) -> tuple[np.ndarray, np.ndarray]:
    """Brackets of the boundary, (...) each, after bisection: lit at `low`, dark at `high`."""
    for _ in range(steps):
        middle = (low + high) / 2
        lit = passes(middle)
        low, high = np.where(lit, middle, low), np.where(lit, high, middle)
    return low, high


def inner_points(points: Float64[np.ndarray, "n m 2"], lit: Bool[np.ndarray, "n m"]) -> np.ndarray:
    """The lit point of each row (n, m, 2) nearest to the mean of the lit ones, (n, 2); NaN where none is lit.

    The mean itself may be dark, as that of a crescent is.
    """
    number = lit.sum(axis=1)[:, None]
    mean = np.where(lit[..., None], points, 0.0).sum(axis=1) / np.maximum(number, 1)
    distance = np.where(lit, np.hypot(*(points - mean[:, None]).transpose(2, 0, 1)), np.inf)
    nearest = points[np.arange(len(points)), distance.argmin(axis=1)]
    return np.where(number > 0, nearest, np.nan)


def even_angles(count: int) -> np.ndarray:
    """Evenly spaced angles from +x on, (count,) [rad]."""
    return 2 * np.pi * np.arange(count) / count


def unit_vectors(angle: Float64[np.ndarray, "..."]) -> np.ndarray:
    """Unit vectors at angles from +x towards +y, (..., 2)."""
    return np.stack([np.cos(angle), np.sin(angle)], axis=-1)


class Corners(NamedTuple):
    """Corners of regions: row of the region, ascending, and direction from its interior point, ascending [rad]."""

    owner: np.ndarray
    angle: np.ndarray


class _Arcs(NamedTuple):
    """Arcs with a corner: row of the region, directions of both ends [rad], and labels there."""

    owner: np.ndarray
    left: np.ndarray
    right: np.ndarray
    before: np.ndarray
    after: np.ndarray

    def only(self, selected: np.ndarray) -> "_Arcs":
        """The arcs selected by a mask, or in another order by indices."""
        return _Arcs(*(values[selected] for values in self))


def corners(
    label_at: LabelAt,
    rows: Int64[np.ndarray, "n"],
    label: Int64[np.ndarray, "n d"],
    steps: int,
    turn: Float64[np.ndarray, "n"] | None = None,
) -> Corners:
    """Directions between which the label of the boundary changes, by bisection.

    A third label in between is an arc that the first directions missed: there are then two corners instead of one. Rows
    of regions ascend; their labels are those in `even_angles(d)`, rotated by `turn` [rad].
    """
    # Begin with the arcs between first directions whose labels differ.
    count = label.shape[1]
    next_label = np.roll(label, -1, axis=1)
    region, direction = np.nonzero(label != next_label)
    left = even_angles(count)[direction] + (0.0 if turn is None else turn[region])
    arcs = _Arcs(
        owner=rows[region],
        left=left,
        right=left + 2 * np.pi / count,
        before=label[region, direction],
        after=next_label[region, direction],
    )
    for _ in range(steps if len(region) else 0):
        # Halve each arc, and keep the half whose ends differ.
        middle = (arcs.left + arcs.right) / 2
        at_middle = label_at(arcs.owner, middle)
        is_before = at_middle == arcs.before
        is_third = ~is_before & (at_middle != arcs.after)
        halves = arcs._replace(
            left=np.where(is_before, middle, arcs.left),
            right=np.where(is_before, arcs.right, middle),
            after=np.where(is_third, at_middle, arcs.after),
        )
        # Where a third label lies between the ends, the other half holds a corner, too.
        other_halves = arcs._replace(left=middle, before=at_middle).only(is_third)
        arcs = _Arcs(*(np.concatenate(pair) for pair in zip(halves, other_halves, strict=True)))
        if is_third.any():
            arcs = arcs.only(np.lexsort((arcs.left, arcs.owner)))
    return Corners(arcs.owner, (arcs.left + arcs.right) / 2)


@functools.cache
def unit_nodes(count: int) -> tuple[np.ndarray, np.ndarray]:
    """Gauss-Legendre nodes on [0, 1] and their weights, (count,) each: exact up to the degree 2 count - 1."""
    nodes, weights = np.polynomial.legendre.leggauss(count)
    return (nodes + 1) / 2, weights / 2


def between(corners: Float64[np.ndarray, "c"], count: int) -> tuple[np.ndarray, np.ndarray]:
    """At least `count` directions, a multiple of 16: at corners and evenly spaced between them.

    Returns their angles, (n,), and the angle from each to the next, (n,) [rad]. Twice the count keeps them and adds one
    between any two.
    """
    arc = np.diff(corners, append=corners[:1] + 2 * np.pi)
    number = count // _ARCS * np.ceil(_ARCS * arc / (2 * np.pi)).astype(int)
    width = np.repeat(arc / number, number)
    return corners[:1] + np.cumsum(width) - width, width


class Directions(NamedTuple):
    """Directions of a quadrature: row of the region (m,), ascending; angle, and weight in an integral over it [rad]."""

    owner: np.ndarray
    angle: np.ndarray
    angular_weight: np.ndarray


def directions(
    rows: Int64[np.ndarray, "n"], between: Corners, around: int, least_per_arc: int, even: int | None = None
) -> Directions:
    """Directions around regions: evenly spaced, or Gauss-Legendre nodes on every arc between two corners.

    `between`: the corners of all regions.
    `around`, `least_per_arc`: nodes over a full circle with corners, and on its shortest arc.
    `even`: directions where there is no corner; None: as many as over a circle with corners.
    """
    # Regions without a corner have even directions.
    even = around if even is None else even
    smooth = rows[~np.isin(rows, between.owner)]
    parts = [(np.repeat(smooth, even), np.tile(even_angles(even), len(smooth)), 2 * np.pi / even)]
    # An arc runs from each corner to the next of its region, the last one to the first.
    owner, start = between
    last = np.append(owner[1:] != owner[:-1], True) if len(owner) else np.zeros(0, bool)
    first = np.searchsorted(owner, owner)
    length = np.where(last, start[first] + 2 * np.pi, np.roll(start, -1)) - start
    # Divide long arcs into equal pieces, which count as arcs from here on.
    pieces = np.ceil(around * length / (2 * np.pi) / _MOST_PER_ARC).astype(int)
    owner, length, start = (np.repeat(values, pieces) for values in (owner, length / pieces, start))
    number_in_arc = np.arange(len(owner)) - np.repeat(np.cumsum(pieces) - pieces, pieces)
    start = start + length * number_in_arc
    # Lay the nodes, for all arcs with equally many at once.
    nodes = np.maximum(np.ceil(around * length / (2 * np.pi)).astype(int), least_per_arc)
    for count in np.unique(nodes).tolist():
        node, weight = unit_nodes(count)
        arcs = nodes == count
        angle = (start[arcs, None] + length[arcs, None] * node).ravel()
        parts.append((np.repeat(owner[arcs], count), angle, (length[arcs, None] * weight).ravel()))
    # Sort all directions by region.
    owner, angle = (np.concatenate([part[i] for part in parts]) for i in (0, 1))
    angular_weight = np.concatenate([np.broadcast_to(part[2], part[0].shape) for part in parts])
    order = np.argsort(owner, kind="stable")
    return Directions(owner[order], angle[order], angular_weight[order])
