"""Poses that change while a frame is exposed, and the times at which lines of a sensor are."""

import functools
from dataclasses import dataclass

import numpy as np

from pipeline.records.shapes import Float64

_NODES = 13
"""Poses of a piece of a motion [1]: half a turn in a piece is right to 1e-10 then, see docs/motion.md."""
Poses = list[list[list[float]]]
"""Transforms a_from_b, row by row, (n, 4, 4) [mm]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Shutter:
    """When lines of a sensor are exposed, after the time code of the frame: `plen:shutter:*`."""

    scan_order: str = "none"
    opens_s: float = 0.0
    line_s: float = 0.0
    exposure_s: float = 0.0
    instants: int = 1

    def opens_at_s(self, y_px: Float64[np.ndarray, "n"], height_px: int) -> np.ndarray:
        """Start of the exposure at each y, (n,) [s]: continuous, and that of a line in the middle of its row."""
        line = {"none": 0.0 * y_px, "topToBottom": y_px, "bottomToTop": height_px - 1 - y_px}[self.scan_order]
        return self.opens_s + self.line_s * line

    def middle_s(self, y_px: Float64[np.ndarray, "n"], height_px: int) -> np.ndarray:
        """Middle of the exposure at each y, (n,) [s]."""
        return self.opens_at_s(y_px, height_px) + self.exposure_s / 2

    @property
    def line_by_y_s(self) -> float:
        """Derivative of `opens_at_s` by y [s per px]."""
        return {"none": 0.0, "topToBottom": 1.0, "bottomToTop": -1.0}[self.scan_order] * self.line_s

    def window_s(self, height_px: int) -> tuple[float, float]:
        """Begin of the first exposure and end of the last [s]."""
        lines = 0 if self.scan_order == "none" else height_px - 1
        return self.opens_s, self.opens_s + self.line_s * lines + self.exposure_s


@dataclass(frozen=True, slots=True, kw_only=True)
class Motion:
    """A rigid motion, by poses a_from_b at Chebyshev's nodes of pieces between `edges_s`, at which it may bend."""

    edges_s: tuple[float, ...]
    poses: tuple[Poses, ...]  # of each piece

    def at(self, times_s: Float64[np.ndarray, "n"]) -> np.ndarray:
        """Poses at times, (n, 4, 4); before and after the motion those of its ends."""
        edges, poses = np.array(self.edges_s), np.array(self.poses)
        times = np.clip(times_s, edges[0], edges[-1])
        piece = np.clip(np.searchsorted(edges, times, side="right") - 1, 0, len(poses) - 1)
        first, end = edges[piece], edges[piece + 1]
        # Barycentric interpolation: Berrut and Trefethen, SIAM Review 46 (2004) 501.
        away = (2 * times - first - end)[:, None] / (end - first)[:, None] - _nodes()
        is_node = away == 0
        with np.errstate(divide="ignore", invalid="ignore"):
            share = _barycentric() / away
            share /= share.sum(axis=1, keepdims=True)
        share = np.where(is_node.any(axis=1, keepdims=True), is_node.astype(float), share)
        return np.einsum("nk,nkij->nij", share, poses[piece])

    @staticmethod
    def times_s(edges_s: Float64[np.ndarray, "m"]) -> np.ndarray:
        """Times of the poses of all pieces, (m - 1, nodes)."""
        first, end = edges_s[:-1, None], edges_s[1:, None]
        return (first + end) / 2 + (end - first) / 2 * _nodes()


@functools.cache
def _nodes() -> np.ndarray:
    """From -1 to 1, both among them."""
    return -np.cos(np.pi * np.arange(_NODES) / (_NODES - 1))


@functools.cache
def _barycentric() -> np.ndarray:
    weight = (-1.0) ** np.arange(_NODES)
    weight[[0, -1]] /= 2
    return weight
