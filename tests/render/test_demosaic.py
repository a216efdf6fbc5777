"""Claim: colours between the pixels of a mosaic are those of a smooth scene, and do not depend on bands of rows."""

import numpy as np
import pytest

from pipeline.render.sensor.colours import has_colours, in_colour
from pipeline.render.sensor.response import SensorResponse

BAYER = ("red", "green", "green", "blue")
EFFICIENCY = {"red": 0.4, "green": 0.6, "blue": 0.3}


def response(filters: tuple[str, ...]) -> SensorResponse:
    channels = tuple(dict.fromkeys(filters))
    return SensorResponse(
        quantum_efficiency=tuple(EFFICIENCY.get(name, 0.5) for name in channels),
        full_well_e=10000.0,
        gain_dn_per_e=0.4,
        bit_depth=12,
        black_level_dn=64.0,
        filters=filters,
    )


def mosaic(one: SensorResponse, colours: np.ndarray) -> np.ndarray:
    """Digital numbers of a scene, (h, w, 3) with 1 the white level of the best channel."""
    height, width, _ = colours.shape
    period = one.period_px
    result = np.empty((height, width))
    for y in range(height):
        for x in range(width):
            name = one.filters[y % period * period + x % period]
            share = EFFICIENCY[name] / max(EFFICIENCY.values())
            result[y, x] = 64 + (one.white_dn - 64) * share * colours[y, x, list(EFFICIENCY).index(name)]
    return result


@pytest.mark.parametrize("filters", [BAYER, ("green", "blue", "red", "green"), ("red", "green", "blue") * 3])
def test_a_ramp_of_each_colour_comes_back(filters: tuple[str, ...]) -> None:
    one = response(filters)
    y, x = np.mgrid[0:20, 0:24] / 50
    scene = np.stack([0.1 + x, 0.2 + y, 0.6 - x / 2 - y / 2], axis=-1)
    found = in_colour(mosaic(one, scene), one)
    inner = slice(one.period_px, -one.period_px)
    np.testing.assert_allclose(found[inner, inner], scene[inner, inner], rtol=0, atol=1e-12)


def test_bands_of_rows_are_those_of_the_whole() -> None:
    one = response(BAYER)
    numbers = np.random.default_rng(1).integers(64, 4000, (15, 12)).astype(float)
    whole = in_colour(numbers, one)
    band = in_colour(numbers[3:13], one, first_row=3)
    np.testing.assert_allclose(band[2:-2], whole[5:11], rtol=0, atol=1e-12)


def test_only_red_green_and_blue_make_a_picture() -> None:
    assert has_colours(response(BAYER))
    assert not has_colours(response(("mono",)))
