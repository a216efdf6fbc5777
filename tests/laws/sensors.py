"""Small sensors for the laws of `render.sensor`, and series of images of even light."""

import dataclasses
from typing import Any

import numpy as np

from pipeline.render.sensor.read_out import Shot, digital_numbers
from pipeline.render.sensor.response import SensorResponse

IDEAL = SensorResponse(
    quantum_efficiency=(1.0,), full_well_e=65535.0, gain_dn_per_e=1.0, bit_depth=16, shot_noise=False
)
"""A digital number per photon, and no noise."""

REAL = SensorResponse(
    quantum_efficiency=(0.6,),
    full_well_e=10000.0,
    gain_dn_per_e=0.35,
    bit_depth=12,
    black_level_dn=64.0,
    dark_noise_e=6.5,
    row_noise_e=0.4,
    column_noise_e=0.3,
    dark_current_e_per_s=40.0,
    dsnu_e=3.0,
    dsnu_row_e=1.0,
    dsnu_column_e=1.5,
    prnu=0.006,
    prnu_row=0.002,
    prnu_column=0.003,
    hot_share=0.002,
    hot_current_e_per_s=9000.0,
    dead_share=0.003,
    nonlinearity=((0.2, 0.0), (0.5, 0.01), (1.0, -0.02)),
    crosstalk=(0.0, 0.01, 0.0, 0.02, 0.93, 0.02, 0.0, 0.02, 0.0),
)
"""Everything on at once."""


def having(response: SensorResponse, **values: Any) -> SensorResponse:
    return dataclasses.replace(response, **values)


def shot(frame: int = 1, exposure_time_s: float = 0.1, seed: int = 3, camera: str = "Rig.Camera") -> Shot:
    return Shot(seed=seed, camera=camera, frame=frame, exposure_time_s=exposure_time_s)


def even(response: SensorResponse, photons: float, shape: tuple[int, int], taken: Shot) -> np.ndarray:
    """Raw image of even light, (h, w) float64 [DN]."""
    margin = 2 * response.margin_px
    light = np.full((shape[0] + margin, shape[1] + margin), photons)
    return digital_numbers(response, dict.fromkeys(response.channels, light), taken).astype(np.float64)


def series(response: SensorResponse, photons: float, shape: tuple[int, int], count: int, time_s: float = 0.0):
    """Raw images of `count` frames of the same even light, (count, h, w) float64 [DN]."""
    return np.array([even(response, photons, shape, shot(frame, time_s)) for frame in range(count)])
