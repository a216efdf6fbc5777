"""Outlines of the passing rays for a lens that is not symmetric about its axis: per point of a grid behind it.

The same as `camera.pupil.outlines` traces per height, for points of any plane. Between four points of the grid supports
are interpolated; an outline is inflated by all that its neighbours say about how wrong that can be, and by how much an
outline changes, besides the drift, while its point moves within a pixel or the aperture of a microlens.
"""

from dataclasses import dataclass

import numpy as np

from pipeline.camera.pupil.chief_ray import chief_crossings
from pipeline.camera.pupil.outlines import (
    DIRECTIONS,
    MARGIN,
    Outlines,
    corners,
    directions_of,
    edges,
    once,
    passing_points,
    supports,
)
from pipeline.optics.table import enclosing, motion_of
from pipeline.records.shapes import Float64

_NODES = 12
"""Steps from the middle of the grid to its farther edge; what interpolation leaves between is added to an outline."""
_TRACED = 240
"""Directions of an edge, 1.5 degrees apart: ten per edge of an outline; a grid has hundreds of points, where
`camera.pupil.outlines` has 48."""
_BISECTIONS = 16
"""Halvings of the way to an edge, 2.5 semi-diameters of the rear surface: to 4e-5 of one, far less than the margin."""
_DARK_RINGS = 2
"""Rings of dark points that outlines go on to: interpolation reads the first, second differences there the second."""


@dataclass(frozen=True, slots=True)
class FilmPlane:
    """A plane behind the lens, vision frame: its points (u, v) are origin + u first + v second."""

    origin_mm: Float64[np.ndarray, "3"]
    # Need not be of unit length: with x and y components of the unit matrix, u and v are x and y from the origin
    axes: Float64[np.ndarray, "2 3"]

    def points(self, uv: Float64[np.ndarray, "... 2"]) -> np.ndarray:
        """Points of the plane in space, (..., 2) to (..., 3) [mm]."""
        return self.origin_mm + uv @ self.axes


def upright(z_mm: float) -> FilmPlane:
    """The plane across the axis at vision z, with x and y as coordinates."""
    return FilmPlane(np.array([0.0, 0.0, z_mm]), np.eye(2, 3))


@once
def grid_outlines(
    table: Float64[np.ndarray, "n columns"],
    stop_row: int,
    plane: FilmPlane,
    half_extents_mm: tuple[float, float],
    slack_mm: float,
    margin: float = MARGIN,
) -> Outlines:
    """Trace the outlines of any lens for a grid of points of a plane behind it.

    `half_extents_mm`: largest distances from the plane's origin, along u and v, of points that will be
        asked for.
    `slack_mm`: distance from its point at which an outline, moved by the drift, still has to hold.
    """
    table = enclosing(table)
    step = max(*half_extents_mm, 1e-6) / _NODES
    columns, rows = (max(3, 2 * int(np.ceil(extent / step - 1e-9)) + 1) for extent in half_extents_mm)
    v, u = np.mgrid[:rows, :columns] * step
    uv = np.stack([u - u.mean(), v - v.mean()], axis=-1)
    traced = _traced(table, stop_row, plane.points(uv.reshape(-1, 2))).reshape(rows, columns, DIRECTIONS)
    centre = corners(traced).mean(axis=2)
    drift = _drift(centre, step)
    shift = drift * step * directions_of(DIRECTIONS)
    reach = _continued(traced, shift)
    wide = np.nan_to_num(_bend(reach) + slack_mm / step * _slope(reach, shift))
    reach += margin * (reach - corners(reach).mean(axis=2) @ directions_of(DIRECTIONS).T) + wide[..., None]
    return Outlines(step, np.nan_to_num(corners(reach)), drift)


def _traced(table: np.ndarray, stop_row: int, starts: np.ndarray) -> np.ndarray:
    """Supports of what passes from each point, (n, DIRECTIONS); NaN where nothing passes."""
    middle = motion_of(table[0])[:2, 3]
    inside = passing_points(table, starts, chief_crossings(table, stop_row, starts), middle)
    lit = ~np.isnan(inside[:, 0])
    result = np.full((len(starts), DIRECTIONS), np.nan)
    if lit.any():
        slack = 2 * float(np.hypot(*middle))
        result[lit] = supports(edges(table, starts[lit], inside[lit], _TRACED, _BISECTIONS, slack))
    return result


def _drift(centre: np.ndarray, step: float) -> float:
    """Movement of outlines per movement of their points, the median over a grid (rows, columns, 2)."""
    along = np.concatenate([np.diff(centre[..., 0], axis=1).ravel(), np.diff(centre[..., 1], axis=0).ravel()]) / step
    known = along[~np.isnan(along)]
    return float(np.median(known)) if known.size else 0.0


def _continued(reach: np.ndarray, shift: np.ndarray) -> np.ndarray:
    """Supports with those of lit neighbours, moved by the drift, in two rings around the lit part of the grid.

    Where light ends between two points the outline must not shrink towards nothing before it does.
    """
    for _ in range(_DARK_RINGS):
        padded = np.pad(reach, ((1, 1), (1, 1), (0, 0)), constant_values=np.nan)
        rows, columns = reach.shape[:2]
        nearby = [
            padded[1 + j : 1 + j + rows, 1 + i : 1 + i + columns] - shift @ np.array([i, j])
            for j in (-1, 0, 1)
            for i in (-1, 0, 1)
        ]
        reach = np.where(np.isnan(reach), np.fmax.reduce(nearby), reach)
    return reach


def _bend(reach: np.ndarray) -> np.ndarray:
    """Largest error of a support interpolated next to each point, (rows, columns).

    Half of the larger second difference at both ends of an interval bounds the error of the interpolation in it, also
    where a kink lies inside: vignetting begins there.
    """
    total = np.zeros(reach.shape[:2])
    for axis in (0, 1):
        second = np.nan_to_num(np.abs(np.diff(reach, 2, axis=axis)).max(axis=2))
        around = np.pad(second, [(2, 2) if a == axis else (1, 1) for a in (0, 1)])
        total += np.lib.stride_tricks.sliding_window_view(around, (3, 3)).max(axis=(2, 3)) / 2
    return total


def _slope(reach: np.ndarray, shift: np.ndarray) -> np.ndarray:
    """Largest change of a support from a point to the next, besides the drift, (rows, columns)."""
    squared = np.zeros(reach.shape[:2])
    for axis in (0, 1):
        change = np.abs(np.diff(reach, axis=axis) - shift[:, 1 - axis])
        ends = [(1, 1) if a == axis else (0, 0) for a in (0, 1)]
        either = np.pad(np.nan_to_num(change.max(axis=2)), ends)
        first, second = (either[:-1], either[1:]) if axis == 0 else (either[:, :-1], either[:, 1:])
        squared += np.maximum(first, second) ** 2
    return np.sqrt(squared)
