"""Microlenses without a main lens, and acceptances as kernels read them."""

import math

from laws import rigs

from pipeline.camera.parts.camera import Camera, Sensor
from pipeline.camera.parts.microlens_array import MicrolensArray
from pipeline.camera.tracer import Tracer
from pipeline.camera.tracing.records import Acceptance


def acceptance_of(power: float = 0.0, half_deg: float = 0.0, roll_deg: float = 0.0) -> Acceptance:
    """An acceptance for the kernels."""
    return Acceptance(float(power), math.radians(half_deg), math.radians(roll_deg), False)


def behind_a_hole(array: MicrolensArray, size_px: int = 60, pitch_mm: float = 0.02, **pixels: object) -> Tracer:
    """Microlenses, and no main lens."""
    sensor = Sensor(width_px=size_px, height_px=size_px, pitch_mm=pitch_mm, **pixels)
    return Tracer(
        Camera(
            prescription=rigs.hole(500.0),
            sensor=sensor,
            sensor_distance_mm=20.0,
            microlenses=array,
            near_mm=100.0,
            far_mm=200.0,
        )
    )
