"""The nearest of many points that lie about evenly in a plane, such as microlenses.

Squares of the plane know the points in them, so that a position asks the squares around it. SciPy's k-d tree gives the
same answers, but every process would load SciPy for longer than it asks.
"""

import math
from dataclasses import dataclass

import numpy as np

from pipeline.jit.decorators import inline, kernel
from pipeline.records.shapes import Float64, Int64

NOBODY = -1
"""Row of no point."""
_ROUNDING = 1 - 1e-9
"""Points so near to the edge of a square may count to the next one."""
_ROOM = 16
"""Points about a position, to begin with."""


@dataclass(frozen=True, slots=True)
class Nearby:
    """Points by the squares that they lie in.

    Attributes
    ----------
    points : (n, 2) float64
    corner, side : (2,) float64, float
        Corner at which the first square begins, and the side of all squares.
    order : (n,) int64
        Rows of the points, square by square along x, then y.
    starts : (lines, squares of a line + 1) int64
        Indices into `order` at which the points of each square begin, and at which those of the line end.
    """

    points: Float64[np.ndarray, "n 2"]
    corner: Float64[np.ndarray, "2"]
    side: float
    order: Int64[np.ndarray, "n"]
    starts: Int64[np.ndarray, "m k"]

    def nearest(self, positions: Float64[np.ndarray, "n 2"], count: int = 1) -> tuple[np.ndarray, np.ndarray]:
        """Distances and rows of the `count` points nearest to each position, nearest first, (m, count) each.

        Of points at one distance the one of the lower row comes first. Infinite and NOBODY where there are no more.
        """
        return self._found(positions, math.inf, count)[:2]

    def within(self, positions: Float64[np.ndarray, "n 2"], radius: float) -> tuple[np.ndarray, np.ndarray]:
        """Distances and rows of all points within a radius of each position, nearest first, (m, most), as `nearest`."""
        room = _ROOM
        while True:
            distance, rows, most = self._found(positions, radius, room)
            if most < room:
                return distance[:, :most], rows[:, :most]
            room *= 4

    def _found(self, positions: np.ndarray, radius: float, count: int) -> tuple[np.ndarray, np.ndarray, int]:
        distance, rows = np.full((len(positions), count), np.inf), np.full((len(positions), count), NOBODY)
        squares = self.points, self.corner, self.side, self.order, self.starts
        most = seek(squares, np.ascontiguousarray(positions), radius, distance, rows)
        return distance, rows, most


def nearby_of(points: Float64[np.ndarray, "n 2"]) -> Nearby:
    """Points (n, 2), n > 0, in squares that hold about one each."""
    corner, extent = points.min(axis=0), np.ptp(points, axis=0)
    side = float(max(np.sqrt(extent.prod() / len(points)), extent.max() / len(points))) or 1.0
    across, lines = np.floor(extent / side).astype(np.int64) + 1
    x, y = np.floor((points - corner) / side).astype(np.int64).T
    order = np.argsort(y * across + x, kind="stable")
    before = np.concatenate([[0], np.cumsum(np.bincount(y * across + x, minlength=across * lines))])
    starts = before[np.arange(lines)[:, None] * across + np.arange(across + 1)]
    return Nearby(np.ascontiguousarray(points), corner, side, order, starts)


@kernel
def seek(squares, positions, radius, distance, rows):
    """Find the points nearest to each position, up to a radius; returns how many one of them was seen to have at most.

    Parameters
    ----------
    squares : tuple
        Attributes of `Nearby`, in their order.
    distance, rows : (m, count) float64, (m, count) int64
        Written, nearest first; what is there stays where there are fewer points.
    """
    _, corner, side, _, starts = squares
    lines, across, most = starts.shape[0], starts.shape[1] - 1, 0
    for n in range(positions.shape[0]):
        u, v = (positions[n, 0] - corner[0]) / side, (positions[n, 1] - corner[1]) / side
        if math.isnan(u) or math.isnan(v):
            continue
        i, j = int(min(max(math.floor(u), 0.0), across - 1.0)), int(min(max(math.floor(v), 0.0), lines - 1.0))
        ring, found, certain = 0, 0, 0.0
        while certain < math.inf and certain <= min(radius, distance[n, -1]):
            for line in range(max(j - ring, 0), min(j + ring + 1, lines)):
                if abs(line - j) == ring:
                    found += _take(squares, line, i - ring, i + ring + 1, positions[n], radius, distance[n], rows[n])
                else:
                    found += _take(squares, line, i - ring, i - ring + 1, positions[n], radius, distance[n], rows[n])
                    found += _take(squares, line, i + ring, i + ring + 1, positions[n], radius, distance[n], rows[n])
            ahead, beyond = _clear(u, i, ring, across), _clear(v, j, ring, lines)
            certain, ring = side * min(ahead, beyond) * _ROUNDING, ring + 1
        most = max(most, found)
    return most


@inline
def _take(squares, line, first, end, position, radius, distance, rows):
    """Sort the points in squares of a line, from `first` up to `end`, in among the nearest; how many are within."""
    points, _, _, order, starts = squares
    first, end, found = max(first, 0), min(end, starts.shape[1] - 1), 0
    if first >= end:
        return 0
    for k in range(starts[line, first], starts[line, end]):
        row = order[k]
        dx, dy = points[row, 0] - position[0], points[row, 1] - position[1]
        away = math.sqrt(dx * dx + dy * dy)
        if away <= radius:
            found += 1
            place = distance.shape[0]
            while place > 0 and (away < distance[place - 1] or (away == distance[place - 1] and row < rows[place - 1])):
                if place < distance.shape[0]:
                    distance[place], rows[place] = distance[place - 1], rows[place - 1]
                place -= 1
            if place < distance.shape[0]:
                distance[place], rows[place] = away, row
    return found


@inline
def _clear(place, square, rings, count):
    """Reach of rings around a square from a place in it, in squares; the outermost ones have no end."""
    before = place - (square - rings) if square - rings > 0 else math.inf
    after = square + rings + 1 - place if square + rings + 1 < count else math.inf
    return min(before, after)
