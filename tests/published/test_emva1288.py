"""The standard's own analysis program recovers the parameters of our sensor from series of our raw images.

`benchmarks/sensor.py` makes the series and asks `emva1288`, the reference implementation of EMVA 1288, release 4.0.
Each parameter has to come back within the standard error that a series of so many pixels has, by the closed forms of
the estimators.
"""

import sys
from pathlib import Path

import numpy as np
import pytest
from scipy import stats
from tolerances import SIGMAS

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "benchmarks"))
try:
    from sensor import HALF_S, PIXELS, RATE, REPORTED, SHAPE, STACKED, TIMES_S, referee
finally:
    del sys.path[0]


@pytest.fixture(scope="module")
def found(tmp_path_factory):
    return referee(tmp_path_factory.mktemp("series"))


def bright(times_s: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Mean signal above the dark one [DN], and temporal variances in light and in the dark [DN^2], by the standard."""
    gain, current = REPORTED.gain_dn_per_e, REPORTED.dark_current_e_per_s
    electrons, dark = REPORTED.quantum_efficiency[0] * RATE * times_s, current * times_s
    noise = gain**2 * (REPORTED.dark_noise_e**2 + dark) + 1 / 12
    return gain * electrons, noise + gain**2 * electrons, noise


def error_of_gain(used: slice) -> float:
    """Standard error of the gain [DN/e-], the slope of variance over mean through the origin.

    A variance of N differences has the variance 2 sigma^4 / N, and a slope is sum(x y) / sum(x^2).
    """
    signal, light, dark = (values[used] for values in bright(TIMES_S))
    return float(np.sqrt(np.sum(signal**2 * 2 * (light**2 + dark**2) / PIXELS)) / np.sum(signal**2))


@pytest.mark.heavy
def test_the_referee_recovers_gain_and_quantum_efficiency(found):
    """Slopes through the origin, of variance over mean and of mean over photons, up to 70 % of saturation."""
    used = slice(found.index_sensitivity_min, found.index_sensitivity_max + 1)
    of_gain, photons = error_of_gain(used), RATE * TIMES_S[used]
    _, light, dark = (values[used] for values in bright(TIMES_S))
    assert abs(found.K - REPORTED.gain_dn_per_e) < SIGMAS * of_gain
    of_slope = np.sqrt(np.sum(photons**2 * (light + dark) / (2 * PIXELS))) / np.sum(photons**2)
    pattern = REPORTED.prnu**2 / PIXELS + REPORTED.prnu_row**2 / SHAPE[0] + REPORTED.prnu_column**2 / SHAPE[1]
    slope = REPORTED.gain_dn_per_e * REPORTED.quantum_efficiency[0]
    assert abs(found.R - slope) < SIGMAS * np.hypot(of_slope, slope * np.sqrt(pattern))
    relative = np.sqrt((of_gain / REPORTED.gain_dn_per_e) ** 2 + (of_slope / slope) ** 2 + pattern)
    assert abs(found.QE / 60 - 1) < SIGMAS * relative


@pytest.mark.heavy
def test_the_referee_recovers_dark_noise_and_dark_current(found):
    """Intercept and slope of the dark variance over time, and the slope of the dark mean."""
    _, _, dark = bright(TIMES_S)
    of_gain = error_of_gain(slice(found.index_sensitivity_max + 1)) / REPORTED.gain_dn_per_e
    time_s = TIMES_S - TIMES_S.mean()
    errors = dark * np.sqrt(2 / PIXELS)
    slope = np.sqrt(np.sum((time_s * errors) ** 2)) / np.sum(time_s**2)
    weights = 1 / len(TIMES_S) - TIMES_S.mean() * time_s / np.sum(time_s**2)
    intercept = np.sqrt(np.sum((weights * errors) ** 2))
    gain = REPORTED.gain_dn_per_e
    variance = gain**2 * REPORTED.dark_noise_e**2 + 1 / 12
    assert abs(found.sigma_y_dark**2 - variance) < SIGMAS * intercept
    relative = intercept / (2 * gain**2 * REPORTED.dark_noise_e**2)
    assert abs(found.sigma_d / REPORTED.dark_noise_e - 1) < SIGMAS * np.hypot(relative, of_gain)
    current = REPORTED.dark_current_e_per_s
    assert abs(found.u_I_var / current - 1) < SIGMAS * np.hypot(slope / (gain**2 * current), 2 * of_gain)
    of_mean = np.sqrt(np.sum((time_s**2) * dark / (2 * PIXELS))) / np.sum(time_s**2)
    assert abs(found.u_I_mean / current - 1) < SIGMAS * np.hypot(of_mean / (gain * current), of_gain)


@pytest.mark.heavy
def test_the_referee_sees_saturation_where_the_full_well_is(found):
    """It takes the photons of largest variance: that of a Poisson number cut off at the full well, exactly summed."""
    counts = np.arange(REPORTED.full_well_e + 1)
    variances = []
    for time_s in TIMES_S:
        mean = (REPORTED.quantum_efficiency[0] * RATE + REPORTED.dark_current_e_per_s) * time_s
        # Pixels differ by their photo response: their own variances, averaged.
        spread = mean * (1 + np.linspace(-2, 2, 41) * 0.0088)
        weight = np.exp(-(np.linspace(-2, 2, 41) ** 2) / 2)
        variances.append(np.average([_cut(counts, one) for one in spread], weights=weight))
    expected = RATE * TIMES_S[int(np.argmax(variances))] * REPORTED.quantum_efficiency[0]
    step = RATE * (TIMES_S[1] - TIMES_S[0]) * REPORTED.quantum_efficiency[0]
    assert abs(found.u_e_sat - expected) <= 1.1 * step


def _cut(counts, mean):
    """Variance of a Poisson number that counts no farther than the last of `counts`."""
    shares = stats.poisson.pmf(counts, mean)
    shares[-1] += stats.poisson.sf(counts[-1], mean)
    return np.sum(shares * counts**2) - np.sum(shares * counts) ** 2


@pytest.mark.heavy
def test_the_referee_recovers_the_nonuniformities(found):
    """In all, and of pixels, rows and columns: variances of normal numbers have the relative variance 2 / n."""
    of_gain = error_of_gain(slice(found.index_sensitivity_max + 1)) / REPORTED.gain_dn_per_e
    _, light, dark = (values[0] / REPORTED.gain_dn_per_e**2 for values in bright(np.array([HALF_S])))
    electrons = RATE * HALF_S * REPORTED.quantum_efficiency[0]
    of_dark = REPORTED.dsnu_e**2, REPORTED.dsnu_row_e**2, REPORTED.dsnu_column_e**2
    of_response = REPORTED.prnu**2, REPORTED.prnu_row**2, REPORTED.prnu_column**2
    # The mean of the stack keeps a part of the temporal noise, which counts as a difference of pixels.
    # To the differences of a PRNU the DSNU adds, too.
    cases = (
        ("DSNU", of_dark, dark / STACKED, 1.0, of_gain),
        ("PRNU", of_response, (2 * of_dark[0] + (light + dark) / STACKED) / electrons**2, 100.0, 0.0),
    )
    for what, variances, rest, scale, of_scale in cases:
        counts = (PIXELS, *SHAPE)
        white = variances[0] + rest
        errors = [
            np.sqrt(2 / n) * (white if n == PIXELS else one + white * n / PIXELS)
            for one, n in zip(variances, counts, strict=True)
        ]
        names = ("_pixel", "_row", "_col", "")
        expected, found_errors = (*variances, sum(variances)), (*errors, np.hypot.reduce(errors))
        for name, variance, error in zip(names, expected, found_errors, strict=True):
            value = getattr(found, f"{what}1288{name}") / scale
            assert abs(value**2 - variance) < SIGMAS * np.hypot(error, 2 * of_scale * variance), (what, name)
