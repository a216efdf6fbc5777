"""Emission of lamps that are not uniform: shaping of UsdLux, and pictures on rects."""

import math
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from pipeline.jit.decorators import inline, unit
from pipeline.plugins.scenes.lighting.records import Lamp, PlacedLamp
from pipeline.records.plain import from_plain
from pipeline.records.shapes import Num

PART, TINT = 18, 21
"""First columns, behind those of `lamps`, of what red, green and blue add to the radiance, and of their factors off the
axis."""
EVEN, FOCUS, CONE, FADING, PICTURE = range(24, 29)
"""Columns: whether a lamp has neither a shape nor a picture; power of the cosine from the axis; largest angle from it,
and that from which light fades out [rad]; start of the picture of a rect, -1: none, and of a dome 0."""
COLUMNS = 29
"""Number of columns of the table of lamps."""


class Emitting(NamedTuple):
    """Pictures on rects, one behind the other, and where that of each lamp begins."""

    numbers: np.ndarray  # (n,), one array, because kernels count the users of each that they hand on
    starts: list[int]  # of the picture of each lamp, -1: none; of a dome with a picture 0


@unit
def shaped(numbers, line, direction, u, v):
    """Radiance of a lamp, a line of the table, along a direction in its frame that meets it at a point."""
    focus = abs(direction[2]) ** line[FOCUS] if line[FOCUS] > 0.0 else 1.0
    angle = math.acos(min(max(direction[2], -1.0), 1.0))
    if angle > line[CONE]:
        return 0.0
    factor = 1.0
    if angle > line[FADING]:  # 1 - smoothstep
        x = (angle - line[FADING]) / (line[CONE] - line[FADING])
        factor = 1.0 - x * x * (3.0 - 2.0 * x)
    red, green, blue = 1.0, 1.0, 1.0
    if line[PICTURE] >= 0.0:
        red, green, blue = _texel_of_rect(numbers, int(line[PICTURE]), u, v)
    red *= line[PART] * (line[TINT] + focus * (1.0 - line[TINT]))
    green *= line[PART + 1] * (line[TINT + 1] + focus * (1.0 - line[TINT + 1]))
    blue *= line[PART + 2] * (line[TINT + 2] + focus * (1.0 - line[TINT + 2]))
    return factor * (red + green + blue)


@inline
def _texel_of_rect(numbers, start, u, v):
    """Red, green and blue of the picture of a rect at a point, from -1 to 1 on both axes, between four texels.

    Its first row is at +y and its first column at +x: upright, seen from the bright side.
    """
    width, height = int(numbers[start]), int(numbers[start + 1])
    x = min(max((0.5 - 0.5 * u) * width - 0.5, 0.0), width - 1.0)
    y = min(max((0.5 - 0.5 * v) * height - 0.5, 0.0), height - 1.0)
    i, j = int(x), int(y)
    a, b = x - i, y - j
    # Indices of the red of the texels (i, j) and (i, j + 1); their right neighbours are a step behind.
    step = 3 * (min(i + 1, width - 1) - i)
    upper = start + 2 + 3 * (j * width + i)
    lower = upper + 3 * width * (min(j + 1, height - 1) - j)
    p, q, r, s = (1.0 - a) * (1.0 - b), a * (1.0 - b), (1.0 - a) * b, a * b
    return (
        p * numbers[upper] + q * numbers[upper + step] + r * numbers[lower] + s * numbers[lower + step],
        p * numbers[upper + 1] + q * numbers[upper + step + 1] + r * numbers[lower + 1] + s * numbers[lower + step + 1],
        p * numbers[upper + 2] + q * numbers[upper + step + 2] + r * numbers[lower + 2] + s * numbers[lower + step + 2],
    )


def shape_of(lamp: Lamp) -> tuple[float, ...]:
    """Columns of a lamp from `TINT` on, still without the start of its picture."""
    shaping = lamp.shaping
    if shaping is None:
        is_even = not (lamp.texture and lamp.kind == "rect")
        return 1.0, 1.0, 1.0, float(is_even), 0.0, math.inf, math.inf, -1.0
    fading = shaping.cone * (1.0 - min(max(shaping.softness, 0.0), 1.0))
    return *shaping.focus_tint, 0.0, shaping.focus, shaping.cone, fading, -1.0


def emitting_of(placed: Sequence[PlacedLamp], pictures: Mapping[str, Num[np.ndarray, "h w c"]]) -> Emitting:
    """Pictures of all lamps but the sky, in their order."""
    parts = [np.zeros(0)]
    count = 0
    starts = list[int]()
    for lamp in (from_plain(Lamp, entry.lamp) for entry in placed):
        start = 0 if lamp.texture and lamp.kind == "dome" else -1
        if lamp.texture and lamp.kind == "rect":
            picture = np.asarray(pictures[lamp.texture])
            start = count
            parts += [np.array(picture.shape[1::-1], float), picture[..., :3].astype(float).ravel()]
            count += 2 + 3 * picture.shape[0] * picture.shape[1]
        starts.append(start)
    return Emitting(np.concatenate(parts), starts)
