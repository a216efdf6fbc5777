"""Paths of light, batch by batch, from the camera to the lamps. Kernels only; vision frame, mm.

Each step is a loop over all paths of a batch: Embree has named the triangle that each meets, and the kernels say what
is there, add the light of lamps that the path has met, send a ray to a lamp, and choose the next direction.

Light of a lamp is found in two ways, by rays sent to a point of the lamp and by paths that meet it; both count,
weighted by the power heuristic (Veach 1997). Arguments are named in `paths`.
"""

import math
from typing import NamedTuple

from pipeline.jit.decorators import borrowed, inline, kernel
from pipeline.render.lighting import draws
from pipeline.render.lighting.emitting import EVEN, PICTURE
from pipeline.render.lighting.lamps import (
    DOME,
    KIND,
    blocked_by_lamp,
    chance_of,
    chosen_lamp,
    density,
    estimate,
    estimates_at,
    far_light,
    meet_lamp,
    radiance_of,
    sample_lamp,
)
from pipeline.render.lighting.lamps import RADIANCE as OF_LAMP
from pipeline.render.lighting.materials import (
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
from pipeline.render.lighting.paths import RATIO
from pipeline.render.lighting.reflection import Paint, SeenSurface, reflected, reflected_as, scattered, seen_along
from pipeline.render.lighting.refraction import glass_reflected, glass_scattered
from pipeline.render.lighting.shapes import (
    glow_density,
    sample_glow,
    shading_normal,
    weights,
)
from pipeline.targets.surface_kernels import path_to
from pipeline.targets.vectors import across, along, dot, local, minus, row, times, unit, world

_GAP = 2e-6
"""Gap between a surface and rays that leave it, a part of the coordinates [1]: single precision moves them by 6e-8."""
_CANDIDATES, _GLOSS = 4, 0.15
"""Points of lamps of which a glossy surface that the camera sees asks one [1], and the width of facets up to which it
is glossy: it sees some points of a lamp far brighter than others. Matt ones ask a single point, because those of all
rays of a pixel are evenly spread, and the chosen ones of several are not."""
_WHOLE = 3
"""Surfaces after which no path ends by chance [1]: few from dark surfaces to a mirror and a lamp would be fireflies."""
_LEAST = 0.05
"""Least probability with which a path goes on from a later surface [1]: it bounds what one path can add."""


@kernel
def reach_lamps(lamps, paths, reaches):
    """Whether each path meets a lamp or the light of the sky, (n,) bool, written, if nothing else is in its way."""
    lamps, paths, reaches = borrowed((lamps, paths, reaches))
    for i in range(reaches.size):
        start, way, reaches[i] = row(paths.origin, i), row(paths.direction, i), paths.density[i] == math.inf
        for k in range(lamps.table.shape[0]):
            reaches[i] = reaches[i] or meet_lamp(lamps.table, k, start, way)[0] < math.inf
            reaches[i] = reaches[i] or far_light(lamps, k, way, 1.0)[0] > 0.0


@kernel
def meet(shapes, materials, layers, albedo, paths, hits):
    """Say what each path meets: `hits.triangle` is the first triangle of each ray, -1: none. A path that could have
    passed it stands for more light.

    `albedo`, (n,) float64: reflectance of the artwork of targets there, whose back is black; NaN elsewhere.
    """
    shapes, materials, layers, albedo, paths, hits = borrowed((shapes, materials, layers, albedo, paths, hits))
    for i in range(hits.triangle.size):
        t = hits.triangle[i]
        hits.distance[i] = math.inf
        if t < 0:
            continue
        start, way = row(paths.origin, i), row(paths.direction, i)
        path, normal = path_to(shapes.corners[t], start, way)
        point = along(start, path, way)
        w = weights(shapes.corners[t], normal, point)
        flat, spot, m = unit(normal), Spot(shapes.primvars, t, w), shapes.material[t]
        shading = shading_normal(shapes, materials, t, w, flat)
        side = -1.0 if dot(flat, way) > 0.0 else 1.0
        flat, shading = times(side, flat), times(side, shading)
        # Seen from its front, a surface must not turn away for shading.
        shading = shading if dot(shading, way) < 0.0 else flat
        paint, hits.beyond[i] = paint_at(materials, m, spot), 0.0
        if paths.absorption[i] > 0.0:
            paths.power[i] *= math.exp(-paths.absorption[i] * path)
        if materials.flags[m, INDEX] > 0.0:
            paint, hits.beyond[i] = glass_at(materials, m, spot, side), max(0.0, side) * materials.flags[m, ABSORPTION]
        elif materials.flags[m, VEIL] == CLEAR:
            paint, more = veiled(layers, materials, m, spot, dot(flat, way), paint)
            paths.power[i] *= more
        if not math.isnan(albedo[i]):
            front = Paint(albedo[i], paint.facing, paint.alpha, 0.0, paint.coat_alpha, 0.0)
            paint = front if side > 0.0 else Paint(0.0, 0.0, 0.0, 0.0, paint.coat_alpha, 0.0)
        hits.distance[i], hits.emission[i] = path, input_at(materials, m, EMISSION, spot)
        for k in range(3):
            hits.point[i, k], hits.flat[i, k], hits.normal[i, k] = point[k], flat[k], shading[k]
        hits.paint[i, 0], hits.paint[i, 1], hits.paint[i, 2] = paint.diffuse, paint.facing, paint.alpha
        hits.paint[i, 3], hits.paint[i, 4], hits.paint[i, RATIO] = paint.coat, paint.coat_alpha, paint.ratio


@kernel
def gather(lamps, paths, hits, light):
    """Add the light that paths meet: lamps before or beyond surfaces, and surfaces that shine.

    `light`, (rays,) float64: radiance of each ray of the camera, added to.
    `hits.distance`: set to infinity where a path ends.
    """
    lamps, paths, hits, light = borrowed((lamps, paths, hits, light))
    for i in range(paths.power.size):
        start, way = row(paths.origin, i), row(paths.direction, i)
        nearest, lamp, bright = hits.distance[i], -1, 0.0
        for k in range(lamps.table.shape[0]):
            t, cosine = meet_lamp(lamps.table, k, start, way)
            if t < nearest:
                nearest, lamp, bright = t, k, cosine
        if lamp >= 0:
            hits.distance[i] = math.inf
            if bright > 0.0:
                chance = _chance(lamps, paths, i, lamp) * density(lamps.table, lamp, start, nearest, bright)
                sent = lamps.table[lamp, OF_LAMP]
                if lamps.table[lamp, EVEN] == 0.0:
                    sent = radiance_of(lamps, lamp, start, way, nearest)
                light[paths.ray[i]] += paths.power[i] * sent * _share(paths.density[i], chance)
        elif nearest < math.inf:
            if hits.emission[i] != 0.0:
                glow = _chance(lamps, paths, i, lamps.table.shape[0])
                chance = glow * glow_density(lamps.glow, hits.triangle[i], way, nearest)
                light[paths.ray[i]] += paths.power[i] * hits.emission[i] * _share(paths.density[i], chance)
        else:
            light[paths.ray[i]] += paths.power[i] * _from_far(lamps, paths, i, way)


@inline
def _chance(lamps, paths, i, k):
    """Mean number of points of a lamp that are asked for where a path comes from, by `_candidate`."""
    if not paths.density[i] > 0.0:
        return 0.0
    point, normal = row(paths.origin, i), row(paths.normal, i)
    return paths.asked[i] * chance_of(estimate(lamps, k, point, normal), estimates_at(lamps, point, normal))


@inline
def _share(taken, other):
    """Weight of the power heuristic. Lamps that the camera sees are found in one way only; others behind glass, too."""
    if taken > 0.0:
        return 1.0 / (1.0 + (other / taken) ** 2)
    return 1.0 if taken == 0.0 else 0.0


@inline
def _from_far(lamps, paths, i, way):
    """Weighted radiance of domes and distant lamps, or the background that the camera sees."""
    total, has_dome, cosine = 0.0, False, dot(row(paths.normal, i), way)
    for k in range(lamps.table.shape[0]):
        has_dome = has_dome or lamps.table[k, KIND] == DOME
        radiance, density_there = far_light(lamps, k, way, cosine)
        if radiance > 0.0:
            by_path = paths.density[i] < 0.0 and not _goes_straight(lamps.table, k)
            share = _share(paths.density[i], _chance(lamps, paths, i, k) * density_there)
            total += radiance if by_path else radiance * share
    return total if has_dome or paths.density[i] != 0.0 else total + lamps.background


@inline
def _goes_straight(table, k):
    """Whether a lamp is asked through bodies of glass: not an even dome, which paths behind glass meet easily."""
    return k == table.shape[0] or table[k, KIND] != DOME or table[k, PICTURE] >= 0.0


@inline
def _paint(hits, i):
    return Paint(
        hits.paint[i, 0], hits.paint[i, 1], hits.paint[i, 2], hits.paint[i, 3], hits.paint[i, 4], hits.paint[i, 5]
    )


@inline
def _outside(paint):
    """1 if a surface is seen from outside, -1 if from inside of glass."""
    return -1.0 if 0.0 < paint.ratio < 1.0 else 1.0


@inline
def _start(hits, i, way, gap_mm):
    """Start of a ray that leaves a surface: a gap off it, because Embree works in single precision."""
    flat, point = row(hits.flat, i), row(hits.point, i)
    return along(point, math.copysign(gap_at(point, gap_mm), dot(way, flat)), flat)


@inline
def gap_at(point, least_mm):
    """Distance from a surface at which rays that leave it start."""
    return max(least_mm, _GAP * (abs(point[0]) + abs(point[1]) + abs(point[2])))


@inline
def _candidates(vertex, paint):
    """Number of points of lamps of which a surface asks one."""
    return _CANDIDATES if vertex == 0 and (paint.coat > 0.0 or 0.0 < paint.alpha < _GLOSS) else 1


@kernel
def send_to_lamps(lamps, scene, vertex, paths, hits, shadows):
    """Make a ray from each surface to a point of one lamp, or of a surface that shines.

    Where a few points are candidates, one of them is asked, the more often the more light it may send; if nothing is in
    between, the light of all of them arrives. So only shadows have the noise of a single point.
    """
    lamps, scene, paths, hits, shadows = borrowed((lamps, scene, paths, hits, shadows))
    layers, points, gap_mm = scene
    for i in range(paths.power.size):
        shadows.light[i], total, kept = 0.0, 0.0, -1
        normal, paint = row(hits.normal, i), _paint(hits, i)
        x, y = across(normal)
        seen = seen_along(layers, paint, local(times(-1.0, row(paths.direction, i)), x, y, normal))
        out = _outside(paint)
        place = SurfacePoint(row(hits.point, i), x, y, times(out, normal), times(out, row(hits.flat, i)), seen)
        asked, estimates, dice = _candidates(vertex, paint), estimates_at(lamps, place.point, place.normal), 0.0
        if asked > 1:
            dice = draws.draw(points, paths.key[i], paths.place[i], draws.STAGES * vertex + draws.CHOICE)[0]
        for c in range(asked):
            pair = draws.draw(points, paths.key[i], asked * paths.place[i] + c, draws.STAGES * vertex + draws.LAMP)
            k, way, end, value = _candidate(lamps, layers, estimates, place, paint, pair, asked)
            if value > 0.0:
                total += value
                if dice * total < value:
                    dice, kept, shadows.end[i] = dice * total / value, k, end
                    for axis in range(3):
                        shadows.direction[i, axis] = way[axis]
                else:
                    dice = (dice * total - value) / (total - value)
        if kept < 0:
            continue
        start, way, shadows.end[i] = _aimed(hits, i, row(shadows.direction, i), shadows.end[i], gap_mm)
        if not blocked_by_lamp(lamps.table, kept, start, way, shadows.end[i]):
            shadows.light[i], shadows.straight[i] = paths.power[i] * total, _goes_straight(lamps.table, kept)
            for axis in range(3):
                shadows.origin[i, axis], shadows.direction[i, axis] = start[axis], way[axis]


@inline
def _aimed(hits, i, way, end, gap_mm):
    """Start, direction and path of a ray to the point that lies so far along a direction from a surface."""
    # Along the old direction it would meet a surface that shines before that point, by the gap over the cosine there,
    # and seen from beside that surface would stop its own light.
    start = _start(hits, i, way, gap_mm)
    if end == math.inf:
        return start, way, end
    off = minus(along(row(hits.point, i), end, way), start)
    path = math.sqrt(dot(off, off))
    return start, times(1.0 / path, off), path


class SurfacePoint(NamedTuple):
    """A place of a surface: point, unit axes of its frame, normal of the triangle, and how it is seen. Both normals are
    outside of glass."""

    point: tuple[float, float, float]
    x: tuple[float, float, float]
    y: tuple[float, float, float]
    normal: tuple[float, float, float]
    flat: tuple[float, float, float]
    seen: SeenSurface


@inline
def _candidate(lamps, layers, estimates, place, paint, pair, asked):
    """A point of a lamp: the lamp, direction, path to it, and the light that it sends if nothing is in between."""
    k, chance, u = chosen_lamp(lamps, estimates, place.point, place.normal, pair[0])
    if k < 0:
        return k, place.normal, math.inf, 0.0
    spot = u, pair[1]
    if k == lamps.table.shape[0]:
        way, end, radiance, by_lamp = sample_glow(lamps.glow, place.point, spot)
    else:
        way, end, radiance, by_lamp = sample_lamp(lamps, k, place.point, place.normal, spot)
        if radiance > 0.0 and lamps.table[k, EVEN] == 0.0:
            radiance = radiance_of(lamps, k, place.point, way, end)
    if not (radiance > 0.0 and by_lamp > 0.0 and dot(way, place.flat) > 0.0):
        return k, way, end, 0.0
    lit = local(way, place.x, place.y, place.normal)
    value, by_surface = reflected_as(layers, paint, place.seen, lit)
    if paint.ratio > 0.0:
        value, by_surface = glass_reflected(paint, place.seen.direction, (lit[0], lit[1], _outside(paint) * lit[2]))
    if by_lamp == math.inf:
        return k, way, end, value * radiance / (asked * chance)
    chance *= asked * by_lamp
    return k, way, end, value * radiance / chance * _share(chance, by_surface)


@kernel
def arrive(corners, triangle, shadows, ray, gap_mm, light):
    """Add the light of rays to lamps that nothing stops.

    `triangle`, (n,) int64: first triangle of each ray, -1: none.
    `ray`, `light`, (n,) int64, (rays,) float64: the ray of the camera of each, and its radiance.
    """
    corners, triangle, shadows, ray, light = borrowed((corners, triangle, shadows, ray, light))
    for i in range(triangle.size):
        if triangle[i] >= 0:
            path, _ = path_to(corners[triangle[i]], row(shadows.origin, i), row(shadows.direction, i))
            if path < shadows.end[i] - 2.0 * gap_at(row(shadows.origin, i), gap_mm):
                continue
        light[ray[i]] += shadows.light[i]


@kernel
def scatter(scene, vertex, paths, hits, goes_on):
    """Choose where each path comes from, (n,) bool written: whether it goes on. Its ray is replaced."""
    scene, paths, hits, goes_on = borrowed((scene, paths, hits, goes_on))
    layers, points, gap_mm = scene
    for i in range(paths.power.size):
        goes_on[i] = False
        normal, flat, paint = row(hits.normal, i), row(hits.flat, i), _paint(hits, i)
        pair = draws.draw(points, paths.key[i], paths.place[i], draws.STAGES * vertex + draws.SCATTER)
        x, y = across(normal)
        seen = local(times(-1.0, row(paths.direction, i)), x, y, normal)
        dice = draws.draw(points, paths.key[i], paths.place[i], draws.STAGES * vertex + draws.SURVIVAL)
        if paint.ratio > 0.0:
            lit = glass_scattered(paint, seen, pair, dice[1])
            value, chance = glass_reflected(paint, seen, lit)
        else:
            lit = scattered(layers, paint, seen, pair)
            value, chance = reflected(layers, paint, seen, lit)
        if not (value > 0.0 and chance > 0.0):
            continue
        way = unit(world(lit, x, y, normal))
        if not dot(way, flat) * lit[2] > 0.0:
            continue
        power = paths.power[i] * value / chance
        if vertex >= _WHOLE:
            survives = min(1.0, max(value / chance, _LEAST))
            if dice[0] >= survives:
                continue
            power /= survives
        goes_on[i] = True
        start = _start(hits, i, way, gap_mm)
        paths.power[i], paths.density[i], paths.asked[i] = power, chance, _candidates(vertex, paint)
        if paint.ratio > 0.0 and _outside(paint) * lit[2] < 0.0:
            paths.density[i] = math.inf  # in glass, from where no lamp is asked
        if lit[2] < 0.0:
            paths.absorption[i] = hits.beyond[i]
        for axis in range(3):
            paths.normal[i, axis] = _outside(paint) * normal[axis]
            paths.origin[i, axis], paths.direction[i, axis] = start[axis], way[axis]
