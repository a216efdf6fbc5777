"""Claim: optiland, a lens-design program, computes the same contrast and Strehl ratio from the same prescription.

It is installed by `pip install optiland`; without it there is nothing to compare with.
"""

import json
import warnings
from pathlib import Path

import numpy as np
import pytest
from laws import rigs
from published.library import optic_of
from tolerances import OPTILAND_CONTRAST, OPTILAND_STREHL

from pipeline.camera.parts.camera import Camera, Sensor
from pipeline.camera.tracer import Tracer
from pipeline.camera.tracing.sampling_bounds import NO_MICROLENS
from pipeline.camera.wave.spread import strehl_ratio, transfer
from pipeline.camera.wave.wavefront import View, wavefront
from pipeline.optics.first_order import first_order

WAVELENGTH_NM, FIELD_DEG = 550.0, 3.0
PER_MM = np.array([50.0, 100.0, 200.0])
KEPT = json.loads((Path(__file__).parent / "optiland_contrast.json").read_text(encoding="utf-8"))["lenses"]


@pytest.mark.heavy
@pytest.mark.parametrize("field", [0.0, 1.0])
@pytest.mark.parametrize("stop_semi_mm", [4.5, 9.0])
def test_optiland_finds_the_same_image_of_a_point(stop_semi_mm: float, field: float) -> None:
    pytest.importorskip("optiland")
    from optiland.mtf import FFTMTF
    from optiland.psf import FFTPSF

    prescription, sensor = rigs.tronnier(stop_semi_mm), Sensor(width_px=64, height_px=64, pitch_mm=0.3)
    lens = first_order(prescription)
    camera = Camera(prescription=prescription, sensor=sensor, sensor_distance_mm=-lens.rear_focus_mm)
    height = lens.efl_mm * np.tan(np.deg2rad(FIELD_DEG * field))
    front = wavefront(Tracer(camera), View(np.array([0.0, height]), NO_MICROLENS, np.inf), WAVELENGTH_NM)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        theirs = optic_of(prescription, lens.bfd_mm, (0.0, FIELD_DEG), WAVELENGTH_NM)
        at = (0.0, field), WAVELENGTH_NM / 1e3
        strehl = FFTPSF(theirs, *at, num_rays=256, grid_size=1024).strehl_ratio()
        curves = FFTMTF(theirs, [at[0]], at[1], num_rays=256, grid_size=1024)
    assert strehl_ratio(front) == pytest.approx(strehl, abs=OPTILAND_STREHL)
    kept = next(row for row in KEPT if row["stop_semi_mm"] == stop_semi_mm and row["field_deg"] == FIELD_DEG * field)
    names = ("tangential", "sagittal")
    for name, along, curve in zip(names, ((0.0, 1.0), (1.0, 0.0)), curves.mtf[0], strict=True):
        expected = np.interp(PER_MM, np.asarray(curves.freq_tang).ravel(), curve)
        np.testing.assert_allclose(kept[name], expected, rtol=0, atol=1e-4, err_msg="optiland_contrast.json")
        np.testing.assert_allclose(
            np.abs(transfer(front, PER_MM, np.array(along))), expected, rtol=0, atol=OPTILAND_CONTRAST
        )
