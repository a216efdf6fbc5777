"""Further starts of the search for J(x) = p, where first guesses lead to no row."""

import math
from collections.abc import Callable

import numpy as np

from pipeline.records.shapes import Float64, Int64

MayExist = Callable[[np.ndarray, np.ndarray, float], np.ndarray]
"""Function of image positions (m, 2), their row indices (m,) and a grace in px that returns whether a solution may
exist within this distance, (m,) bool."""
AROUND_PX = np.array(
    [
        2**i * np.array([math.cos(k * math.pi / 8), math.sin(k * math.pi / 8)])
        for i in np.arange(-2, 6.5, 0.5)
        for k in range(16)
    ]
)
"""Positions around a guess that are tried for light (n, 2) [px]: on rings, as far as across a micro-image of 64 px."""
BEYOND_PX = np.array([0.5, 1.0, 1.5, 2.0, 3.0, 4.0, 6.0, 8.0, 11.0, 16.0])
"""Distances beyond a solution outside the image at which J may return to the point [px]."""


def least_miss(
    j: Callable[[np.ndarray, np.ndarray], np.ndarray],
    rows: Int64[np.ndarray, "n"],
    starts_px: Float64[np.ndarray, "m n 2"],
    may_exist: MayExist,
) -> tuple[Float64[np.ndarray, "n 2"], Float64[np.ndarray, "n 2"]]:
    """The start of each row, among m, with the smallest residual of J, and the residual [mm]; NaN where none has light.

    `j` is a function of rows and positions; only starts near which a solution may exist count.
    """
    best_px, best_mm = np.full((2, len(rows), 2), np.nan)
    for x_px in starts_px if len(rows) else ():
        may = may_exist(x_px, rows, 0.0)
        residual_mm = np.full(x_px.shape, np.nan)
        residual_mm[may] = j(rows[may], x_px[may])
        # Before the first start with light the best is NaN, which no residual reaches.
        is_better = ~(np.hypot(*residual_mm.T) >= np.hypot(*best_mm.T)) & np.isfinite(residual_mm[:, 0])
        best_px[is_better] = x_px[is_better]
        best_mm[is_better] = residual_mm[is_better]
    return best_px, best_mm
