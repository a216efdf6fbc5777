"""The nearest of many points in a plane, by SciPy's k-d tree, which comes with the first question."""

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from pipeline.records.shapes import Float64

NOBODY = -1
"""Row of no point."""
_TIES = 8
"""Further points that are looked at for one at the same distance with a lower row: a lattice has six neighbours."""


@dataclass(frozen=True)
class Nearby:
    """Points (n, 2), n > 0."""

    points: Float64[np.ndarray, "n 2"]

    @cached_property
    def _tree(self) -> Any:
        from scipy.spatial import KDTree

        return KDTree(self.points)

    def nearest(self, positions: Float64[np.ndarray, "n 2"], count: int = 1) -> tuple[np.ndarray, np.ndarray]:
        """Distances and rows of the `count` points nearest to each position, nearest first, (m, count) each.

        Of points at one distance the one of the lower row comes first. Infinite and NOBODY where there are no more.
        """
        known = np.isfinite(positions).all(axis=1)
        rows = self._tree.query(np.where(known[:, None], positions, 0.0), np.arange(1, count + _TIES + 1))[1]
        rows[~known] = len(self.points)
        # The tree's own distances might be rounded otherwise on another processor.
        offset = np.append(self.points, [[np.inf, np.inf]], axis=0)[rows] - positions[:, None]
        distance = np.where(rows < len(self.points), np.sqrt((offset**2).sum(axis=2)), np.inf)
        order = np.lexsort((rows, distance))[:, :count]
        distance, rows = (np.take_along_axis(values, order, axis=1) for values in (distance, rows))
        return distance, np.where(rows < len(self.points), rows, NOBODY)

    def within(self, positions: Float64[np.ndarray, "n 2"], radius: float) -> tuple[np.ndarray, np.ndarray]:
        """Distances and rows of all points within a radius of each position, nearest first, (m, most), as `nearest`."""
        about = self._tree.query_ball_point(positions, radius * (1 + 1e-9), return_length=True)
        distance, rows = self.nearest(positions, int(np.max(about, initial=0)))
        inside = distance <= radius
        most = int(inside.sum(axis=1).max(initial=0))
        return np.where(inside, distance, np.inf)[:, :most], np.where(inside, rows, NOBODY)[:, :most]
