"""Points on triangles: where rays meet them, and where those that shine are asked for light. In double precision, with
normals and texture coordinates. Kernels only; mm.
"""

import math
from typing import NamedTuple

import numpy as np

from pipeline.jit.decorators import inline, kernel
from pipeline.render.lighting.material_kernels import (
    BUMPY,
    EMISSION,
    NORMAL_X,
    NORMAL_Y,
    NORMAL_Z,
    Materials,
    input_at,
    is_hole,
)
from pipeline.targets.vectors import along, cross, dot, minus, row, times, unit


class Shapes(NamedTuple):
    """All triangles of a scene, vision frame.

    `corners`, `normals`, (t, 3, 3) float64: corners and normals of each triangle, anticlockwise as seen from the front.
    `st`, (t, 3, 2) float64: texture coordinates at the corners.
    `material`, (t,) int64.
    """

    corners: np.ndarray
    normals: np.ndarray
    st: np.ndarray
    material: np.ndarray


class Glow(NamedTuple):
    """Triangles that shine by themselves, as one more lamp beside those of the table.

    `chance`: probability with which they are asked for light, and not a lamp.
    `triangle`, (k,) int64: triangles that shine.
    `cumulated`, (k,) float64: cumulated probability of each among them.
    `per_mm2`, (t,) float64: density with which a point of any triangle is asked, the chance included [1/mm^2]; 0 where
        it does not shine.
    `shapes`, `materials`: shapes and materials of all triangles.
    """

    chance: float
    triangle: np.ndarray
    cumulated: np.ndarray
    per_mm2: np.ndarray
    shapes: Shapes
    materials: Materials


@inline
def sample_glow(glow, origin, pair):
    """A point of a triangle that shines: unit direction to it, path, radiance, and density over directions [1/sr], the
    chance of `Glow` included.
    """
    low, high = 0, glow.cumulated.size - 1
    while low < high:
        middle = (low + high) // 2
        if glow.cumulated[middle] > pair[0]:
            high = middle
        else:
            low = middle + 1
    below = glow.cumulated[low - 1] if low > 0 else 0.0
    part = min(max((pair[0] - below) / (glow.cumulated[low] - below), 0.0), 1.0)
    t, side = glow.triangle[low], math.sqrt(part)
    w, corners = (1.0 - side, side * (1.0 - pair[1]), side * pair[1]), glow.shapes.corners[t]
    off = minus(along(along(times(w[0], row(corners, 0)), w[1], row(corners, 1)), w[2], row(corners, 2)), origin)
    length = math.sqrt(dot(off, off))
    way = times(1.0 / length, off)
    radiance = input_at(glow.materials, glow.shapes.material[t], EMISSION, st_at(glow.shapes, t, w))
    return way, length, radiance, glow_density(glow, t, way, length)


@inline
def glow_density(glow, t, way, length):
    """Density with which `sample_glow` finds a direction that meets a triangle after a path [1/sr]."""
    corners = glow.shapes.corners[t]
    normal = cross(minus(row(corners, 1), row(corners, 0)), minus(row(corners, 2), row(corners, 0)))
    cosine = abs(dot(normal, way)) / math.sqrt(dot(normal, normal))
    return glow.per_mm2[t] * length * length / cosine if cosine > 0.0 else 0.0


@inline
def path_to(corners, origin, direction):
    """Path of a ray to the plane of a triangle, and the plane's normal, which is not of unit length."""
    a = row(corners, 0)
    normal = cross(minus(row(corners, 1), a), minus(row(corners, 2), a))
    return dot(minus(a, origin), normal) / dot(direction, normal), normal


@inline
def weights(corners, normal, point):
    """Weights of the three corners at a point of the plane."""
    a, area = row(corners, 0), dot(normal, normal)
    e1, e2, off = minus(row(corners, 1), a), minus(row(corners, 2), a), minus(point, a)
    second, third = dot(cross(off, e2), normal) / area, dot(cross(e1, off), normal) / area
    second, third = min(max(second, 0.0), 1.0), min(max(third, 0.0), 1.0)
    return 1.0 - second - third, second, third


@inline
def st_at(shapes, t, w):
    """Texture coordinates where the corners have some weights."""
    st = shapes.st
    return (
        w[0] * st[t, 0, 0] + w[1] * st[t, 1, 0] + w[2] * st[t, 2, 0],
        w[0] * st[t, 0, 1] + w[1] * st[t, 1, 1] + w[2] * st[t, 2, 1],
    )


@inline
def shading_normal(shapes, materials, t, w, flat):
    """Unit normal for shading: that of the corners, turned by the material's normal map.

    `flat` is the unit normal of the triangle's front.
    """
    normals = shapes.normals
    smooth = times(w[0], row(normals[t], 0))
    smooth = along(smooth, w[1], row(normals[t], 1))
    smooth = along(smooth, w[2], row(normals[t], 2))
    # Normals may point inwards, and a mirrored mesh turns its corners round: both sides are alike.
    up = dot(smooth, flat)
    smooth = unit(times(math.copysign(1.0, up), smooth)) if abs(up) > 0.0 else flat
    m = shapes.material[t]
    if materials.flags[m, BUMPY] == 0.0:
        return smooth
    s_axis, t_axis = _axes_of_st(shapes, t)
    s_axis = along(s_axis, -dot(s_axis, smooth), smooth)
    if not dot(s_axis, s_axis) > 1e-24:
        return smooth
    s_axis = unit(s_axis)
    across = cross(smooth, s_axis)
    side = math.copysign(1.0, dot(across, t_axis))
    st = st_at(shapes, t, w)
    x, y = input_at(materials, m, NORMAL_X, st), input_at(materials, m, NORMAL_Y, st)
    bent = along(times(x, s_axis), side * y, across)
    bent = along(bent, input_at(materials, m, NORMAL_Z, st), smooth)
    return unit(bent) if dot(bent, flat) > 1e-6 else smooth


@inline
def _axes_of_st(shapes, t):
    """Directions in which s and t grow on a triangle, times a number common to both."""
    corners, st = shapes.corners[t], shapes.st[t]
    e1, e2 = minus(row(corners, 1), row(corners, 0)), minus(row(corners, 2), row(corners, 0))
    s1, t1, s2, t2 = st[1, 0] - st[0, 0], st[1, 1] - st[0, 1], st[2, 0] - st[0, 0], st[2, 1] - st[0, 1]
    sign = math.copysign(1.0, s1 * t2 - s2 * t1)
    return along(times(sign * t2, e1), -sign * t1, e2), along(times(-sign * s2, e1), sign * s1, e2)


@kernel
def find_holes(shapes, materials, triangle, origin, direction, past):
    """Path of each ray to its triangle where that is a hole, (n,), written; NaN where it is none."""
    for i in range(triangle.size):
        past[i], t = math.nan, triangle[i]
        if t < 0:
            continue
        start, way = row(origin, i), row(direction, i)
        path, normal = path_to(shapes.corners[t], start, way)
        w = weights(shapes.corners[t], normal, along(start, path, way))
        if is_hole(materials, shapes.material[t], st_at(shapes, t, w)):
            past[i] = path
