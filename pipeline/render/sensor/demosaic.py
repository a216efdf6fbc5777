"""Colours of a mosaic for a picture: each channel between its pixels, white as white. Not for measurements."""

from collections.abc import Mapping

import numpy as np

from pipeline.channel_names import colour_of
from pipeline.records.shapes import Num
from pipeline.render.sensor.response import SensorResponse

PRIMARIES = ("red", "green", "blue")
"""Colours that make a picture."""


def in_colour(
    numbers: Num[np.ndarray, "h w"],
    response: SensorResponse,
    first_row: int = 0,
    photons: Mapping[str, float] | None = None,
) -> np.ndarray:
    """Red, green and blue of every pixel of some rows of a mosaic, 1 at the white level, (h, w, 3) float64.

    Missing values are means of those of the same channel less than a period away, by a triangle of distances. Channels
    are divided by their quantum efficiencies, relative to the best, so that a white scene is grey.

    `numbers`: digital numbers.
    `first_row`: index in the image of the first of these rows, which decides where the mosaic begins.
    `photons`: photons of white in each channel, if they differ.
    """
    period, height, width = response.period_px, *numbers.shape
    light = (numbers - response.black_level_dn) / max(response.white_dn - response.black_level_dn, 1.0)
    pattern = np.roll(np.array(response.filters).reshape(period, period), -first_row, axis=0)
    where = np.tile(pattern, (height // period + 1, width // period + 1))[:height, :width]
    efficiency = dict(zip(response.channels, response.quantum_efficiency, strict=True))
    if photons:
        efficiency = {name: share * photons[name] for name, share in efficiency.items()}
    name_of = {colour_of(name): name for name in response.channels}
    names = [name_of[colour] for colour in PRIMARIES]
    best = max(efficiency[name] for name in names)
    return np.stack([_between(light, where == name, period) * best / efficiency[name] for name in names], axis=-1)


def has_colours(response: SensorResponse) -> bool:
    """Whether a mosaic has the channels of a picture."""
    return set(PRIMARIES) <= set(map(colour_of, response.channels))


def _between(values: np.ndarray, known: np.ndarray, period: int) -> np.ndarray:
    """Values everywhere from those that are known, weighted by a triangle of twice the period."""
    weight = np.convolve(np.ones(period), np.ones(period)) / period
    total = _smoothed(np.where(known, values, 0.0), weight)
    count = _smoothed(known.astype(float), weight)
    return np.where(known, values, total / np.maximum(count, 1e-12))


def _smoothed(values: np.ndarray, weight: np.ndarray) -> np.ndarray:
    """A separable convolution; nothing lies beyond the border."""
    for axis in (0, 1):
        values = np.apply_along_axis(np.convolve, axis, values, weight, mode="same")
    return values
