"""Intersections of rays with the surfaces of targets, and the light of their artwork. Kernels only; mm.

A board is z = h(u, v) over the chart: Catmull-Rom cubics between heights, h = sum of h_ij w_i(u) w_j(v), or a parabolic
warp, h = a (1 - (u / half width)^2) + b (1 - (v / half height)^2). Newton's method solves o_z + t d_z = h for the path
t. A cylinder is x^2 + (z + R)^2 = R^2 in the patch frame, met at the roots of a quadratic.

`shape` of a board: number of heights along x and y, half width, half height, then the heights, rows from the top, each
from the left; 0 heights along x mark a parabolic warp, followed by its two deflections. That of a cylinder holds its
radius.
"""

import math
from typing import NamedTuple

import numpy as np

from pipeline.jit.decorators import inline, kernel, unit
from pipeline.targets.drawing import DrawingArrays, check_colour, only_checks, whiteness
from pipeline.targets.vectors import along, column, cross, dot, local, minus, row

COLUMNS, ROWS, HALF_X, HALF_Y, HEIGHTS = range(5)
"""Columns of the shape of a board; its heights, or two deflections, begin at the last one."""
CYLINDER_RADIUS = 0
"""Column of the shape of a cylinder."""
_STEPS = 20
"""Most Newton steps: digits double near the board, and the search for a grazing ray must end."""
_PRECISION = 1e-12
"""Last step of Newton's method [mm]; the remaining error is some digits smaller."""


class Artwork(NamedTuple):
    """A drawing on a patch: radiance (2,) of black and of white, and the pose vision_from_patch (4, 4)."""

    drawing: DrawingArrays
    colours: np.ndarray
    pose: np.ndarray


class Curved(NamedTuple):
    """A cylinder or a warped board: its parameters, and corners (m, 3, 3) of a mesh near it, patch frame."""

    is_cylinder: bool
    shape: np.ndarray
    triangles: np.ndarray


@inline
def on_plane(pose, origin, direction):
    """Intersect a ray with the plane z = 0 of a frame: path, x, y, and a number that is positive for rays from behind.

    `pose` is vision_from_frame, the ray two triples in the vision frame; the path is negative behind its start.
    """
    z = column(pose, 2)
    from_frame = minus(origin, column(pose, 3))
    towards = dot(z, direction)
    t = -dot(z, from_frame) / towards
    hit = along(from_frame, t, direction)
    return t, dot(column(pose, 0), hit), dot(column(pose, 1), hit), towards


@inline
def path_to(corners, origin, direction):
    """Path of a ray to the plane of a triangle, and the plane's normal, not of unit length."""
    first = row(corners, 0)
    normal = cross(minus(row(corners, 1), first), minus(row(corners, 2), first))
    return dot(minus(first, origin), normal) / dot(direction, normal), normal


@inline
def shares(corners, normal, point):
    """Weights of the second and the third corner at a point of the plane of a triangle."""
    first = row(corners, 0)
    squared = dot(normal, normal)
    to_second, to_third = minus(row(corners, 1), first), minus(row(corners, 2), first)
    to_point = minus(point, first)
    return dot(cross(to_point, to_third), normal) / squared, dot(cross(to_second, to_point), normal) / squared


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
    """A height of the map, continued linearly beyond its edge."""
    nx, ny = int(shape[COLUMNS]), int(shape[ROWS])
    if i < 0:
        return 2.0 * _row_node(shape, 0, j, nx, ny) - _row_node(shape, 1, j, nx, ny)
    if i >= nx:
        return 2.0 * _row_node(shape, nx - 1, j, nx, ny) - _row_node(shape, nx - 2, j, nx, ny)
    return _row_node(shape, i, j, nx, ny)


@inline
def _row_node(shape, i, j, nx, ny):
    """A height in a column of the map, continued linearly beyond its first and its last row."""
    if j < 0:
        return 2.0 * shape[HEIGHTS + i] - shape[HEIGHTS + nx + i]
    if j >= ny:
        return 2.0 * shape[HEIGHTS + (ny - 1) * nx + i] - shape[HEIGHTS + (ny - 2) * nx + i]
    return shape[HEIGHTS + j * nx + i]


@inline
def height_into(shape, u, v, result):
    """Write the height z and its derivatives by u, v, uu, uv, vv at a point of the chart into `result` (6,)."""
    half_x, half_y = shape[HALF_X], shape[HALF_Y]
    if shape[COLUMNS] == 0.0:  # a parabolic warp
        a = shape[HEIGHTS]
        b = shape[HEIGHTS + 1]
        x = u / half_x
        y = v / half_y
        result[0] = a * (1.0 - x * x) + b * (1.0 - y * y)
        result[1], result[2] = -2.0 * a * x / half_x, -2.0 * b * y / half_y
        result[3], result[4], result[5] = -2.0 * a / (half_x * half_x), 0.0, -2.0 * b / (half_y * half_y)
        return
    # Find the cell of the point, by heights per mm from the top left, and the weights of its 4 x 4 neighbours.
    per_x, per_y = 0.5 * (shape[COLUMNS] - 1.0) / half_x, -0.5 * (shape[ROWS] - 1.0) / half_y
    along, down = (u + half_x) * per_x, (v - half_y) * per_y
    i = min(max(math.floor(along), 0.0), shape[COLUMNS] - 2.0)
    j = min(max(math.floor(down), 0.0), shape[ROWS] - 2.0)
    wx, wy = _weights(along - i), _weights(down - j)
    # Sum up the products of weights; each derivative by u or v brings a factor of heights per mm.
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


@unit
def height_hit(shape, o, d, t):
    """Newton's method from a path t: u, v and the normal (not of unit length) at the intersection with the board."""
    height = np.empty(6)
    u, v, nx, ny = math.nan, math.nan, 0.0, 0.0
    for _ in range(_STEPS):
        u, v = o[0] + t * d[0], o[1] + t * d[1]
        height_into(shape, u, v, height)
        # With the normal (nx, ny, 1) the residual o_z + t d_z - h changes along the path by d . n.
        nx, ny = -height[1], -height[2]
        step = (o[2] + t * d[2] - height[0]) / (d[2] + nx * d[0] + ny * d[1])
        t -= step
        if not abs(step) > _PRECISION:
            break
    return o[0] + t * d[0], o[1] + t * d[1], nx, ny, 1.0


@inline
def cylinder_hit(radius, o, d, start):
    """Intersection of a ray with a cylinder about the line x = 0, z = -radius; the one of two nearer to a path.

    u is the length of the arc from the line x = 0, z = 0; a negative radius is a hollow seen from inside.
    """
    # Across the axis, from which the ray starts at (cx, cz), its path t solves a t^2 + 2 b t + c = 0 with c = cx^2 +
    # cz^2 - radius^2.
    cx, cz = o[0], o[2] + radius
    a = d[0] * d[0] + d[2] * d[2]
    b = cx * d[0] + cz * d[2]
    root = math.sqrt(b * b - a * (cx * cx + cz * cz - radius * radius))
    # The two roots of a quadratic without loss of digits by cancellation.
    q = -(b + math.copysign(root, b))
    first, second = q / a, (cx * cx + cz * cz - radius * radius) / q
    t = first if abs(first - start) < abs(second - start) else second
    # The normal is the unit vector from the axis, and its angle times the radius is the arc.
    x, z = (cx + t * d[0]) / radius, (cz + t * d[2]) / radius
    return radius * math.atan2(x, z), o[1] + t * d[1], x, 0.0, z


@inline
def _in_patch(pose, origin, direction, i):
    """Ray number i in the frame of the patch: two triples."""
    x, y, z = column(pose, 0), column(pose, 1), column(pose, 2)
    return local(minus(row(origin, i), column(pose, 3)), x, y, z), local(row(direction, i), x, y, z)


@kernel
def plane_light(artwork, chosen, origin, direction, light):
    """Radiance along rays that meet a flat patch first: of the artwork on its front, 0 on its back.

    `chosen`, (n,) bool: the candidate rays; one whose exact hit lies outside, or behind its start, keeps its light.
    `origin`, `direction`, (n, 3) float64: vision frame.
    `light`, (n,) float64: written where the ray hits.
    """
    # Plain numbers stay in registers; the arrays of a drawing would be passed at every ray.
    drawing, colours, pose = artwork
    is_checks, columns, rows, square = only_checks(drawing)
    half_x, half_y, black, white = drawing.half_x, drawing.half_y, colours[0], colours[1]
    for i in range(chosen.size):
        if not chosen[i]:
            continue
        t, x, y, towards = on_plane(pose, row(origin, i), row(direction, i))
        if not (t > 0.0 and abs(x) <= half_x and abs(y) <= half_y):
            continue
        value = check_colour(columns, rows, square, x, y) if is_checks else whiteness(drawing, x, y)
        if towards < 0.0:
            light[i] = black if value == 0.0 else white
        else:
            light[i] = 0.0


@kernel
def curved_light(artwork, surface, triangle, origin, direction, light):
    """Radiance along rays that meet a curved patch first: the hit on its mesh is the start, the exact surface decides.

    `triangle`, (n,) int64: triangle of the patch that each ray meets first; negative: none.
    """
    drawing, colours, pose = artwork
    is_cylinder, shape, triangles = surface
    for i in range(triangle.size):
        if triangle[i] < 0:
            continue
        o, d = _in_patch(pose, origin, direction, i)
        start, _ = path_to(triangles[triangle[i]], o, d)
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
    """Radiance along rays that meet a mesh first; backs are black.

    `albedo`, (m, 3) float64: radiance at the corners of the triangles, interpolated.
    """
    for i in range(triangle.size):
        if triangle[i] < 0:
            continue
        o, d = _in_patch(pose, origin, direction, i)
        corners = triangles[triangle[i]]
        shade = albedo[triangle[i]]
        t, normal = path_to(corners, o, d)
        second, third = shares(corners, normal, along(o, t, d))
        value = shade[0] + second * (shade[1] - shade[0]) + third * (shade[2] - shade[0])
        light[i] = value if dot(normal, d) < 0.0 else 0.0


@kernel
def heights_at_points(shape, u, v, result):
    """Write `height_into` at many points (n,) into `result` (n, 6)."""
    for i in range(u.size):
        height_into(shape, u[i], v[i], result[i])
