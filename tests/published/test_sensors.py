"""Sensors of the library have the figures that their makers print, by the formulas of EMVA 1288, release 4.0."""

import math

import numpy as np
import pytest
from pxr import Usd
from scipy import stats

from pipeline.folders import shipped_folder
from pipeline.render.sensor.response import SensorResponse
from pipeline.scene.sensor import read_response

PRINTED = [("imx250", 40.3, 71.2), ("imx535", 39.7, 69.8)]
"""SNRmax and dynamic range [dB], from the pages that the stages name."""
HALF_A_UNIT_DB = 0.05
"""Both are printed to one decimal."""


def saturation_capacity(response: SensorResponse) -> float:
    """Mean number of electrons with the largest variance: of Poisson numbers cut off at the full well."""
    means = np.arange(response.full_well_e - 6 * math.sqrt(response.full_well_e), response.full_well_e, 5.0)
    return float(means[int(np.argmax([_variance(response.full_well_e, mean) for mean in means]))])


def _variance(full_well_e: float, mean: float) -> float:
    counts = np.arange(max(0, mean - 12 * math.sqrt(mean)) // 1, full_well_e + 1)
    shares = stats.poisson.pmf(counts, mean)
    shares[-1] += stats.poisson.sf(full_well_e, mean)
    return float(np.sum(shares * counts**2) - np.sum(shares * counts) ** 2)


@pytest.mark.parametrize(("name", "snr_db", "range_db"), PRINTED)
def test_a_sensor_of_the_library_has_the_printed_figures(name, snr_db, range_db):
    stage = Usd.Stage.Open(str(shipped_folder("stages") / "sensors" / f"{name}.usda"))
    response = read_response(stage.GetDefaultPrim())
    electrons = saturation_capacity(response)
    dark = math.sqrt(response.dark_noise_e**2 + 1 / 12 / response.gain_dn_per_e**2)
    assert abs(10 * math.log10(electrons) - snr_db) < HALF_A_UNIT_DB
    assert abs(20 * math.log10(electrons / (dark + 0.5)) - range_db) < HALF_A_UNIT_DB
    # The gain is chosen so that a full well gives the largest number.
    assert response.white_dn <= response.most_dn < response.white_dn + 3
