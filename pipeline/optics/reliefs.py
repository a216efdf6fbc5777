"""Reliefs: surfaces whose sag h(x, y) is a bicubic spline of heights. Functions of one ray, inlined into kernels.

h(x, y) = sum of c_ij B_i(x) B_j(y) over cubic B-splines on an even grid, 16 of which are not zero at a point. From the
vertex plane Newton's method solves t d_z = h(x + t d_x, y + t d_y) for the path t. A relief is nearly flat, so each
step doubles the digits, and a ray that has not converged after `_STEPS` has missed it. Beyond the grid, where no
aperture reaches, the spline of the edge cell continues.
"""

import math
from typing import NamedTuple

from pipeline.jit.decorators import inline
from pipeline.optics.aspheres import RESIDUAL_MM
from pipeline.optics.crossing import Ray
from pipeline.optics.table import (
    COEFFICIENTS,
    RELIEF_COLUMNS,
    RELIEF_ROWS,
    RELIEF_SPACING,
    SEMI_DIAMETER_SQUARED,
    VERTEX,
)

_STEPS = 7
"""Newton steps: five are enough where slopes stay below 1."""


class Height(NamedTuple):
    """Height of a relief at a point [mm], and its slopes along x and y."""

    mm: float
    by_x: float
    by_y: float


@inline
def through_relief(row, mu, ray):
    """The ray moved from the vertex plane to the relief, and refracted there."""
    # Solve t d_z = h by Newton's method.
    t = 0.0
    height = height_at(row, ray.x, ray.y)
    for _ in range(_STEPS):
        step = (height.mm - t * ray.dz) / (ray.dz - height.by_x * ray.dx - height.by_y * ray.dy)
        t += step
        height = height_at(row, ray.x + t * ray.dx, ray.y + t * ray.dy)
    # Refract as in `aspheres.bent`, with the normal m = (-dh/dx, -dh/dy, 1).
    x, y = ray.x + t * ray.dx, ray.y + t * ray.dy
    along = ray.dz - height.by_x * ray.dx - height.by_y * ray.dy
    length = 1.0 + height.by_x * height.by_x + height.by_y * height.by_y
    squared = length - mu * mu * (length - along * along)
    bend = (math.sqrt(max(squared, 0.0)) - mu * along) / length
    meets = (abs(height.mm - t * ray.dz) <= RESIDUAL_MM) & (along > 0.0) & (squared >= 0.0)
    passes = meets & (x * x + y * y <= row[SEMI_DIAMETER_SQUARED])
    return Ray(
        x,
        y,
        row[VERTEX] + t * ray.dz,
        mu * ray.dx - bend * height.by_x,
        mu * ray.dy - bend * height.by_y,
        mu * ray.dz + bend,
        ray.alive if passes else 0.0,
    )


@inline
def height_at(row, x, y):
    """Height and slopes at a point of the vertex plane: the sum over 16 splines, row by row."""
    columns = row[RELIEF_COLUMNS]
    rows = row[RELIEF_ROWS]
    per_mm = 1.0 / row[RELIEF_SPACING]
    # Coefficients lie one spacing beyond the heights on each side.
    u, v = x * per_mm + 0.5 * (columns - 1.0), y * per_mm + 0.5 * (rows - 1.0)
    column, row_below = _cell(u, columns), _cell(v, rows)
    u, v = u - column, v - row_below
    height = by_x = by_y = 0.0
    corner = COEFFICIENTS + (int(row_below) - 1) * int(columns) + int(column) - 1
    width = int(columns)
    for k in range(4):
        first = corner + k * width
        row_sum = 0.0
        row_slope = 0.0
        for n in range(4):
            a = row[first + n]
            row_sum += _basis(n, u) * a
            row_slope += _slope(n, u) * a
        height += _basis(k, v) * row_sum
        by_x += _basis(k, v) * row_slope
        by_y += _slope(k, v) * row_sum
    return Height(height, by_x * per_mm, by_y * per_mm)


@inline
def _cell(u, count):
    """The cell of a grid coordinate, or the nearest one with four splines; the first one for NaN.

    An integral value, but no integer: in single precision the two types must not meet.
    """
    inside = u if u > 1.0 else 1.0
    inside = inside if inside < count - 3.0 else count - 3.0
    return inside - inside % 1.0


@inline
def _basis(n, t):
    """The n-th of the four cubic B-splines on a cell, at coordinate t in [0, 1]."""
    s = 1.0 - t
    if n == 0:
        return s * s * s / 6.0
    if n == 1:
        return (4.0 - 6.0 * t * t + 3.0 * t * t * t) / 6.0
    if n == 2:
        return (4.0 - 6.0 * s * s + 3.0 * s * s * s) / 6.0
    return t * t * t / 6.0


@inline
def _slope(n, t):
    """The derivative of `_basis`."""
    s = 1.0 - t
    if n == 0:
        return -0.5 * s * s
    if n == 1:
        return -2.0 * t + 1.5 * t * t
    if n == 2:
        return 2.0 * s - 1.5 * s * s
    return 0.5 * t * t
