"""Lamps: their intersection with rays, and importance sampling of directions towards them. Vision frame, mm.

A lamp is a row of a table whose columns are named below. All emit the same radiance in all directions of their bright
side, unless they are shaped; rects and disks shine along the -z of their frame, cylinders from their lateral surface,
which lies about x. See `emitting` for these, and `skies`.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from pipeline.jit.decorators import inline, unit
from pipeline.plugins.scenes.lighting.emitting import (
    COLUMNS,
    PART,
    PICTURE,
    TINT,
    Emitting,
    shape_of,
    shaped,
)
from pipeline.plugins.scenes.lighting.records import Lamp, PlacedLamp
from pipeline.plugins.scenes.lighting.shapes import Glow
from pipeline.plugins.scenes.lighting.skies import Dome, dome_density, dome_sample, dome_texel
from pipeline.records.plain import from_plain
from pipeline.records.shapes import Float64
from pipeline.targets.vectors import across, along, dot, minus, times, world
from pipeline.targets.vectors import unit as of_length_one

KINDS = ("rect", "disk", "sphere", "cylinder", "distant", "dome")
"""Kinds of lamps, by their number in kernels."""
RECT, DISK, SPHERE, CYLINDER, DISTANT, DOME = range(6)
"""Numbers of the kinds."""
KIND, RADIANCE, BREADTH, AREA, SIZE_A, SIZE_B = range(6)
"""Columns: kind; radiance; its area as it is seen from afar, and its area [mm^2], of domes and distant lamps solid
angles [sr]; both sizes of `records.Lamp`."""
CENTRE, AXIS_X, AXIS_Y, AXIS_Z = 6, 9, 12, 15
"""First columns of the origin and of the unit axes of its frame."""
TOUCHING = 1e-9
"""Part of a path within which two things count as the same place [1]."""
_EVEN = 0.25
"""Part of the choices of a lamp that does not ask how much light it may send [1]: estimates know of no walls."""
_STEADY = 0.5
"""Error of the light of an even sky by a path, over that of a lamp of the same estimate [1]: it only has shadows."""


class Lamps(NamedTuple):
    """All lamps of a scene, and its emissive surfaces."""

    table: np.ndarray
    emitting: np.ndarray  # `Emitting.numbers`
    dome: Dome  # the picture of the textured dome; without texels there is none
    background: float  # radiance that the camera sees where nothing is, if there is no dome
    glow: Glow


class Estimates(NamedTuple):
    """Irradiance that all lamps may send to a surface: the sum of their estimates, and the number above 0."""

    total: float
    number: int


@inline
def _triple(table, k, column):
    """Three columns of a lamp as a vector."""
    return table[k, column], table[k, column + 1], table[k, column + 2]


@inline
def meet_lamp(table, k, origin, direction):
    """Path to a lamp of finite size, infinite if the ray misses it, and the cosine at its surface, positive where the
    bright side faces the start.
    """
    kind, z = table[k, KIND], _triple(table, k, AXIS_Z)
    a, b, from_centre = table[k, SIZE_A], table[k, SIZE_B], minus(origin, _triple(table, k, CENTRE))
    if kind in (RECT, DISK):
        towards = dot(direction, z)
        t = -dot(from_centre, z) / towards
        p = along(from_centre, t, direction)
        x, y = dot(p, _triple(table, k, AXIS_X)), dot(p, _triple(table, k, AXIS_Y))
        inside = (abs(x) <= a and abs(y) <= b) if kind == RECT else x * x + y * y <= a * a
        return (t, towards) if t > 0.0 and inside else (math.inf, 0.0)
    if kind == SPHERE:
        t = _nearer_root(1.0, dot(from_centre, direction), dot(from_centre, from_centre) - a * a, -math.inf, math.inf)
        return t, -dot(along(from_centre, t, direction), direction) / a
    if kind == CYLINDER:
        x = _triple(table, k, AXIS_X)
        ox, dx = dot(from_centre, x), dot(direction, x)
        o, d = along(from_centre, -ox, x), along(direction, -dx, x)
        low, high = ((-a if dx > 0.0 else a) - ox) / dx, ((a if dx > 0.0 else -a) - ox) / dx
        t = _nearer_root(dot(d, d), dot(o, d), dot(o, o) - b * b, low, high)
        return t, -dot(along(o, t, d), d) / b
    return math.inf, 0.0


@inline
def _nearer_root(a, b, c, low, high):
    """The smaller positive root of a t^2 + 2 b t + c between two bounds; infinite if there is none."""
    inner = b * b - a * c
    if not inner > 0.0:
        return math.inf
    q = -(b + math.copysign(math.sqrt(inner), b))
    near, far = min(q / a, c / q), max(q / a, c / q)
    if near > 0.0 and low <= near <= high:
        return near
    return far if far > 0.0 and low <= far <= high else math.inf


@unit
def radiance_of(lamps, k, origin, direction, t):
    """Radiance of a lamp of finite size that is not even, along a direction that meets it after a path."""
    table = lamps.table
    x, y, p = _triple(table, k, AXIS_X), _triple(table, k, AXIS_Y), minus(origin, _triple(table, k, CENTRE))
    p = along(p, t, direction)
    in_lamp = dot(direction, x), dot(direction, y), dot(direction, _triple(table, k, AXIS_Z))
    return shaped(lamps.emitting, table[k], in_lamp, dot(p, x) / table[k, SIZE_A], dot(p, y) / table[k, SIZE_B])


@inline
def density(table, k, origin, t, cosine):
    """Probability density of `sample_lamp` for the direction that meets a lamp of finite size [1/sr]."""
    if table[k, KIND] == SPHERE:
        return 1.0 / _cap(table, k, origin)
    return t * t / (cosine * table[k, AREA])


@inline
def _cap(table, k, origin):
    """Solid angle of a sphere [sr]; infinite from inside."""
    off, a = minus(_triple(table, k, CENTRE), origin), table[k, SIZE_A]
    part = a * a / dot(off, off)
    return 2.0 * math.pi * part / (1.0 + math.sqrt(1.0 - part)) if part < 1.0 else math.inf


@inline
def sample_lamp(lamps, k, origin, normal, pair):
    """A direction towards a lamp: unit vector, path to it, radiance, density [1/sr]; density 0: no light comes.
    The radiance is that of an even lamp.

    A distant lamp without extent has an infinite density; its `radiance` is then the irradiance across its light.
    """
    table = lamps.table
    kind, radiance, z = table[k, KIND], table[k, RADIANCE], _triple(table, k, AXIS_Z)
    if kind == DOME:
        return _towards_dome(lamps, k, normal, pair)
    if kind == DISTANT:
        if table[k, AREA] == 0.0:
            return z, math.inf, radiance, math.inf
        return _in_cap(z, table[k, AREA], pair), math.inf, radiance, 1.0 / table[k, AREA]
    if kind == SPHERE:
        cap = _cap(table, k, origin)
        if cap == math.inf:
            return z, math.inf, 0.0, 0.0
        off = minus(_triple(table, k, CENTRE), origin)
        direction = _in_cap(of_length_one(off), cap, pair)
        t, cosine = meet_lamp(table, k, origin, direction)
        # A direction at the rim may miss the sphere by rounding; it counts as touching.
        return direction, (math.sqrt(dot(off, off)) if t == math.inf else t), radiance, 1.0 / cap
    off = minus(_point_on(table, k, pair), origin)
    t = math.sqrt(dot(off, off))
    direction = times(1.0 / t, off)
    cosine = dot(direction, z)
    if kind == CYLINDER:
        turn = 2.0 * math.pi * pair[1]
        cosine = -(math.cos(turn) * dot(direction, _triple(table, k, AXIS_Y)) + math.sin(turn) * cosine)
    if not cosine > 0.0:
        return direction, t, 0.0, 0.0
    return direction, t, radiance, t * t / (cosine * table[k, AREA])


@inline
def _point_on(table, k, pair):
    """A point of a rect, a disk or a cylinder, evenly by area."""
    kind, a, b, centre = table[k, KIND], table[k, SIZE_A], table[k, SIZE_B], _triple(table, k, CENTRE)
    x, y, z = _triple(table, k, AXIS_X), _triple(table, k, AXIS_Y), _triple(table, k, AXIS_Z)
    turn = 2.0 * math.pi * pair[1]
    if kind == RECT:
        p = (2.0 * pair[0] - 1.0) * a, (2.0 * pair[1] - 1.0) * b, 0.0
    elif kind == DISK:
        r = a * math.sqrt(pair[0])
        p = r * math.cos(turn), r * math.sin(turn), 0.0
    else:
        p = (2.0 * pair[0] - 1.0) * a, b * math.cos(turn), b * math.sin(turn)
    return along(centre, 1.0, world(p, x, y, z))


@inline
def _in_cap(axis, solid_angle, pair):
    """A direction about an axis, evenly within a solid angle."""
    rise = pair[0] * solid_angle / (2.0 * math.pi)  # 1 - cos, which keeps its digits for small caps
    radius, turn = math.sqrt(rise * (2.0 - rise)), 2.0 * math.pi * pair[1]
    x, y = across(axis)
    return world((radius * math.cos(turn), radius * math.sin(turn), 1.0 - rise), x, y, axis)


@inline
def _towards_dome(lamps, k, normal, pair):
    """A direction towards a dome, as from `sample_lamp`: by its picture, or evenly by the cosine to the normal."""
    table = lamps.table
    x, y, z = _triple(table, k, AXIS_X), _triple(table, k, AXIS_Y), _triple(table, k, AXIS_Z)
    if table[k, PICTURE] >= 0.0:
        in_dome, chance = dome_sample(lamps.dome, pair)
        return world(in_dome, x, y, z), math.inf, table[k, RADIANCE] * dome_texel(lamps.dome, in_dome), chance
    radius, turn = math.sqrt(pair[0]), 2.0 * math.pi * pair[1]
    height = math.sqrt(max(0.0, 1.0 - pair[0]))
    right, up = across(normal)
    direction = world((radius * math.cos(turn), radius * math.sin(turn), height), right, up, normal)
    return direction, math.inf, table[k, RADIANCE], height / math.pi


@inline
def far_light(lamps, k, direction, cosine):
    """Radiance of a dome or a distant lamp with extent along a direction that meets nothing, and the density with
    which `sample_lamp` finds it from a surface at whose normal the direction has a cosine.
    """
    table = lamps.table
    kind = table[k, KIND]
    if kind == DISTANT and table[k, AREA] > 0.0:
        off = minus(direction, _triple(table, k, AXIS_Z))
        # The squared chord is 2 (1 - cos), and the solid angle 2 pi (1 - cos).
        inside = math.pi * dot(off, off) <= table[k, AREA]
        return (table[k, RADIANCE], 1.0 / table[k, AREA]) if inside else (0.0, 0.0)
    if kind != DOME:
        return 0.0, 0.0
    if table[k, PICTURE] >= 0.0:
        x, y, z = _triple(table, k, AXIS_X), _triple(table, k, AXIS_Y), _triple(table, k, AXIS_Z)
        in_dome = dot(direction, x), dot(direction, y), dot(direction, z)
        return table[k, RADIANCE] * dome_texel(lamps.dome, in_dome), dome_density(lamps.dome, in_dome)
    return table[k, RADIANCE], max(cosine, 0.0) / math.pi


@inline
def blocked_by_lamp(table, chosen, origin, direction, end):
    """Whether a lamp other than the chosen one lies between a start and the end of a path."""
    for k in range(table.shape[0]):
        if k != chosen and meet_lamp(table, k, origin, direction)[0] < end * (1.0 - TOUCHING):
            return True
    return False


@inline
def lamps_in(lamps):
    """Number of lamps; emissive triangles are together the last one."""
    return lamps.table.shape[0] + (1 if lamps.glow.estimate > 0.0 else 0)


@inline
def estimate(lamps, k, point, normal):
    """Estimate of the irradiance by a lamp if nothing is in between; 0 only if none of its light comes to this side."""
    table = lamps.table
    if k == table.shape[0]:
        return lamps.glow.estimate
    kind, bright = table[k, KIND], table[k, RADIANCE] * table[k, BREADTH]
    if kind == DOME:
        return bright
    z, a = _triple(table, k, AXIS_Z), table[k, SIZE_A]
    if kind == DISTANT:
        return bright * max(dot(normal, z) + a, 0.0) / (1.0 + a)
    off, radius = minus(_triple(table, k, CENTRE), point), a + table[k, SIZE_B]
    square = dot(off, off)
    far = math.sqrt(square) + radius
    rise, front = max(dot(off, normal) + radius, 0.0) / far, 1.0
    if kind in (RECT, DISK):
        towards = dot(off, z)
        front = (towards + radius) / far if towards > 0.0 else 0.0
    # Nothing is brighter than a sky of its radiance.
    return bright * rise * front / (square + table[k, BREADTH] / math.pi)


@inline
def estimates_at(lamps, point, normal, of_lamp):
    """Estimates of all lamps, and together; `of_lamp`, (lamps_in,), is written.

    An even sky is found as well by all paths that leave the surface. So the errors of its light and of all other are
    the same if it gets half of what its estimate, times `_STEADY`, exceeds theirs; if it does not, nothing.
    """
    others, total, number = 0.0, 0.0, 0
    for k in range(of_lamp.size):
        of_lamp[k] = estimate(lamps, k, point, normal)
        others += 0.0 if is_even_sky(lamps.table, k) else of_lamp[k]
    for k in range(of_lamp.size):
        if is_even_sky(lamps.table, k):
            of_lamp[k] = 0.5 * max(_STEADY * of_lamp[k] - others, 0.0)
        total += of_lamp[k]
        number += 1 if of_lamp[k] > 0.0 else 0
    return Estimates(total, number)


@inline
def is_even_sky(table, k):
    """Whether a lamp is a dome without a picture; the one behind the last are surfaces that shine."""
    return k < table.shape[0] and table[k, KIND] == DOME and table[k, PICTURE] < 0.0


@inline
def chance_of(light, estimates):
    """Probability with which a lamp of an estimate is drawn."""
    return _EVEN / estimates.number + (1.0 - _EVEN) * light / estimates.total if light > 0.0 else 0.0


@inline
def chosen_lamp(of_lamp, estimates, u):
    """A lamp drawn by the estimates, -1: none may send light; its probability, and the rest of u, again in [0, 1)."""
    lamp, part = -1, 0.0
    for k in range(of_lamp.size):
        chance = chance_of(of_lamp[k], estimates)
        if chance > 0.0:
            lamp, part = k, chance
            if u < chance:
                return k, chance, u / chance
            u -= chance
    return lamp, part, 1.0 - 1e-16  # by rounding


def lamps_of(
    placed: Sequence[PlacedLamp],
    sky: Dome,
    emitting: Emitting,
    rgb_weights: Float64[np.ndarray, "3"],
    shining: tuple[Glow, float],
    background: float,
) -> Lamps:
    """The lamps of a view, with the pictures of `sky_of` and `emitting_of`, and the emissive surfaces of
    `shapes.glow_of`.
    """
    table = np.zeros((len(placed), COLUMNS))
    for k, entry in enumerate(placed):
        lamp = from_plain(Lamp, entry.lamp)
        pose = np.array(entry.vision_from_lamp, float)
        radiance = float(rgb_weights @ np.array(lamp.radiance))
        table[k, :CENTRE] = KINDS.index(lamp.kind), radiance, _breadth(lamp, sky), lamp.area, *lamp.size
        table[k, CENTRE : CENTRE + 3] = pose[:3, 3]
        table[k, AXIS_X:PART] = pose[:3, :3].T.ravel()
        table[k, PART:TINT] = rgb_weights * np.array(lamp.radiance)
        table[k, TINT:] = shape_of(lamp)
    glow, power_mm2 = shining
    if power_mm2 > 0:
        corners = glow.shapes.corners
        middle_mm = 0.5 * (corners.min(axis=(0, 1)) + corners.max(axis=(0, 1)))
        away_mm = corners[glow.triangle].mean(axis=(0, 1)) - middle_mm
        area = float(1.0 / glow.per_mm2[glow.triangle].mean())
        glow = glow._replace(estimate=power_mm2 / (4 * float(np.sum(away_mm**2)) + area / math.pi))
    table[:, PICTURE] = emitting.starts
    return Lamps(table, emitting.numbers, sky._replace(rgb_weights=rgb_weights), background, glow)


def _breadth(lamp: Lamp, sky: Dome) -> float:
    """Column `BREADTH` of a lamp; of a parallel beam, whose `radiance` is an irradiance, 1."""
    if lamp.kind == "dome":
        return math.pi * (sky.mean if lamp.texture else 1.0)
    narrower = {"sphere": 4.0, "cylinder": math.pi}
    return lamp.area / narrower.get(lamp.kind, 1.0) or 1.0
