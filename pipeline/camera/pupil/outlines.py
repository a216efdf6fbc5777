"""Outlines of the rays that pass a lens backwards, on its rear vertex plane.

From a point on a plane behind the lens (sensor or microlens array) the passing rays fill a region of the rear vertex
plane. Its boundary is traced and enclosed by a polygon of support lines n_i . x = h_i, h_i the maximum of n_i . x over
the boundary, with normals n_i in `DIRECTIONS` fixed directions. So corners of a vignetted pupil stay inside, and
polygons of different points can be interpolated vertex by vertex, so that bounds are continuous in the field. Outlines
only bound the sampling: they are inflated, and every ray is still clipped at every surface.

In a centred lens of rotationally symmetric apertures an outline rotates with the azimuth of its point: one per height
off the axis suffices. Any other lens has a grid of them over the plane. Polygons, rectangles and obstructions do not
rotate: outlines are those of the circles around all apertures, which pass at least as much. Bounds are looser by the
share of the circle that an aperture covers; no ray is lost.

`table` is one of `optics.table.towards_scene`, `stop_row` the row of its aperture stop.
"""

import functools
from dataclasses import dataclass

import numpy as np

from pipeline.camera.boundary import even_angles, halved, inner_points, unit_vectors
from pipeline.camera.pupil.chief_ray import chief_crossings, chief_heights
from pipeline.optics.kernels import trace
from pipeline.optics.prescription import Prescription
from pipeline.optics.rays import directions_to
from pipeline.optics.table import (
    ENTRY,
    SEMI_DIAMETER_SQUARED,
    UPRIGHT,
    Film,
    enclosing,
    motion_of,
    towards_scene,
)
from pipeline.records.shapes import Float64

_KEPT = 8
"""Outlines that are kept for other tracers of a lens: more than the planes of a camera, and few enough to hold."""
HEIGHTS = 48
"""Heights from the axis to the farthest point; `MARGIN` covers the interpolation between them."""
DIRECTIONS = 24
"""Edges of an outline, 15 degrees apart: around a circle it is 0.6 percent larger in area, which costs rays."""
MARGIN = 0.02
"""Inflation of an outline about its centre [1]: covers interpolation in height and between traced directions."""
_TRACED = 720
"""Directions of a boundary, half a degree apart: 30 per edge of an outline."""
_BISECTIONS = 26
"""Bisections of a boundary within 2.5 semi-diameters of the rear surface: to 4e-8 of one."""
_GRID = 65
"""Rays along each side of a grid where the chief ray does not pass: a sliver narrower than a 64th counts as dark."""
_LIT_STEPS = 24
"""Intervals of the first scan for light: light that comes and goes within one of them is missed."""
_LIT_BISECTIONS = 12
"""Bisections of the interval in which light ends: 1 / (24 * 4096), the 1e-5 that `lit_share` states."""
_NODES = 12
"""Steps from the middle of a grid to its farther edge; the interpolation error between them is added to an outline."""
_GRID_TRACED, _GRID_BISECTIONS = 240, 16
"""Directions and bisections of a boundary in a grid, which has hundreds of points: ten directions per edge of an
outline, and 4e-5 of a semi-diameter, far less than the margin."""
_DARK_RINGS = 2
"""Rings of dark points to which outlines are extended: interpolation reads the first, second differences there the
second."""


@dataclass(frozen=True, slots=True)
class Outlines:
    """Outlines of the passing rays on the rear vertex plane, vision frame."""

    step_mm: float  # distance of neighbouring points
    # Counter-clockwise polygons, some of their edges short or of no length; all zero where nothing passes. One row:
    # outline i belongs to the height i * step_mm on the +x axis. Several: a grid over x (columns) and y (rows) with its
    # middle in (0, 0).
    vertices_mm: Float64[np.ndarray, "rows columns DIRECTIONS 2"]
    drift: float  # motion of an outline per motion of its point: near the axis, or the median over a grid


def _rear_of(prescription: Prescription, film: Film = UPRIGHT) -> tuple[np.ndarray, int]:
    """Table towards the scene of the circles around all apertures, and the row of the stop."""
    table = enclosing(towards_scene(prescription, film))
    return table, len(table) - 1 - prescription.stop_index


@functools.lru_cache(maxsize=_KEPT)
def outlines(prescription: Prescription, plane_mm: float, max_height_mm: float, margin: float = MARGIN) -> Outlines:
    """Trace the outlines of a centred lens for points on the plane at vision z `plane_mm` behind it, up to a height."""
    table, stop_row = _rear_of(prescription)
    step = max(max_height_mm, 1e-6) / (HEIGHTS - 1)
    heights = step * np.arange(HEIGHTS)
    starts = np.stack([heights, np.zeros(HEIGHTS), np.full(HEIGHTS, plane_mm)], axis=1)
    chief = np.stack([chief_heights(table, stop_row, plane_mm, heights), np.zeros(HEIGHTS)], axis=1)
    inside = interior_points(table, starts, chief, np.zeros(2))
    lit = ~np.isnan(inside[:, 0])
    support = np.full((HEIGHTS, DIRECTIONS), np.nan)
    # The outline is its own mirror image in the x axis: about a point there, half of the directions tell the others.
    ray, half = directions_of(_TRACED), _TRACED // 2 + 1
    for rows, traced in ((lit & (inside[:, 1] == 0), half), (lit & (inside[:, 1] != 0), _TRACED)):
        if rows.any():
            upper = edges(table, starts[rows], inside[rows], ray[:traced], _BISECTIONS, 0.0)
            distance = np.concatenate([upper, upper[:, _TRACED - traced : 0 : -1]], axis=1)
            support[rows] = supports(inside[rows, None] + distance[..., None] * ray)
    vertices = _vertices(support, margin)
    drift = float(vertices[1].mean(axis=0)[0] - vertices[0].mean(axis=0)[0]) / step if lit[:2].all() else 0.0
    return Outlines(step, vertices[None], drift)


def _vertices(support: np.ndarray, margin: float) -> np.ndarray:
    """Outlines of all heights from their supports, (HEIGHTS, DIRECTIONS, 2); dark heights are NaN, and become zero."""
    # Outlines are widened beyond the margin where supports bend from height to height by more than half of it, as
    # where another rim begins to cut: half of the larger second difference at both ends of an interval bounds the error
    # of the interpolation in it. A dark height beside a lit one takes that one's outline, joined with its
    # extrapolation: light may end anywhere in between.
    normals = directions_of(DIRECTIONS)
    # Extrapolate from the two heights on either side: the nearest, and the one beyond it.
    padded = np.pad(support, ((2, 2), (0, 0)), constant_values=np.nan)
    for nearest, second in ((padded[1:-3], padded[:-4]), (padded[3:-1], padded[4:])):
        motion = np.nan_to_num((corners(nearest) - corners(second)).mean(axis=1))
        support = np.where(np.isnan(support), np.fmax(nearest, nearest + motion @ normals.T), support)
    # Inflate about the centre, and widen where supports bend.
    bounds = corners(support)
    centre = bounds.mean(axis=1, keepdims=True)
    bend = np.pad(np.nan_to_num(np.abs(np.diff(support, 2, axis=0))), ((2, 2), (0, 0))) / 2
    bend = np.maximum.reduce([bend[:-2], bend[1:-1], bend[2:]])
    widening = np.maximum(bend - margin / 2 * (support - centre[:, 0] @ normals.T), 0.0).max(axis=1, keepdims=True)
    return np.nan_to_num(centre + (1 + margin) * (bounds - centre) + corners(widening + 0 * support))


def passes(
    table: Float64[np.ndarray, "surfaces columns"],
    starts: Float64[np.ndarray, "... 3"],
    points: Float64[np.ndarray, "... 2"],
) -> np.ndarray:
    """Whether the ray from each start (..., 3) through each point (..., 2) of the rear vertex plane leaves the lens."""
    direction = directions_to(table, starts, points)
    start = np.broadcast_to(starts, direction.shape)
    return trace(table, start.reshape(-1, 3), direction.reshape(-1, 3)).passes.reshape(direction.shape[:-1])


def interior_points(
    table: Float64[np.ndarray, "surfaces columns"],
    starts: Float64[np.ndarray, "n 3"],
    chief: Float64[np.ndarray, "n 2"],
    middle: Float64[np.ndarray, "2"],
) -> np.ndarray:
    """Crossings of chief rays if they pass, else interior points from a grid about a middle, (n, 2); NaN: dark."""
    result = chief.copy()
    radius = np.sqrt(table[0, SEMI_DIAMETER_SQUARED])
    u = np.linspace(-radius, radius, _GRID)
    grid = middle + np.stack(np.meshgrid(u, u), axis=-1).reshape(-1, 2)
    for i in np.flatnonzero(~passes(table, starts, result)):
        result[i] = inner_points(grid[None], passes(table, starts[i], grid)[None])[0]
    return result


def edges(
    table: Float64[np.ndarray, "surfaces columns"],
    starts: Float64[np.ndarray, "n 3"],
    inside: Float64[np.ndarray, "n 2"],
    ray: Float64[np.ndarray, "m 2"],
    bisections: int,
    slack_mm: float,
) -> np.ndarray:
    """Distance of the first blocked point in every direction from a passing one by bisection, (n, m) [mm].

    `slack_mm`: added to the distance of 2.5 semi-diameters of the rear surface at which rays are surely blocked.
    """
    shape = (len(inside), len(ray))
    farthest = np.full(shape, 2.5 * np.sqrt(table[0, SEMI_DIAMETER_SQUARED]) + slack_mm)

    def passes_at(far: np.ndarray) -> np.ndarray:
        """Whether rays at these distances from the inner points pass, (n, m)."""
        points = np.stack([inside[:, [axis]] + far * ray[:, axis] for axis in (0, 1)], axis=-1)
        return passes(table, starts[:, None], points)

    return halved(passes_at, np.zeros(shape), farthest, bisections)[1]


def directions_of(count: int) -> np.ndarray:
    """Unit vectors at even angles from +x, (count, 2)."""
    return unit_vectors(even_angles(count))


def supports(points: Float64[np.ndarray, "n m 2"]) -> np.ndarray:
    """Supports of sets of points (n, m, 2) along the normals of an outline's edges, (n, DIRECTIONS)."""
    return (points @ directions_of(DIRECTIONS).T).max(axis=1)


def corners(support: Float64[np.ndarray, "..."]) -> np.ndarray:
    """Polygons (..., DIRECTIONS, 2) from the supports (..., DIRECTIONS) of an outline's edges.

    Neighbouring support lines n_i . x = h_i meet in a vertex.
    """
    normal = directions_of(DIRECTIONS)
    next_support = np.roll(support, -1, axis=-1)
    turn = 2 * np.pi / DIRECTIONS
    along = (next_support - support * np.cos(turn)) / np.sin(turn)
    tangent = np.stack([-normal[:, 1], normal[:, 0]], axis=-1)
    return support[..., None] * normal + along[..., None] * tangent


def lit_share(
    table: Float64[np.ndarray, "n columns"],
    stop_row: int,
    start_mm: Float64[np.ndarray, "3"],
    end_mm: Float64[np.ndarray, "3"],
) -> float:
    """The share of the distance between two points behind the lens up to which light arrives: 1 if it does at the end.

    Right to 1e-5, if light arrives at the first point and ends once in between; a sliver of the pupil that is narrower
    than 1/64 of the rear surface and has no chief ray counts as dark.
    """
    table = enclosing(table)

    def is_lit(shares: np.ndarray) -> np.ndarray:
        """Whether light arrives at these shares of the distance."""
        points = start_mm + shares[:, None] * (end_mm - start_mm)
        # First through the centre of the stop, which may be narrow, and else over the whole rear surface.
        crossings = interior_points(table, points, chief_crossings(table, stop_row, points), np.zeros(2))
        return ~np.isnan(crossings[:, 0])

    shares = np.linspace(0, 1, _LIT_STEPS + 1)
    lit = is_lit(shares)
    if lit[-1]:
        return 1.0
    last = shares[lit].max(initial=0.0, keepdims=True)
    return float(halved(is_lit, last, last + 1 / _LIT_STEPS, _LIT_BISECTIONS)[0][0])


@functools.lru_cache(maxsize=_KEPT)
def grid_outlines(
    prescription: Prescription,
    middle_mm: tuple[float, float, float],
    half_extents_mm: tuple[float, float],
    slack_mm: float,
    margin: float = MARGIN,
    film: Film = UPRIGHT,
) -> Outlines:
    """Trace the outlines of any lens for a grid of points of a plane behind it.

    `middle_mm`: middle of the grid, film frame.
    `half_extents_mm`: half widths of the area that the grid serves, along x and y.
    `slack_mm`: distance from its point at which an outline, moved by the drift, still has to hold.
    """
    table, stop_row = _rear_of(prescription, film)
    step = max(*half_extents_mm, 1e-6) / _NODES
    columns, rows = (max(3, 2 * int(np.ceil(extent / step - 1e-9)) + 1) for extent in half_extents_mm)
    y, x = (axis - axis.mean() for axis in np.mgrid[:rows, :columns] * step)
    starts = np.array(middle_mm) + np.stack([x.ravel(), y.ravel(), np.zeros(x.size)], axis=1)
    # Trace the outline at every node, and the drift from node to node.
    traced = _traced(table, stop_row, starts).reshape(rows, columns, DIRECTIONS)
    centre = corners(traced).mean(axis=2)
    motions = np.concatenate([np.diff(centre[..., 0], axis=1).ravel(), np.diff(centre[..., 1], axis=0).ravel()]) / step
    finite = motions[~np.isnan(motions)]
    drift = float(np.median(finite)) if finite.size else 0.0
    # Extend outlines into the dark, and widen them by the margin, the error of interpolation, and what may change
    # beside the drift within the slack.
    shift = drift * step * directions_of(DIRECTIONS)
    support = _continued(traced, shift)
    widening = np.nan_to_num(_bend(support) + slack_mm / step * _slope(support, shift))
    centre_support = corners(support).mean(axis=2) @ directions_of(DIRECTIONS).T
    support += margin * (support - centre_support) + widening[..., None]
    return Outlines(step, np.nan_to_num(corners(support)), drift)


def _traced(table: np.ndarray, stop_row: int, starts: np.ndarray) -> np.ndarray:
    """Supports of the passing rays from each point, (n, DIRECTIONS); NaN where nothing passes."""
    middle = motion_of(table[0], ENTRY)[:2, 3]
    inside = interior_points(table, starts, chief_crossings(table, stop_row, starts), middle)
    lit = ~np.isnan(inside[:, 0])
    result = np.full((len(starts), DIRECTIONS), np.nan)
    if lit.any():
        slack = 2 * float(np.hypot(*middle))
        ray = directions_of(_GRID_TRACED)
        distance = edges(table, starts[lit], inside[lit], ray, _GRID_BISECTIONS, slack)
        result[lit] = supports(inside[lit, None] + distance[..., None] * ray)
    return result


def _continued(support: np.ndarray, shift: np.ndarray) -> np.ndarray:
    """Supports extended by those of lit neighbours, moved by the drift, in two rings around the lit part."""
    # Where light ends between two points the outline must not shrink to nothing before the light does.
    for _ in range(_DARK_RINGS):
        padded = np.pad(support, ((1, 1), (1, 1), (0, 0)), constant_values=np.nan)
        rows, columns = support.shape[:2]
        nearby = [
            padded[1 + j : 1 + j + rows, 1 + i : 1 + i + columns] - shift @ np.array([i, j])
            for j in (-1, 0, 1)
            for i in (-1, 0, 1)
        ]
        support = np.where(np.isnan(support), np.fmax.reduce(nearby), support)
    return support


def _bend(support: np.ndarray) -> np.ndarray:
    """Largest interpolation error of a support next to each point, (rows, columns)."""
    # Half of the larger second difference at both ends of an interval bounds the error of the interpolation in it, also
    # where a kink lies inside: vignetting begins there.
    total = np.zeros(support.shape[:2])
    for axis in (0, 1):
        second = np.nan_to_num(np.abs(np.diff(support, 2, axis=axis)).max(axis=2))
        padded = np.pad(second, [(2, 2) if a == axis else (1, 1) for a in (0, 1)])
        total += np.lib.stride_tricks.sliding_window_view(padded, (3, 3)).max(axis=(2, 3)) / 2
    return total


def _slope(support: np.ndarray, shift: np.ndarray) -> np.ndarray:
    """Largest change of a support from a point to the next, less the drift, (rows, columns)."""
    squared = np.zeros(support.shape[:2])
    for axis in (0, 1):
        change = np.abs(np.diff(support, axis=axis) - shift[:, 1 - axis])
        ends = [(1, 1) if a == axis else (0, 0) for a in (0, 1)]
        largest = np.pad(np.nan_to_num(change.max(axis=2)), ends)
        # The larger of the changes to both neighbours.
        squared += np.lib.stride_tricks.sliding_window_view(largest, 2, axis=axis).max(axis=-1) ** 2
    return np.sqrt(squared)
