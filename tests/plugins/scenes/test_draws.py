"""Random numbers of paths of light: points of a digital net, each taken once."""

import numpy as np
import pytest

from pipeline.camera.tracing.records import Squares
from pipeline.plugins.scenes.lighting import draws

KEY, STAGE = np.uint32(77), 5


def points(places: np.ndarray) -> np.ndarray:
    return np.array([draws.draw(draws.points(), KEY, int(place), STAGE) for place in places])


@pytest.mark.parametrize("digits", [2, 5, 8])
def test_the_first_points_hold_one_in_every_elementary_interval(digits: int) -> None:
    """A (0, m, 2)-net in base 2: halves, quarters and so on of both axes, in all shapes of the same area."""
    u, v = points(np.arange(1 << digits)).T
    for across in range(digits + 1):
        cells = (u * (1 << across)).astype(int) * (1 << (digits - across)) + (v * (1 << (digits - across))).astype(int)
        assert len(np.unique(cells)) == 1 << digits


def named(light: int, lights: int, skipped: int, count: int = 4) -> np.ndarray:
    """Places of the rays of one pixel at one wavelength, in the first pass or the second."""
    squares = Squares(*(np.array([[value]]) for value in (0, 0.0, 0, count, skipped)))
    squares = squares._replace(pixels=np.array([[3, 2]]), positions=np.zeros((1, 2)))
    key, place = np.empty(count, np.uint32), np.empty(count, np.int64)
    draws.name_rays(np.uint32(9), (light, lights), squares, np.zeros(count, np.int64), key, place)
    assert len(set(key.tolist())) == 1
    return place


def test_wavelengths_and_passes_take_every_point_once() -> None:
    first = np.concatenate([named(light, 3, 0) for light in range(3)])
    second = np.concatenate([named(light, 3, 4) for light in range(3)])
    assert sorted(first.tolist()) == list(range(12))
    assert sorted(second.tolist()) == list(range(12, 24))
