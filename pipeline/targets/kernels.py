"""Artwork of targets as formulas: the colour of a point of the chart, and light along rays that meet a surface.

Lengths in mm. `drawing` is a `DrawingArrays`.
"""

import math
from typing import NamedTuple

import numpy as np

from pipeline.jit.decorators import inline, kernel
from pipeline.targets.surface_kernels import CYLINDER_RADIUS, cylinder_hit, height_hit, height_into

KINDS = ("Polygon", "Disc", "Spokes", "Checks")
"""Kinds of shapes, by their number in kernels."""
POLYGON, DISC, SPOKES, CHECKS = range(4)
"""Numbers of the kinds of shapes."""

NOT_PAINTED = -1.0
"""Value for a point beside a shape; black is 0 and white is 1."""
COLOUR, LEFT, RIGHT, BOTTOM, TOP = range(5)
"""Columns of the numbers of a polygon: 0 for black or 1 for white, and its bounds."""
MIDDLE_X, MIDDLE_Y, RADIUS = 1, 2, 3
"""Columns of a disc after its colour; spokes have a centre, too."""
SPOKES_COUNT, INNER, OUTER, PHASE = 0, 3, 4, 5
"""Columns of spokes: their number, both radii, the direction of the first [rad]."""
COLUMNS, ROWS, SQUARE = range(3)
"""Columns of checks: inner corners along x and y, and the edge of a square."""
NUMBERS = 6
"""Number of columns for a shape; spokes need all."""


class DrawingArrays(NamedTuple):
    """A drawing for the kernels, from `drawing.Drawing.arrays`; chart, mm.

    Attributes
    ----------
    half_x, half_y : float
        Half the width and half the height of the sheet.
    kinds : (s,) int64
        Kinds of the shapes, numbers of `KINDS`.
    numbers : (s, NUMBERS) float64
        Numbers of each shape, in columns that depend on its kind.
    first : (s + 1,) int64
        Index of the first corner of each shape.
    corners : (c, 2) float64
    bins : int
        Bins of a grid over the sheet, along each axis.
    starts, items : (bins^2 + 1,), (i,) int64
        Shapes that may be seen in each bin, the last one first, and where those of each begin.
    """

    half_x: float
    half_y: float
    kinds: np.ndarray
    numbers: np.ndarray
    first: np.ndarray
    corners: np.ndarray
    bins: int
    starts: np.ndarray
    items: np.ndarray


class Artwork(NamedTuple):
    """A drawing on a patch.

    Attributes
    ----------
    drawing : DrawingArrays
    colours : (2,) float64
        Radiance of black and of white.
    pose : (4, 4) float64
        vision_from_patch.
    """

    drawing: DrawingArrays
    colours: np.ndarray
    pose: np.ndarray


class Curved(NamedTuple):
    """A curved surface.

    Attributes
    ----------
    is_cylinder : bool
        Or else a warped board.
    shape : (k,) float64
        Its numbers, see `surface_kernels`.
    triangles : (m, 3, 3) float64
        Corners of a mesh near it, patch frame.
    """

    is_cylinder: bool
    shape: np.ndarray
    triangles: np.ndarray


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
def painted(drawing, s, x, y):
    """Colour that shape number s gives a point, NOT_PAINTED beside it."""
    kind, numbers, first = drawing.kinds[s], drawing.numbers, drawing.first
    if kind == CHECKS:
        return check_colour(numbers[s, COLUMNS], numbers[s, ROWS], numbers[s, SQUARE], x, y)
    if kind == POLYGON:
        if x < numbers[s, LEFT] or x > numbers[s, RIGHT] or y < numbers[s, BOTTOM] or y > numbers[s, TOP]:
            return NOT_PAINTED
        return numbers[s, COLOUR] if in_polygon(drawing.corners, first[s], first[s + 1], x, y) else NOT_PAINTED
    dx, dy = x - numbers[s, MIDDLE_X], y - numbers[s, MIDDLE_Y]
    if kind == DISC:
        return numbers[s, COLOUR] if dx * dx + dy * dy <= numbers[s, RADIUS] * numbers[s, RADIUS] else NOT_PAINTED
    return spoke_colour(numbers[s, SPOKES_COUNT], numbers[s, INNER], numbers[s, OUTER], numbers[s, PHASE], dx, dy)


@inline
def whiteness(drawing, x, y):
    """1 on white, 0 on black, NaN beside the sheet: the last shape that holds the point decides."""
    half_x, half_y, n, starts = drawing.half_x, drawing.half_y, drawing.bins, drawing.starts
    if not (abs(x) <= half_x and abs(y) <= half_y):
        return math.nan
    bin_ = 0
    if n > 1:
        i = min(int((x + half_x) / (2.0 * half_x) * n), n - 1)
        j = min(int((y + half_y) / (2.0 * half_y) * n), n - 1)
        bin_ = j * n + i
    for place in range(starts[bin_], starts[bin_ + 1]):
        colour = painted(drawing, drawing.items[place], x, y)
        if colour != NOT_PAINTED:
            return colour
    return 1.0


@kernel
def whiteness_at_points(drawing, x, y, value):
    """`whiteness` at many points, (n,) each; `value` is written."""
    for i in range(x.size):
        value[i] = whiteness(drawing, x[i], y[i])


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


@inline
def only_checks(drawing):
    """Whether a drawing is one checkerboard, and its columns, rows and square."""
    if drawing.kinds.size == 1 and drawing.kinds[0] == CHECKS:
        return True, drawing.numbers[0, COLUMNS], drawing.numbers[0, ROWS], drawing.numbers[0, SQUARE]
    return False, 0.0, 0.0, 1.0


@kernel
def plane_light(artwork, chosen, origin, direction, light):
    """Radiance along rays that meet a flat patch first.

    Parameters
    ----------
    artwork : Artwork
    chosen : (n,) bool
        The rays that may; a ray whose exact hit lies outside, or behind its start, keeps its light.
    origin, direction : (n, 3) float64
        Vision frame.
    light : (n,) float64
        Written where the ray hits: the artwork's radiance on the front, 0 on the back.
    """
    # Plain numbers stay in registers; the arrays of a drawing would be handed on at every ray.
    drawing, pose, colours = artwork.drawing, artwork.pose, artwork.colours
    is_checks, columns, rows, square = only_checks(drawing)
    half_x, half_y, black, white = drawing.half_x, drawing.half_y, colours[0], colours[1]
    for i in range(chosen.size):
        if not chosen[i]:
            continue
        x, y, towards = on_plane(pose, origin, direction, i)
        if not (abs(x) <= half_x and abs(y) <= half_y):
            continue
        value = check_colour(columns, rows, square, x, y) if is_checks else whiteness(drawing, x, y)
        if towards < 0.0:
            light[i] = black if value == 0.0 else white
        else:
            light[i] = 0.0


@kernel
def curved_light(artwork, surface, triangle, origin, direction, light):
    """Radiance along rays that meet a curved patch first: the hit on its mesh is the start, the true surface decides.

    Parameters
    ----------
    artwork : Artwork
    surface : Curved
    triangle : (n,) int64
        Triangle of the patch that each ray meets first; negative: none.
    """
    drawing, colours, pose = artwork
    is_cylinder, shape, triangles = surface
    for i in range(triangle.size):
        if triangle[i] < 0:
            continue
        o, d = _in_patch(pose, origin[i], direction[i])
        start = _meets(triangles[triangle[i]], o, d)
        if is_cylinder:
            u, v, nx, ny, nz = cylinder_hit(shape[CYLINDER_RADIUS], o, d, start)
        else:
            u, v, nx, ny, nz = height_hit(shape, o, d, start)
        value = whiteness(drawing, u, v)
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
