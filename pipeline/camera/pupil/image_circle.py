"""The image circle: the part of a way off the axis that light reaches behind the main lens, by real rays."""

import numpy as np

from pipeline.camera.boundary import halved
from pipeline.camera.pupil.chief_ray import chief_crossings
from pipeline.camera.pupil.outlines import passing_points
from pipeline.optics.table import enclosing
from pipeline.records.shapes import Float64

_STEPS = 24
"""Parts of the way that are looked at first: light that comes and goes within one of them is not seen."""
_BISECTIONS = 12
"""Halvings of the part in which light ends: 1 / (24 * 4096), the 1e-5 that `lit_share` states."""


def lit_share(
    table: Float64[np.ndarray, "n columns"],
    stop_row: int,
    start_mm: Float64[np.ndarray, "3"],
    end_mm: Float64[np.ndarray, "3"],
) -> float:
    """The share of the way between two points behind the lens up to which light arrives: 1 if it does at the end.

    Parameters
    ----------
    table : (n, columns) float64
        Table from `optics.table.towards_scene`.
    stop_row : int
        Row of the aperture stop in the table.
    start_mm, end_mm : (3,) float64
        Vision frame; light arrives at the first one.

    Returns
    -------
    float
        The share to 1e-5, if light ends once along the way; a sliver of the pupil that is narrower than 1/64 of the
        rear surface and has no chief ray counts as dark.
    """
    table = enclosing(table)

    def is_lit(shares: np.ndarray) -> np.ndarray:
        points = start_mm + shares[:, None] * (end_mm - start_mm)
        # First through the centre of the stop, which may be narrow, and else over the whole rear surface.
        found = passing_points(table, points, chief_crossings(table, stop_row, points), np.zeros(2))
        return ~np.isnan(found[:, 0])

    shares = np.linspace(0, 1, _STEPS + 1)
    lit = is_lit(shares)
    if lit[-1]:
        return 1.0
    last = shares[lit].max(initial=0.0, keepdims=True)
    return float(halved(is_lit, last, last + 1 / _STEPS, _BISECTIONS)[0][0])
