"""Polygons on the sampling plane that tightly enclose all passing rays of a sensor position.

Kernels only; vision frame, mm. Without a microlens the polygon is the outline of the lens; behind one it is the
aperture, clipped by the outline mapped back through the linear map of `_clipped_aperture`. `camera` is a
`camera.tracing.records.CameraArrays`, `microlens` a row or NO_MICROLENS.
"""

import math
from typing import NamedTuple

import numpy as np

from pipeline.camera.parts.polygon import MAX_VERTICES, clip, fan
from pipeline.camera.tracing import microlens_kernels as column
from pipeline.camera.tracing.records import CameraArrays
from pipeline.jit.decorators import inline, kernel, unit
from pipeline.records.shapes import Float64

NO_MICROLENS, SKIP = -1, -2
"""Substitutes for the row of a microlens: a camera without any; nothing to trace."""
SHORTEST_EDGE_MM = 1e-9
"""Length below which an edge of an outline is a corner: it bounds nothing, and rounding may reverse it."""


class Region(NamedTuple):
    """Buffers of a region: polygon, outline and scratch, (MAX_VERTICES, 2) each, and cumulative areas of its fan."""

    polygon: np.ndarray
    outline: np.ndarray
    scratch: np.ndarray
    cumulative: np.ndarray


class Fan(NamedTuple):
    """Number of vertices of a region's polygon, its centre [mm], and its area [mm^2]: 0 where nothing passes."""

    vertices: int
    x: float
    y: float
    area: float


@unit
def new_region():
    """Buffers of a region, uninitialised."""
    shape = MAX_VERTICES, 2
    return Region(np.empty(shape), np.empty(shape), np.empty(shape), np.empty(MAX_VERTICES))


@unit
def bound(camera, microlens, x, y, slack, region):
    """Bound the rays of a sensor position, which may move by `slack`, by a polygon in the region; returns its fan."""
    if microlens == NO_MICROLENS:
        count = outline_at(camera.optics.step_mm, camera.outlines, x, y, region.polygon)
    else:
        count = _clipped_aperture(camera, microlens, x, y, slack, region)
    if count < 3:
        return Fan(0, 0.0, 0.0, 0.0)
    cx, cy, area = fan(region.polygon, count, region.cumulative)
    return Fan(count, cx, cy, area)


@inline
def outline_at(step, outlines, x, y, polygon):
    """The outline on the rear vertex plane for a point (x, y): from radial outlines or from a grid of them."""
    if outlines.shape[0] > 1:
        return _outline_in_grid(step, outlines, x, y, polygon)
    # Interpolate between the outlines of two heights, and turn the result to the azimuth of the point.
    height = math.sqrt(x * x + y * y)
    position = min(height / step, outlines.shape[1] - 1.0)
    i = min(int(position), outlines.shape[1] - 2)
    f = position - i
    c, s = (x / height, y / height) if height > 0.0 else (1.0, 0.0)
    for j in range(outlines.shape[2]):
        px = (1.0 - f) * outlines[0, i, j, 0] + f * outlines[0, i + 1, j, 0]
        py = (1.0 - f) * outlines[0, i, j, 1] + f * outlines[0, i + 1, j, 1]
        polygon[j, 0], polygon[j, 1] = c * px - s * py, s * px + c * py
    return outlines.shape[2]


@inline
def _outline_in_grid(step, outlines, x, y, polygon):
    """Bilinear interpolation between the four nodes around the point; the grid's middle belongs to (0, 0)."""
    i, f = _cell(x / step, outlines.shape[1])
    j, g = _cell(y / step, outlines.shape[0])
    a, b, c, d = (1.0 - f) * (1.0 - g), f * (1.0 - g), (1.0 - f) * g, f * g
    for n in range(outlines.shape[2]):
        for k in range(2):
            low = a * outlines[j, i, n, k] + b * outlines[j, i + 1, n, k]
            polygon[n, k] = low + c * outlines[j + 1, i, n, k] + d * outlines[j + 1, i + 1, n, k]
    return outlines.shape[2]


@inline
def _cell(position, count):
    """Left node of the interval that contains a position counted from the middle, and the share of the right one."""
    from_first = min(max(position + 0.5 * (count - 1), 0.0), count - 1.0)
    i = min(int(from_first), count - 2)
    return i, from_first - i


@inline
def _clipped_aperture(camera, microlens, x, y, slack, region):
    """Clip a microlens aperture to the rays that can pass the main lens, for a sensor position; returns the count."""
    # With L the distance from array to rear vertex, B from sensor to array and a the offset from the vertex v, the ray
    # meets the rear vertex plane at r = v + L (v - s) / B + a (1 + L / B - L / f), while the outline of v + a is that
    # of v, shifted by drift * a. So the outline of v, mapped back by the scale (1 + L / B - L / f - drift), clips a.
    # For microlenses that are not plain their columns hold this linear map, with a margin for its error.
    optics, row, aperture = camera.optics, camera.microlenses[microlens], camera.aperture
    polygon, outline, scratch, _ = region
    vx, vy, focal = row[column.X], row[column.Y], row[column.FOCAL]
    count = aperture.shape[0]
    if camera.elements.model == column.PLAIN:
        behind, ahead = optics.sampling_z_mm - optics.sensor_z_mm, optics.rear_z_mm - optics.sampling_z_mm
        scale = 1.0 + ahead / behind - ahead / focal - optics.drift
        bx, by = vx + ahead * (vx - x) / behind, vy + ahead * (vy - y) / behind
        reach = slack * ahead / behind
        for i in range(count):
            polygon[i, 0], polygon[i, 1] = aperture[i, 0], aperture[i, 1]
        size = outline_at(optics.step_mm, camera.outlines, vx, vy, outline)
    else:
        by_start, scale = row[column.BY_START], row[column.BY_AIM]
        bx, by = row[column.BASE_X] + by_start * (x - vx), row[column.BASE_Y] + by_start * (y - vy)
        reach = slack * abs(by_start) + row[column.MARGIN]
        for i in range(count):
            polygon[i, 0] = (1.0 + row[column.INFLATION]) * aperture[i, 0]
            polygon[i, 1] = (1.0 + row[column.INFLATION]) * aperture[i, 1]
        size = outline_at(optics.step_mm, camera.outlines, row[column.OUTLINE_X], row[column.OUTLINE_Y], outline)
    if outline[0, 0] == outline[size // 2, 0] and outline[0, 1] == outline[size // 2, 1]:
        return 0
    # Clip by each edge of the outline. A negative scale mirrors the region through its centre.
    sign = 1.0 if scale > 0.0 else -1.0
    for j in range(size):
        k = j + 1 if j + 1 < size else 0
        ex, ey = outline[k, 0] - outline[j, 0], outline[k, 1] - outline[j, 1]
        length = math.sqrt(ex * ex + ey * ey)
        if length < SHORTEST_EDGE_MM:
            continue
        # Outward normal of a counter-clockwise edge.
        nx, ny = ey / length, -ex / length
        limit = nx * (outline[j, 0] - bx) + ny * (outline[j, 1] - by) + reach
        count = clip(polygon, count, sign * nx, sign * ny, limit / abs(scale), scratch)
        if count < 3:
            return 0
    for i in range(count):
        polygon[i, 0] += vx
        polygon[i, 1] += vy
    return count


def outlines_around(camera: CameraArrays, points_mm: Float64[np.ndarray, "n 2"]) -> np.ndarray:
    """Outlines for points of the plane of the microlenses or sensor, (n, directions, 2)."""
    polygons = np.empty((len(points_mm), camera.outlines.shape[2], 2))
    _outlines_at(camera.optics.step_mm, camera.outlines, np.ascontiguousarray(points_mm), polygons)
    return polygons


@kernel
def _outlines_at(step, outlines, points, polygons):
    """Write the outlines (n, directions, 2) for points (n, 2)."""
    for n in range(points.shape[0]):
        outline_at(step, outlines, points[n, 0], points[n, 1], polygons[n])
