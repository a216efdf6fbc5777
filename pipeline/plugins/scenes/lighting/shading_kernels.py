"""Shading, where paths of light meet surfaces. Kernels only; vision frame, mm. Arguments are named in `paths`.

A path estimates the radiance L that leaves a surface towards the path's start, direction v:

    L(v) = L_e(v) + integral of f(v, l) L(l) cos(l) dl

Of the light in the integral, that of lamps comes by a shadow ray (next-event estimation), and all of it by the path's
next direction l, drawn in proportion to f cos (importance sampling). Both count by the power heuristic. Paths end at
random (Russian roulette). Glossy surfaces choose the point of a lamp among a few candidates (resampled importance
sampling: Talbot, Cline and Egbert 2005).
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
from pipeline.plugins.scenes.lighting.reflection import Paint, ViewedSurface, reflected, scattered, viewed_along
from pipeline.plugins.scenes.lighting.refraction import glass_reflected, glass_scattered
from pipeline.plugins.scenes.lighting.shapes import sample_glow
from pipeline.targets.vectors import across, along, dot, local, minus, row, times, unit, world

_CANDIDATES, _GLOSS = 4, 0.15
"""Candidates for the point of a lamp on a glossy surface that the camera sees [1], and the width of facets up to which
a surface is glossy: some points of a lamp are far brighter there than others. Matt surfaces take the only candidate:
points of all rays of a pixel are evenly spread, and chosen ones are not."""
_CERTAIN = 3
"""Vertices of a path without Russian roulette [1]: few paths from dark surfaces to a mirror and a lamp would be
fireflies."""
_LEAST = 0.05
"""Least probability of survival [1]: it bounds the light of one path."""


class SurfacePoint(NamedTuple):
    """A point of a surface: position, unit axes and normal for shading, normal of the triangle, paint, and the surface
    as it is viewed. Both normals point out of glass.
    """

    point: tuple[float, float, float]
    x: tuple[float, float, float]
    y: tuple[float, float, float]
    normal: tuple[float, float, float]
    flat: tuple[float, float, float]
    paint: Paint
    viewed: ViewedSurface


@kernel
def shade(lamps, scene, vertex, paths, hits, shadows):
    """Make a shadow ray from each surface to a point of a lamp or of an emissive surface, and draw the next direction
    of its path.

    Shadow rays, and paths that survive, become the first rows of `shadows` and `paths`.
    Returns the numbers of both.
    """
    lamps, scene, paths, hits, shadows = borrowed((lamps, scene, paths, hits, shadows))
    layers, points, gap_mm = scene
    of_lamp = np.empty(lamps_in(lamps))
    rays, count = 0, 0
    for i in range(paths.power.size):
        if hits.distance[i] == math.inf:
            continue
        surface = _surface_at(layers, hits, i, row(paths.direction, i))
        candidates = _candidates(vertex, surface.paint)
        dice = points, paths.key[i], paths.rank[i], draws.STAGES * vertex
        # Next-event estimation: a shadow ray, unless another lamp is in its way.
        if of_lamp.size > 0:
            lamp, direction, end, light = _light_of_lamp(lamps, of_lamp, layers, surface, dice, candidates)
            start, direction, end = _aimed(surface, direction, end, gap_mm)
            light *= paths.power[i]
            if light > 0.0 and not blocked_by_lamp(lamps.table, lamp, start, direction, end):
                shadows.end[rays], shadows.light[rays], shadows.ray[rays] = end, light, paths.ray[i]
                shadows.straight[rays] = goes_straight(lamps.table, lamp)
                for axis in range(3):
                    shadows.origin[rays, axis], shadows.direction[rays, axis] = start[axis], direction[axis]
                rays += 1
        # The path goes on in a direction drawn by the reflectance.
        direction, rise, value, chance, survives = _scattered(layers, surface, dice, vertex >= _CERTAIN)
        if value > 0.0:
            if count < i:
                move(paths, i, count)
            paths.power[count] = paths.power[count] * value / chance / survives
            paths.density[count], paths.candidates[count] = chance, candidates
            if surface.paint.ratio > 0.0 and _outside(surface.paint) * rise < 0.0:
                paths.density[count] = math.inf  # in glass, from where no lamp is asked
            if rise < 0.0:
                paths.absorption[count] = hits.beyond[i]
            start = _start(surface, direction, gap_mm)
            for axis in range(3):
                paths.normal[count, axis] = surface.normal[axis]
                paths.origin[count, axis], paths.direction[count, axis] = start[axis], direction[axis]
            count += 1
    return rays, count


@inline
def _surface_at(layers, hits, i, direction):
    """The point where a path meets a surface."""
    normal = row(hits.normal, i)
    fields = hits.paint
    paint = Paint(fields[i, 0], fields[i, 1], fields[i, 2], fields[i, 3], fields[i, 4], fields[i, 5])
    x, y = across(normal)
    out = _outside(paint)
    viewed = viewed_along(layers, paint, local(times(-1.0, direction), x, y, normal))
    return SurfacePoint(row(hits.point, i), x, y, times(out, normal), times(out, row(hits.flat, i)), paint, viewed)


@inline
def _outside(paint):
    """1 if a surface is seen from outside, -1 if from inside of glass."""
    return -1.0 if 0.0 < paint.ratio < 1.0 else 1.0


@inline
def _start(surface, direction, gap_mm):
    """Start of a ray that leaves a surface: a gap off it, because Embree works in single precision."""
    gap = math.copysign(gap_at(surface.point, gap_mm), dot(direction, surface.flat))
    return along(surface.point, gap, surface.flat)


@inline
def _candidates(vertex, paint):
    """Number of candidates for the point of a lamp."""
    return _CANDIDATES if vertex == 0 and (paint.coat > 0.0 or 0.0 < paint.alpha < _GLOSS) else 1


@inline
def _light_of_lamp(lamps, of_lamp, layers, surface, dice, candidates):
    """A point of a lamp: the lamp, direction, path to it, and its light if nothing is in between.

    The point is drawn among the candidates in proportion to their light, and stands for the mean of them all. So only
    shadows have the noise of a single point.
    """
    points, key, number, stage = dice
    # Reservoir sampling: of n candidates the k-th replaces the one that is kept with the chance value / total so far;
    # u, a number in [0, 1), is stretched again after each choice.
    total, u = 0.0, 0.0
    lamp, aim, path = -1, surface.normal, math.inf
    estimates = estimates_at(lamps, surface.point, surface.normal, of_lamp)
    if candidates > 1:
        u = draws.draw(points, key, number, stage + draws.CHOICE)[0]
    for c in range(candidates):
        pair = draws.draw(points, key, candidates * number + c, stage + draws.LAMP)
        k, direction, end, value = _candidate(lamps, layers, (of_lamp, estimates), surface, pair, candidates)
        if value > 0.0:
            total += value
            if u * total < value:
                u, lamp, aim, path = u * total / value, k, direction, end
            else:
                u = (u * total - value) / (total - value)
    return lamp, aim, path, total


@inline
def _aimed(surface, direction, end, gap_mm):
    """Start, direction and path of a shadow ray to the end of a path in a direction from a surface."""
    # Along the old direction it would meet a surface that shines before that point, by the gap over the cosine there,
    # and seen from beside that surface would stop its own light.
    start = _start(surface, direction, gap_mm)
    if end == math.inf:
        return start, direction, end
    off = minus(along(surface.point, end, direction), start)
    path = math.sqrt(dot(off, off))
    return start, times(1.0 / path, off), path


@inline
def _candidate(lamps, layers, estimates, surface, pair, candidates):
    """A candidate: the lamp, direction, path to it, and its light if nothing is in between, by the power heuristic."""
    k, chance, u = chosen_lamp(*estimates, pair[0])
    if k < 0:
        return k, surface.normal, math.inf, 0.0
    numbers = u, pair[1]
    if k == lamps.table.shape[0]:
        direction, end, radiance, by_lamp = sample_glow(lamps.glow, surface.point, numbers)
    else:
        direction, end, radiance, by_lamp = sample_lamp(lamps, k, surface.point, surface.normal, numbers)
        if radiance > 0.0 and lamps.table[k, EVEN] == 0.0:
            radiance = radiance_of(lamps, k, surface.point, direction, end)
    if not (radiance > 0.0 and by_lamp > 0.0 and dot(direction, surface.flat) > 0.0):
        return k, direction, end, 0.0
    paint, lit = surface.paint, local(direction, surface.x, surface.y, surface.normal)
    value, by_surface = reflected(layers, paint, surface.viewed, lit)
    if paint.ratio > 0.0:
        value, by_surface = glass_reflected(paint, surface.viewed.direction, (lit[0], lit[1], _outside(paint) * lit[2]))
    if by_lamp == math.inf:
        return k, direction, end, value * radiance / (candidates * chance)
    chance *= candidates * by_lamp
    return k, direction, end, value * radiance / chance * power_share(chance, by_surface)


@inline
def _scattered(layers, surface, dice, may_end):
    """The next direction of a path, drawn by the reflectance of the surface, and what its light counts.

    Returns the unit direction, vision frame; its component along the normal on the viewed side, negative for light that
    passes into or out of glass; reflectance times cosine, f cos [1/sr], 0 for a path that ends; the density with which
    the direction was drawn [1/sr]; and the probability that the path survives.

    `dice`: what `draws.draw` takes, with the first stage of this vertex.
    `may_end`: whether the path may end at random (Russian roulette).
    """
    # Draw random numbers: a pair for the direction; of another pair the first decides whether the path goes on, and the
    # second whether glass reflects or refracts.
    points, key, number, stage = dice
    pair = draws.draw(points, key, number, stage + draws.SCATTER)
    survival = 0.0, 0.0
    if may_end or surface.paint.ratio > 0.0:
        survival = draws.draw(points, key, number, stage + draws.SURVIVAL)
    # Draw the direction in the frame of the surface, whose z is the normal on the viewed side: -normal inside of glass.
    out = _outside(surface.paint)
    if surface.paint.ratio > 0.0:
        lit = glass_scattered(surface.paint, surface.viewed.direction, pair, survival[1])
        value, chance = glass_reflected(surface.paint, surface.viewed.direction, lit)
    else:
        lit = scattered(surface.paint, surface.viewed, pair)
        value, chance = reflected(layers, surface.paint, surface.viewed, lit)
    if not (value > 0.0 and chance > 0.0):
        return surface.normal, 0.0, 0.0, 1.0, 1.0
    direction = unit(world(lit, surface.x, surface.y, times(out, surface.normal)))
    # End dark paths more often: the probability of survival is f cos over the density, within bounds.
    survives = min(1.0, max(value / chance, _LEAST)) if may_end else 1.0
    # End also where the normal for shading and that of the triangle differ in the side to which the direction points.
    if survival[0] >= survives or not out * dot(direction, surface.flat) * lit[2] > 0.0:
        return surface.normal, 0.0, 0.0, 1.0, 1.0
    return direction, lit[2], value, chance, survives
