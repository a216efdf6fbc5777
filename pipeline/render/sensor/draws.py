"""Random numbers as a function of (seed, camera, frame, pixel, stage) alone: the counter-based generator Philox4x32-10.

No state: any pixel can be computed first, alone, or twice, in any process.

Source: Salmon, Moraes, Dror and Shaw, "Parallel Random Numbers: As Easy as 1, 2, 3", SC 2011.
"""

import hashlib
import math
from typing import NamedTuple

import numpy as np

from pipeline.jit.decorators import inline

_LOW = np.uint64(0xFFFFFFFF)
"""The lower 32 bits of a word [1]."""
_MULTIPLY_0, _MULTIPLY_1 = np.uint64(0xD2511F53), np.uint64(0xCD9E8D57)
"""Multipliers of Philox4x32 [1]: the paper chose them for the best diffusion of bits."""
_ADD_0, _ADD_1 = np.uint64(0x9E3779B9), np.uint64(0xBB67AE85)
"""What is added to the key after each round [1]: the golden ratio and sqrt(3) - 1, as the paper has them."""
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
"""Means beyond this are taken as this [e-]: ten times the largest full well, so that none of them is seen."""


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
        first, second = _MULTIPLY_0 * a, _MULTIPLY_1 * c
        a = (second >> _SHIFT_32) ^ b ^ key_0
        c = (first >> _SHIFT_32) ^ d ^ key_1
        b, d = second & _LOW, first & _LOW
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
    radius, angle = math.sqrt(-2.0 * math.log(first)), 2.0 * math.pi * second
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
    count, probability = 0.0, math.exp(-mean)
    total = probability
    while level > total and probability > _NEVER:
        count += 1.0
        probability *= mean / count
        total += probability
    return count


@inline
def _by_rejection(keys, row, column, stage, mean):
    b = 0.931 + 2.53 * math.sqrt(mean)
    a = -0.059 + 0.02483 * b
    inverse_alpha, squeeze = 1.1239 + 1.1328 / (b - 3.4), 0.9277 - 3.6224 / (b - 2.0)
    count = mean
    for draw in range(DRAWS):
        first, second = uniforms(keys, row, column, stage, draw)
        first -= 0.5
        edge = 0.5 - abs(first)
        count = math.floor((2.0 * a / edge + b) * first + mean + 0.43)
        if edge >= 0.07 and second <= squeeze:
            break
        if count < 0.0 or (edge < 0.013 and second > edge):
            continue
        bound = count * math.log(mean) - mean - math.lgamma(count + 1.0)
        if math.log(second * inverse_alpha / (a / (edge * edge) + b)) <= bound:
            break
    return count
