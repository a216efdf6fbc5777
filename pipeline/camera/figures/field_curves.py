"""Relative illumination and distortion over the field of the main lens alone, by real rays."""

import dataclasses
import math
from dataclasses import dataclass

import numpy as np

from pipeline.camera.parts.camera import Camera, Sensor
from pipeline.camera.parts.errors import CameraError
from pipeline.camera.pupil.chief_ray import chief_rays, chief_slopes
from pipeline.camera.pupil.outlines import lit_share
from pipeline.camera.tracer import Tracer, parallel_planes
from pipeline.camera.tracing.moments import WEIGHT
from pipeline.camera.tracing.sampling_bounds import NO_MICROLENS
from pipeline.optics.first_order import first_order
from pipeline.optics.kernels import trace
from pipeline.optics.table import unbounded
from pipeline.records.plain import Json
from pipeline.records.shapes import Float64

_SAMPLES = 1 << 14
"""Random rays per height: right to about 1e-4 of their integral, finer than a curve shows."""
_POSITIONS = 25
"""Positions from the axis to the end of a field of view: if the last has no chief ray, the error is one interval,
1/24."""
_NEWTON_STEPS = 6
"""Newton steps to the image of the axis: chief rays are nearly linear over it, so each step gains several digits."""
_DIFFERENCE_MM = 1e-3
"""Step of finite differences [mm]: roundings of 1e-13 mm leave ten digits, and chief rays are linear over it."""


@dataclass(frozen=True, slots=True)
class FieldCurves:
    """Rows from the axis to the farthest corner of the sensor, or to where light ends before it."""

    height_mm: Float64[np.ndarray, "n"]  # distance of the sensor position from the image of the axis
    angle_deg: Float64[np.ndarray, "n"]  # angle of the real chief ray with the axis, in the scene
    relative_illumination: Float64[np.ndarray, "n"]  # weight of the bundle over that at height 0
    # Real over paraxial image height of the point where the chief ray meets the object plane, minus 1. The paraxial
    # height is the principal distance times the point's slope from the entrance pupil. 0 on the axis; NaN from 90
    # degrees on, where chief rays meet no plane.
    distortion: Float64[np.ndarray, "n"]
    object_mm: float  # vision z of that plane; inf: the chief ray's direction decides
    # Shift of the image of the axis: where the chief ray from the axis of that plane meets the sensor, less where it
    # does in the centred lens, x and y in the image; None for a centred lens
    boresight_px: tuple[float, float] | None = None
    corner_mm: float = 0.0  # distance of that corner from the image of the axis: beyond the last row the image is dark

    @property
    def is_dark_in_the_corner(self) -> bool:
        """Whether the image circle ends before the corner."""
        return bool(self.corner_mm > self.height_mm[-1])

    def to_plain(self) -> Json:
        """The rows as lists."""
        names = ("height_mm", "angle_deg", "relative_illumination", "distortion")
        head = {"object_mm": self.object_mm, "corner_mm": self.corner_mm}
        return {**head, **{name: getattr(self, name).tolist() for name in names}}


def field_curves(camera: Camera, object_mm: float, rows: int = 11) -> FieldCurves:
    """Trace `rows` field positions with an object plane at vision z.

    From the image of the axis towards the farthest corner of the sensor, as far as light arrives; in a centred lens
    along x, because all directions are equivalent.
    """
    sensor = dataclasses.replace(camera.sensor, tilt_deg=(0.0, 0.0))  # the curves are those of the lens
    tracer = Tracer(dataclasses.replace(camera, sensor=sensor, microlenses=None))
    # Lay out positions on the line from the image of the axis to the corner, as far as light reaches.
    is_centred = camera.prescription.is_centred
    corner = sensor.farthest_corner_mm
    end = np.array([math.hypot(*corner), 0.0]) if is_centred else corner
    start = np.zeros(2) if is_centred else _image_of_the_axis(tracer, object_mm)
    reach = lit_share(tracer.table, tracer.stop_row, *tracer.on_film(np.stack([start, end])))
    positions = start + np.linspace(0.0, reach, rows)[:, None] * (end - start)
    heights = np.hypot(*(positions - start).T)
    if not is_centred or reach < 1:
        # Bounds of rays are found for all of a sensor: one about the axis that reaches as far and no farther.
        width, height = (2 * math.ceil(extent / sensor.pitch_mm + 1) for extent in np.abs(positions).max(axis=0))
        covering = Sensor(width_px=width, height_px=height, pitch_mm=sensor.pitch_mm)
        tracer = Tracer(dataclasses.replace(tracer.camera, sensor=covering))
    # Distortion, from chief rays.
    direction, crossing = _to_object(tracer, positions, object_mm)
    angle = np.arctan2(np.hypot(*direction[:, :2].T), direction[:, 2])
    lens = first_order(camera.prescription)
    principal_mm = lens.principal_distance_mm(camera.sensor_distance_mm)
    from_pupil_mm = object_mm - lens.entrance_pupil.z_mm
    tangent = np.hypot(*crossing.T) if math.isinf(object_mm) else np.hypot(*crossing.T) / from_pupil_mm
    ratio = np.divide(heights, principal_mm * tangent, out=np.ones_like(heights), where=heights > 0)
    ratio[angle >= math.pi / 2] = np.nan
    # Illumination, from complete bundles.
    weight = tracer.moments(
        positions, np.full(rows, NO_MICROLENS), parallel_planes(1.0, 2.0), _SAMPLES, np.zeros((rows, 2), np.int64)
    )[:, WEIGHT]
    x, y = -start / sensor.pitch_mm + 0.0
    boresight = None if is_centred else (float(x), float(y))
    if not weight[0] > 0:
        raise CameraError("no light passes the lens from the middle of the image", hint="is the stop too small?")
    illumination = weight / weight[0]
    corner_mm = float(np.hypot(*(end - start)))
    return FieldCurves(heights, np.degrees(angle), illumination, ratio - 1, object_mm, boresight, corner_mm)


def field_of_view_deg(camera: Camera) -> list[float]:
    """Field angles of the main lens over the image's middle row, its middle column and its diagonal. [deg]

    Each is the sum of the angles from the chief ray nearest to the axis to those at both ends, or at the last positions
    before them with light and a chief ray: more than 180 degrees for a fisheye.
    """
    tracer = Tracer(dataclasses.replace(camera, microlenses=None))
    sensor = camera.sensor
    middle = np.array([sensor.offset_x_mm, sensor.offset_y_mm])
    half = np.array(sensor.size_mm) / 2
    angles = []
    for half_line in (half * [1.0, 0.0], half * [0.0, 1.0], half):
        # The foot of the axis on the line, or the end of the line nearest to it.
        foot = middle - np.clip(middle @ half_line / (half_line @ half_line), -1, 1) * half_line
        angle = 0.0
        for end in (middle - half_line, middle + half_line):
            # Add the angle between the chief rays of the foot and of the last position that has light and a chief ray.
            reach = lit_share(tracer.table, tracer.stop_row, *tracer.on_film(np.stack([foot, end])))
            positions = foot + reach * np.linspace(0, 1, _POSITIONS)[:, None] * (end - foot)
            directions = chief_directions(tracer, positions)
            directions = directions[np.isfinite(directions[:, 0])]
            if len(directions):
                sine = np.linalg.norm(np.cross(directions[0], directions[-1]))
                angle += math.atan2(sine, directions[0] @ directions[-1])
        angles.append(math.degrees(angle))
    return angles


def chief_directions(tracer: Tracer, positions_mm: Float64[np.ndarray, "n 2"]) -> np.ndarray:
    """Directions in the scene of the chief rays of film positions, apertures ignored, (n, 3); NaN: none."""
    rays = chief_rays(tracer.table, tracer.stop_row, tracer.on_film(positions_mm))
    return np.where(rays.passes[:, None], rays.direction, np.nan)


def _image_of_the_axis(tracer: Tracer, object_mm: float) -> np.ndarray:
    """Sensor position of the chief ray from the axis of the object plane, vision frame (2,), by Newton's method."""
    position = np.zeros(2)
    for _ in range(_NEWTON_STEPS):
        probes = position + _DIFFERENCE_MM * np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])
        from_axis = _to_object(tracer, probes, object_mm)[1]
        jacobian = (from_axis[1:] - from_axis[0]).T / _DIFFERENCE_MM
        position = position - np.linalg.solve(jacobian, from_axis[0])
    return position


def _to_object(tracer: Tracer, positions: np.ndarray, object_mm: float) -> tuple[np.ndarray, np.ndarray]:
    """Directions of chief rays in the scene, (n, 3), and intersections with the object plane, at infinity slopes."""
    table = unbounded(tracer.table)
    start = tracer.on_film(positions)
    slopes = chief_slopes(table, tracer.stop_row, start)
    towards = np.column_stack([slopes, np.ones(len(slopes))])
    position, direction, leaves = trace(table, start, towards / np.linalg.norm(towards, axis=1, keepdims=True))
    direction[~leaves] = np.nan
    slope = direction[:, :2] / direction[:, 2:]
    if math.isinf(object_mm):
        return direction, slope
    return direction, position[:, :2] + slope * (object_mm - position[:, 2:])
