"""Where light can leave a lens backwards: outlines of the passing rays, per height off the axis.

From a point at height h on a plane behind the lens (sensor or microlens array) the rays that pass fill a region of the
rear vertex plane. Its outline is traced in `DIRECTIONS` directions at `HEIGHTS` heights and interpolated in between, so
that bounds are continuous in the field. Outlines only bound the sampling: they are inflated, and every ray is still
clipped at every surface.

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
"""Inflation of an outline about its centre: covers interpolation in height and the chords between directions."""
_BISECTIONS = 40
_GRID = 65


@dataclass(frozen=True, slots=True)
class Outlines:
    """Outlines of the passing rays on the rear vertex plane, vision frame.

    Attributes
    ----------
    step_mm : float
        Distance of neighbouring heights; height i is i * step_mm, on the +x axis.
    vertices_mm : (HEIGHTS, DIRECTIONS, 2) float64
        Counter-clockwise polygons; all zero where nothing passes.
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
        edge = _edges(table, plane_mm, heights[found], inside[found])
        centre = edge.mean(axis=1, keepdims=True)
        inflation = (1 + margin) / np.cos(np.pi / DIRECTIONS)
        vertices[found] = centre + inflation * (edge - centre)
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
    """Last passing point in every direction by bisection, (n, DIRECTIONS, 2)."""
    angle = 2 * np.pi * np.arange(DIRECTIONS) / DIRECTIONS
    ray = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    shape = (heights.size, DIRECTIONS)
    low, high = np.zeros(shape), np.full(shape, 2.5 * np.sqrt(table[0, 3]))
    height = np.broadcast_to(heights[:, None], shape).copy()
    for _ in range(_BISECTIONS):
        middle = (low + high) / 2
        ok = passes(table, plane_mm, height, inside[:, None] + middle[..., None] * ray)
        low, high = np.where(ok, middle, low), np.where(ok, high, middle)
    return inside[:, None] + high[..., None] * ray
