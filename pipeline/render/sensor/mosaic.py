"""Mosaic of a colour filter array, and the crosstalk of its pixels."""

import math
from collections.abc import Mapping

import numpy as np

from pipeline.records.shapes import Float64
from pipeline.render.sensor.response import SensorError, SensorResponse


def mosaic(response: SensorResponse, photons: Mapping[str, np.ndarray], corner: tuple[int, int]) -> np.ndarray:
    """Expected electrons of every pixel behind its own filter, before crosstalk.

    `photons`, mapping of str to (h, w) array: mean number of photons in a pixel, of every channel.
    `corner`: row and column of the first pixel on the sensor; they may be negative.
    Returns (h, w) float64.
    Raises SensorError: the channels are not those of the filters.
    """
    if photons.keys() != set(response.channels):
        raise SensorError(f"images of the channels {sorted(photons)} for filters of {sorted(response.channels)}")
    electrons = {
        name: efficiency * np.asarray(photons[name], np.float64)
        for name, efficiency in zip(response.channels, response.quantum_efficiency, strict=True)
    }
    period = response.period_px
    if period == 1:
        return electrons[response.filters[0]]
    result = np.empty(np.shape(photons[response.channels[0]]))
    for number, name in enumerate(response.filters):
        row, column = number // period, number % period
        first = (row - corner[0]) % period, (column - corner[1]) % period
        result[first[0] :: period, first[1] :: period] = electrons[name][first[0] :: period, first[1] :: period]
    return result


def after_crosstalk(electrons: Float64[np.ndarray, "h w"], kernel: tuple[float, ...]) -> np.ndarray:
    """Expected electrons after each pixel has given its neighbours their shares.

    Counts that scatter independently stay Poisson-distributed and independent, so that the mean alone has to be spread.

    `electrons`: with a margin of m pixels all around, m half the edge of the kernel, rounded down.
    `kernel`: row by row, the share of a pixel's electrons that the pixel there collects.
    Returns (h, w) float64.
    """
    edge = math.isqrt(len(kernel))
    if edge <= 1:
        return electrons
    height, width = electrons.shape[0] - edge + 1, electrons.shape[1] - edge + 1
    result = np.zeros((height, width))
    for number, share in enumerate(kernel):
        # What goes up in the kernel comes from below: the source lies opposite to the entry.
        row, column = edge - 1 - number // edge, edge - 1 - number % edge
        result += share * electrons[row : row + height, column : column + width]
    return result
