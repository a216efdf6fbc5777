"""Where light can leave a lens backwards: outlines of the passing rays, per height off the axis.

From a point at height h on a plane behind the lens (sensor or microlens array) the rays that pass fill a region of the
rear vertex plane. Its edge is traced in `_TRACED` directions at `HEIGHTS` heights and enclosed by a polygon whose edges
support it, with normals in `DIRECTIONS` fixed directions: corners of a vignetted pupil stay inside, and polygons of
different heights can be interpolated vertex by vertex, so that bounds are continuous in the field. Outlines only bound
the sampling: they are inflated, and every ray is still clipped at every surface.

Outlines turn with the azimuth of their point, as a lens of rotationally symmetric surfaces and apertures allows.
Polygons, rectangles and obstructions do not: outlines are those of the circles around all apertures, which let pass
whatever the apertures do. Bounds are looser by the share of the circle that an aperture covers; no ray is lost.
"""

from dataclasses import dataclass

import numpy as np

from pipeline.camera.chief import chief_heights
from pipeline.optics.kernels import trace_rays
from pipeline.optics.table import enclosing

HEIGHTS = 48
DIRECTIONS = 24
MARGIN = 0.02
"""Inflation of an outline about its centre: covers interpolation in height and what lies between traced directions."""
_TRACED = 720
_BISECTIONS = 26
_GRID = 65


@dataclass(frozen=True, slots=True)
class Outlines:
    """Outlines of the passing rays on the rear vertex plane, vision frame.

    Attributes
    ----------
    step_mm : float
        Distance of neighbouring heights; height i is i * step_mm, on the +x axis.
    vertices_mm : (HEIGHTS, DIRECTIONS, 2) float64
        Counter-clockwise polygons, some of their edges short or of no length; all zero where nothing passes.
    drift : float
        How far an outline's centre moves per height of its point, near the axis.
    """

    step_mm: float
    vertices_mm: np.ndarray
    drift: float


def outlines(
    table: np.ndarray, stop_row: int, plane_mm: float, max_height_mm: float, margin: float = MARGIN
) -> Outlines:
    """Trace the outlines for points on the plane z = `plane_mm` behind the lens.

    Parameters
    ----------
    table : (n, columns) float64
        From `optics.table.towards_scene`.
    stop_row : int
        Row of the aperture stop in the table.
    plane_mm : float
        Vision z of the plane (negative).
    max_height_mm : float
        Largest height that will be asked for.
    """
    table = enclosing(table)
    step = max(max_height_mm, 1e-6) / (HEIGHTS - 1)
    heights = step * np.arange(HEIGHTS)
    inside = _inner_points(table, stop_row, plane_mm, heights)
    found = ~np.isnan(inside[:, 0])
    vertices = np.zeros((HEIGHTS, DIRECTIONS, 2))
    if found.any():
        bounds = _supporting(_edges(table, plane_mm, heights[found], inside[found]))
        centre = bounds.mean(axis=1, keepdims=True)
        vertices[found] = centre + (1 + margin) * (bounds - centre)
    drift = float(vertices[1].mean(axis=0)[0] - vertices[0].mean(axis=0)[0]) / step if found[:2].all() else 0.0
    return Outlines(step, vertices, drift)


def passes(table: np.ndarray, plane_mm: float, heights: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Whether the ray from (height, 0, plane) through each point of the rear vertex plane leaves the lens, bool."""
    start = np.stack([heights, np.zeros_like(heights), np.full_like(heights, plane_mm)], axis=-1)
    aim = np.concatenate([points, np.full((*points.shape[:-1], 1), table[0, 0])], axis=-1)
    direction = aim - start
    direction /= np.linalg.norm(direction, axis=-1, keepdims=True)
    alive = np.ones(heights.size)
    trace_rays(table, start.reshape(-1, 3).copy(), direction.reshape(-1, 3).copy(), alive)
    return alive.reshape(heights.shape) > 0


def _inner_points(table: np.ndarray, stop_row: int, plane_mm: float, heights: np.ndarray) -> np.ndarray:
    """A passing point per height, (n, 2); NaN where nothing passes.

    The chief ray where it passes, else the centroid of the passing rays of a grid (strong vignetting).
    """
    result = np.zeros((heights.size, 2))
    result[:, 0] = chief_heights(table, stop_row, plane_mm, heights)
    missed = np.flatnonzero(~passes(table, plane_mm, heights, result))
    radius = np.sqrt(table[0, 3])
    u = np.linspace(-radius, radius, _GRID)
    grid = np.stack(np.meshgrid(u, u), axis=-1).reshape(-1, 2)
    for i in missed:
        ok = passes(table, plane_mm, np.full(len(grid), heights[i]), grid)
        result[i] = grid[ok].mean(axis=0) if ok.any() else np.nan
    return result


def _edges(table: np.ndarray, plane_mm: float, heights: np.ndarray, inside: np.ndarray) -> np.ndarray:
    """First blocked point in every traced direction by bisection, (n, _TRACED, 2)."""
    ray = _directions(_TRACED)
    shape = (heights.size, _TRACED)
    low, high = np.zeros(shape), np.full(shape, 2.5 * np.sqrt(table[0, 3]))
    height = np.broadcast_to(heights[:, None], shape).copy()
    for _ in range(_BISECTIONS):
        middle = (low + high) / 2
        ok = passes(table, plane_mm, height, inside[:, None] + middle[..., None] * ray)
        low, high = np.where(ok, middle, low), np.where(ok, high, middle)
    return inside[:, None] + high[..., None] * ray


def _directions(count: int) -> np.ndarray:
    angle = 2 * np.pi * np.arange(count) / count
    return np.stack([np.cos(angle), np.sin(angle)], axis=-1)


def _supporting(points: np.ndarray) -> np.ndarray:
    """Polygons around sets of points (n, m, 2) whose edges have normals in fixed directions, (n, DIRECTIONS, 2)."""
    normal = _directions(DIRECTIONS)
    support = (points @ normal.T).max(axis=1)
    # Neighbouring support lines n_i . x = h_i meet in a vertex.
    following = np.roll(support, -1, axis=1)
    turn = 2 * np.pi / DIRECTIONS
    along = (following - support * np.cos(turn)) / np.sin(turn)
    tangent = np.stack([-normal[:, 1], normal[:, 0]], axis=-1)
    return support[..., None] * normal + along[..., None] * tangent
