"""How lamps shine that do not do so evenly: with shapes of UsdLux, profiles of luminaires, and pictures on rects."""

import math
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from pipeline.jit.decorators import inline
from pipeline.records.plain import from_plain
from pipeline.records.shapes import Num
from pipeline.render.lighting.records import Lamp, PlacedLamp
from pipeline.render.lighting.shapes import first_above

PART, TINT = 18, 21
"""First columns, behind those of `lamps`, of what red, green and blue add to the radiance, and of their factors off the
axis."""
EVEN, FOCUS, CONE, FADING, PROFILE, ANGLE_SCALE, PICTURE = range(24, 31)
"""Columns: whether a lamp has neither a shape nor a picture; power of the cosine from the axis; largest angle from it,
and that from which light fades out [rad]; row of the profile, -1: none; scale of its angles; row of the picture of a
rect, -1: none, and of a dome 0."""
COLUMNS = 31
"""Number of columns of the table of lamps."""
_BEFORE_LAST = 1.0 - 1e-12
"""Factor of the last angle of a profile, to stay before it [1]."""


class Emitting(NamedTuple):
    """Profiles of luminaires, padded to the same size, and pictures on rects."""

    polar: np.ndarray  # (p, v), ascending angles from the axis [rad]
    around: np.ndarray  # (p, h), ascending angles about it [rad]
    factors: np.ndarray  # (p, h, v)
    pictures: np.ndarray  # (k, 3) int64, first texel, width and height of each picture
    texels: np.ndarray  # (n, 4) float32


@inline
def shaped(emitting, line, way, u, v):
    """Radiance of a line of the table towards the start of a direction, in its frame, that meets it at a point."""
    focus = abs(way[2]) ** line[FOCUS] if line[FOCUS] > 0.0 else 1.0
    off, factor = math.acos(min(max(way[2], -1.0), 1.0)), 1.0
    if off > line[CONE]:
        return 0.0
    if off > line[FADING]:
        x = (off - line[FADING]) / (line[CONE] - line[FADING])
        factor = 1.0 - x * x * (3.0 - 2.0 * x)
    if line[PROFILE] >= 0.0:
        polar = _scaled(off, line[ANGLE_SCALE])
        factor *= _of_profile(emitting, int(line[PROFILE]), polar, math.atan2(-way[1], -way[0]))
    red, green, blue = 1.0, 1.0, 1.0
    if line[PICTURE] >= 0.0:
        red, green, blue = _of_picture(emitting, int(line[PICTURE]), u, v)
    red *= line[PART] * (line[TINT] + focus * (1.0 - line[TINT]))
    green *= line[PART + 1] * (line[TINT + 1] + focus * (1.0 - line[TINT + 1]))
    blue *= line[PART + 2] * (line[TINT + 2] + focus * (1.0 - line[TINT + 2]))
    return factor * (red + green + blue)


@inline
def _scaled(polar, scale):
    """Polar angle at which a profile is asked, as UsdLux says it of `inputs:shaping:ies:angleScale`."""
    if scale > 0.0:
        return polar / scale
    return (polar - math.pi) / -scale + math.pi if scale < 0.0 else polar


@inline
def _of_profile(emitting, p, polar, around):
    """Factor of a profile, linear between its angles; 0 beyond its polar ones."""
    angles, turns = emitting.polar[p], emitting.around[p]
    if not angles[0] <= polar <= angles[-1]:
        return 0.0
    # Padding repeats the last angle: nothing may lie on it.
    around = min(around + 2.0 * math.pi if around < 0.0 else around, turns[-1] * _BEFORE_LAST)
    polar = min(polar, angles[-1] * _BEFORE_LAST)
    i, j = _below(turns, around), _below(angles, polar)
    a = (around - turns[i]) / (turns[i + 1] - turns[i])
    b = (polar - angles[j]) / (angles[j + 1] - angles[j])
    low, high = emitting.factors[p, i], emitting.factors[p, i + 1]
    return (1.0 - a) * ((1.0 - b) * low[j] + b * low[j + 1]) + a * ((1.0 - b) * high[j] + b * high[j + 1])


@inline
def _below(angles, angle):
    """Place of the angle below another one."""
    return min(max(first_above(angles, angle) - 1, 0), angles.size - 2)


@inline
def _of_picture(emitting, row, u, v):
    """Red, green and blue of the picture of a rect at a point, from -1 to 1 on both axes, between four texels.

    Its first row is at +y and its first column at +x: upright, seen from the bright side.
    """
    first, width, height = emitting.pictures[row]
    x = min(max((0.5 - 0.5 * u) * width - 0.5, 0.0), width - 1.0)
    y = min(max((0.5 - 0.5 * v) * height - 0.5, 0.0), height - 1.0)
    i, j = int(x), int(y)
    a, b, right, down = x - i, y - j, min(i + 1, width - 1), min(j + 1, height - 1)
    one, two = emitting.texels[first + j * width + i], emitting.texels[first + j * width + right]
    three, four = emitting.texels[first + down * width + i], emitting.texels[first + down * width + right]
    p, q, r, s = (1.0 - a) * (1.0 - b), a * (1.0 - b), (1.0 - a) * b, a * b
    return (
        p * one[0] + q * two[0] + r * three[0] + s * four[0],
        p * one[1] + q * two[1] + r * three[1] + s * four[1],
        p * one[2] + q * two[2] + r * three[2] + s * four[2],
    )


def shape_of(lamp: Lamp) -> tuple[float, ...]:
    """Columns of a lamp from `TINT` on, still without rows of profiles and pictures."""
    shaping = lamp.shaping
    if shaping is None:
        return (
            1.0,
            1.0,
            1.0,
            float(not (lamp.texture and lamp.kind == "rect")),
            0.0,
            math.inf,
            math.inf,
            -1.0,
            0.0,
            -1.0,
        )
    fading = shaping.cone * (1.0 - min(max(shaping.softness, 0.0), 1.0))
    shape = (0.0, shaping.focus, shaping.cone, fading, -1.0, shaping.angle_scale, -1.0)
    return *shaping.focus_tint, *shape


def rows_of(placed: Sequence[PlacedLamp]) -> list[tuple[int, int]]:
    """Rows of the profile and of the picture of each lamp; -1: none."""
    rows, profiles, pictures = list[tuple[int, int]](), 0, 0
    for entry in placed:
        shaping, kind, texture = entry.lamp.get("shaping"), entry.lamp["kind"], entry.lamp["texture"]
        has_profile, has_picture = bool(shaping and shaping["profile"]), bool(texture and kind == "rect")
        dome = 0 if texture and kind == "dome" else -1
        rows.append((profiles if has_profile else -1, pictures if has_picture else dome))
        profiles, pictures = profiles + has_profile, pictures + has_picture
    return rows


def emitting_of(placed: Sequence[PlacedLamp], pictures: Mapping[str, Num[np.ndarray, "h w c"]]) -> Emitting:
    """Profiles and pictures of all lamps but the sky, in their order."""
    lamps = [from_plain(Lamp, entry.lamp) for entry in placed]
    shapes = [lamp.shaping for lamp in lamps if lamp.shaping and lamp.shaping.profile]
    tables = [np.asarray(pictures[shape.profile], float) for shape in shapes]
    count, tall, wide = (len(tables), *(max([2, *(table.shape[k] for table in tables)]) for k in (0, 1)))
    polar, around, factors = np.zeros((count, wide)), np.zeros((count, tall)), np.zeros((count, tall, wide))
    for p, (table, shape) in enumerate(zip(tables, shapes, strict=True)):
        edge = (0, tall - len(table)), (0, wide - len(table[0]))
        scale = table[0, 0, 3] if shape.is_normalized and table[0, 0, 3] > 0 else 1.0
        factors[p] = np.pad(table[..., 0], edge) / scale
        polar[p], around[p] = np.pad(table[0, :, 1], edge[1], mode="edge"), np.pad(table[:, 0, 2], edge[0], mode="edge")
    shown = [np.asarray(pictures[lamp.texture], np.float32) for lamp in lamps if lamp.texture and lamp.kind == "rect"]
    first = np.cumsum([0, *(picture.shape[0] * picture.shape[1] for picture in shown)])
    places = [(start, picture.shape[1], picture.shape[0]) for start, picture in zip(first, shown, strict=False)]
    texels = np.concatenate([np.zeros((0, 4), np.float32), *(picture.reshape(-1, 4) for picture in shown)])
    return Emitting(polar, around, factors, np.array(places, np.int64).reshape(-1, 3), texels)
