"""Artwork of targets as formulas: radiance at a point of the target's plane, target frame [mm]."""

import math

from pipeline.jit import inline, kernel


@inline
def checkerboard(columns, rows, square, white, black, x, y):
    """Radiance of a checkerboard with a white margin of one square, NaN outside of it.

    Parameters
    ----------
    columns, rows : int
        Inner corners. The top-left square, at small x and large y, is black.
    """
    column = math.floor(x / square + 0.5 * (columns + 1))
    row = math.floor(0.5 * (rows + 1) - y / square)
    if abs(x) > 0.5 * (columns + 3) * square or abs(y) > 0.5 * (rows + 3) * square:
        return math.nan
    inside = 0 <= column <= columns and 0 <= row <= rows
    return black if inside and (int(column) + int(row)) % 2 == 0 else white


@kernel
def checkerboard_points(columns, rows, square, white, black, x, y, radiance):
    """`checkerboard` at many points, (n,) each; `radiance` is written."""
    for i in range(x.size):
        radiance[i] = checkerboard(columns, rows, square, white, black, x[i], y[i])


@kernel
def checkerboard_light(columns, rows, square, white, black, pose, chosen, origin, direction, light):
    """Radiance along rays that meet a checkerboard first.

    Parameters
    ----------
    pose : (4, 4) float64
        vision_from_target.
    chosen : (n,) bool
        The rays that do; a ray whose exact hit lies outside keeps its light.
    origin, direction : (n, 3) float64
        Vision frame.
    light : (n,) float64
        Written where the ray hits: the artwork's radiance on the front, 0 on the back.
    """
    for i in range(chosen.size):
        if not chosen[i]:
            continue
        ox, oy, oz = origin[i, 0] - pose[0, 3], origin[i, 1] - pose[1, 3], origin[i, 2] - pose[2, 3]
        dx, dy, dz = direction[i, 0], direction[i, 1], direction[i, 2]
        towards = pose[0, 2] * dx + pose[1, 2] * dy + pose[2, 2] * dz
        t = -(pose[0, 2] * ox + pose[1, 2] * oy + pose[2, 2] * oz) / towards
        hx, hy, hz = ox + t * dx, oy + t * dy, oz + t * dz
        x = pose[0, 0] * hx + pose[1, 0] * hy + pose[2, 0] * hz
        y = pose[0, 1] * hx + pose[1, 1] * hy + pose[2, 1] * hz
        value = checkerboard(columns, rows, square, white, black, x, y)
        if not math.isnan(value):
            light[i] = value if towards < 0.0 else 0.0
