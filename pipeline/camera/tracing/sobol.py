"""Owen-scrambled Sobol points by hashing: random numbers as a function of (seed, pixel, sample, dimension) alone.

Sources: Sobol's sequence with the direction numbers of Joe and Kuo (2008); Owen's scrambling as in Burley, "Practical
Hash-based Owen Scrambling", JCGT 9(4), 2020, with the hash of Laine and Karras in the form improved by Vegdahl (2021).
"""

import functools

import numpy as np

from pipeline.jit.decorators import inline
from pipeline.records.shapes import Num

DIMENSIONS = 7
"""Random numbers of a ray: two for its aim, two for its start on a square, and three for its diffraction."""
_PRIMITIVE = {
    1: (1, 0, (1,)),
    2: (2, 1, (1, 3)),
    3: (3, 1, (1, 3, 1)),
    4: (3, 2, (1, 1, 1)),
    5: (4, 1, (1, 1, 3, 3)),
    6: (4, 4, (1, 3, 5, 13)),
}
"""Per dimension after the first: degree s, coefficients a, initial m of Joe and Kuo's table."""


@functools.lru_cache(maxsize=8)
def sobol_bits(count: int) -> np.ndarray:
    """The first `count` points of the unscrambled sequence with their bits reversed, ready for scrambling.

    Returns (DIMENSIONS, count) uint32: bit 0 holds the most significant binary digit. Bundles of one camera use the
    array again and again: it is shared, and must not be written to.
    """
    return sobol_bits_at(np.arange(count, dtype=np.uint32))


def sobol_bits_at(index: Num[np.ndarray, "n"]) -> np.ndarray:
    """Points with indices (n,) uint32, as `sobol_bits`: (DIMENSIONS, n) uint32."""
    points = np.zeros((DIMENSIONS, len(index)), np.uint32)
    for dimension in range(DIMENSIONS):
        for bit, direction in enumerate(_directions(dimension)):
            points[dimension] ^= np.where(index >> np.uint32(bit) & np.uint32(1), direction, np.uint32(0))
    digits = np.unpackbits(points.astype(">u4").view(np.uint8).reshape(*points.shape, 4), axis=-1)
    return np.packbits(digits[..., ::-1], axis=-1).view(">u4")[..., 0].astype(np.uint32)


def _directions(dimension: int) -> list[np.uint32]:
    """Direction numbers of a dimension by Sobol's recurrence."""
    if dimension == 0:
        return [np.uint32(1 << (31 - i)) for i in range(32)]
    degree, coefficients, initial = _PRIMITIVE[dimension]
    m = list(initial)
    for i in range(degree, 32):
        value = m[i - degree] ^ (m[i - degree] << degree)
        for j in range(1, degree):
            if coefficients >> (degree - 1 - j) & 1:
                value ^= m[i - j] << j
        m.append(value)
    return [np.uint32(m[i] << (31 - i)) for i in range(32)]


@inline
def hash32(a, b):
    """Mix two 32-bit numbers into one (the finaliser of MurmurHash3 after a multiply-add)."""
    h = np.uint32(np.uint32(a) * np.uint32(0x9E3779B1) + np.uint32(b) + np.uint32(0x7F4A7C15))
    h ^= h >> np.uint32(16)
    h = np.uint32(h * np.uint32(0x85EBCA6B))
    h ^= h >> np.uint32(13)
    h = np.uint32(h * np.uint32(0xC2B2AE35))
    h ^= h >> np.uint32(16)
    return h


@inline
def scrambled(bits, seed):
    """A coordinate in [0, 1) of a point from `sobol_bits`, Owen-scrambled by `seed`."""
    return scrambled_bits(bits, seed) * 2.3283064365386963e-10


@inline
def scrambled_bits(bits, seed):
    """A scrambled coordinate as an integer, whose most significant digit is that of the coordinate."""
    x = np.uint32(bits)
    x ^= np.uint32(x * np.uint32(0x3D20ADEA))
    x = np.uint32(x + np.uint32(seed))
    x = np.uint32(x * (np.uint32(seed) >> np.uint32(16) | np.uint32(1)))
    x ^= np.uint32(x * np.uint32(0x05526C56))
    x ^= np.uint32(x * np.uint32(0x53A22864))
    return reversed_bits(x)


@inline
def reversed_bits(x):
    """The 32 bits of a number in reverse order."""
    x = (x >> np.uint32(1)) & np.uint32(0x55555555) | (x & np.uint32(0x55555555)) << np.uint32(1)
    x = (x >> np.uint32(2)) & np.uint32(0x33333333) | (x & np.uint32(0x33333333)) << np.uint32(2)
    x = (x >> np.uint32(4)) & np.uint32(0x0F0F0F0F) | (x & np.uint32(0x0F0F0F0F)) << np.uint32(4)
    x = (x >> np.uint32(8)) & np.uint32(0x00FF00FF) | (x & np.uint32(0x00FF00FF)) << np.uint32(8)
    x = x >> np.uint32(16) | x << np.uint32(16)
    return np.uint32(x)
