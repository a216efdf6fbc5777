"""Star-shaped polygons as sampling regions: uniform points, area, clipping, projected solid angle.

The area of a polygon is half the sum of x_i y_(i+1) - x_(i+1) y_i over its edges; Lambert's formula for its projected
solid angle is stated below. A polygon is a (MAX_VERTICES, 2) buffer and a count, vertices counter-clockwise. Kernels
only; lengths in mm.
"""

import math

import numpy as np

from pipeline.jit.decorators import inline
from pipeline.records.shapes import Float64

MAX_VERTICES = 64
"""Capacity of a buffer: an aperture of up to 24 corners cut by the 24 edges of an outline has 48 at most, because a cut
of a convex polygon adds one vertex."""


@inline
def fan(polygon, count, cumulative):
    """Write the cumulative areas of the triangles around the mean of the vertices; return the mean, and the area."""
    cx, cy = 0.0, 0.0
    for i in range(count):
        cx += polygon[i, 0]
        cy += polygon[i, 1]
    if count > 0:
        cx /= count
        cy /= count
    area = 0.0
    for i in range(count):
        j = i + 1 if i + 1 < count else 0
        ax, ay = polygon[i, 0] - cx, polygon[i, 1] - cy
        bx, by = polygon[j, 0] - cx, polygon[j, 1] - cy
        area += 0.5 * abs(ax * by - ay * bx)
        cumulative[i] = area
    return cx, cy, area


@inline
def triangle_of(cumulative, count, area, first):
    """Number of the first triangle of a fan up to which the areas exceed `area`, searched from number `first` on."""
    i = min(first, count - 1)
    while i > 0 and cumulative[i - 1] > area:
        i -= 1
    while i < count - 1 and cumulative[i] <= area:
        i += 1
    return i


@inline
def point_in_fan(polygon, count, cumulative, cx, cy, u, v):
    """Map the unit square onto the polygon, uniform in area: u picks triangle and angle, sqrt(v) the radius."""
    area_to_point = u * cumulative[count - 1]
    i = triangle_of(cumulative, count, area_to_point, int(u * count))
    below = cumulative[i - 1] if i > 0 else 0.0
    share = (area_to_point - below) / (cumulative[i] - below)
    j = i + 1 if i + 1 < count else 0
    radius = math.sqrt(v)
    ex = (1.0 - share) * (polygon[i, 0] - cx) + share * (polygon[j, 0] - cx)
    ey = (1.0 - share) * (polygon[i, 1] - cy) + share * (polygon[j, 1] - cy)
    return cx + radius * ex, cy + radius * ey


@inline
def clip(polygon, count, nx, ny, limit, scratch):
    """Clip a convex polygon to the half plane nx x + ny y <= limit, in place; returns the new count.

    Algorithm of Sutherland and Hodgman, Commun. ACM 17, 1974, 32.
    """
    is_cut = False
    for i in range(count):
        is_cut |= nx * polygon[i, 0] + ny * polygon[i, 1] > limit
    if not is_cut:
        return count
    # Keep vertices inside, and add one where an edge crosses the line.
    kept = 0
    for i in range(count):
        j = i + 1 if i + 1 < count else 0
        excess = nx * polygon[i, 0] + ny * polygon[i, 1] - limit
        next_excess = nx * polygon[j, 0] + ny * polygon[j, 1] - limit
        if excess <= 0.0 and kept < MAX_VERTICES:
            scratch[kept, 0], scratch[kept, 1] = polygon[i, 0], polygon[i, 1]
            kept += 1
        if excess * next_excess < 0.0 and kept < MAX_VERTICES:
            t = excess / (excess - next_excess)
            scratch[kept, 0] = polygon[i, 0] + t * (polygon[j, 0] - polygon[i, 0])
            scratch[kept, 1] = polygon[i, 1] + t * (polygon[j, 1] - polygon[i, 1])
            kept += 1
    for i in range(kept):
        polygon[i, 0], polygon[i, 1] = scratch[i, 0], scratch[i, 1]
    return kept


@inline
def area(polygon, count):
    """Area of a polygon, counter-clockwise [mm^2]."""
    total = 0.0
    for i in range(count):
        j = i + 1 if i + 1 < count else 0
        total += 0.5 * (polygon[i, 0] * polygon[j, 1] - polygon[j, 0] * polygon[i, 1])
    return total


@inline
def projected_solid_angle(polygon, count, x, y, distance):
    """Integral of cos(theta) d omega over a polygon in the plane z = distance, seen from (x, y, 0) [sr].

    Lambert's formula: half the sum over the edges of the angle they subtend times the z component of the normal of the
    plane through the edge and the point. Exact.
    """
    total = 0.0
    for i in range(count):
        j = i + 1 if i + 1 < count else 0
        ax, ay = polygon[i, 0] - x, polygon[i, 1] - y
        bx, by = polygon[j, 0] - x, polygon[j, 1] - y
        nx, ny, nz = (ay - by) * distance, (bx - ax) * distance, ax * by - ay * bx
        length = math.sqrt(nx * nx + ny * ny + nz * nz)
        if length > 0.0:
            angle = math.atan2(length, ax * bx + ay * by + distance * distance)
            total += 0.5 * angle * nz / length
    return total


def regular(sides: int, inradius: float, first_deg: float) -> np.ndarray:
    """A regular polygon around the origin whose first edge normal points at `first_deg`, (sides, 2)."""
    angle = np.deg2rad(first_deg) + (np.arange(sides) - 0.5) * 2 * np.pi / sides
    radius = inradius / np.cos(np.pi / sides)
    return radius * np.stack([np.cos(angle), np.sin(angle)], axis=1)


def rim_of(corners: Float64[np.ndarray, "n 2"], count: int) -> np.ndarray:
    """Points spaced evenly along the edges of a polygon, its corners among them, (count, 2)."""
    share = np.arange(count // len(corners)) / (count // len(corners))
    edge = np.roll(corners, -1, axis=0) - corners
    return (corners[:, None] + share[:, None] * edge[:, None]).reshape(-1, 2)
