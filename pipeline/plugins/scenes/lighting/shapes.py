"""Triangles of a lit scene with normals, primvars and materials: shading normals, transparency, and importance sampling
of emissive triangles. In double precision; mm.
"""

import math
from typing import NamedTuple

import numpy as np

from pipeline.frames import apply
from pipeline.jit.decorators import borrowed, inline, kernel, unit
from pipeline.plugins.scenes.lighting import materials as column
from pipeline.plugins.scenes.lighting.draws import draw
from pipeline.plugins.scenes.lighting.materials import (
    BODY,
    Materials,
    Spot,
    input_at,
    passing,
    passing_to_lamps,
    presence_at,
)
from pipeline.plugins.scenes.lighting.records import Finish
from pipeline.records.shapes import Float64
from pipeline.targets.mesh import Occluder
from pipeline.targets.surface_kernels import path_to, shares
from pipeline.targets.surfaces import CYLINDER, HEIGHTS, Patch
from pipeline.targets.vectors import along, cross, dot, minus, row, times
from pipeline.targets.vectors import unit as of_length_one


class Shapes(NamedTuple):
    """All triangles of a scene, vision frame."""

    # (t, 3, 3), corners and normals of each, anticlockwise as seen from the front
    corners: np.ndarray
    normals: np.ndarray
    primvars: np.ndarray  # (t, 3, n), texture coordinates, colours and other numbers at the corners
    material: np.ndarray


class Glow(NamedTuple):
    """Emissive triangles, together one more lamp beside those of the table."""

    estimate: float  # irradiance that they give in the middle of the scene, about; 0: none shines
    # (k,) int64, (k,) float64, triangles that shine, and cumulated probability of each
    triangle: np.ndarray
    cumulated: np.ndarray
    # (t,), density with which a point of any triangle is drawn; 0 where it does not shine
    per_mm2: np.ndarray
    # of all triangles
    shapes: Shapes
    materials: Materials


@inline
def first_above(cumulated, u):
    """The first of ascending numbers that exceeds u, or the last one."""
    low, high = 0, cumulated.size - 1
    while low < high:
        middle = (low + high) // 2
        if cumulated[middle] > u:
            high = middle
        else:
            low = middle + 1
    return low


@inline
def sample_glow(glow, origin, pair):
    """A point of an emissive triangle: unit direction to it, path, radiance, and density [1/sr]."""
    k = first_above(glow.cumulated, pair[0])
    below = glow.cumulated[k - 1] if k > 0 else 0.0
    part = min(max((pair[0] - below) / (glow.cumulated[k] - below), 0.0), 1.0)
    t = glow.triangle[k]
    corners = glow.shapes.corners[t]
    # Weights of the corners: even by area with the root of a number
    side = math.sqrt(part)
    w = 1.0 - side, side * (1.0 - pair[1]), side * pair[1]
    off = minus(along(along(times(w[0], row(corners, 0)), w[1], row(corners, 1)), w[2], row(corners, 2)), origin)
    length = math.sqrt(dot(off, off))
    direction = times(1.0 / length, off)
    return direction, length, _radiance_at(glow, t, w), glow_density(glow, t, direction, length)


@unit
def _radiance_at(glow, t, w):
    """Radiance of an emissive triangle times its presence."""
    m, spot = glow.shapes.material[t], Spot(glow.shapes.primvars, t, w)
    return input_at(glow.materials, m, column.EMISSION, spot) * presence_at(glow.materials, m, spot)


@inline
def glow_density(glow, t, direction, length):
    """Density with which `sample_glow` finds a direction that meets a triangle after a path [1/sr]."""
    corners = glow.shapes.corners[t]
    normal = cross(minus(row(corners, 1), row(corners, 0)), minus(row(corners, 2), row(corners, 0)))
    cosine = abs(dot(normal, direction)) / math.sqrt(dot(normal, normal))
    return glow.per_mm2[t] * length * length / cosine if cosine > 0.0 else 0.0


@inline
def weights(corners, normal, point):
    """Barycentric weights of a point of the plane, within the triangle."""
    second, third = shares(corners, normal, point)
    second, third = min(max(second, 0.0), 1.0), min(max(third, 0.0), 1.0)
    return 1.0 - second - third, second, third


@inline
def shading_normal(shapes, materials, t, w, flat):
    """Unit normal for shading: that of the corners, turned by the material's normal map."""
    normals = shapes.normals
    smooth = times(w[0], row(normals[t], 0))
    smooth = along(smooth, w[1], row(normals[t], 1))
    smooth = along(smooth, w[2], row(normals[t], 2))
    # Normals may point inwards, and a mirrored mesh turns its corners round: both sides are alike.
    up = dot(smooth, flat)
    smooth = of_length_one(times(math.copysign(1.0, up), smooth)) if abs(up) > 0.0 else flat
    m = shapes.material[t]
    if materials.flags[m, column.BUMPY] == 0.0:
        return smooth
    s_axis, t_axis = _axes_of_st(shapes, t, materials.inputs[m, column.NORMAL_X])
    s_axis = along(s_axis, -dot(s_axis, smooth), smooth)
    if not dot(s_axis, s_axis) > 1e-24:
        return smooth
    s_axis = of_length_one(s_axis)
    across = cross(smooth, s_axis)
    side = math.copysign(1.0, dot(across, t_axis))
    spot = Spot(shapes.primvars, t, w)
    x, y = input_at(materials, m, column.NORMAL_X, spot), input_at(materials, m, column.NORMAL_Y, spot)
    bent = along(times(x, s_axis), side * y, across)
    bent = along(bent, input_at(materials, m, column.NORMAL_Z, spot), smooth)
    return of_length_one(bent) if dot(bent, flat) > 1e-6 else smooth


@inline
def _axes_of_st(shapes, t, texture):
    """Directions in which s and t of a texture grow on a triangle, times a number common to both."""
    corners, first = shapes.corners[t], int(texture[column.FIRST])
    e1, e2 = minus(row(corners, 1), row(corners, 0)), minus(row(corners, 2), row(corners, 0))
    s1, t1 = _step_of_st(shapes, t, texture, first, 1)
    s2, t2 = _step_of_st(shapes, t, texture, first, 2)
    sign = math.copysign(1.0, s1 * t2 - s2 * t1)
    return along(times(sign * t2, e1), -sign * t1, e2), along(times(-sign * s2, e1), sign * s1, e2)


@inline
def _step_of_st(shapes, t, texture, first, corner):
    """Difference of a texture's s and t at a corner from those at the first."""
    values, m = shapes.primvars[t], texture[column.MAP : column.MAP + 6]
    a, b = values[corner, first] - values[0, first], values[corner, first + 1] - values[0, first + 1]
    return m[0] * a + m[1] * b, m[3] * a + m[4] * b


@inline
def _transmitted(surfaces, t, start, direction, straight):
    """Path to a triangle, and its transmittance there; with `straight` also of bodies of glass, without refraction."""
    shapes, materials, layers = surfaces
    path, normal = path_to(shapes.corners[t], start, direction)
    w, m = weights(shapes.corners[t], normal, along(start, path, direction)), shapes.material[t]
    cosine = dot(of_length_one(normal), direction)
    if straight and materials.flags[m, column.VEIL] == BODY:
        return path, passing_to_lamps(materials, m, Spot(shapes.primvars, t, w), cosine, path)
    return path, passing(layers, materials, m, Spot(shapes.primvars, t, w), cosine)


@kernel
def pass_by_chance(surfaces, dice, triangle, origin, direction, past):
    """Write the path of each ray to its triangle, (n,), if it passes the triangle by chance; NaN if it does not.

    `surfaces`: shapes, materials and tables of layers. `dice`: points of random numbers, keys, ranks and the stage.
    """
    surfaces, dice, triangle, past = borrowed((surfaces, dice, triangle, past))
    origin, direction = borrowed((origin, direction))
    points, key, rank, stage = dice
    for i in range(triangle.size):
        past[i] = math.nan
        if triangle[i] < 0:
            continue
        path, share = _transmitted(surfaces, triangle[i], row(origin, i), row(direction, i), False)
        if share >= 1.0 or (share > 0.0 and draw(points, key[i], rank[i], stage)[0] < share):
            past[i] = path


@kernel
def dim(surfaces, triangle, origin, direction, straight, left, light, past):
    """Dim shadow rays: write the path of each to its triangle, (n,), if light passes; NaN if not, or if none needs to.

    `straight`, (n,) bool: whether light goes through bodies of glass, unbent.
    `left`, (n,): path that the light has before it; `light`, (n,): what there is of it, multiplied by what passes.
    """
    surfaces, triangle, straight, left, light, past = borrowed((surfaces, triangle, straight, left, light, past))
    origin, direction = borrowed((origin, direction))
    for i in range(triangle.size):
        past[i] = math.nan
        if triangle[i] < 0:
            continue
        path, share = _transmitted(surfaces, triangle[i], row(origin, i), row(direction, i), straight[i])
        if share > 0.0 and path < left[i]:
            light[i] *= share
            past[i] = path


def joined(pieces: list[Shapes]) -> Shapes:
    """All pieces, one after the other."""
    width = max([2, *(piece.primvars.shape[2] for piece in pieces)])
    nothing = Shapes(np.zeros((0, 3, 3)), np.zeros((0, 3, 3)), np.zeros((0, 3, width)), np.zeros(0, np.int64))
    wide = [_widened(piece, width) for piece in pieces]
    return Shapes(*(np.concatenate(arrays) for arrays in zip(nothing, *wide, strict=True)))


def _widened(piece: Shapes, width: int) -> Shapes:
    """A piece with primvars of a common width."""
    missing = width - piece.primvars.shape[2]
    return piece._replace(primvars=np.pad(piece.primvars, ((0, 0), (0, 0), (0, missing))))


def of_patch(patch: Patch, pose: Float64[np.ndarray, "4 4"], material: int) -> Shapes:
    """A patch of a target; `pose` is vision_from_patch."""
    mesh = patch.mesh()
    corners = apply(pose, mesh.reshape(-1, 3)).reshape(-1, 3, 3)
    normals = _flat(corners)
    if patch.kind == CYLINDER:
        radius = patch.shape[0]
        arc = radius * np.arctan2(mesh[..., 0] / radius, mesh[..., 2] / radius + 1)
        chart = np.stack([arc, mesh[..., 1]], axis=-1)
    elif patch.kind == HEIGHTS:
        chart = mesh[..., :2]
    else:
        return Shapes(corners, normals, np.zeros((len(mesh), 3, 0)), np.full(len(mesh), material))
    _, axes, _ = patch.surface_at(np.ascontiguousarray(chart.reshape(-1, 2)))
    normals = (axes[:, :, 2] @ pose[:3, :3].T).reshape(-1, 3, 3)
    return Shapes(corners, normals, np.zeros((len(mesh), 3, 0)), np.full(len(mesh), material))


def of_mesh(occluder: Occluder, pose: Float64[np.ndarray, "4 4"], finish: Finish, rows: list[int]) -> Shapes:
    """A mesh; `pose` is vision_from_mesh, any affine transform, and `rows` are those of its materials. One that the
    transform flattens has flat normals.
    """
    corners = apply(pose, occluder.corners_mm().reshape(-1, 3)).reshape(-1, 3, 3)
    count = len(corners)
    normals = _flat(corners)
    if finish.normals is not None and np.linalg.det(pose[:3, :3]):
        turned = np.asarray(finish.normals, float).reshape(-1, 3) @ np.linalg.inv(pose[:3, :3])
        normals = (turned / np.maximum(np.linalg.norm(turned, axis=1, keepdims=True), 1e-300)).reshape(-1, 3, 3)
    tables = [np.asarray(values, float).reshape(count, 3, -1) for values in finish.primvars.values()]
    primvars = np.concatenate([np.zeros((count, 3, 0)), *tables], axis=2)
    material = np.full(count, rows[0]) if finish.material_of is None else np.array(rows)[finish.material_of]
    return Shapes(corners, normals, primvars, material)


def outward(piece: Shapes) -> Shapes:
    """A closed mesh with the fronts of its triangles outside, whichever way round it was written."""
    a, b, c = piece.corners.transpose(1, 0, 2)
    if np.sum(a * np.cross(b, c)) >= 0:
        return piece
    corners, normals, primvars = (np.ascontiguousarray(values[:, [0, 2, 1]]) for values in piece[:3])
    return Shapes(corners, normals, primvars, piece.material)


def columns_of(finish: Finish) -> dict[str, int]:
    """First column of each primvar of a mesh."""
    sizes = [np.shape(values)[1] // 3 for values in finish.primvars.values()]
    return dict(zip(finish.primvars, np.cumsum([0, *sizes]).tolist(), strict=False))


def _flat(corners: Float64[np.ndarray, "m 3 3"]) -> np.ndarray:
    """Normals of triangles at each corner, (m, 3, 3); zeros for a triangle without area."""
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    length = np.linalg.norm(normal, axis=1, keepdims=True)
    return np.repeat((normal / np.where(length > 0, length, 1.0))[:, None], 3, axis=1)


def glow_of(shapes: Shapes, materials: Materials) -> tuple[Glow, float]:
    """Emissive triangles, drawn by area times emission, still without an estimate; and the sum of the products."""
    emission = _emission(materials)
    power, area = np.zeros((2, len(shapes.corners)))
    emitting = np.flatnonzero(emission[shapes.material] > 0)  # of few scenes any, and each slice of the light asks
    edge, next_edge = (shapes.corners[emitting, k] - shapes.corners[emitting, 0] for k in (1, 2))
    area[emitting] = 0.5 * np.linalg.norm(np.cross(edge, next_edge), axis=1)
    power[emitting] = area[emitting] * emission[shapes.material[emitting]]
    shining = np.flatnonzero(power > 0)
    share = power / power.sum() if len(shining) else power
    per_mm2 = np.divide(share, area, out=np.zeros(len(area)), where=area > 0)
    return Glow(0.0, shining, np.cumsum(share[shining]), per_mm2, shapes, materials), float(power.sum())


def _emission(materials: Materials) -> np.ndarray:
    """Radiance of each material, (m,), the mean of its picture if it has one; of a primvar as if it were 1."""
    inputs = materials.inputs[:, column.EMISSION]
    result = inputs[:, column.CONSTANT].copy()
    for m in np.flatnonzero(inputs[:, column.TEXTURE] >= 0):
        first, width, height = materials.pictures[int(inputs[m, column.TEXTURE])]
        texels = materials.texels[first : first + width * height]
        result[m] += texels.mean(axis=0, dtype=float) @ inputs[m, column.COEFFICIENTS : column.MAP]
    painted = inputs[:, column.TEXTURE] == column.PRIMVAR
    result[painted] += inputs[painted, column.COEFFICIENTS : column.MAP].sum(axis=1)
    return np.maximum(result, 0.0)
