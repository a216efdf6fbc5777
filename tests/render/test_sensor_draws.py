"""Random numbers of a sensor: Philox by its known answers, counts and normal numbers by their closed forms."""

import numpy as np
import pytest
from laws.sensors import IDEAL, even, having, shot
from scipy import stats
from shorter import few
from tolerances import ONCE_IN_A_MILLION, SIGMAS

from pipeline.render.sensor.read_out import fixed_pattern, philox, stream, unit_interval

SHAPE = (400, 500)
MANY = (1500, 2000)
"""Enough counts to see a per mille."""
COUNTING = having(IDEAL, shot_noise=True)

KNOWN = [
    ((0, 0, 0, 0), (0, 0), (0x6627E8D5, 0xE169C58D, 0xBC57AC4C, 0x9B00DBD8)),
    ((0xFFFFFFFF,) * 4, (0xFFFFFFFF,) * 2, (0x408F276D, 0x41C83B0E, 0xA20BC7C6, 0x6D5451FD)),
    (
        (0x243F6A88, 0x85A308D3, 0x13198A2E, 0x03707344),
        (0xA4093822, 0x299F31D0),
        (0xD16CFE09, 0x94FDCCEB, 0x5001E420, 0x24126EA1),
    ),
]
"""Counter, key and answer of Philox4x32-10, from kat_vectors of the authors' library Random123."""


@pytest.mark.parametrize(("counter", "key", "answer"), KNOWN)
def test_philox_gives_the_known_answers(counter, key, answer):
    assert tuple(map(int, philox(*map(np.uint64, (*counter, *key))))) == answer


def test_random_numbers_reach_neither_end_of_the_unit_interval():
    zero, ones = np.uint64(0), np.uint64(0xFFFFFFFF)
    assert unit_interval(zero, zero) == 2.0**-53
    assert unit_interval(ones, ones) == 1 - 2.0**-53


def test_a_stream_takes_any_whole_numbers():
    """A frame may be negative; what has the same lower 32 bits has the same noise."""
    assert stream(7, "A", -1) == stream(7 + 2**32, "A", 2**32 - 1)
    assert len({stream(7, "A", 1), stream(7, "A", 2), stream(7, "B", 1), stream(8, "A", 1)}) == 4


@pytest.mark.parametrize("mean", [0.003, 0.7, 4.0, 9.999, 10.0, 27.3, 400.0, 5.0e4])
def test_counts_have_the_moments_of_poisson(mean):
    """Central moments about the known mean: mu, mu and mu; their own variances follow from mu_4 and mu_6."""
    off = even(COUNTING, mean, SHAPE, shot()).ravel() - mean
    fourth, sixth = mean + 3 * mean**2, mean + 25 * mean**2 + 15 * mean**3
    for power, expected, variance in ((1, 0.0, mean), (2, mean, fourth - mean**2), (3, mean, sixth - mean**2)):
        assert abs(np.mean(off**power) - expected) < SIGMAS * np.sqrt(variance / off.size), power


@pytest.mark.parametrize("mean", few([9.9, 10.1], 0.7, 60.0))
def test_counts_are_as_frequent_as_poisson_says(mean):
    counts = np.bincount(even(COUNTING, mean, MANY, shot()).astype(int).ravel())
    expected = stats.poisson.pmf(np.arange(len(counts)), mean) * counts.sum()
    often = expected > 5
    rest = counts.sum() - counts[often].sum(), counts.sum() - expected[often].sum()
    found = stats.chisquare([*counts[often], rest[0]], [*expected[often], rest[1]])
    assert found.pvalue > ONCE_IN_A_MILLION


def test_neighbouring_counts_are_independent():
    image = even(COUNTING, 300.0, SHAPE, shot())
    for one, other in ((image[:, 1:], image[:, :-1]), (image[1:], image[:-1]), (image[1:, 1:], image[:-1, :-1])):
        assert abs(np.corrcoef(one.ravel(), other.ravel())[0, 1]) < SIGMAS / np.sqrt(one.size)


def test_normal_numbers_are_normal():
    maps = fixed_pattern(having(IDEAL, dsnu_e=1.0, prnu=0.01).spread, "Camera", (0, 0), SHAPE)
    both = maps.dark_e.ravel(), (maps.response.ravel() - 1) / 0.01
    for numbers in both:
        assert stats.kstest(numbers, "norm").pvalue > ONCE_IN_A_MILLION
        assert abs(np.mean(numbers**4) - 3) < SIGMAS * np.sqrt(96 / numbers.size)
    assert abs(np.corrcoef(*both)[0, 1]) < SIGMAS / np.sqrt(both[0].size)
