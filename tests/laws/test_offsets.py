"""A sensor that is shifted carries its microlens array along, and the optical axis moves across both."""

import dataclasses

import numpy as np
import pytest
from laws import rigs

from pipeline.camera.micro_images import micro_images
from pipeline.camera.report import report
from pipeline.camera.tracer import Tracer


def test_the_microlens_on_the_axis_has_its_micro_image_on_the_axis():
    """Chosen so that the axis meets the vertex of lens (1, 0): by symmetry its centre lies exactly there."""
    camera = rigs.plenoptic(extent_mm=3.0)
    pitch = camera.microlenses.pitch_mm
    shifted = dataclasses.replace(camera, sensor=dataclasses.replace(camera.sensor, offset_x_mm=pitch))
    tracer = Tracer(shifted)
    row = int(np.flatnonzero((tracer.lattice.k == 1) & (tracer.lattice.l == 0))[0])
    centre = tracer.pixels_at(micro_images(tracer).centre_mm)[row]
    assert centre == pytest.approx(report(shifted)["optical_axis_px"], abs=1e-9)
    assert centre[0] == pytest.approx((shifted.sensor.width_px - 1) / 2 + pitch / shifted.sensor.pitch_mm, abs=1e-9)


def test_a_shift_moves_what_a_pixel_sees_by_the_shifted_field():
    """A pixel of a conventional camera sees what the pixel at the same place across the axis saw before the shift."""
    camera = rigs.conventional()
    sensor = camera.sensor
    shifted = dataclasses.replace(camera, sensor=dataclasses.replace(sensor, offset_x_mm=3 * sensor.pitch_mm))
    assert np.allclose(
        Tracer(shifted).positions_mm(np.array([13.0]), np.array([7.0])),
        Tracer(camera).positions_mm(np.array([10.0]), np.array([7.0])),
        rtol=0,
        atol=1e-12,
    )
