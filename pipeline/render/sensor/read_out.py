"""Read-out of a sensor: from expected photons to digital numbers, in the stages of EMVA 1288, release 4.0.

Random numbers are a function of (seed, camera, frame, pixel, stage) alone, by the counter-based generator Philox4x32-10
(Salmon, Moraes, Dror and Shaw, "Parallel Random Numbers: As Easy as 1, 2, 3", SC 2011). There is no state: any pixel
can be computed first, alone, or twice, in any process.
"""

import hashlib
import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from pipeline.jit.decorators import inline, kernel
from pipeline.records.shapes import Float64
from pipeline.render.sensor.response import PatternSpread, SensorError, SensorResponse

_LOW = np.uint64(0xFFFFFFFF)
"""Mask of the lower 32 bits of a word [1]."""
_MULTIPLY_0, _MULTIPLY_1 = np.uint64(0xD2511F53), np.uint64(0xCD9E8D57)
"""Multipliers of Philox4x32 [1]: the paper chose them for the best diffusion of bits."""
_ADD_0, _ADD_1 = np.uint64(0x9E3779B9), np.uint64(0xBB67AE85)
"""Increments of the key after each round [1]: the golden ratio and sqrt(3) - 1 as 32-bit fractions, as in the paper."""
_ROUNDS = 10
"""Rounds [1]: seven pass all tests of the paper; ten are its margin of safety."""
_SHIFT_32, _SHIFT_6 = np.uint64(32), np.uint64(6)
"""Shifts [bit]: to the upper half of a product, and from 32 bits to the upper 26."""
_FIRST_26, _STEP = 2.0**-26, 2.0**-52
"""Units of the upper and of the lower half of a random number of 52 bits [1]."""

DRAWS = 1 << 16
"""Random numbers that a stage of a pixel may draw [pairs]: trials of a rejection, of which two are usual."""
ELECTRONS, DARK_NOISE, ROW_NOISE, COLUMN_NOISE = 0, 1, 2, 3
"""Stages of a frame [1]: each has random numbers of its own, so that one that is switched off moves no other."""
PATTERN, PATTERN_OF_ROW, PATTERN_OF_COLUMN, DEFECTS = 16, 17, 18, 19
"""Stages of the fixed pattern [1]."""


_FEW = 10.0
"""Mean up to which a count is found by inversion [e-]: rejection needs a mean of 10, and inversion takes as many steps
as the count."""
_NEVER = 1e-20
"""Probability below which no further count is tried [1]: random numbers have steps of 2e-16."""
_MOST = 1e9
"""Means beyond this are clipped to it [e-]: ten times the largest full well, so that none of them is visible."""


class Stream(NamedTuple):
    """Origin of random numbers: two keys of 32 bits, and the frame."""

    seed: np.uint64
    camera: np.uint64
    frame: np.uint64


def stream(seed: int, camera: str, frame: int = 0) -> Stream:
    """The random numbers of a camera, by its name, in a frame."""
    name = int.from_bytes(hashlib.sha256(camera.encode()).digest()[:4], "little")
    return Stream(np.uint64(seed & 0xFFFFFFFF), np.uint64(name), np.uint64(frame & 0xFFFFFFFF))


@inline
def philox(a, b, c, d, key_0, key_1):
    """Four words of 32 bits, from a counter of four and a key of two; all in uint64."""
    for _ in range(_ROUNDS):
        product_0, product_1 = _MULTIPLY_0 * a, _MULTIPLY_1 * c
        a = (product_1 >> _SHIFT_32) ^ b ^ key_0
        c = (product_0 >> _SHIFT_32) ^ d ^ key_1
        b, d = product_1 & _LOW, product_0 & _LOW
        key_0, key_1 = (key_0 + _ADD_0) & _LOW, (key_1 + _ADD_1) & _LOW
    return a, b, c, d


@inline
def unit_interval(high, low):
    """A number in (0, 1), its ends excluded, from two words: (n + 1/2) / 2^52."""
    return np.float64(high >> _SHIFT_6) * _FIRST_26 + (np.float64(low >> _SHIFT_6) + 0.5) * _STEP


@inline
def uniforms(keys, row, column, stage, draw):
    """Two independent numbers in (0, 1), a function of the arguments alone."""
    a, b, c, d = philox(
        np.uint64(column), np.uint64(row), keys.frame, np.uint64(stage * DRAWS + draw), keys.seed, keys.camera
    )
    return unit_interval(a, b), unit_interval(c, d)


@inline
def normals(keys, row, column, stage):
    """Two independent numbers of mean 0 and variance 1 (Box and Muller 1958)."""
    first, second = uniforms(keys, row, column, stage, 0)
    radius = math.sqrt(-2.0 * math.log(first))
    angle = 2.0 * math.pi * second
    return radius * math.cos(angle), radius * math.sin(angle)


@inline
def poisson(keys, row, column, stage, mean):
    """Poisson-distributed count of a mean, as a float.

    Small means by inversion of the distribution function, others by transformed rejection with squeeze (PTRS): both
    are exact but for rounding.

    Source: W. Hormann, The transformed rejection method for generating Poisson random variables, Insurance: Mathematics
    and Economics 12 (1993) 39-45.
    """
    if mean <= 0.0:
        return 0.0
    if mean < _FEW:
        return _by_inversion(mean, uniforms(keys, row, column, stage, 0)[0])
    return _by_rejection(keys, row, column, stage, min(mean, _MOST))


@inline
def _by_inversion(mean, level):
    """The smallest count at which the distribution function reaches a level in (0, 1)."""
    count = 0.0
    probability = math.exp(-mean)
    cumulative = probability
    while level > cumulative and probability > _NEVER:
        count += 1.0
        probability *= mean / count
        cumulative += probability
    return count


@inline
def _by_rejection(keys, row, column, stage, mean):
    """A count by Hormann's algorithm PTRS, with the names of its steps and constants."""
    b = 0.931 + 2.53 * math.sqrt(mean)
    a = -0.059 + 0.02483 * b
    inverse_alpha = 1.1239 + 1.1328 / (b - 3.4)
    squeeze = 0.9277 - 3.6224 / (b - 2.0)
    count = mean
    for draw in range(DRAWS):
        # Step 1: a count from a transformed uniform number; most are accepted at once by the squeeze.
        u, v = uniforms(keys, row, column, stage, draw)
        u -= 0.5
        u_s = 0.5 - abs(u)
        count = math.floor((2.0 * a / u_s + b) * u + mean + 0.43)
        if u_s >= 0.07 and v <= squeeze:
            break
        # Step 2: surely rejected
        if count < 0.0 or (u_s < 0.013 and v > u_s):
            continue
        # Step 3: accepted if below the Poisson probability
        log_probability = count * math.log(mean) - mean - math.lgamma(count + 1.0)
        if math.log(v * inverse_alpha / (a / (u_s * u_s) + b)) <= log_probability:
            break
    return count


@dataclass(frozen=True, slots=True, kw_only=True)
class Shot:
    """One exposure of a named camera: two cameras of a dataset share no noise. `seed`: of temporal noise."""

    seed: int
    camera: str
    frame: int
    exposure_time_s: float


class Chain(NamedTuple):
    """Parameters of the read-out of one frame."""

    counts: bool
    full_well_e: float
    dark_s_and_current: tuple[float, float]  # exposure time [s] and mean dark current [e-/s]
    temporal_e: tuple[float, float, float]  # noise of pixel, row and column
    scale: tuple[float, float, float]  # black level [DN], gain [DN/e-], largest digital number [DN]
    nonlinear_at: np.ndarray
    nonlinear_by: np.ndarray


def digital_numbers(
    response: SensorResponse, photons: Mapping[str, np.ndarray], shot: Shot, corner: tuple[int, int] = (0, 0)
) -> np.ndarray:
    """Raw image of a window of the sensor: bit for bit that window of the complete raw image.

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
    table = np.array(response.nonlinearity, np.float64).reshape(-1, 2)
    chain = Chain(
        counts=response.shot_noise,
        full_well_e=response.full_well_e,
        dark_s_and_current=(shot.exposure_time_s, response.dark_current()),
        temporal_e=(response.dark_noise_e, response.row_noise_e, response.column_noise_e),
        scale=(response.black_level_dn, response.gain_dn_per_e, float(response.most_dn)),
        nonlinear_at=np.ascontiguousarray(table[:, 0]),
        nonlinear_by=np.ascontiguousarray(table[:, 1]),
    )
    read_out(chain, keys, corner, electrons, pattern, np.empty(electrons.shape[1]), result)
    return result


def mosaic(response: SensorResponse, photons: Mapping[str, np.ndarray], corner: tuple[int, int]) -> np.ndarray:
    """Expected electrons of every pixel behind its own filter, before crosstalk, (h, w) float64.

    `photons`: mean number of photons in a pixel, of every channel, (h, w) each.
    `corner`: row and column of the first pixel on the sensor; they may be negative.
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

    Poisson counts that scatter independently remain independent Poisson counts, so that only the mean has to be spread.

    `electrons`: with a margin of m pixels all around, m half the edge of the kernel, rounded down.
    `kernel`: row by row, the share of a pixel's electrons that the pixel there collects.
    """
    edge = math.isqrt(len(kernel))
    if edge <= 1:
        return electrons
    height = electrons.shape[0] - edge + 1
    width = electrons.shape[1] - edge + 1
    result = np.zeros((height, width))
    for number, share in enumerate(kernel):
        # What goes up in the kernel comes from below: the source lies opposite to the entry.
        row, column = edge - 1 - number // edge, edge - 1 - number % edge
        result += share * electrons[row : row + height, column : column + width]
    return result


class FixedPattern(NamedTuple):
    """Pixel-to-pixel differences of a specimen, constant over frames, (h, w) float64 each."""

    dark_e: np.ndarray  # difference of the dark signal from its mean, DSNU
    response: np.ndarray  # photo response over its mean, PRNU; 0 of dead pixels
    hot_e_per_s: np.ndarray  # dark current of hot pixels beyond that of the others, 0 elsewhere


def fixed_pattern(spread: PatternSpread, camera: str, corner: tuple[int, int], shape: tuple[int, int]) -> FixedPattern:
    """Maps of a window of the sensor of a named camera."""
    maps = FixedPattern(np.zeros(shape), np.ones(shape), np.zeros(shape))
    deviations = spread.dark_e, spread.response
    defects = spread.dead_share, spread.hot_share, spread.hot_current_e_per_s
    keys = stream(spread.specimen, camera)
    fill_maps(deviations, defects, keys, corner, np.zeros((2, shape[1])), maps)
    return maps


@kernel
def fill_maps(deviations, defects, keys, corner, of_columns, maps):
    """Fill the maps of a window; `of_columns` is a buffer for the dark signal and the response of each column."""
    (pixel_dark, rows_dark, columns_dark), (pixel_response, rows_response, columns_response) = deviations
    dead_share, hot_share, hot_e_per_s = defects
    height, width = maps.dark_e.shape
    for j in range(width):
        dark, response = normals(keys, 0, corner[1] + j, PATTERN_OF_COLUMN)
        of_columns[0, j], of_columns[1, j] = columns_dark * dark, columns_response * response
    for i in range(height):
        row = corner[0] + i
        dark, response = normals(keys, row, 0, PATTERN_OF_ROW)
        row_dark, row_response = rows_dark * dark, rows_response * response
        for j in range(width):
            column = corner[1] + j
            dark, response = normals(keys, row, column, PATTERN)
            maps.dark_e[i, j] = pixel_dark * dark + row_dark + of_columns[0, j]
            maps.response[i, j] = max(0.0, 1.0 + pixel_response * response + row_response + of_columns[1, j])
            hot, dead = uniforms(keys, row, column, DEFECTS, 0)
            if dead < dead_share:
                maps.response[i, j] = 0.0
            if hot < hot_share:
                maps.hot_e_per_s[i, j] = -hot_e_per_s * math.log(uniforms(keys, row, column, DEFECTS, 1)[0])


@kernel
def read_out(chain: Chain, keys: Stream, corner, electrons, pattern: FixedPattern, of_columns, result):
    """Fill `result` with digital numbers; `electrons` are expected ones, `of_columns` a buffer for noise of columns."""
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
            charge = _with_nonlinearity(chain, min(charge, chain.full_well_e))
            charge += pattern.dark_e[i, j] + of_row + of_columns[j]
            if chain.temporal_e[0] > 0.0:
                charge += chain.temporal_e[0] * normals(keys, row, column, DARK_NOISE)[0]
            number = math.floor(chain.scale[0] + chain.scale[1] * charge + 0.5)
            result[i, j] = np.uint16(min(max(number, 0.0), chain.scale[2]))


@inline
def _with_nonlinearity(chain: Chain, charge):
    """Signal of a charge, by the table of non-linearity, linear between its knots and constant beyond them [e-]."""
    knots = len(chain.nonlinear_at)
    if knots == 0:
        return charge
    share = charge / chain.full_well_e
    n = 1
    if share <= chain.nonlinear_at[0]:
        return charge * (1.0 + chain.nonlinear_by[0])
    while n < knots and chain.nonlinear_at[n] < share:
        n += 1
    if n == knots:
        return charge * (1.0 + chain.nonlinear_by[knots - 1])
    low, high = chain.nonlinear_at[n - 1], chain.nonlinear_at[n]
    fraction = (share - low) / (high - low)
    return charge * (1.0 + (1.0 - fraction) * chain.nonlinear_by[n - 1] + fraction * chain.nonlinear_by[n])
