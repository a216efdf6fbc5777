"""Surfaces and the paths of light that meet them: they send rays to lamps, and choose where each path comes from.
Kernels only; vision frame, mm. Arguments are named in `paths`.
"""

import math
from typing import NamedTuple

import numpy as np

from pipeline.jit.decorators import borrowed, inline, kernel
from pipeline.plugins.scenes.lighting import draws
from pipeline.plugins.scenes.lighting.emitting import EVEN
from pipeline.plugins.scenes.lighting.lamps import (
    blocked_by_lamp,
    chosen_lamp,
    estimates_at,
    lamps_in,
    radiance_of,
    sample_lamp,
)
from pipeline.plugins.scenes.lighting.path_kernels import gap_at, goes_straight, move, power_share
from pipeline.plugins.scenes.lighting.reflection import Paint, SeenSurface, reflected, scattered, seen_along
from pipeline.plugins.scenes.lighting.refraction import glass_reflected, glass_scattered
from pipeline.plugins.scenes.lighting.shapes import sample_glow
from pipeline.targets.vectors import across, along, dot, local, minus, row, times, unit, world

_CANDIDATES, _GLOSS = 4, 0.15
"""Points of lamps of which a glossy surface that the camera sees asks one [1], and the width of facets up to which it
is glossy: it sees some points of a lamp far brighter than others. Matt ones ask a single point, because those of all
rays of a pixel are evenly spread, and the chosen ones of several are not."""
_WHOLE = 3
"""Surfaces after which no path ends by chance [1]: few from dark surfaces to a mirror and a lamp would be fireflies."""
_LEAST = 0.05
"""Least probability with which a path goes on from a later surface [1]: it bounds what one path can add."""


class SurfacePoint(NamedTuple):
    """A place of a surface: point, unit axes of its frame, normal of the triangle, what it is made of and how it is
    seen. Both normals are outside of glass."""

    point: tuple[float, float, float]
    x: tuple[float, float, float]
    y: tuple[float, float, float]
    normal: tuple[float, float, float]
    flat: tuple[float, float, float]
    paint: Paint
    seen: SeenSurface


@kernel
def shade(lamps, scene, vertex, paths, hits, shadows):
    """Make a ray from each surface to a point of one lamp, or of a surface that shines, and choose where its path comes
    from: the path's ray is replaced.

    Rays to lamps, and paths that go on, become the first rows of `shadows` and `paths`.
    Returns the numbers of both.
    """
    lamps, scene, paths, hits, shadows = borrowed((lamps, scene, paths, hits, shadows))
    (layers, points, gap_mm), of_each, rays, count = scene, np.empty(lamps_in(lamps)), 0, 0
    for i in range(paths.power.size):
        if hits.distance[i] == math.inf:
            continue
        place = _place(layers, hits, i, row(paths.direction, i))
        asked, dice = _candidates(vertex, place.paint), (points, paths.key[i], paths.place[i], draws.STAGES * vertex)
        if of_each.size > 0:
            lamp, way, end, light = _light_of_lamp(lamps, of_each, layers, place, dice, asked)
            start, way, end = _aimed(place, way, end, gap_mm)
            light *= paths.power[i]
            if light > 0.0 and not blocked_by_lamp(lamps.table, lamp, start, way, end):
                shadows.end[rays], shadows.light[rays], shadows.ray[rays] = end, light, paths.ray[i]
                shadows.straight[rays] = goes_straight(lamps.table, lamp)
                for axis in range(3):
                    shadows.origin[rays, axis], shadows.direction[rays, axis] = start[axis], way[axis]
                rays += 1
        way, rise, value, chance, survives = _scattered(layers, place, dice, vertex >= _WHOLE)
        if value > 0.0:
            if count < i:
                move(paths, i, count)
            paths.power[count] = paths.power[count] * value / chance / survives
            paths.density[count], paths.asked[count] = chance, asked
            if place.paint.ratio > 0.0 and _outside(place.paint) * rise < 0.0:
                paths.density[count] = math.inf  # in glass, from where no lamp is asked
            if rise < 0.0:
                paths.absorption[count] = hits.beyond[i]
            start = _start(place, way, gap_mm)
            for axis in range(3):
                paths.normal[count, axis] = place.normal[axis]
                paths.origin[count, axis], paths.direction[count, axis] = start[axis], way[axis]
            count += 1
    return rays, count


@inline
def _place(layers, hits, i, way):
    """The place where a path meets a surface."""
    normal, of_paint = row(hits.normal, i), hits.paint
    paint = Paint(of_paint[i, 0], of_paint[i, 1], of_paint[i, 2], of_paint[i, 3], of_paint[i, 4], of_paint[i, 5])
    (x, y), out = across(normal), _outside(paint)
    seen = seen_along(layers, paint, local(times(-1.0, way), x, y, normal))
    return SurfacePoint(row(hits.point, i), x, y, times(out, normal), times(out, row(hits.flat, i)), paint, seen)


@inline
def _outside(paint):
    """1 if a surface is seen from outside, -1 if from inside of glass."""
    return -1.0 if 0.0 < paint.ratio < 1.0 else 1.0


@inline
def _start(place, way, gap_mm):
    """Start of a ray that leaves a surface: a gap off it, because Embree works in single precision."""
    return along(place.point, math.copysign(gap_at(place.point, gap_mm), dot(way, place.flat)), place.flat)


@inline
def _candidates(vertex, paint):
    """Number of points of lamps of which a surface asks one."""
    return _CANDIDATES if vertex == 0 and (paint.coat > 0.0 or 0.0 < paint.alpha < _GLOSS) else 1


@inline
def _light_of_lamp(lamps, of_each, layers, place, dice, asked):
    """A point of a lamp: the lamp, direction, path to it, and the light that it sends if nothing is in between.

    Where a few points are candidates, one of them is asked, the more often the more light it may send; if nothing is in
    between, the light of all of them arrives. So only shadows have the noise of a single point.
    """
    points, key, number, stage = dice
    total, u, lamp, aim, path = 0.0, 0.0, -1, place.normal, math.inf
    estimates = estimates_at(lamps, place.point, place.normal, of_each)
    if asked > 1:
        u = draws.draw(points, key, number, stage + draws.CHOICE)[0]
    for c in range(asked):
        pair = draws.draw(points, key, asked * number + c, stage + draws.LAMP)
        k, way, end, value = _candidate(lamps, layers, (of_each, estimates), place, pair, asked)
        if value > 0.0:
            total += value
            if u * total < value:
                u, lamp, aim, path = u * total / value, k, way, end
            else:
                u = (u * total - value) / (total - value)
    return lamp, aim, path, total


@inline
def _aimed(place, way, end, gap_mm):
    """Start, direction and path of a ray to the point that lies so far along a direction from a surface."""
    # Along the old direction it would meet a surface that shines before that point, by the gap over the cosine there,
    # and seen from beside that surface would stop its own light.
    start = _start(place, way, gap_mm)
    if end == math.inf:
        return start, way, end
    off = minus(along(place.point, end, way), start)
    path = math.sqrt(dot(off, off))
    return start, times(1.0 / path, off), path


@inline
def _candidate(lamps, layers, estimates, place, pair, asked):
    """A point of a lamp: the lamp, direction, path to it, and the light that it sends if nothing is in between."""
    k, chance, u = chosen_lamp(*estimates, pair[0])
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
    paint, lit = place.paint, local(way, place.x, place.y, place.normal)
    value, by_surface = reflected(layers, paint, place.seen, lit)
    if paint.ratio > 0.0:
        value, by_surface = glass_reflected(paint, place.seen.direction, (lit[0], lit[1], _outside(paint) * lit[2]))
    if by_lamp == math.inf:
        return k, way, end, value * radiance / (asked * chance)
    chance *= asked * by_lamp
    return k, way, end, value * radiance / chance * power_share(chance, by_surface)


@inline
def _scattered(layers, place, dice, may_end):
    """A direction from which light may have come, and its height above the side that is seen; the value of the
    reflectance, the density of the direction, and the probability with which the path goes on. Without value it ends.
    """
    points, key, number, stage = dice
    pair, survival = draws.draw(points, key, number, stage + draws.SCATTER), (0.0, 0.0)
    if may_end or place.paint.ratio > 0.0:
        survival = draws.draw(points, key, number, stage + draws.SURVIVAL)
    out, survives = _outside(place.paint), 1.0
    if place.paint.ratio > 0.0:
        lit = glass_scattered(place.paint, place.seen.direction, pair, survival[1])
        value, chance = glass_reflected(place.paint, place.seen.direction, lit)
    else:
        lit = scattered(place.paint, place.seen, pair)
        value, chance = reflected(layers, place.paint, place.seen, lit)
    if not (value > 0.0 and chance > 0.0):
        return place.normal, 0.0, 0.0, 1.0, 1.0
    way = unit(world(lit, place.x, place.y, times(out, place.normal)))
    if may_end:
        survives = min(1.0, max(value / chance, _LEAST))
    if survival[0] >= survives or not out * dot(way, place.flat) * lit[2] > 0.0:
        return place.normal, 0.0, 0.0, 1.0, 1.0
    return way, lit[2], value, chance, survives
