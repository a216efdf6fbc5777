"""Paths of light, batch by batch, from the camera to the lamps. Kernels only; vision frame, mm.

Each step is a loop over all paths of a batch: Embree names the triangle that each path meets, and the kernels here find
its paint and add the light of lamps on the way. Shadow rays and next directions are made in `shading_kernels`.

Light of a lamp comes in two ways, by shadow rays and by paths that meet the lamp. With the densities p and q of both,
the one counts by p^2 / (p^2 + q^2): the power heuristic (Veach 1997). Arguments are named in `paths`.
"""

import math

import numpy as np

from pipeline.jit.decorators import borrowed, inline, kernel
from pipeline.plugins.scenes.lighting.emitting import EVEN, PICTURE
from pipeline.plugins.scenes.lighting.lamps import (
    DOME,
    KIND,
    chance_of,
    density,
    estimates_at,
    far_light,
    lamps_in,
    meet_lamp,
    radiance_of,
)
from pipeline.plugins.scenes.lighting.lamps import RADIANCE as OF_LAMP
from pipeline.plugins.scenes.lighting.materials import (
    ABSORPTION,
    CLEAR,
    EMISSION,
    INDEX,
    VEIL,
    Spot,
    glass_at,
    input_at,
    paint_at,
    veiled,
)
from pipeline.plugins.scenes.lighting.paths import RATIO
from pipeline.plugins.scenes.lighting.reflection import Paint
from pipeline.plugins.scenes.lighting.shapes import glow_density, shading_normal, weights
from pipeline.targets.surface_kernels import path_to
from pipeline.targets.vectors import along, dot, row, times, unit

_GAP = 2e-6
"""Gap between a surface and rays that leave it, a part of the coordinates [1]: single precision moves them by 6e-8."""


@kernel
def reach_lamps(lamps, paths):
    """Move paths that meet a lamp or the sky, if nothing else is in their way, to the first rows.

    Returns their number.
    """
    lamps, paths = borrowed((lamps, paths))
    count = 0
    for i in range(paths.power.size):
        start, direction, reaches = row(paths.origin, i), row(paths.direction, i), paths.density[i] == math.inf
        for k in range(lamps.table.shape[0]):
            reaches = reaches or meet_lamp(lamps.table, k, start, direction)[0] < math.inf
            reaches = reaches or far_light(lamps, k, direction, 1.0)[0] > 0.0
        if reaches:
            if count < i:
                move(paths, i, count)
            count += 1
    return count


@inline
def move(paths, i, j):
    """Move a path to another row."""
    for axis in range(3):
        paths.origin[j, axis], paths.direction[j, axis] = paths.origin[i, axis], paths.direction[i, axis]
        paths.normal[j, axis] = paths.normal[i, axis]
    paths.power[j], paths.density[j], paths.candidates[j] = paths.power[i], paths.density[i], paths.candidates[i]
    paths.absorption[j], paths.key[j], paths.rank[j] = paths.absorption[i], paths.key[i], paths.rank[i]
    paths.ray[j] = paths.ray[i]


@kernel
def meet(shapes, materials, layers, albedo, paths, hits):
    """Write the point, normals, paint and emission where each path meets `hits.triangle`, -1: none. A path that could
    have passed the triangle gets more power.

    `albedo`, (n,) float64: reflectance of the artwork of targets there, whose back is black; NaN elsewhere.
    """
    shapes, materials, layers, albedo, paths, hits = borrowed((shapes, materials, layers, albedo, paths, hits))
    for i in range(hits.triangle.size):
        t = hits.triangle[i]
        hits.distance[i] = math.inf
        if t < 0:
            continue
        start, direction = row(paths.origin, i), row(paths.direction, i)
        path, normal = path_to(shapes.corners[t], start, direction)
        point = along(start, path, direction)
        w = weights(shapes.corners[t], normal, point)
        flat, spot, m = unit(normal), Spot(shapes.primvars, t, w), shapes.material[t]
        shading = shading_normal(shapes, materials, t, w, flat)
        # Normals on the side from which the path comes.
        side = -1.0 if dot(flat, direction) > 0.0 else 1.0
        flat, shading = times(side, flat), times(side, shading)
        # Seen from its front, a surface must not turn away for shading.
        shading = shading if dot(shading, direction) < 0.0 else flat
        paint = paint_at(materials, m, spot)
        hits.beyond[i] = 0.0
        # A path in glass is absorbed up to here; one that enters glass, beyond its front.
        if paths.absorption[i] > 0.0:
            paths.power[i] *= math.exp(-paths.absorption[i] * path)
        if materials.flags[m, INDEX] > 0.0:
            paint = glass_at(materials, m, spot, side)
            hits.beyond[i] = max(0.0, side) * materials.flags[m, ABSORPTION]
        elif materials.flags[m, VEIL] == CLEAR:
            paint, factor = veiled(layers, materials, m, spot, dot(flat, direction), paint)
            paths.power[i] *= factor
        # The pattern of a target in place of the paint, and its black back.
        if not math.isnan(albedo[i]):
            front = Paint(albedo[i], paint.facing, paint.alpha, 0.0, paint.coat_alpha, 0.0)
            paint = front if side > 0.0 else Paint(0.0, 0.0, 0.0, 0.0, paint.coat_alpha, 0.0)
        hits.distance[i] = path
        hits.emission[i] = input_at(materials, m, EMISSION, spot)
        for k in range(3):
            hits.point[i, k], hits.flat[i, k], hits.normal[i, k] = point[k], flat[k], shading[k]
        hits.paint[i, 0], hits.paint[i, 1], hits.paint[i, 2] = paint.diffuse, paint.facing, paint.alpha
        hits.paint[i, 3], hits.paint[i, 4], hits.paint[i, RATIO] = paint.coat, paint.coat_alpha, paint.ratio


@kernel
def gather(lamps, paths, hits, light):
    """Add the light of lamps, of the sky and of emissive surfaces that paths meet, by the power heuristic.

    `light`, (rays,) float64: radiance of each ray of the camera, added to.
    `hits.distance`: set to infinity where a path ends.
    """
    lamps, paths, hits, light = borrowed((lamps, paths, hits, light))
    of_lamp = np.empty(lamps_in(lamps))
    for i in range(paths.power.size):
        start, direction = row(paths.origin, i), row(paths.direction, i)
        # The nearest of the surface and all lamps, and the cosine to its bright side
        nearest, lamp, lamp_cosine = hits.distance[i], -1, 0.0
        for k in range(lamps.table.shape[0]):
            t, cosine = meet_lamp(lamps.table, k, start, direction)
            if t < nearest:
                nearest, lamp, lamp_cosine = t, k, cosine
        if lamp >= 0:
            hits.distance[i] = math.inf
            if lamp_cosine > 0.0:
                chance = _chance(lamps, paths, i, lamp, of_lamp)
                chance *= density(lamps.table, lamp, start, nearest, lamp_cosine)
                sent = lamps.table[lamp, OF_LAMP]
                if lamps.table[lamp, EVEN] == 0.0:
                    sent = radiance_of(lamps, lamp, start, direction, nearest)
                light[paths.ray[i]] += paths.power[i] * sent * power_share(paths.density[i], chance)
        elif nearest < math.inf:
            if hits.emission[i] != 0.0:
                chance = _chance(lamps, paths, i, lamps.table.shape[0], of_lamp)
                chance *= glow_density(lamps.glow, hits.triangle[i], direction, nearest)
                light[paths.ray[i]] += paths.power[i] * hits.emission[i] * power_share(paths.density[i], chance)
        else:
            light[paths.ray[i]] += paths.power[i] * _from_far(lamps, paths, i, direction, of_lamp)


@inline
def _chance(lamps, paths, i, k, of_lamp):
    """Expected number of candidates on a lamp at the previous vertex of a path."""
    if not paths.density[i] > 0.0:
        return 0.0
    point, normal = row(paths.origin, i), row(paths.normal, i)
    estimates = estimates_at(lamps, point, normal, of_lamp)
    return paths.candidates[i] * chance_of(of_lamp[k], estimates)


@inline
def power_share(p, q):
    """Weight of a path of the density p by the power heuristic; 1 for lamps that the camera sees, which have no shadow
    rays, and 0 behind glass through which these were sent.
    """
    if p > 0.0:
        return 1.0 / (1.0 + (q / p) ** 2)
    return 1.0 if p == 0.0 else 0.0


@inline
def _from_far(lamps, paths, i, direction, of_lamp):
    """Radiance of domes and distant lamps by the power heuristic, or the background that the camera sees."""
    total, has_dome, cosine = 0.0, False, dot(row(paths.normal, i), direction)
    for k in range(lamps.table.shape[0]):
        has_dome = has_dome or lamps.table[k, KIND] == DOME
        radiance, far_density = far_light(lamps, k, direction, cosine)
        if radiance > 0.0:
            by_path = paths.density[i] < 0.0 and not goes_straight(lamps.table, k)
            share = power_share(paths.density[i], _chance(lamps, paths, i, k, of_lamp) * far_density)
            total += radiance if by_path else radiance * share
    return total if has_dome or paths.density[i] != 0.0 else total + lamps.background


@inline
def goes_straight(table, k):
    """Whether shadow rays go to a lamp through bodies of glass: not to an even dome, which paths behind glass meet."""
    return k == table.shape[0] or table[k, KIND] != DOME or table[k, PICTURE] >= 0.0


@inline
def gap_at(point, least_mm):
    """Distance from a surface at which rays that leave it start."""
    return max(least_mm, _GAP * (abs(point[0]) + abs(point[1]) + abs(point[2])))


@kernel
def arrive(corners, triangle, shadows, gap_mm, light):
    """Add the light of shadow rays that nothing stops.

    `triangle`, (n,) int64: first triangle of each ray, -1: none.
    `light`, (rays,) float64: the radiance of each ray of the camera.
    """
    corners, triangle, shadows, light = borrowed((corners, triangle, shadows, light))
    for i in range(triangle.size):
        if triangle[i] >= 0:
            path, _ = path_to(corners[triangle[i]], row(shadows.origin, i), row(shadows.direction, i))
            if path < shadows.end[i] - 2.0 * gap_at(row(shadows.origin, i), gap_mm):
                continue
        light[shadows.ray[i]] += shadows.light[i]
