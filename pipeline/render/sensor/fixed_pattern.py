"""Fixed pattern of a specimen of a sensor: what differs from pixel to pixel and stays the same in every frame."""

import math
from typing import NamedTuple

import numpy as np

from pipeline.jit.decorators import kernel
from pipeline.render.sensor.counter import DEFECTS, PATTERN, PATTERN_OF_COLUMN, PATTERN_OF_ROW, Stream, stream, uniforms
from pipeline.render.sensor.draws import normals
from pipeline.render.sensor.response import PatternSpread


class FixedPattern(NamedTuple):
    """Maps of some pixels, (h, w) float64 each.

    `dark_e`, array: difference of the dark signal from its mean, DSNU [e-].
    `response`, array: photo response over its mean, PRNU; 0 of dead pixels.
    `hot_e_per_s`, array: dark current of hot pixels beyond that of the others, 0 elsewhere [e-/s].
    """

    dark_e: np.ndarray
    response: np.ndarray
    hot_e_per_s: np.ndarray


class Spread(NamedTuple):
    """Numbers of a `PatternSpread` for kernels: deviations of dark signal [e-] and response, and defects."""

    dark: tuple[float, float, float]
    response: tuple[float, float, float]
    hot_share: float
    hot_e_per_s: float
    dead_share: float


def fixed_pattern(spread: PatternSpread, camera: str, corner: tuple[int, int], shape: tuple[int, int]) -> FixedPattern:
    """Maps of a window of the sensor of a camera, by its name.

    `corner`, `shape`: row and column of the first pixel; height and width [px].
    """
    numbers = Spread(spread.dark_e, spread.response, spread.hot_share, spread.hot_current_e_per_s, spread.dead_share)
    maps = FixedPattern(np.zeros(shape), np.ones(shape), np.zeros(shape))
    fill_maps(numbers, stream(spread.specimen, camera), corner, np.zeros((2, shape[1])), maps)
    return maps


@kernel
def fill_maps(spread: Spread, keys: Stream, corner, of_columns, maps: FixedPattern):
    """Fill the maps of a window; `of_columns` is room for the dark signal and the response of each column."""
    height, width = maps.dark_e.shape
    for j in range(width):
        dark, response = normals(keys, 0, corner[1] + j, PATTERN_OF_COLUMN)
        of_columns[0, j], of_columns[1, j] = spread.dark[2] * dark, spread.response[2] * response
    for i in range(height):
        row = corner[0] + i
        dark, response = normals(keys, row, 0, PATTERN_OF_ROW)
        row_dark, row_response = spread.dark[1] * dark, spread.response[1] * response
        for j in range(width):
            column = corner[1] + j
            dark, response = normals(keys, row, column, PATTERN)
            maps.dark_e[i, j] = spread.dark[0] * dark + row_dark + of_columns[0, j]
            maps.response[i, j] = max(0.0, 1.0 + spread.response[0] * response + row_response + of_columns[1, j])
            hot, dead = uniforms(keys, row, column, DEFECTS, 0)
            if dead < spread.dead_share:
                maps.response[i, j] = 0.0
            if hot < spread.hot_share:
                maps.hot_e_per_s[i, j] = -spread.hot_e_per_s * math.log(uniforms(keys, row, column, DEFECTS, 1)[0])
