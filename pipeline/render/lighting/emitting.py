"""Lamps that do not shine evenly: with shapes of UsdLux, profiles of luminaires, and pictures on rects."""

import math
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from pipeline.jit.decorators import inline, unit
from pipeline.records.plain import from_plain
from pipeline.records.shapes import Num
from pipeline.render.lighting.records import Lamp, PlacedLamp
from pipeline.render.lighting.shapes import first_above

PART, TINT = 18, 21
"""First columns, behind those of `lamps`, of what red, green and blue add to the radiance, and of their factors off the
axis."""
EVEN, FOCUS, CONE, FADING, PROFILE, ANGLE_SCALE, PICTURE = range(24, 31)
"""Columns: whether a lamp has neither a shape nor a picture; power of the cosine from the axis; largest angle from it,
and that from which light fades out [rad]; place of the profile, -1: none; scale of its angles; place of the picture
of a rect, -1: none, and of a dome 0."""
COLUMNS = 31
"""Number of columns of the table of lamps."""


class Emitting(NamedTuple):
    """Profiles of luminaires and pictures on rects, one behind the other, and where those of each lamp begin."""

    numbers: np.ndarray  # (n,), one array, because kernels count the users of each that they hand on
    places: list[tuple[int, int]]  # of the profile and the picture of each lamp, -1: none; of a dome with a picture 0


@unit
def shaped(numbers, line, way, u, v):
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
        factor *= _of_profile(numbers, int(line[PROFILE]), polar, math.atan2(-way[1], -way[0]))
    red, green, blue = 1.0, 1.0, 1.0
    if line[PICTURE] >= 0.0:
        red, green, blue = _of_picture(numbers, int(line[PICTURE]), u, v)
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
def _of_profile(numbers, at, polar, around):
    """Factor of a profile, linear between its angles; 0 beyond its polar ones."""
    wide, tall = int(numbers[at]), int(numbers[at + 1])
    turns, table = numbers[at + 2 + wide : at + 2 + wide + tall], at + 2 + wide + tall
    angles = numbers[at + 2 : at + 2 + wide]
    if not angles[0] <= polar <= angles[-1]:
        return 0.0
    around = around + 2.0 * math.pi if around < 0.0 else around
    i, j = _below(turns, around), _below(angles, polar)
    a = min((around - turns[i]) / (turns[i + 1] - turns[i]), 1.0)
    b = (polar - angles[j]) / (angles[j + 1] - angles[j])
    low, high = table + i * wide + j, table + (i + 1) * wide + j
    lower = (1.0 - b) * numbers[low] + b * numbers[low + 1]
    return (1.0 - a) * lower + a * ((1.0 - b) * numbers[high] + b * numbers[high + 1])


@inline
def _below(angles, angle):
    """Place of the angle below another one."""
    return min(max(first_above(angles, angle) - 1, 0), angles.size - 2)


@inline
def _of_picture(numbers, at, u, v):
    """Red, green and blue of the picture of a rect at a point, from -1 to 1 on both axes, between four texels.

    Its first row is at +y and its first column at +x: upright, seen from the bright side.
    """
    width, height = int(numbers[at]), int(numbers[at + 1])
    x = min(max((0.5 - 0.5 * u) * width - 0.5, 0.0), width - 1.0)
    y = min(max((0.5 - 0.5 * v) * height - 0.5, 0.0), height - 1.0)
    i, j = int(x), int(y)
    a, b = x - i, y - j
    step, upper = 3 * (min(i + 1, width - 1) - i), at + 2 + 3 * (j * width + i)
    lower = upper + 3 * width * (min(j + 1, height - 1) - j)
    p, q, r, s = (1.0 - a) * (1.0 - b), a * (1.0 - b), (1.0 - a) * b, a * b
    return (
        p * numbers[upper] + q * numbers[upper + step] + r * numbers[lower] + s * numbers[lower + step],
        p * numbers[upper + 1] + q * numbers[upper + step + 1] + r * numbers[lower + 1] + s * numbers[lower + step + 1],
        p * numbers[upper + 2] + q * numbers[upper + step + 2] + r * numbers[lower + 2] + s * numbers[lower + step + 2],
    )


def shape_of(lamp: Lamp) -> tuple[float, ...]:
    """Columns of a lamp from `TINT` on, still without places of profiles and pictures."""
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


def emitting_of(placed: Sequence[PlacedLamp], pictures: Mapping[str, Num[np.ndarray, "h w c"]]) -> Emitting:
    """Profiles and pictures of all lamps but the sky, in their order."""
    parts, count, places = list[np.ndarray](), 0, list[tuple[int, int]]()

    def added(*arrays: np.ndarray) -> int:
        nonlocal count
        parts.extend(array.astype(float).ravel() for array in arrays)
        count, first = sum(len(part) for part in parts), count
        return first

    for lamp in (from_plain(Lamp, entry.lamp) for entry in placed):
        profile, picture, shaping = -1, 0 if lamp.texture and lamp.kind == "dome" else -1, lamp.shaping
        if shaping and shaping.profile:
            table = np.asarray(pictures[shaping.profile], float)
            factors = table[..., 0] / (table[0, 0, 3] if shaping.is_normalized and table[0, 0, 3] > 0 else 1.0)
            profile = added(np.array(table.shape[1::-1]), table[0, :, 1], table[:, 0, 2], factors)
        if lamp.texture and lamp.kind == "rect":
            shown = np.asarray(pictures[lamp.texture])
            picture = added(np.array(shown.shape[1::-1]), shown[..., :3])
        places.append((profile, picture))
    return Emitting(np.concatenate([np.zeros(0), *parts]), places)
