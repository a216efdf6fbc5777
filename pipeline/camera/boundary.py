"""The boundary of what passes, for whoever can tell whether a ray does: the one search of it in this package.

Pupils, image circles, quadrature over bundles, micro-images and their contours all look at a region that light fills.
Each brings its own predicate, a function that traces rays, and takes the rest from here: bounds that are moved outwards
until they are dark, and halved; an inner point; corners, where what blocks changes; directions and their shares of the
circle between corners. All ways are searched side by side, so that a predicate gets whole arrays of rays.

One search is not of this kind, and says why: `camera.integrating.edge_search`.
"""

import functools
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from pipeline.records.shapes import Bool, Float64, Int64

_MOST_PER_ARC = 64
"""Nodes on the longest piece of an arc: NumPy vouches for Gauss-Legendre nodes up to 100."""

_ARCS = 16
"""Parts of a circle of which an arc between corners counts as a whole number: so the directions of a count are among
those of its double."""

Passes = Callable[[np.ndarray], np.ndarray]
"""Whether light passes at some distance along each way, (...) float64 to (...) bool."""
LabelAt = Callable[[np.ndarray, np.ndarray], np.ndarray]
"""Labels of what ends the light of regions (m,) int64 in directions (m,) float64 [rad], (m,) int64."""


def widened(
    passes: Passes, low: Float64[np.ndarray, "..."], high: Float64[np.ndarray, "..."], farther: Passes, most: int
) -> tuple[np.ndarray, np.ndarray]:
    """Outer bounds moved outwards by `farther` until they are dark, inner ones that follow to the last lit place."""
    for _ in range(most):
        lit = passes(high)
        if not lit.any():
            break
        low, high = np.where(lit, high, low), np.where(lit, farther(high), high)
    return low, high


def halved(
    passes: Passes, low: Float64[np.ndarray, "..."], high: Float64[np.ndarray, "..."], steps: int
) -> tuple[np.ndarray, np.ndarray]:
    """Bounds of the boundary along many ways, (...) each, after so many bisections: lit at `low`, dark at `high`."""
    for _ in range(steps):
        middle = (low + high) / 2
        lit = passes(middle)
        low, high = np.where(lit, middle, low), np.where(lit, high, middle)
    return low, high


def inner_points(points: Float64[np.ndarray, "n m 2"], lit: Bool[np.ndarray, "n m"]) -> np.ndarray:
    """The lit one of some points (n, m, 2) that is nearest to the mean of all lit ones, (n, 2); NaN where none is.

    The mean itself may be dark: a crescent's is.
    """
    number = lit.sum(axis=1)[:, None]
    mean = np.where(lit[..., None], points, 0.0).sum(axis=1) / np.maximum(number, 1)
    away = np.where(lit, np.hypot(*(points - mean[:, None]).transpose(2, 0, 1)), np.inf)
    nearest = points[np.arange(len(points)), away.argmin(axis=1)]
    return np.where(number > 0, nearest, np.nan)


def even_angles(count: int) -> np.ndarray:
    """Angles all around, from +x on, (count,) [rad]."""
    return 2 * np.pi * np.arange(count) / count


def unit_vectors(angle: Float64[np.ndarray, "..."]) -> np.ndarray:
    """Unit vectors in directions from +x towards +y, (..., 2)."""
    return np.stack([np.cos(angle), np.sin(angle)], axis=-1)


class Corners(NamedTuple):
    """Corners of regions: rows of the regions, ascending, and directions from their inner points, ascending [rad]."""

    owner: np.ndarray
    angle: np.ndarray


def corners(
    label_at: LabelAt,
    rows: Int64[np.ndarray, "n"],
    label: Int64[np.ndarray, "n d"],
    steps: int,
    turn: Float64[np.ndarray, "n"] | None = None,
) -> Corners:
    """Directions between which the label of the edge changes, bisected.

    A third label in between is an arc that the first directions missed: then there are two corners instead of one.
    Rows of regions ascend; their labels are those in `even_angles(d)`, turned by `turn` [rad].
    """
    count = label.shape[1]
    region, place = np.nonzero(label != np.roll(label, -1, axis=1))
    before, after = label[region, place], np.roll(label, -1, axis=1)[region, place]
    owner, left = rows[region], even_angles(count)[place] + (0.0 if turn is None else turn[region])
    right = left + 2 * np.pi / count
    for _ in range(steps if len(owner) else 0):
        middle = (left + right) / 2
        here = label_at(owner, middle)
        is_left, new = here == before, (here != before) & (here != after)
        if not new.any():
            left, right = np.where(is_left, middle, left), np.where(is_left, right, middle)
            continue
        parts = (
            (owner, np.where(is_left, middle, left), np.where(is_left, right, middle), before),
            (owner[new], middle[new], right[new], here[new]),
        )
        after = np.concatenate([np.where(new, here, after), after[new]])
        owner, left, right, before = (np.concatenate(pair) for pair in zip(*parts, strict=True))
        order = np.lexsort((left, owner))
        owner, left, right, before, after = (values[order] for values in (owner, left, right, before, after))
    return Corners(owner, (left + right) / 2)


@functools.cache
def unit_nodes(count: int) -> tuple[np.ndarray, np.ndarray]:
    """Nodes on [0, 1] and their weights, (count,) each: exact up to the degree 2 count - 1."""
    nodes, weights = np.polynomial.legendre.leggauss(count)
    return (nodes + 1) / 2, weights / 2


def between(corners: Float64[np.ndarray, "c"], count: int) -> tuple[np.ndarray, np.ndarray]:
    """At least `count` directions, a multiple of 16, at corners and evenly spaced between them: angles (n,), and the
    angle from each to the next, (n,) [rad]. Twice the count has the same ones, and one more between any two.
    """
    arc = np.diff(corners, append=corners[:1] + 2 * np.pi)
    number = count // _ARCS * np.ceil(_ARCS * arc / (2 * np.pi)).astype(int)
    width = np.repeat(arc / number, number)
    return corners[:1] + np.cumsum(width) - width, width


class Directions(NamedTuple):
    """Directions of a quadrature: rows of regions (m,), ascending; angles and the part of the circle of each [rad]."""

    owner: np.ndarray
    angle: np.ndarray
    share: np.ndarray


def directions(
    rows: Int64[np.ndarray, "n"], between: Corners, around: int, least_per_arc: int, even: int | None = None
) -> Directions:
    """Directions all around regions: evenly spaced, or Gauss-Legendre nodes on every arc between two corners.

    `around`, `least_per_arc`: nodes over a full circle with corners, and on its shortest arc.
    `even`: directions where there is no corner; None: as many as over a circle with corners.
    """
    even = around if even is None else even
    smooth = rows[~np.isin(rows, between.owner)]
    parts = [(np.repeat(smooth, even), np.tile(even_angles(even), len(smooth)), 2 * np.pi / even)]
    owner, start = between
    last = np.append(owner[1:] != owner[:-1], True) if len(owner) else np.zeros(0, bool)
    first = np.searchsorted(owner, owner)
    length = np.where(last, start[first] + 2 * np.pi, np.roll(start, -1)) - start
    pieces = np.ceil(around * length / (2 * np.pi) / _MOST_PER_ARC).astype(int)  # of long arcs
    owner, length, start = (np.repeat(values, pieces) for values in (owner, length / pieces, start))
    start = start + length * (np.arange(len(owner)) - np.repeat(np.cumsum(pieces) - pieces, pieces))
    number = np.maximum(np.ceil(around * length / (2 * np.pi)).astype(int), least_per_arc)
    for count in np.unique(number).tolist():
        node, weight = unit_nodes(count)
        here = number == count
        angle = (start[here, None] + length[here, None] * node).ravel()
        parts.append((np.repeat(owner[here], count), angle, (length[here, None] * weight).ravel()))
    owner, angle = (np.concatenate([part[i] for part in parts]) for i in (0, 1))
    share = np.concatenate([np.broadcast_to(part[2], part[0].shape) for part in parts])
    order = np.argsort(owner, kind="stable")
    return Directions(owner[order], angle[order], share[order])
