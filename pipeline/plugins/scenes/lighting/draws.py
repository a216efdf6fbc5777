"""Random numbers of paths: functions of seed, pixel and microlens, of the rank of a ray among those of its pixel, and
of the stage of the path; of nothing else. So a tile, a window or another number of workers gives the same bytes.

Every pair of numbers is a point of a two-dimensional Sobol sequence, Owen-scrambled, whose points are taken in an order
that is scrambled, too: rays of a pixel fill the square evenly at each stage, and the stages are independent. All
wavelengths and all passes of a replica share one sequence, each its own stretch: together they fill the square more
evenly than alone. Source: Burley, "Practical Hash-based Owen Scrambling", JCGT 9(4), 2020.
"""

import functools
from typing import NamedTuple

import numpy as np

from pipeline.camera.tracing.sobol import hash32, reversed_bits, scrambled, scrambled_bits, sobol_bits_at
from pipeline.jit.decorators import inline, kernel

LAMP, SCATTER, SURVIVAL, CHOICE = range(4)
"""Stages of a vertex of a path [1]: points on lamps, the next direction, whether the path goes on, and the lamp that is
asked."""
STAGES = 4
"""Stages of each vertex [1]."""
_COLOUR = 1 << 20
"""Stage at which a ray gets its slice of the spectrum [1]: beyond those of all vertices."""
_PASSING = 1 << 21
"""First stage at which surfaces let a ray pass by chance [1]: beyond that of colours."""
_CROSSING = 1 << 22
"""First stage at which a path is reflected or refracted by a smooth face of glass [1]: beyond that of passing."""
CROSSINGS = 32
"""Most smooth faces of glass that a path crosses one after the other [1]: then it ends."""
_VERTICES = 128
"""Stages of passing between two crossings [1]: more than a path has vertices."""
LAYERS = 64
"""Most surfaces that a ray passes one after the other [1]: leaves of a tree; the next one is opaque."""
_STREAM = 1 << 26
"""First stream of random numbers of paths, one for each microlens of a pixel: far behind those of rays."""
_BYTES = 4
"""Bytes of an index of the sequence [1]."""


class Names(NamedTuple):
    """Keys of random numbers, common to all rays of a pixel through a microlens, and ranks of rays among these."""

    key: np.ndarray
    rank: np.ndarray


@functools.cache
def points() -> np.ndarray:
    """Second coordinates of the sequence by the bytes of the index, which are added without carry, (4, 256) uint32."""
    first = np.arange(256, dtype=np.uint32)
    return np.stack([sobol_bits_at(first << np.uint32(8 * byte))[1] for byte in range(_BYTES)])


@inline
def draw(points, key, rank, stage):
    """Two numbers in [0, 1) for a ray of a rank among those with a key."""
    seed = hash32(key, np.uint32(3 * stage))
    index = scrambled_bits(reversed_bits(np.uint32(rank)), seed)
    second = points[0, index & np.uint32(255)]
    for byte in range(1, _BYTES):
        second ^= points[byte, index >> np.uint32(8 * byte) & np.uint32(255)]
    # The first coordinate is the index with its digits turned round, as all bits are here.
    return scrambled(index, hash32(seed, np.uint32(1))), scrambled(second, hash32(seed, np.uint32(2)))


def passing_stage(vertex: int, crossing: int, layer: int) -> int:
    """Stage at which a ray to a vertex, behind `crossing` faces of glass, may pass its `layer`-th surface."""
    return _PASSING + LAYERS * (vertex + _VERTICES * crossing) + layer


def crossing_stage(vertex: int, crossing: int) -> int:
    """Stage at which the light of a path to a vertex is reflected or refracted by a face of glass."""
    return _CROSSING + CROSSINGS * vertex + crossing


@kernel
def choose_slices(points, key, rank, count, chosen):
    """Choose one of `count` slices of the spectrum for each ray (n,), written, (n,) int64."""
    for i in range(chosen.size):
        chosen[i] = int(draw(points, key[i], rank[i], _COLOUR)[0] * count)


@kernel
def name_rays(seed, light, squares, owner, key, rank):
    """Name rays of some pixels; rays of one owner follow one another. `key` and `rank`, (n,), are written.

    `seed`, int: the same for all wavelengths.
    `light`, (int, int): the wavelength among all of the image, and their number.
    `owner`, (n,) int64: pixel times the number of microlenses, plus the microlens.
    """
    number, lights = light
    microlenses = squares.skipped.shape[1]
    for i in range(owner.size):
        if i > 0 and owner[i] == owner[i - 1]:
            key[i], rank[i] = key[i - 1], rank[i - 1] + 1
            continue
        n, j = owner[i] // microlenses, owner[i] % microlenses
        base = hash32(hash32(seed, squares.pixels[n, 0]), squares.pixels[n, 1])
        # A later pass has as many rays as all before it: their stretches lie behind those of all wavelengths so far.
        stretch = number + lights if squares.skipped[n, j] > 0 else number
        key[i], rank[i] = hash32(base, _STREAM + j), stretch * squares.counts[n, j]
