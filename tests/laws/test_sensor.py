"""Laws of any sensor by the linear model of EMVA 1288, release 4.0.

Expected values are closed forms of the standard; a deviation counts in its own standard error (z).
"""

import numpy as np
import pytest
from laws.sensors import IDEAL, REAL, even, having, series, shot
from tolerances import SIGMAS

from pipeline.render.sensor.read_out import after_crosstalk, digital_numbers, fixed_pattern, mosaic
from pipeline.render.sensor.response import Irradiation, SensorError, SensorResponse

FLAT = (200, 300)
QUANTISATION = 1.0 / 12.0
"""Variance of rounding to whole numbers [DN^2], eq. (10) of the standard."""


def pair(response: SensorResponse, photons: float, time_s: float = 0.0) -> tuple[float, float, int]:
    first, second = series(response, photons, FLAT, 2, time_s)
    variance = 0.5 * np.mean((first - second) ** 2) - 0.5 * (first.mean() - second.mean()) ** 2
    return 0.5 * (first.mean() + second.mean()), variance, first.size


def test_a_crop_is_a_slice_of_the_whole():
    """With everything switched on, and a filter array of 3 x 3 pixels of three channels: bit for bit."""
    response = having(REAL, filters=tuple("abbcabacc"), quantum_efficiency=(0.6, 0.5, 0.4))
    rng = np.random.default_rng(1)
    light = {name: rng.uniform(0, 15000, (42, 62)) for name in "abc"}
    whole = digital_numbers(response, light, shot())

    for row, column, height, width in ((0, 0, 40, 60), (13, 7, 9, 11), (39, 59, 1, 1), (0, 30, 40, 1)):
        window = {name: pixels[row : row + height + 2, column : column + width + 2] for name, pixels in light.items()}
        crop = digital_numbers(response, window, shot(), (row, column))
        np.testing.assert_array_equal(crop, whole[row : row + height, column : column + width])


def test_without_noise_the_expectation_comes_out():
    photons = np.linspace(0.0, 5000.0, 4000).reshape(40, 100)
    response = having(IDEAL, quantum_efficiency=(0.5,), gain_dn_per_e=0.7, black_level_dn=10.25, bit_depth=12)
    expected = np.floor(10.25 + 0.7 * (0.5 * photons) + 0.5)
    np.testing.assert_array_equal(digital_numbers(response, {"mono": photons}, shot()), expected)


@pytest.mark.parametrize("photons", [0.0, 30.0, 1000.0, 12000.0])
def test_variance_grows_with_the_mean(photons):
    """sigma_y^2 = K^2 (sigma_d^2 + mu_e + mu_d) + 1/12, with mu_y = K (mu_e + mu_d) + black level."""
    response = having(IDEAL, quantum_efficiency=(0.6,), gain_dn_per_e=0.35, bit_depth=12, shot_noise=True)
    response = having(response, dark_noise_e=6.5, dark_current_e_per_s=50.0, black_level_dn=64.0)
    electrons = 0.6 * photons + 50.0 * 0.2

    mean, variance, pixels = pair(response, photons, time_s=0.2)

    expected = 0.35**2 * (6.5**2 + electrons) + QUANTISATION
    assert abs(mean - (64.0 + 0.35 * electrons)) < SIGMAS * np.sqrt(expected / (2 * pixels))
    # Half the mean square of a difference of two nearly normal numbers has the relative variance 2 / n.
    assert abs(variance / expected - 1) < SIGMAS * np.sqrt(2 / pixels)


def test_twice_the_time_is_twice_the_electrons():
    response = having(IDEAL, quantum_efficiency=(0.5,), shot_noise=True)
    once, twice = (Irradiation(exposure_time_s=time_s, photon_rate=4.0e5) for time_s in (0.01, 0.02))
    assert twice.photons_at_one(response) == 2 * once.photons_at_one(response) == 8000.0

    short, long = (even(response, one.photons_at_one(response), FLAT, shot()).mean() for one in (once, twice))

    assert abs(long - 2 * short) < SIGMAS * np.sqrt((4000 + 4 * 2000) / (FLAT[0] * FLAT[1]))


def test_twice_the_time_is_twice_the_dark_current_and_so_are_some_kelvin():
    response = having(IDEAL, dark_current_e_per_s=1000.0)
    at = {"dark_current_at_degc": 20.0, "doubling_k": 6.0}
    short, long = (even(response, 0.0, (1, 1), shot(exposure_time_s=time_s)) for time_s in (0.5, 1.0))
    warm = even(having(response, temperature_degc=26.0, **at), 0.0, (1, 1), shot(exposure_time_s=0.5))
    cold = even(having(response, temperature_degc=8.0, **at), 0.0, (1, 1), shot(exposure_time_s=0.5))
    assert (short, long, warm, cold) == (500, 1000, 1000, 125)


def test_a_pixel_holds_no_more_than_its_full_well():
    """With all temporal noise on: the mean at saturation is exact and its variance is that of the read-out alone."""
    response = having(
        IDEAL, full_well_e=9000.0, gain_dn_per_e=0.25, bit_depth=12, black_level_dn=100.0, shot_noise=True
    )
    full = even(response, 50000.0, FLAT, shot())
    assert np.unique(full).tolist() == [response.white_dn] == [100 + 2250]
    assert response.saturation_e == 9000.0
    full = even(having(response, full_well_e=9003.0), 50000.0, (8, 8), shot())
    assert np.unique(full).tolist() == [having(response, full_well_e=9003.0).white_dn] == [2351]  # 2350.75
    assert np.unique(even(response, 1e15, (8, 8), shot())).tolist() == [2350]
    variance = pair(having(response, dark_noise_e=8.0), 50000.0)[1]
    expected = 0.25**2 * 64 + QUANTISATION
    assert abs(variance / expected - 1) < SIGMAS * np.sqrt(2 / (FLAT[0] * FLAT[1]))


def test_a_digital_number_is_no_larger_than_its_bits():
    response = having(IDEAL, bit_depth=10, gain_dn_per_e=0.5, black_level_dn=23.0)
    assert np.unique(even(response, 60000.0, (8, 8), shot())).tolist() == [1023] == [response.white_dn]
    assert response.saturation_e == 2000.0
    assert np.unique(even(having(response, dark_noise_e=1e4), 0.0, FLAT, shot()))[[0, -1]].tolist() == [0, 1023]


def test_a_white_level_is_a_share_of_saturation():
    """0.8 of saturation where the linear image is 1, of the channel that gets most electrons."""
    response = having(IDEAL, quantum_efficiency=(0.3, 0.6), filters=("a", "b", "b", "a"), full_well_e=5000.0)
    photons = Irradiation(exposure_time_s=0.0, white_level=0.8).photons_at_one(response)
    light = dict.fromkeys("ab", np.full((2, 2), photons))
    np.testing.assert_array_equal(digital_numbers(response, light, shot()), [[2000, 4000], [4000, 2000]])


def test_the_two_ways_to_say_an_exposure_exclude_each_other():
    for values in ({}, {"white_level": 0.5, "photon_rate": 1.0}):
        with pytest.raises(SensorError):
            Irradiation(exposure_time_s=1.0, **values)


def test_nonuniformities_of_pixels_rows_and_columns_are_found_again():
    """Release 4.0 takes the spatial variance apart: of the means of rows and columns, and the rest."""
    rows, columns = 400, 500
    response = having(IDEAL, dsnu_e=3.0, dsnu_row_e=0.8, dsnu_column_e=1.5, prnu=0.01, prnu_row=0.004, prnu_column=0.02)
    maps = fixed_pattern(response.spread, "Camera", (10, 20), (rows, columns))
    for pixels, mean, expected in ((maps.dark_e, 0.0, (3.0, 0.8, 1.5)), (maps.response, 1.0, (0.01, 0.004, 0.02))):
        of_rows, of_columns = pixels.mean(axis=1), pixels.mean(axis=0)
        rest = pixels - of_rows[:, None] - of_columns + pixels.mean()
        white = rest.var() * rows * columns / ((rows - 1) * (columns - 1))
        found = white, of_rows.var(ddof=1) - white / columns, of_columns.var(ddof=1) - white / rows
        for variance, one, freedom in zip(found, expected, (rows * columns, rows, columns), strict=True):
            # The variance of means also holds that of the pixels they are means of: a few per cent at most.
            assert abs(variance / one**2 - 1) < 1.1 * SIGMAS * np.sqrt(2 / freedom)
        total = np.sqrt(expected[0] ** 2 / (rows * columns) + expected[1] ** 2 / rows + expected[2] ** 2 / columns)
        assert abs(pixels.mean() - mean) < SIGMAS * total


def test_the_fixed_pattern_is_of_the_specimen_and_of_no_frame():
    still = having(IDEAL, dsnu_e=50.0, black_level_dn=500.0)
    first = even(still, 0.0, FLAT, shot(1))
    np.testing.assert_array_equal(even(still, 0.0, FLAT, shot(2, seed=99)), first)
    others = even(having(still, specimen=1), 0.0, FLAT, shot(1)), even(still, 0.0, FLAT, shot(1, camera="Other"))
    for other in others:
        assert abs(np.corrcoef(first.ravel(), other.ravel())[0, 1]) < SIGMAS / np.sqrt(first.size)


def test_noise_of_frames_cameras_and_seeds_is_independent():
    noisy = having(IDEAL, dark_noise_e=50.0, black_level_dn=500.0)
    images = [even(noisy, 0.0, FLAT, one) for one in (shot(1), shot(2), shot(1, seed=4), shot(1, camera="Other"))]
    correlation = np.corrcoef([image.ravel() for image in images])
    assert np.abs(correlation - np.eye(4)).max() < SIGMAS / np.sqrt(images[0].size)


def test_rows_and_columns_have_noise_of_their_own():
    response = having(IDEAL, black_level_dn=500.0, row_noise_e=20.0, column_noise_e=30.0)
    image = even(response, 0.0, (600, 800), shot())
    of_rows, of_columns = image.mean(axis=1), image.mean(axis=0)
    rest = image - of_rows[:, None] - of_columns + image.mean()
    assert np.abs(rest).max() < 2.0  # three roundings of half a number, and their means
    assert abs(of_rows.var() / 400 - 1) < SIGMAS * np.sqrt(2 / 600)
    assert abs(of_columns.var() / 900 - 1) < SIGMAS * np.sqrt(2 / 800)
    assert not np.array_equal(of_rows, even(response, 0.0, (600, 800), shot(2)).mean(axis=1))


def test_defects_are_as_many_as_declared():
    count = FLAT[0] * FLAT[1]
    response = having(IDEAL, hot_share=0.01, hot_current_e_per_s=2000.0, dead_share=0.02)
    maps = fixed_pattern(response.spread, "Camera", (0, 0), FLAT)
    hot, dead = maps.hot_e_per_s > 0, maps.response == 0
    assert abs(hot.sum() - 0.01 * count) < SIGMAS * np.sqrt(0.01 * 0.99 * count)
    assert abs(dead.sum() - 0.02 * count) < SIGMAS * np.sqrt(0.02 * 0.98 * count)
    assert abs(maps.hot_e_per_s[hot].mean() / 2000 - 1) < SIGMAS / np.sqrt(hot.sum())
    both = 0.01 * 0.02 * count
    assert abs(np.sum(hot & dead) - both) < SIGMAS * np.sqrt(both)
    image = even(response, 1000.0, FLAT, shot(exposure_time_s=0.5))  # of camera "Rig.Camera"
    maps = fixed_pattern(response.spread, "Rig.Camera", (0, 0), FLAT)
    dead = maps.response == 0
    np.testing.assert_array_equal(image[dead], np.floor(0.5 * maps.hot_e_per_s[dead] + 0.5))
    assert image[~dead].min() == 1000


def test_crosstalk_spreads_a_point_as_its_kernel_and_loses_nothing():
    kernel = tuple(range(9))
    point = np.zeros((5, 5))
    point[2, 2] = 1.0
    np.testing.assert_array_equal(after_crosstalk(point, kernel), np.arange(9.0).reshape(3, 3))
    response = having(IDEAL, crosstalk=REAL.crosstalk, shot_noise=True)
    mean, variance, pixels = pair(response, 2000.0)
    assert abs(mean - 2000) < SIGMAS * np.sqrt(2000 / (2 * pixels))
    assert abs(variance / 2000 - 1) < SIGMAS * np.sqrt(2 / pixels)


def test_a_filter_array_takes_each_pixel_from_its_channel():
    response = having(IDEAL, filters=("r", "g", "g", "b"), quantum_efficiency=(0.5, 1.0, 0.25))
    light = {name: np.full((4, 4), 100.0) for name in "rgb"}
    row_0, row_1 = [50, 100, 50, 100], [100, 25, 100, 25]
    np.testing.assert_array_equal(mosaic(response, light, (0, 0)), [row_0, row_1, row_0, row_1])
    np.testing.assert_array_equal(mosaic(response, light, (-1, 0))[1:], [row_0, row_1, row_0])
    # A kernel that moves nothing needs a margin, and the filters stay where they are.
    still = having(response, crosstalk=(0, 0, 0, 0, 1, 0, 0, 0, 0))
    around = {name: np.pad(pixels, 1, "edge") for name, pixels in light.items()}
    np.testing.assert_array_equal(
        digital_numbers(still, around, shot(), (3, 2)), digital_numbers(response, light, shot(), (3, 2))
    )
    with pytest.raises(SensorError, match="channels"):
        mosaic(response, {"mono": light["r"]}, (0, 0))


def test_nonlinearity_deviates_by_its_table():
    response = having(IDEAL, full_well_e=10000.0, nonlinearity=((0.2, 0.0), (0.5, 0.03), (1.0, -0.02)))
    photons = np.array([[1000.0, 2000.0, 3400.0, 5000.0, 7600.0, 10000.0, 20000.0]])
    found = digital_numbers(response, {"mono": photons}, shot())
    expected = [1000, 2000, 3400 * 1.014, 5000 * 1.03, 7600 * 1.004, 9800, 9800]
    np.testing.assert_array_equal(found[0], np.rint(expected))
    short = having(response, nonlinearity=((0.3, 0.01), (0.5, 0.03)))
    found = digital_numbers(short, {"mono": photons}, shot())
    expected = [1010, 2020, 3400 * 1.014, 5000 * 1.03, 7600 * 1.03, 10300, 10300]
    np.testing.assert_array_equal(found[0], np.rint(expected))


@pytest.mark.parametrize(
    "values",
    [
        {"quantum_efficiency": (0.5, 0.5)},
        {"filters": ("a", "b", "c")},
        {"black_level_dn": 65535.0},
        {"nonlinearity": ((0.5, 0.0), (0.2, 0.0))},
        {"nonlinearity": ((-0.1, 0.0),)},
        {"temperature_degc": 20.0},
        {"crosstalk": (0.5, 0.5)},
        {"crosstalk": (0.25, 0.25, 0.25, 0.25)},
        {"crosstalk": (0.1,) * 9},
    ],
)
def test_a_sensor_that_cannot_be_is_refused(values):
    with pytest.raises(SensorError):
        having(IDEAL, **values)
