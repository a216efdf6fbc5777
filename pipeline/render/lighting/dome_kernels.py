"""Pictures of the sky: radiance along a direction, and directions where it is bright. Kernels only.

A picture is in latitude and longitude as UsdLux has it: the first row is at +y of the dome's frame, the columns run
from longitude +pi to -pi, longitude 0 is +z and pi/2 is +x. Directions are drawn from a table of the picture's bins.
"""

import math
from typing import NamedTuple

import numpy as np

from pipeline.jit.decorators import inline


class Dome(NamedTuple):
    """A picture of the sky in one light.

    `texels`, (h, w, 4) float32: red, green and blue as factors of the lamp's radiance; (0, 0, 4): none.
    `raised`, (3,) float64: weights of red, green and blue in the light.
    `rows`, (h + 1,) float64: cumulated probability of the rows.
    `columns`, (h, w + 1) float64: cumulated probability of the columns of each row.
    """

    texels: np.ndarray
    raised: np.ndarray
    rows: np.ndarray
    columns: np.ndarray


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
    i = _bin(dome.rows, pair[0])
    part = (pair[0] - dome.rows[i]) / (dome.rows[i + 1] - dome.rows[i])
    j = _bin(dome.columns[i], pair[1])
    other = (pair[1] - dome.columns[i, j]) / (dome.columns[i, j + 1] - dome.columns[i, j])
    latitude, longitude = (0.5 - (i + part) / height) * math.pi, (0.5 - (j + other) / width) * 2.0 * math.pi
    across = math.cos(latitude)
    direction = across * math.sin(longitude), math.sin(latitude), across * math.cos(longitude)
    return direction, dome_density(dome, direction)


@inline
def _bin(cumulated, u):
    """The last bin that begins at or before u."""
    low, high = 0, cumulated.size - 1
    while high - low > 1:
        middle = (low + high) // 2
        if cumulated[middle] <= u:
            low = middle
        else:
            high = middle
    return low
