"""Random numbers of paths: functions of the ray that left the camera, its place among those of its pixel, and the stage
of the path; of nothing else. So a tile, a window or another number of workers gives the same bytes.

Every pair of numbers is a point of a two-dimensional Sobol set, Owen-scrambled, whose points are taken in an order that
is scrambled, too: neighbouring rays of a pixel fill the square evenly at each stage, and the stages are independent.
Source: Burley, "Practical Hash-based Owen Scrambling", JCGT 9(4), 2020.
"""

from typing import NamedTuple

import numpy as np

from pipeline.camera.tracing.sobol import hash32, scrambled, sobol_bits
from pipeline.jit.decorators import inline, kernel

LAMP, SCATTER, SURVIVAL = range(3)
"""Stages of a vertex of a path [1]: the point on a lamp, the next direction, and whether the path goes on."""
STAGES = 4
"""Stages reserved for each vertex [1]."""


class Points(NamedTuple):
    """Sobol points for the kernels.

    Attributes
    ----------
    bits : (2, size) uint32
        Numbers from `camera.tracing.sobol`.
    turned : (size,) uint32
        Binary digits of each index, the last one first.
    """

    bits: np.ndarray
    turned: np.ndarray


def points_of(samples: int) -> Points:
    """Points for pixels with so many rays, a power of two."""
    digits = max(1, samples.bit_length() - 1)
    index = np.arange(1 << digits, dtype=np.uint32)
    turned = np.zeros_like(index)
    for digit in range(digits):
        turned |= (index >> np.uint32(digit) & np.uint32(1)) << np.uint32(digits - 1 - digit)
    return Points(np.ascontiguousarray(sobol_bits(len(index))[:2]), turned)


@inline
def draw(points, key, place, stage):
    """Two numbers in [0, 1) for the ray at a place of a pixel with a key."""
    size = points.turned.size
    seed = hash32(key, np.uint32(3 * stage))
    # Places beyond the points are those of more rays than asked for; they begin again with another key.
    turn, own = place // size, place % size
    seed = hash32(seed, np.uint32(turn))
    shuffled = int(scrambled(points.turned[own], seed) * size)
    u = scrambled(points.bits[0, shuffled], hash32(seed, np.uint32(1)))
    v = scrambled(points.bits[1, shuffled], hash32(seed, np.uint32(2)))
    return u, v


@kernel
def name_rays(owner, words, key, place):
    """Key and place of each ray: rays of one owner follow one another, and the first one names all of them.

    Parameters
    ----------
    owner : (n,) int64
    words : (n, 12) uint32
        The bits of origin and direction.
    key, place : (n,) uint32, (n,) int64
        Written.
    """
    for i in range(owner.size):
        if i > 0 and owner[i] == owner[i - 1]:
            key[i], place[i] = key[i - 1], place[i - 1] + 1
            continue
        key[i], place[i] = np.uint32(0), 0
        for k in range(words.shape[1]):
            key[i] = hash32(key[i], words[i, k])
