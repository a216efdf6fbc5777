"""Artwork of targets as formulas: the colour of a point of the chart, and light along rays that meet a surface.

Lengths in mm. The leading arguments of all kernels are the arrays of `drawing.Drawing.arrays`.
"""

import math

import numpy as np

from pipeline.jit.decorators import inline, kernel
from pipeline.targets.surface_kernels import cylinder_hit, height_hit, height_into

KINDS = ("Polygon", "Disc", "Spokes", "Checks")
"""Shapes of a drawing, by the numbers that the kernels know them by."""
POLYGON, DISC, SPOKES, CHECKS = range(4)

NOT_PAINTED = -1.0


@inline
def in_polygon(corners, first, end, x, y):
    """Even-odd rule: of two polygons that share an edge only one holds a point of it."""
    inside = False
    j = end - 1
    for i in range(first, end):
        xi, yi, xj, yj = corners[i, 0], corners[i, 1], corners[j, 0], corners[j, 1]
        if (yi > y) != (yj > y) and x < (xj - xi) * (y - yi) / (yj - yi) + xi:
            inside = not inside
        j = i
    return inside


@inline
def check_colour(columns, rows, square, x, y):
    """0 on the black squares of a checkerboard, 1 on its white ones, NOT_PAINTED beside it."""
    column = math.floor(x / square + 0.5 * (columns + 1))
    row = math.floor(0.5 * (rows + 1) - y / square)
    if 0 <= column <= columns and 0 <= row <= rows:
        return 0.0 if (int(column) + int(row)) % 2 == 0 else 1.0
    return NOT_PAINTED


@inline
def spoke_colour(count, inner, outer, phase, x, y):
    """0 on the black sectors of a ring about the origin, NOT_PAINTED elsewhere."""
    squared = x * x + y * y
    if squared > outer * outer or squared < inner * inner:
        return NOT_PAINTED
    turn = (math.atan2(y, x) - phase) * count / (2.0 * math.pi)
    return 0.0 if turn - math.floor(turn) < 0.5 else NOT_PAINTED


@inline
def painted(kinds, numbers, first, corners, s, x, y):
    """Colour that shape number s gives a point, NOT_PAINTED beside it."""
    kind = kinds[s]
    if kind == CHECKS:
        return check_colour(numbers[s, 0], numbers[s, 1], numbers[s, 2], x, y)
    if kind == POLYGON:
        if x < numbers[s, 1] or x > numbers[s, 2] or y < numbers[s, 3] or y > numbers[s, 4]:
            return NOT_PAINTED
        return numbers[s, 0] if in_polygon(corners, first[s], first[s + 1], x, y) else NOT_PAINTED
    dx, dy = x - numbers[s, 1], y - numbers[s, 2]
    if kind == DISC:
        return numbers[s, 0] if dx * dx + dy * dy <= numbers[s, 3] * numbers[s, 3] else NOT_PAINTED
    return spoke_colour(numbers[s, 0], numbers[s, 3], numbers[s, 4], numbers[s, 5], dx, dy)


@inline
def whiteness(sheet, kinds, numbers, first, corners, bins, starts, items, x, y):
    """1 on white, 0 on black, NaN beside the sheet: the last shape that holds the point decides."""
    if not (abs(x) <= sheet[0] and abs(y) <= sheet[1]):
        return math.nan
    n = bins[0]
    own = 0
    if n > 1:
        i = min(int((x + sheet[0]) / (2.0 * sheet[0]) * n), n - 1)
        j = min(int((y + sheet[1]) / (2.0 * sheet[1]) * n), n - 1)
        own = j * n + i
    for place in range(starts[own], starts[own + 1]):
        s = items[place]
        colour = painted(kinds, numbers, first, corners, s, x, y)
        if colour != NOT_PAINTED:
            return colour
    return 1.0


@kernel
def whiteness_at_points(sheet, kinds, numbers, first, corners, bins, starts, items, x, y, value):
    """`whiteness` at many points, (n,) each; `value` is written."""
    for i in range(x.size):
        value[i] = whiteness(sheet, kinds, numbers, first, corners, bins, starts, items, x[i], y[i])


@inline
def on_plane(pose, origin, direction, i):
    """Meet the plane of a patch: x and y there, x NaN if the ray does not; and positive if it comes from behind."""
    ox, oy, oz = origin[i, 0] - pose[0, 3], origin[i, 1] - pose[1, 3], origin[i, 2] - pose[2, 3]
    dx, dy, dz = direction[i, 0], direction[i, 1], direction[i, 2]
    towards = pose[0, 2] * dx + pose[1, 2] * dy + pose[2, 2] * dz
    t = -(pose[0, 2] * ox + pose[1, 2] * oy + pose[2, 2] * oz) / towards
    hx, hy, hz = ox + t * dx, oy + t * dy, oz + t * dz
    x = pose[0, 0] * hx + pose[1, 0] * hy + pose[2, 0] * hz
    y = pose[0, 1] * hx + pose[1, 1] * hy + pose[2, 1] * hz
    return (x if t > 0.0 else math.nan), y, towards


@kernel
def plane_light(
    sheet, kinds, numbers, first, corners, bins, starts, items, colours, pose, chosen, origin, direction, light
):
    """Radiance along rays that meet a flat patch first.

    Parameters
    ----------
    colours : (2,) float64
        Radiance of black and of white.
    pose : (4, 4) float64
        vision_from_patch.
    chosen : (n,) bool
        The rays that may; a ray whose exact hit lies outside, or behind its start, keeps its light.
    origin, direction : (n, 3) float64
        Vision frame.
    light : (n,) float64
        Written where the ray hits: the artwork's radiance on the front, 0 on the back.
    """
    # Plain numbers stay in registers; the arrays of a drawing would be handed on at every ray.
    is_checks = kinds.size == 1 and kinds[0] == CHECKS
    columns, rows, square = (numbers[0, 0], numbers[0, 1], numbers[0, 2]) if is_checks else (0.0, 0.0, 1.0)
    half_x, half_y, black, white = sheet[0], sheet[1], colours[0], colours[1]
    for i in range(chosen.size):
        if not chosen[i]:
            continue
        x, y, towards = on_plane(pose, origin, direction, i)
        if not (abs(x) <= half_x and abs(y) <= half_y):
            continue
        if is_checks:
            value = check_colour(columns, rows, square, x, y)
        else:
            value = whiteness(sheet, kinds, numbers, first, corners, bins, starts, items, x, y)
        if towards < 0.0:
            light[i] = black if value == 0.0 else white
        else:
            light[i] = 0.0


@kernel
def curved_light(
    sheet,
    kinds,
    numbers,
    first,
    corners,
    bins,
    starts,
    items,
    colours,
    pose,
    triangle,
    triangles,
    is_cylinder,
    shape,
    origin,
    direction,
    light,
):
    """Radiance along rays that meet a curved patch first: the hit on its mesh is the start, the true surface decides.

    Parameters
    ----------
    triangle : (n,) int64
        Which triangle of the patch each ray meets first; negative: none.
    triangles : (m, 3, 3) float64
        Corners, patch frame.
    is_cylinder : bool
    shape : (k,) float64
        Numbers of the surface, see `surface_kernels`.
    """
    for i in range(triangle.size):
        if triangle[i] < 0:
            continue
        o, d = _in_patch(pose, origin[i], direction[i])
        start = _meets(triangles[triangle[i]], o, d)
        if is_cylinder:
            u, v, nx, ny, nz = cylinder_hit(shape[0], o, d, start)
        else:
            u, v, nx, ny, nz = height_hit(shape, o, d, start)
        value = whiteness(sheet, kinds, numbers, first, corners, bins, starts, items, u, v)
        if not math.isnan(value):
            towards = nx * d[0] + ny * d[1] + nz * d[2]
            light[i] = colours[int(value)] if towards < 0.0 else 0.0


@kernel
def mesh_light(albedo, triangles, pose, triangle, origin, direction, light):
    """Radiance along rays that meet a mesh first: the albedo of the triangle's corners, interpolated; backs are black.

    Parameters
    ----------
    albedo : (m, 3) float64
        Radiance at the corners of the triangles.
    """
    for i in range(triangle.size):
        if triangle[i] < 0:
            continue
        o, d = _in_patch(pose, origin[i], direction[i])
        corners = triangles[triangle[i]]
        t = _meets(corners, o, d)
        p = (o[0] + t * d[0], o[1] + t * d[1], o[2] + t * d[2])
        e1, e2 = _minus(corners[1], corners[0]), _minus(corners[2], corners[0])
        normal = _cross(e1, e2)
        area = _dot(normal, normal)
        q = (p[0] - corners[0, 0], p[1] - corners[0, 1], p[2] - corners[0, 2])
        b1 = _dot(_cross(q, e2), normal) / area
        b2 = _dot(_cross(e1, q), normal) / area
        shade = albedo[triangle[i]]
        value = shade[0] + b1 * (shade[1] - shade[0]) + b2 * (shade[2] - shade[0])
        light[i] = value if _dot(normal, d) < 0.0 else 0.0


@inline
def _in_patch(pose, origin, direction):
    """A ray in the frame of the patch: two triples."""
    ox, oy, oz = origin[0] - pose[0, 3], origin[1] - pose[1, 3], origin[2] - pose[2, 3]
    dx, dy, dz = direction[0], direction[1], direction[2]
    return (
        (
            pose[0, 0] * ox + pose[1, 0] * oy + pose[2, 0] * oz,
            pose[0, 1] * ox + pose[1, 1] * oy + pose[2, 1] * oz,
            pose[0, 2] * ox + pose[1, 2] * oy + pose[2, 2] * oz,
        ),
        (
            pose[0, 0] * dx + pose[1, 0] * dy + pose[2, 0] * dz,
            pose[0, 1] * dx + pose[1, 1] * dy + pose[2, 1] * dz,
            pose[0, 2] * dx + pose[1, 2] * dy + pose[2, 2] * dz,
        ),
    )


@inline
def _meets(corners, o, d):
    """Path of a ray to the plane of a triangle."""
    normal = _cross(_minus(corners[1], corners[0]), _minus(corners[2], corners[0]))
    away = (corners[0, 0] - o[0], corners[0, 1] - o[1], corners[0, 2] - o[2])
    return _dot(away, normal) / _dot(d, normal)


@inline
def _minus(a, b):
    return (a[0] - b[0], a[1] - b[1], a[2] - b[2])


@inline
def _cross(a, b):
    return (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])


@inline
def _dot(a, b):
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@kernel
def heights_at_points(shape, u, v, result):
    """`surface_kernels.height` at many points; `result` (n, 6) is written."""
    from_shape = np.empty(6)
    for i in range(u.size):
        height_into(shape, u[i], v[i], from_shape)
        for k in range(6):
            result[i, k] = from_shape[k]
