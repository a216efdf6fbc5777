"""Solid parts of the 3-D view: surfaces of a lens and real rays through them, vision frame [mm]."""

import math
from dataclasses import dataclass

import numpy as np

from pipeline.camera.focusing.depth_of_field import middle_focus
from pipeline.camera.parts.camera import Camera
from pipeline.camera.pupil.from_stop import WIDE_RAD
from pipeline.camera.pupil.outlines import lit_share
from pipeline.camera.tracer import Tracer
from pipeline.optics.kernels import trace_path
from pipeline.optics.prescription import Prescription
from pipeline.optics.rays import Traced, directions_to
from pipeline.optics.table import SEMI_DIAMETER_SQUARED, placed, towards_scene
from pipeline.records.shapes import Float64

_PROFILE = 13
"""Points of a profile from the axis to the rim: a smooth curve in a picture."""
_ACROSS = 5
"""Rays tried along each side of the rear surface; a fan holds those that pass."""
_FINE = 81
"""Rays tried instead if none of them passes, as at the edge of a fisheye's field."""
_RIM = 0.95
"""Share of the image circle whose rays represent a dark corner: at the rim itself hardly any pass."""
_TURN = np.diag([1.0, -1.0, -1.0, 1.0])
"""Vision frame from the frame of the stop with z towards the sensor: a half turn about x; it is its own inverse."""


Matrix = tuple[tuple[float, ...], ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class SurfaceShape:
    """A surface of the lens for the 3-D view, vision frame.

    `height_mm`, `z_mm`: its profile from the axis to the rim.
    `has_glass_behind`: whether glass follows towards the sensor.
    `moved`: transform of a displaced surface, else the identity.
    """

    height_mm: tuple[float, ...]
    z_mm: tuple[float, ...]
    has_glass_behind: bool
    is_stop: bool
    moved: Matrix


@dataclass(frozen=True, slots=True, kw_only=True)
class RayFan:
    """Real rays of one sensor position, each a polyline from the sensor into the scene, vision frame [mm]."""

    place: str
    rays: tuple[tuple[tuple[float, float, float], ...], ...]


def surface_shapes(prescription: Prescription) -> tuple[SurfaceShape, ...]:
    """All surfaces from the scene to the sensor."""
    shapes = []
    for surface, vertex, motion in placed(prescription):
        heights = np.linspace(0.0, surface.semi_diameter_mm, _PROFILE).tolist()
        moved = np.eye(4) if motion is None else _TURN @ motion @ _TURN
        shapes.append(
            SurfaceShape(
                height_mm=tuple(heights),
                z_mm=tuple(-(vertex + float(surface.sag_mm(height))) for height in heights),
                has_glass_behind=surface.is_before_glass,
                is_stop=surface.is_stop,
                moved=matrix(moved),
            )
        )
    return tuple(shapes)


def matrix(transform: Float64[np.ndarray, "r c"]) -> Matrix:
    """Rows of a transform."""
    return tuple(tuple(row) for row in transform.tolist())


def sensor_corners_mm(camera: Camera) -> np.ndarray:
    """Corners of the sensor, one after the other around it, (4, 3) vision frame."""
    sensor = camera.sensor
    signs = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
    corners = signs * np.array(sensor.size_mm) / 2 + np.array([sensor.offset_x_mm, sensor.offset_y_mm])
    return camera.in_vision(np.column_stack([corners, np.full(4, -camera.sensor_distance_mm)]))


def ray_fans(camera: Camera) -> tuple[RayFan, ...]:
    """Rays of the centre and two opposite corners of the sensor through the main lens alone.

    A dark corner is replaced by a position near the rim of the image circle.
    """
    tracer = Tracer(camera)
    sensor = camera.sensor
    half_x, half_y = (size / 2 for size in sensor.size_mm)
    ends = (("centre", 0.0), ("top left", 0.96), ("bottom right", -0.96))
    # The image is upside down on the sensor: its top left lies at +x, +y of the vision frame.
    centre = np.array([sensor.offset_x_mm, sensor.offset_y_mm])
    fans = []
    for name, fraction in ends:
        corner = fraction * np.array([half_x, half_y])
        lit = lit_share(tracer.table, tracer.stop_row, *tracer.on_film(np.stack([centre, centre + corner])))
        start = np.array([[*(centre + (1.0 if lit == 1 else _RIM * lit) * corner), tracer.film_z_mm]])
        fans.append(RayFan(place=name, rays=_rays(camera, camera.in_vision(start)[0])))
    return tuple(fans)


def _rays(camera: Camera, start_mm: np.ndarray) -> tuple[tuple[tuple[float, float, float], ...], ...]:
    """Polylines of the rays from a point that pass all surfaces, to somewhat beyond the distance in focus."""
    table = towards_scene(camera.prescription)
    radius = math.sqrt(table[0, SEMI_DIAMETER_SQUARED])
    for count in (_ACROSS, _FINE):  # the finer one where no ray of the other passes
        u = np.linspace(-radius, radius, count)
        aims = np.stack(np.meshgrid(u, u), axis=-1).reshape(-1, 2)
        if _traced(table, start_mm, aims)[1].passes.any():
            break
    for _ in range(2):  # again within what passed: a narrow stop lets few rays through
        passes = _traced(table, start_mm, aims)[1].passes
        if not passes.any():
            return ()
        low, high = aims[passes].min(axis=0), aims[passes].max(axis=0)
        step = (aims[:, 0].max() - aims[:, 0].min()) / (math.isqrt(len(aims)) - 1)
        across = [np.linspace(low[i] - 0.6 * step, high[i] + 0.6 * step, _ACROSS) for i in (0, 1)]
        aims = np.stack(np.meshgrid(*across), axis=-1).reshape(-1, 2)
    points, (exit_point, direction, passes) = _traced(table, start_mm, aims)
    focus = middle_focus(camera)
    reach = 1.15 * focus if math.isfinite(focus) else 20.0 * camera.sensor_distance_mm
    ahead = direction[:, 2]
    front_mm = -camera.prescription.vertices_from_stop_mm[0]
    is_steep = ahead < math.cos(WIDE_RAD)  # it meets that plane far away or nowhere
    length = np.where(is_steep, reach - front_mm, (reach - exit_point[:, 2]) / np.where(is_steep, 1.0, ahead))
    end = exit_point + direction * length[:, None]
    paths = np.round(np.stack([*points, end], axis=1)[passes], 3)
    return tuple(tuple((p[0], p[1], p[2]) for p in path) for path in paths.tolist())


def _traced(table: np.ndarray, start_mm: np.ndarray, aim: np.ndarray) -> tuple[np.ndarray, Traced]:
    """The rays from a point towards aims on the rear vertex plane, as from `trace_path`."""
    starts = np.tile(start_mm, (len(aim), 1))
    return trace_path(table, starts, directions_to(table, starts, aim))
