"""Crossings of rays with warped boards and cylinders, in the frame of the patch [mm].

`shape` of a board over the chart: number of heights along x and y, half width, half height, then the heights, rows from
the top, each from the left; 0 heights along x stand for a parabolic warp, whose two deflections follow instead. That of
a cylinder holds its radius.
"""

import math

import numpy as np

from pipeline.jit.decorators import buffers, inline

COLUMNS, ROWS, HALF_X, HALF_Y, HEIGHTS = range(5)
"""Columns of the shape of a board; from the last one on follow its heights, or two deflections."""
CYLINDER_RADIUS = 0
"""Column of the shape of a cylinder."""
_STEPS = 20
"""Most steps of Newton's method: the number of correct digits doubles near the board, and a ray that grazes it must
end.
"""
_PRECISION = 1e-12
"""Last step of Newton's method [mm]; the remaining error is some digits smaller."""


@inline
def _weights(t):
    """Catmull-Rom weights of four neighbouring heights at a fraction t between the middle two, with two derivatives."""
    return (
        (
            0.5 * t * ((2.0 - t) * t - 1.0),
            0.5 * (t * t * (3.0 * t - 5.0) + 2.0),
            0.5 * t * ((4.0 - 3.0 * t) * t + 1.0),
            0.5 * t * t * (t - 1.0),
        ),
        (
            0.5 * ((4.0 - 3.0 * t) * t - 1.0),
            0.5 * t * (9.0 * t - 10.0),
            0.5 * ((8.0 - 9.0 * t) * t + 1.0),
            0.5 * t * (3.0 * t - 2.0),
        ),
        (2.0 - 3.0 * t, 9.0 * t - 5.0, 4.0 - 9.0 * t, 3.0 * t - 1.0),
    )


@inline
def _node(shape, i, j):
    """A height of the map; beyond its edge the linear continuation."""
    nx, ny = int(shape[COLUMNS]), int(shape[ROWS])
    if i < 0:
        return 2.0 * _row_node(shape, 0, j, nx, ny) - _row_node(shape, 1, j, nx, ny)
    if i >= nx:
        return 2.0 * _row_node(shape, nx - 1, j, nx, ny) - _row_node(shape, nx - 2, j, nx, ny)
    return _row_node(shape, i, j, nx, ny)


@inline
def _row_node(shape, i, j, nx, ny):
    if j < 0:
        return 2.0 * shape[HEIGHTS + i] - shape[HEIGHTS + nx + i]
    if j >= ny:
        return 2.0 * shape[HEIGHTS + (ny - 1) * nx + i] - shape[HEIGHTS + (ny - 2) * nx + i]
    return shape[HEIGHTS + j * nx + i]


@inline
def height_into(shape, u, v, result):
    """Height z and its derivatives by u, v, uu, uv, vv at a point of the chart; `result` (6,) is written."""
    half_x, half_y = shape[HALF_X], shape[HALF_Y]
    if shape[COLUMNS] == 0.0:
        a, b, x, y = shape[HEIGHTS], shape[HEIGHTS + 1], u / half_x, v / half_y
        result[0] = a * (1.0 - x * x) + b * (1.0 - y * y)
        result[1], result[2] = -2.0 * a * x / half_x, -2.0 * b * y / half_y
        result[3], result[4], result[5] = -2.0 * a / (half_x * half_x), 0.0, -2.0 * b / (half_y * half_y)
        return
    per_x, per_y = 0.5 * (shape[COLUMNS] - 1.0) / half_x, -0.5 * (shape[ROWS] - 1.0) / half_y
    along, down = (u + half_x) * per_x, (v - half_y) * per_y
    i = min(max(math.floor(along), 0.0), shape[COLUMNS] - 2.0)
    j = min(max(math.floor(down), 0.0), shape[ROWS] - 2.0)
    wx, wy = _weights(along - i), _weights(down - j)
    for k in range(6):
        result[k] = 0.0
    for b in range(4):
        for a in range(4):
            h = _node(shape, int(i) + a - 1, int(j) + b - 1)
            result[0] += h * wx[0][a] * wy[0][b]
            result[1] += h * wx[1][a] * wy[0][b] * per_x
            result[2] += h * wx[0][a] * wy[1][b] * per_y
            result[3] += h * wx[2][a] * wy[0][b] * per_x * per_x
            result[4] += h * wx[1][a] * wy[1][b] * per_x * per_y
            result[5] += h * wx[0][a] * wy[2][b] * per_y * per_y


@buffers
def height_hit(shape, o, d, t):
    """Newton's method from a path t: u, v and the normal (not of unit length) at the point where the ray meets the
    board.
    """
    height = np.empty(6)
    u, v, nx, ny = math.nan, math.nan, 0.0, 0.0
    for _ in range(_STEPS):
        u, v = o[0] + t * d[0], o[1] + t * d[1]
        height_into(shape, u, v, height)
        nx, ny = -height[1], -height[2]
        step = (o[2] + t * d[2] - height[0]) / (d[2] + nx * d[0] + ny * d[1])
        t -= step
        if not abs(step) > _PRECISION:
            break
    return o[0] + t * d[0], o[1] + t * d[1], nx, ny, 1.0


@inline
def cylinder_hit(radius, o, d, start):
    """Crossing of a ray with a cylinder about the line x = 0, z = -radius; of two crossings the one nearer to a
    path.

    u is the length of the arc from the line x = 0, z = 0; a negative radius is a hollow seen from inside.
    """
    cx, cz = o[0], o[2] + radius
    a, b = d[0] * d[0] + d[2] * d[2], cx * d[0] + cz * d[2]
    root = math.sqrt(b * b - a * (cx * cx + cz * cz - radius * radius))
    # The two roots of a quadratic without loss of digits by cancellation.
    q = -(b + math.copysign(root, b))
    first, second = q / a, (cx * cx + cz * cz - radius * radius) / q
    t = first if abs(first - start) < abs(second - start) else second
    x, z = (cx + t * d[0]) / radius, (cz + t * d[2]) / radius
    return radius * math.atan2(x, z), o[1] + t * d[1], x, 0.0, z
