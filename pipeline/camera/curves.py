"""What real rays do over the field of the main lens alone: relative illumination and distortion."""

import dataclasses
import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from pipeline.camera.camera import Camera
from pipeline.camera.chief import chief_heights
from pipeline.camera.moments import WEIGHT
from pipeline.camera.regions import NO_MICROLENS
from pipeline.camera.tracer import Tracer, parallel_planes
from pipeline.optics.first_order import first_order
from pipeline.optics.kernels import trace_rays

_SAMPLES = 1 << 14


@dataclass(frozen=True, slots=True)
class FieldCurves:
    """Rows from the axis to the farthest corner of the sensor.

    Attributes
    ----------
    height_mm : (n,) float64
        Distance of the sensor position from the optical axis.
    angle_deg : (n,) float64
        Angle of the real chief ray with the axis, in the scene.
    relative_illumination : (n,) float64
        Weight of the bundle over the weight of the bundle on the axis.
    distortion : (n,) float64
        Real over paraxial image height of the point where the chief ray meets the object plane, minus 1. The paraxial
        height is the principal distance times the point's slope from the entrance pupil. 0 on the axis.
    object_mm : float
        Vision z of that plane; inf: the chief ray's direction decides.
    """

    height_mm: np.ndarray
    angle_deg: np.ndarray
    relative_illumination: np.ndarray
    distortion: np.ndarray
    object_mm: float

    def to_plain(self) -> dict[str, Any]:
        """The rows as lists."""
        names = ("height_mm", "angle_deg", "relative_illumination", "distortion")
        return {"object_mm": self.object_mm, **{name: getattr(self, name).tolist() for name in names}}


def field_curves(camera: Camera, object_mm: float, rows: int = 11) -> FieldCurves:
    """Trace `rows` field positions with an object plane at vision z."""
    alone = dataclasses.replace(camera, microlenses=None)
    tracer, sensor = Tracer(alone), camera.sensor
    corner = math.hypot(
        sensor.width_px * sensor.pitch_mm / 2 + abs(sensor.offset_x_mm),
        sensor.height_px * sensor.pitch_mm / 2 + abs(sensor.offset_y_mm),
    )
    heights = np.linspace(0.0, corner, rows)
    slope, crossing = _chief_slopes(tracer, heights, object_mm)
    lens = first_order(camera.prescription)
    principal_mm = (lens.exit_pupil.z_mm + camera.sensor_distance_mm) / lens.pupil_magnification
    ahead = object_mm - lens.entrance_pupil.z_mm
    tangent = slope if math.isinf(object_mm) else crossing / ahead
    ideal = principal_mm * np.abs(tangent)
    ratio = np.divide(heights, ideal, out=np.ones_like(heights), where=heights > 0)
    positions = np.stack([heights, np.zeros(rows)], axis=1)
    weight = tracer.moments(
        positions, np.full(rows, NO_MICROLENS), parallel_planes(1.0, 2.0), _SAMPLES, np.zeros((rows, 2), np.int64)
    )[:, WEIGHT]
    return FieldCurves(heights, np.degrees(np.arctan(np.abs(slope))), weight / weight[0], ratio - 1, object_mm)


def _chief_slopes(tracer: Tracer, heights: np.ndarray, object_mm: float) -> tuple[np.ndarray, np.ndarray]:
    """Slope of each chief ray in the scene, and its height at vision z `object_mm`; edges do not block it."""
    table = tracer.table.copy()
    table[:, 3] = np.inf
    aim = chief_heights(table, tracer.stop_row, tracer.film_z_mm, heights)
    zero = np.zeros_like(heights)
    position = np.stack([heights, zero, np.full_like(heights, tracer.film_z_mm)], axis=1)
    direction = np.stack([aim - heights, zero, np.full_like(heights, table[0, 0] - tracer.film_z_mm)], axis=1)
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    alive = np.ones(heights.size)
    trace_rays(table, position, direction, alive)
    slope = direction[:, 0] / direction[:, 2]
    slope[alive == 0] = np.nan
    if math.isinf(object_mm):
        return slope, slope
    return slope, position[:, 0] + slope * (object_mm - position[:, 2])
