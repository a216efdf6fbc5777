"""Poses that change during an exposure, and exposure times of sensor lines."""

import functools
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from pipeline.records.shapes import Float64

NODES = 13
"""Chebyshev nodes per piece of a motion [1]: half a turn within a piece is then right to 1e-10, see docs/motion.md."""
_MARGIN_S = 2e-6
"""Margin at both ends of a motion [s], over which the velocity at an instant is measured."""
Poses = list[list[list[float]]]
"""Transforms a_from_b, row by row, (n, 4, 4) [mm]."""
_SCANS = {"none": (1, 0), "leftToRight": (0, 1), "rightToLeft": (0, -1), "topToBottom": (1, 1), "bottomToTop": (1, -1)}
"""Image axis along which lines follow each other, 0: x, 1: y, and the sign of their time along it."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Shutter:
    """Exposure of the lines of a sensor relative to the time code of the frame: `plen:shutter:*`."""

    scan_order: str = "none"
    opens_s: float = 0.0
    line_s: float = 0.0
    exposure_s: float = 0.0
    instants: int = 1

    @property
    def axis(self) -> int:
        """Image axis along which lines follow each other, 0: x, lines are columns, 1: y, lines are rows."""
        return _SCANS[self.scan_order][0]

    @property
    def line_by_px_s(self) -> float:
        """Derivative of `opens_at_s` by the position along the axis [s/px]."""
        return _SCANS[self.scan_order][1] * self.line_s

    def opens_at_s(self, x_px: Float64[np.ndarray, "n 2"], size_px: tuple[int, int]) -> np.ndarray:
        """Start of the exposure at image positions, (n,) [s]: continuous, and exact at the middle of each line.

        `size_px`: width and height of the image.
        """
        axis, sign = _SCANS[self.scan_order]
        line = size_px[axis] - 1 - x_px[:, axis] if sign < 0 else sign * x_px[:, axis]
        return self.opens_s + self.line_s * line

    def middle_s(self, x_px: Float64[np.ndarray, "n 2"], size_px: tuple[int, int]) -> np.ndarray:
        """Middle of the exposure at image positions, (n,) [s]."""
        return self.opens_at_s(x_px, size_px) + self.exposure_s / 2

    def lines(
        self, rows: tuple[int, int], size_px: tuple[int, int]
    ) -> Iterator[tuple[float, tuple[int, int], tuple[int, int]]]:
        """Pixels of these image rows that are exposed together: start of their exposure [s], rows and columns."""
        columns = 0, size_px[0]
        if self.scan_order == "none":
            yield self.opens_s, rows, columns
            return
        lines = np.arange(*(columns, rows)[self.axis], dtype=float)
        opens_s = self.opens_at_s(np.stack([lines, lines], axis=1), size_px)
        for line, time in zip(lines.tolist(), opens_s.tolist(), strict=True):
            line_range = int(line), int(line) + 1
            yield (time, rows, line_range) if self.axis == 0 else (time, line_range, columns)

    def window_s(self, size_px: tuple[int, int]) -> tuple[float, float]:
        """Start of the first exposure and end of the last, in an image of this size [s]."""
        lines = 0 if self.scan_order == "none" else size_px[self.axis] - 1
        return self.opens_s, self.opens_s + self.line_s * lines + self.exposure_s

    def motion_s(self, size_px: tuple[int, int]) -> tuple[float, float]:
        """Start and end of the time that a motion covers [s]: two lines more at both ends, where a solver may step."""
        first, end = self.window_s(size_px)
        margin_s = 2 * self.line_s + _MARGIN_S
        return first - margin_s, end + margin_s

    def ends_s(self, size_px: tuple[int, int]) -> np.ndarray:
        """Mid-exposure times of the first and of the last line, (2,) [s]."""
        return np.array(self.window_s(size_px)) + np.array([0.5, -0.5]) * self.exposure_s


@dataclass(frozen=True, kw_only=True)
class Motion:
    """A rigid motion, by poses a_from_b at the Chebyshev nodes of pieces; it may have a kink at each of `edges_s`."""

    edges_s: tuple[float, ...]
    poses: tuple[Poses, ...]  # of each piece

    @classmethod
    def of(cls, pose: Callable[[float], np.ndarray], edges_s: Sequence[float]) -> "Motion":
        """Sample a pose (4, 4) [mm] that is a function of time [s], smooth between the edges."""
        times = cls.times_s(np.array(edges_s)).tolist()
        poses = tuple([np.asarray(pose(time), float).tolist() for time in piece] for piece in times)
        return cls(edges_s=tuple(edges_s), poses=poses)

    def at(self, times_s: Float64[np.ndarray, "n"]) -> np.ndarray:
        """Poses at these times, (n, 4, 4); before and after the motion, those at its ends."""
        piece, share = node_shares(np.array(self.edges_s), NODES, times_s)
        return np.einsum("nk,nkij->nij", share, self._poses[piece])

    @functools.cached_property
    def _poses(self) -> np.ndarray:
        """Poses of all pieces, (m - 1, nodes, 4, 4): a row asks for them at each of its instants."""
        return np.array(self.poses)

    @staticmethod
    def times_s(edges_s: Float64[np.ndarray, "m"]) -> np.ndarray:
        """Times of the poses of all pieces, (m - 1, nodes)."""
        return node_times(edges_s, NODES)


def node_times(edges_s: Float64[np.ndarray, "m"], count: int) -> np.ndarray:
    """Times of `count` Chebyshev nodes in each piece between edges, both ends included, (m - 1, count)."""
    first, end = edges_s[:-1, None], edges_s[1:, None]
    return (first + end) / 2 + (end - first) / 2 * _nodes(count)


def node_shares(
    edges_s: Float64[np.ndarray, "m"], count: int, times_s: Float64[np.ndarray, "n"]
) -> tuple[np.ndarray, np.ndarray]:
    """Piece of each time, (n,), and the barycentric weights of its nodes, (n, count); times before and after all pieces
    take those of the ends.
    """
    times = np.clip(times_s, edges_s[0], edges_s[-1])
    piece = np.clip(np.searchsorted(edges_s, times, side="right") - 1, 0, len(edges_s) - 2)
    first, end = edges_s[piece], edges_s[piece + 1]
    # Barycentric interpolation: Berrut and Trefethen, SIAM Review 46 (2004) 501. The share of a node is its weight over
    # the distance to it, divided by the sum over all nodes; at a node itself it is 1.
    from_nodes = (2 * times - first - end)[:, None] / (end - first)[:, None] - _nodes(count)
    is_node = from_nodes == 0
    with np.errstate(divide="ignore", invalid="ignore"):
        share = _barycentric(count) / from_nodes
        share /= share.sum(axis=1, keepdims=True)
    return piece, np.where(is_node.any(axis=1, keepdims=True), is_node.astype(float), share)


@functools.cache
def _nodes(count: int) -> np.ndarray:
    """Chebyshev nodes of the second kind on [-1, 1], both ends included."""
    return -np.cos(np.pi * np.arange(count) / (count - 1))


@functools.cache
def _barycentric(count: int) -> np.ndarray:
    """Barycentric weights of Chebyshev nodes of the second kind: alternating signs, half at both ends."""
    weight = (-1.0) ** np.arange(count)
    weight[[0, -1]] /= 2
    return weight
