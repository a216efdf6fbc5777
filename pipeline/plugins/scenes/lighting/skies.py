"""Pictures of the sky: radiance in a direction, and importance sampling of directions, in the frame of the dome.

A picture is in latitude and longitude as UsdLux has it: the first row is at +y, the columns run from longitude +pi to
-pi, longitude 0 is +z and pi/2 is +x. Directions are drawn from a table of its bins.
"""

import math
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from pipeline.jit.decorators import inline
from pipeline.plugins.scenes.lighting.records import PlacedLamp
from pipeline.plugins.scenes.lighting.shapes import first_above
from pipeline.records.shapes import Float64, Num

_FLOOR = 0.05
"""Share of directions towards a sky that are drawn whatever its brightness there [1]."""
_LEAST_WEIGHT = 1e-12
"""Least weight of a texel [1]: directions are drawn from a black picture, too."""


class Dome(NamedTuple):
    """A picture of the sky in one light."""

    texels: np.ndarray  # (h, w, 4) float32, red, green and blue as factors of the lamp's radiance; (0, 0, 4): none
    rgb_weights: np.ndarray  # (3,), weights of red, green and blue in the light
    # (h + 1,), (h, w + 1), cumulative distributions of directions over rows, and over the columns of each row
    row_cdf: np.ndarray
    column_cdf: np.ndarray
    mean: float  # of the picture over the sphere, in the light that the tables are for


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
    red, green, blue = dome.rgb_weights
    return red * dome.texels[i, j, 0] + green * dome.texels[i, j, 1] + blue * dome.texels[i, j, 2]


@inline
def dome_texel(dome, direction):
    """Linear interpolation between the centres of four texels."""
    height, width, _ = dome.texels.shape
    y, x = _position(dome, direction)
    y, x = y - 0.5, x - 0.5
    i, j = math.floor(y), math.floor(x)
    lower_share, right_share = y - i, x - j
    up, down = min(max(i, 0), height - 1), min(max(i + 1, 0), height - 1)
    left, right = j % width, (j + 1) % width
    upper = (1.0 - right_share) * _bright(dome, up, left) + right_share * _bright(dome, up, right)
    lower = (1.0 - right_share) * _bright(dome, down, left) + right_share * _bright(dome, down, right)
    return (1.0 - lower_share) * upper + lower_share * lower


@inline
def dome_density(dome, direction):
    """Density of `dome_sample` [1/sr]: the chance of a bin over its solid angle, 2 pi^2 cos(latitude) / (h w)."""
    height, width, _ = dome.texels.shape
    y, x = _position(dome, direction)
    i, j = min(max(int(y), 0), height - 1), min(max(int(x), 0), width - 1)
    cos_latitude = math.sqrt(max(1e-30, 1.0 - direction[1] * direction[1]))
    chance = (dome.row_cdf[i + 1] - dome.row_cdf[i]) * (dome.column_cdf[i, j + 1] - dome.column_cdf[i, j])
    return chance * height * width / (2.0 * math.pi * math.pi * cos_latitude)


@inline
def dome_sample(dome, pair):
    """A direction drawn by the brightness of the sky, and its density [1/sr]."""
    height, width, _ = dome.texels.shape
    i = first_above(dome.row_cdf, pair[0]) - 1
    row_share = (pair[0] - dome.row_cdf[i]) / (dome.row_cdf[i + 1] - dome.row_cdf[i])
    j = first_above(dome.column_cdf[i], pair[1]) - 1
    column_share = (pair[1] - dome.column_cdf[i, j]) / (dome.column_cdf[i, j + 1] - dome.column_cdf[i, j])
    latitude, longitude = (0.5 - (i + row_share) / height) * math.pi, (0.5 - (j + column_share) / width) * 2.0 * math.pi
    across = math.cos(latitude)
    direction = across * math.sin(longitude), math.sin(latitude), across * math.cos(longitude)
    return direction, dome_density(dome, direction)


def sky_of(
    placed: Sequence[PlacedLamp],
    pictures: Mapping[str, Num[np.ndarray, "h w c"]],
    rgb_weights: Float64[np.ndarray, "3"],
) -> Dome:
    """The picture of the dome that has one, with tables from which directions are drawn by its brightness in a light.

    Linear interpolation spreads a texel over its neighbours, so the tables hold the brightest of these nine.

    `rgb_weights`: of red, green and blue in that light.
    """
    domes = [entry.lamp for entry in placed if entry.lamp["kind"] == "dome"]
    # Only one has a picture: readers refuse a second sky.
    name = next((lamp["texture"] for lamp in domes if lamp["texture"]), None)
    if name is None:
        return Dome(np.zeros((0, 0, 4), np.float32), rgb_weights, np.zeros(1), np.zeros((0, 1)), 1.0)
    picture = np.array(pictures[name], np.float32)
    brightness = picture[..., :3].astype(float) @ rgb_weights
    height = len(picture)
    padded = np.pad(brightness, ((1, 1), (0, 0)), mode="edge")
    of_three = np.max([padded[:-2], padded[1:-1], padded[2:]], axis=0)
    brightest = np.max([np.roll(of_three, 1, axis=1), of_three, np.roll(of_three, -1, axis=1)], axis=0)
    cos_latitude = np.sin((np.arange(height) + 0.5) * np.pi / height)[:, None]  # area of a row
    weight = (brightest + _FLOOR * brightest.mean() + _LEAST_WEIGHT) * cos_latitude
    # Sums over each row are the weights of the rows.
    of_columns = np.concatenate([np.zeros((height, 1)), np.cumsum(weight, axis=1)], axis=1)
    of_row = of_columns[:, -1:]
    of_rows = np.concatenate([[0.0], np.cumsum(of_row[:, 0])])
    mean = float((brightness * cos_latitude).mean() / cos_latitude.mean())
    return Dome(picture, rgb_weights, of_rows / of_rows[-1], of_columns / of_row, mean)
