"""Lamps: where a ray meets one, directions towards one, and pictures of the sky. Vision frame, mm.

A lamp is a row of a table whose columns are named below. All emit the same radiance in all directions of their bright
side; rects and disks shine along the -z of their frame, cylinders from their lateral surface, which lies about x.

A picture of the sky is in latitude and longitude as UsdLux has it: the first row is at +y of the dome's frame, the
columns run from longitude +pi to -pi, longitude 0 is +z and pi/2 is +x. Directions are drawn from a table of its bins.
"""

import math
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from pipeline.jit.decorators import inline
from pipeline.records.plain import from_plain
from pipeline.records.shapes import Float64, Num
from pipeline.render.lighting.records import Lamp, PlacedLamp
from pipeline.render.lighting.shapes import Glow, first_above
from pipeline.targets.vectors import across, along, dot, minus, times, unit, world

KINDS = ("rect", "disk", "sphere", "cylinder", "distant", "dome")
"""Kinds of lamps, by their number in kernels."""
RECT, DISK, SPHERE, CYLINDER, DISTANT, DOME = range(6)
"""Numbers of the kinds."""
KIND, RADIANCE, CHANCE, AREA, SIZE_A, SIZE_B = range(6)
"""Columns: kind; radiance; probability with which it is chosen; its area [mm^2], of a distant lamp the solid angle
[sr]; both sizes of `records.Lamp`."""
CENTRE, AXIS_X, AXIS_Y, AXIS_Z = 6, 9, 12, 15
"""First columns of the origin and of the unit axes of its frame."""
COLUMNS = 18
"""Number of columns."""
TOUCHING = 1e-9
"""Part of a path within which two things count as the same place [1]."""
_EVEN = 0.5
"""Part of the choices of a lamp that does not ask how bright it is [1]: estimates may be wrong behind walls."""
_FLOOR = 0.05
"""Part of the directions towards a sky that does not ask how bright it is there [1]."""


class Dome(NamedTuple):
    """A picture of the sky in one light."""

    texels: np.ndarray  # (h, w, 4) float32, red, green and blue as factors of the lamp's radiance; (0, 0, 4): none
    raised: np.ndarray  # (3,), weights of red, green and blue in the light
    # (h + 1,), (h, w + 1), cumulated probability of the rows, and of the columns of each row
    rows: np.ndarray
    columns: np.ndarray


class Lamps(NamedTuple):
    """All lamps of a scene, with surfaces that shine by themselves."""

    table: np.ndarray
    dome: Dome  # the picture of the textured dome; without texels there is none
    background: float  # radiance that the camera sees where nothing is, if there is no dome
    glow: Glow


@inline
def _position(dome, direction):
    """Row and column of a direction, as fractions of the picture."""
    height, width, _ = dome.texels.shape
    latitude = math.asin(min(1.0, max(-1.0, direction[1])))
    longitude = math.atan2(direction[0], direction[2])
    return (0.5 - latitude / math.pi) * height, (0.5 - longitude / (2.0 * math.pi)) * width


@inline
def _bright(dome, i, j):
    """A texel in the light of the dome."""
    red, green, blue = dome.raised
    return red * dome.texels[i, j, 0] + green * dome.texels[i, j, 1] + blue * dome.texels[i, j, 2]


@inline
def dome_texel(dome, direction):
    """Linear interpolation between the centres of four texels."""
    height, width, _ = dome.texels.shape
    y, x = _position(dome, direction)
    y, x = y - 0.5, x - 0.5
    i, j = math.floor(y), math.floor(x)
    a, b = y - i, x - j
    up, down = min(max(i, 0), height - 1), min(max(i + 1, 0), height - 1)
    left, right = j % width, (j + 1) % width
    upper = (1.0 - b) * _bright(dome, up, left) + b * _bright(dome, up, right)
    lower = (1.0 - b) * _bright(dome, down, left) + b * _bright(dome, down, right)
    return (1.0 - a) * upper + a * lower


@inline
def dome_density(dome, direction):
    """Density of `dome_sample` [1/sr]."""
    height, width, _ = dome.texels.shape
    y, x = _position(dome, direction)
    i, j = min(max(int(y), 0), height - 1), min(max(int(x), 0), width - 1)
    sine = math.sqrt(max(1e-30, 1.0 - direction[1] * direction[1]))
    chance = (dome.rows[i + 1] - dome.rows[i]) * (dome.columns[i, j + 1] - dome.columns[i, j])
    return chance * height * width / (2.0 * math.pi * math.pi * sine)


@inline
def dome_sample(dome, pair):
    """A direction and its density [1/sr]."""
    height, width, _ = dome.texels.shape
    i = first_above(dome.rows, pair[0]) - 1
    part = (pair[0] - dome.rows[i]) / (dome.rows[i + 1] - dome.rows[i])
    j = first_above(dome.columns[i], pair[1]) - 1
    other = (pair[1] - dome.columns[i, j]) / (dome.columns[i, j + 1] - dome.columns[i, j])
    latitude, longitude = (0.5 - (i + part) / height) * math.pi, (0.5 - (j + other) / width) * 2.0 * math.pi
    across = math.cos(latitude)
    direction = across * math.sin(longitude), math.sin(latitude), across * math.cos(longitude)
    return direction, dome_density(dome, direction)


@inline
def _triple(table, k, column):
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
        direction = _in_cap(unit(off), cap, pair)
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
    table = lamps.table
    x, y, z = _triple(table, k, AXIS_X), _triple(table, k, AXIS_Y), _triple(table, k, AXIS_Z)
    if lamps.dome.texels.shape[0] > 0:
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
    if lamps.dome.texels.shape[0] > 0:
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


def lamps_of(
    placed: Sequence[PlacedLamp],
    sky: Dome,
    raised: Float64[np.ndarray, "3"],
    shining: tuple[Glow, float],
    background: float,
) -> Lamps:
    """The lamps of a view, with the picture of `sky_of`, and with the surfaces that shine, by `shapes.glow_of`."""
    corners = shining[0].shapes.corners.reshape(-1, 3)
    # The middle of what is lit decides how often each lamp is asked.
    middle_mm = 0.5 * (corners.min(axis=0) + corners.max(axis=0)) if len(corners) else np.zeros(3)
    table, light = np.zeros((len(placed), COLUMNS)), np.zeros(len(placed))
    for k, entry in enumerate(placed):
        lamp, pose = from_plain(Lamp, entry.lamp), np.array(entry.vision_from_lamp, float)
        radiance, area = float(raised @ np.array(lamp.radiance)), lamp.area
        table[k, :CENTRE] = KINDS.index(lamp.kind), radiance, 0.0, area, *lamp.size
        table[k, CENTRE : CENTRE + 3] = pose[:3, 3]
        table[k, AXIS_X:] = pose[:3, :3].T.ravel()
        light[k] = radiance * _seen(lamp.kind, area, float(np.linalg.norm(pose[:3, 3] - middle_mm)))
    if shining[1] > 0:
        glow, power_mm2 = shining  # about the irradiance that they may give, as `_seen` says it of lamps
        away_mm = glow.shapes.corners[glow.triangle].mean(axis=(0, 1)) - middle_mm
        area = float(1.0 / glow.per_mm2[glow.triangle].mean())
        light = np.append(light, power_mm2 / (4 * float(np.sum(away_mm**2)) + area))
    known = light / light.sum() if light.sum() > 0 else np.full(len(light), 1 / max(1, len(light)))
    chance = _EVEN / max(1, len(light)) + (1 - _EVEN) * known
    table[:, CHANCE] = chance[: len(table)]
    of_glow = float(chance[len(table) :].sum())
    glow = shining[0]._replace(chance=of_glow, per_mm2=of_glow * shining[0].per_mm2)
    return Lamps(table, sky._replace(raised=raised), background, glow)


def _seen(kind: str, area: float, distance_mm: float) -> float:
    """Solid angle of a lamp from far away, about; for a parallel beam, whose `radiance` is an irradiance, 1."""
    if kind in ("distant", "dome"):
        return area or 1.0
    return area / (4 * distance_mm**2 + area)


def sky_of(
    placed: Sequence[PlacedLamp], pictures: Mapping[str, Num[np.ndarray, "h w c"]], raised: Float64[np.ndarray, "3"]
) -> Dome:
    """The picture of the textured dome with the tables from which directions are drawn, by how bright it is in a light;
    linear interpolation spreads a texel over its neighbours, so the tables know the brightest of them.
    """
    name = next((entry.lamp["texture"] for entry in placed if entry.lamp["texture"]), None)
    if name is None:
        return Dome(np.zeros((0, 0, 4), np.float32), raised, np.zeros(1), np.zeros((0, 1)))
    picture = np.array(pictures[name], np.float32)
    texels, height = picture[..., :3].astype(float) @ raised, len(picture)
    rows = np.pad(texels, ((1, 1), (0, 0)), mode="edge")
    taller = np.max([rows[:-2], rows[1:-1], rows[2:]], axis=0)
    most = np.max([np.roll(taller, 1, axis=1), taller, np.roll(taller, -1, axis=1)], axis=0)
    sine = np.sin((np.arange(height) + 0.5) * np.pi / height)[:, None]
    share = (most + _FLOOR * most.mean() + 1e-12) * sine
    columns = np.concatenate([np.zeros((height, 1)), np.cumsum(share, axis=1)], axis=1)
    whole = columns[:, -1:]
    rows = np.concatenate([[0.0], np.cumsum(whole[:, 0])])
    return Dome(picture, raised, rows / rows[-1], columns / whole)
