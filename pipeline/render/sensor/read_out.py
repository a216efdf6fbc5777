"""Read-out of a sensor: from expected photons to digital numbers, in the order of stages of EMVA 1288, release 4.0."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from pipeline.jit.decorators import inline, kernel
from pipeline.render.sensor.counter import COLUMN_NOISE, DARK_NOISE, ELECTRONS, ROW_NOISE, Stream, stream
from pipeline.render.sensor.draws import normals, poisson
from pipeline.render.sensor.fixed_pattern import FixedPattern, fixed_pattern
from pipeline.render.sensor.mosaic import after_crosstalk, mosaic
from pipeline.render.sensor.response import SensorResponse


@dataclass(frozen=True, slots=True, kw_only=True)
class Shot:
    """One exposure of a camera: what its noise is a function of, and for how long it lasts.

    `seed`: seed of the temporal noise.
    `camera`: name of the camera: two cameras of a dataset share no noise.
    """

    seed: int
    camera: str
    frame: int
    exposure_time_s: float


class Chain(NamedTuple):
    """Numbers of the read-out of one frame.

    `dark_s_and_current`: exposure time [s] and mean dark current [e-/s].
    `temporal_e`: noise of pixel, row and column [e-].
    `scale`: black level [DN], gain [DN/e-], largest digital number [DN].
    """

    counts: bool
    full_well_e: float
    dark_s_and_current: tuple[float, float]
    temporal_e: tuple[float, float, float]
    scale: tuple[float, float, float]
    nonlinear_at: np.ndarray
    nonlinear_by: np.ndarray


def digital_numbers(
    response: SensorResponse, photons: Mapping[str, np.ndarray], shot: Shot, corner: tuple[int, int] = (0, 0)
) -> np.ndarray:
    """Raw image of a window of the sensor: that window of the raw image of the whole, bit for bit.

    `photons`, mapping of str to (h + 2 m, w + 2 m) array: mean number of photons in a pixel during the exposure, of
        every channel; with a margin of `response.margin_px` pixels around the window.
    `corner`: row and column of the first pixel of the window.
    Returns (h, w) uint16 [DN].
    """
    margin = response.margin_px
    electrons = mosaic(response, photons, (corner[0] - margin, corner[1] - margin))
    electrons = np.ascontiguousarray(after_crosstalk(electrons, response.crosstalk))
    pattern = fixed_pattern(response.spread, shot.camera, corner, electrons.shape)
    result = np.empty(electrons.shape, np.uint16)
    keys = stream(shot.seed, shot.camera, shot.frame)
    read_out(_chain(response, shot), keys, corner, electrons, pattern, np.empty(electrons.shape[1]), result)
    return result


def _chain(response: SensorResponse, shot: Shot) -> Chain:
    table = np.array(response.nonlinearity, np.float64).reshape(-1, 2)
    return Chain(
        counts=response.shot_noise,
        full_well_e=response.full_well_e,
        dark_s_and_current=(shot.exposure_time_s, response.dark_current()),
        temporal_e=(response.dark_noise_e, response.row_noise_e, response.column_noise_e),
        scale=(response.black_level_dn, response.gain_dn_per_e, float(response.most_dn)),
        nonlinear_at=np.ascontiguousarray(table[:, 0]),
        nonlinear_by=np.ascontiguousarray(table[:, 1]),
    )


@kernel
def read_out(chain: Chain, keys: Stream, corner, electrons, pattern: FixedPattern, of_columns, result):
    """Fill `result` with digital numbers; `electrons` are expected ones, `of_columns` room for the noise of columns."""
    height, width = electrons.shape
    time_s, current = chain.dark_s_and_current
    for j in range(width):
        of_columns[j] = chain.temporal_e[2] * normals(keys, 0, corner[1] + j, COLUMN_NOISE)[0]
    for i in range(height):
        row = corner[0] + i
        of_row = chain.temporal_e[1] * normals(keys, row, 0, ROW_NOISE)[0]
        for j in range(width):
            column = corner[1] + j
            # Light and dark current are both Poisson-distributed, and so is their sum.
            charge = electrons[i, j] * pattern.response[i, j] + (current + pattern.hot_e_per_s[i, j]) * time_s
            if chain.counts:
                charge = poisson(keys, row, column, ELECTRONS, charge)
            charge = _bent(chain, min(charge, chain.full_well_e))
            charge += pattern.dark_e[i, j] + of_row + of_columns[j]
            if chain.temporal_e[0] > 0.0:
                charge += chain.temporal_e[0] * normals(keys, row, column, DARK_NOISE)[0]
            number = math.floor(chain.scale[0] + chain.scale[1] * charge + 0.5)
            result[i, j] = np.uint16(min(max(number, 0.0), chain.scale[2]))


@inline
def _bent(chain: Chain, charge):
    """The signal of a charge by the table of non-linearity [e-]."""
    knots = len(chain.nonlinear_at)
    if knots == 0:
        return charge
    share, n = charge / chain.full_well_e, 1
    if share <= chain.nonlinear_at[0]:
        return charge * (1.0 + chain.nonlinear_by[0])
    while n < knots and chain.nonlinear_at[n] < share:
        n += 1
    if n == knots:
        return charge * (1.0 + chain.nonlinear_by[knots - 1])
    low, high = chain.nonlinear_at[n - 1], chain.nonlinear_at[n]
    way = (share - low) / (high - low)
    return charge * (1.0 + (1.0 - way) * chain.nonlinear_by[n - 1] + way * chain.nonlinear_by[n])
