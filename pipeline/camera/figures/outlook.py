"""Visibility of points by a few rays each, traced towards the sensor. For checks, not for positions.

Points are in the vision frame. A doubtful point counts as visible, so that a warning about a hidden board is reliable.
"""

import math
from dataclasses import dataclass
from enum import IntEnum
from typing import NamedTuple

import numpy as np

from pipeline.camera.parts.camera import Camera
from pipeline.camera.parts.microlens_array import MicrolensArray
from pipeline.camera.pupil.from_stop import depths_mm, is_steep, pupil_fan
from pipeline.camera.tracer import Tracer
from pipeline.optics.first_order import FirstOrder, first_order
from pipeline.optics.rays import front_grid, traced
from pipeline.optics.table import towards_sensor
from pipeline.records.shapes import Float64, Int64

_FLIP = np.array([1.0, -1.0, -1.0])
"""Signs of x, y and z from the vision frame to the frame in which light travels to the sensor along +z."""
_RINGS, _SPOKES = (0.5, 0.95, 1.25), 8
"""Radii of rings of rays, over that of the paraxial entrance pupil, and rays on each."""
_WIDE, _TRIED = 25, 8
"""Rays along an edge of the grid over the front surface, for strong vignetting and fisheyes, and the number of points
of a pose that get one: those nearest to the axis."""
_SLACK_PX, _BLUR_SHARE = 4.0, 0.25
"""Distance outside of the image at which the centre of a point's light still counts as inside: pixels, and share of its
blur."""


_SLACK_PITCHES = 2.0
"""Excess width of the microlenses that may see a point over the width of its light [pitches]."""


class Fate(IntEnum):
    """Fate of the light of a point; where several apply, the first."""

    AWAY = 0
    """The front of its surface faces away from the camera."""
    NO_LIGHT = 1
    """No ray passes the lens, or none reaches the microlenses."""
    BLURRED = 2
    """Its light spreads over more than the image, even on the axis at its distance; behind microlenses over more than a
    micro-image."""
    OUTSIDE = 3
    """It falls beside the image."""
    SEEN = 4


@dataclass(frozen=True, slots=True)
class Outlook:
    """Fates of points."""

    fate: Int64[np.ndarray, "poses n"]  # fate of each point, a value of `Fate`
    # Width of their light on the sensor, behind microlenses that of the sharpest type
    blur_px: Float64[np.ndarray, "poses n"]


@np.errstate(all="ignore")  # NaN counts as invisible
def outlook(camera: Camera, points_mm: Float64[np.ndarray, "n m 3"], front: Float64[np.ndarray, "k m 3"]) -> Outlook:
    """Determine the fate of points with surface normals `front`, both (poses, n, 3), vision frame."""
    lens = first_order(camera.prescription)
    shape = points_mm.shape[:2]
    points = points_mm.reshape(-1, 3)
    tracer = Tracer(camera)
    table = towards_sensor(camera.prescription)
    # Aim at the paraxial entrance pupil; from the side, or where that fails, at the pupil as seen from the point; and
    # from a few dark points all over the front surface.
    blur, lit, inside = _light(tracer, table, points, _fan(lens))
    pupil = pupil_fan(camera.prescription)
    steep = is_steep(camera.prescription, points)
    oblique = np.flatnonzero(steep | ~lit & pupil.in_field(points))
    if len(oblique):
        aims = np.array([pupil.aims(point) for point in points[oblique]]) * _FLIP
        blur[oblique], lit[oblique], inside[oblique] = _light(tracer, table, points[oblique], aims, is_towards=True)
    dark = _nearest_to_axis(points_mm, ~(lit | steep).reshape(shape))
    if len(dark):
        blur[dark], lit[dark], inside[dark] = _light(tracer, table, points[dark], front_grid(table, _WIDE))
    if array := camera.microlenses:
        blur, _ = behind_microlenses_px(camera, array, depths_mm(camera.prescription, points))
    # Choose the fates, the decisive ones last.
    fate = np.where(inside, Fate.SEEN, Fate.OUTSIDE)
    blurred = np.flatnonzero(blur >= widest_blur_px(camera))
    fate[blurred] = Fate.BLURRED
    if not camera.microlenses:  # far beside the field a lens blurs what is in focus, too
        blur_on_axis, lit_on_axis, _ = _light(tracer, table, points[blurred] * (0.0, 0.0, 1.0), _fan(lens))
        fate[blurred[lit_on_axis & (blur_on_axis < widest_blur_px(camera))]] = Fate.OUTSIDE
    fate[~lit] = Fate.NO_LIGHT
    fate[np.sum(points_mm * front, axis=-1).ravel() >= 0] = Fate.AWAY
    return Outlook(fate.reshape(shape), blur.reshape(shape))


def pupil_points_mm(camera: Camera) -> np.ndarray:
    """Points of the entrance pupil, vision frame (n, 3)."""
    return (_fan(first_order(camera.prescription)) * _FLIP)[: 1 + 2 * _SPOKES]


def covered_mm(camera: Camera, z_mm: float) -> tuple[float, float]:
    """Paraxial width and height of the image's field on the plane at vision z."""
    lens = first_order(camera.prescription)
    sensor = camera.sensor
    principal_mm = lens.principal_distance_mm(camera.sensor_distance_mm)
    scale = sensor.pitch_mm * abs((z_mm - lens.entrance_pupil.z_mm) / principal_mm)
    return sensor.width_px * scale, sensor.height_px * scale


def microlenses_lit(camera: Camera, array: MicrolensArray, z_mm: float) -> float:
    """Paraxial number of microlenses that may see a point at vision z; 0 where its light has no width."""
    lens = first_order(camera.prescription)
    sensor = camera.sensor
    try:
        image_mm = lens.image_mm(z_mm)
    except ZeroDivisionError:  # a point in the front focus
        return 0.0
    pupil = lens.exit_pupil
    # The cone from the exit pupil to the image, cut by the array.
    array_mm = array.distance_mm - camera.sensor_distance_mm
    light_mm = pupil.diameter_mm * abs((array_mm - image_mm) / (pupil.z_mm - image_mm))
    width = light_mm / array.pitch_mm + _SLACK_PITCHES
    before_sensor = sensor.width_px * sensor.height_px * (sensor.pitch_mm / array.pitch_mm) ** 2
    return min(before_sensor, math.pi / 4 * width**2) if math.isfinite(width) else 0.0


def widest_blur_px(camera: Camera) -> float:
    """Blur beyond which a point is not recognisable: the width of the image, or of a micro-image."""
    if camera.microlenses:
        return camera.microlenses.aperture_mm / camera.sensor.pitch_mm
    return float(max(camera.sensor.size_px))


def _fan(lens: FirstOrder) -> np.ndarray:
    """Points in and slightly beyond the entrance pupil, (rays, 3), in the frame of the light."""
    angle = 2 * np.pi * np.arange(_SPOKES) / _SPOKES
    radius = np.outer(_RINGS, np.full(_SPOKES, lens.entrance_pupil.diameter_mm / 2)).ravel()
    x = radius * np.tile(np.cos(angle), len(_RINGS))
    y = radius * np.tile(np.sin(angle), len(_RINGS))
    aims = np.column_stack([x, y, np.full(len(x), -lens.entrance_pupil.z_mm)])
    return np.concatenate([[[0.0, 0.0, -lens.entrance_pupil.z_mm]], aims])


def _nearest_to_axis(points_mm: np.ndarray, wanted: np.ndarray) -> np.ndarray:
    """Rows of the wanted points of each pose, at most `_TRIED`, nearest to the axis as seen from the stop."""
    slope = np.hypot(points_mm[..., 0], points_mm[..., 1]) / np.abs(points_mm[..., 2])
    order = np.argsort(np.where(wanted, slope, np.inf), axis=1)[:, :_TRIED]
    rows = order + points_mm.shape[1] * np.arange(len(points_mm))[:, None]
    return rows[np.take_along_axis(wanted, order, axis=1)]


class _Light(NamedTuple):
    """Width of the light of points on the film [px], whether there is any, and whether it is in the image."""

    blur: np.ndarray
    lit: np.ndarray
    inside: np.ndarray


def _light(
    tracer: Tracer, table: np.ndarray, points_mm: np.ndarray, aims: np.ndarray, *, is_towards: bool = False
) -> _Light:
    """The light of points through aims in front of the lens, shared (m, 3) or of each point (n, m, 3).

    `is_towards`: rays lead from the points towards their aims; else along +z, whichever of both lies ahead.
    """
    # Trace the rays to the film. They start at their aims, which are exact however far the point is.
    aims = np.broadcast_to(aims, (len(points_mm), *aims.shape[-2:]))
    start = aims.reshape(-1, 3).copy()
    direction = start - np.repeat(points_mm * _FLIP, aims.shape[1], axis=0)
    sign = 1.0 if is_towards else np.sign(direction[:, 2:])
    direction *= sign / np.linalg.norm(direction, axis=1, keepdims=True)
    exit_point, direction, passes = traced(table, start, direction)
    film, slope = tracer.arrivals(exit_point * _FLIP, direction * _FLIP)
    array = tracer.camera.microlenses
    shape = aims.shape[:2]
    if array:
        low = tracer.vertices_mm.min(axis=0) - array.pitch_mm
        high = tracer.vertices_mm.max(axis=0) + array.pitch_mm
        passes &= ((film >= low) & (film <= high)).all(axis=1)
        film = film - array.distance_mm * slope  # through a microlens's vertex light goes straight on
    # Measure the extent of each point's light.
    x = tracer.pixels_at(film).reshape(*shape, 2)
    has_ray = passes.reshape(*shape, 1)
    lit: np.ndarray = has_ray.any(axis=(1, 2))  # type: ignore[assignment]
    low = np.where(has_ray, x, np.inf).min(axis=1)
    high = np.where(has_ray, x, -np.inf).max(axis=1)
    blur = np.where(lit, (high - low).max(axis=1), 0.0)
    if array:
        return _Light(blur, lit, (_is_in_image(tracer.camera, x, _SLACK_PX) & has_ray[..., 0]).any(axis=1))
    middle = np.where(has_ray, x, 0.0).sum(axis=1) / np.maximum(1, has_ray.sum(axis=1))
    return _Light(blur, lit, _is_in_image(tracer.camera, middle, (_SLACK_PX + _BLUR_SHARE * blur)[:, None]))


def _is_in_image(camera: Camera, x_px: np.ndarray, slack_px: np.ndarray | float) -> np.ndarray:
    """Whether positions (..., 2) lie in the image, or at most so far outside."""
    beyond_px = np.maximum(-0.5 - x_px, x_px - np.array(camera.sensor.size_px) + 0.5)
    return np.asarray((beyond_px < slack_px).all(axis=-1))


def behind_microlenses_px(
    camera: Camera, array: MicrolensArray, z_mm: Float64[np.ndarray, "n"]
) -> tuple[np.ndarray, np.ndarray]:
    """Blur disc D |1 - B / f - B / a| of objects at vision z [px], and the size of 1 mm in a micro-image [px].

    Both are those of the sharpest type; see `focusing.depth_of_field`.
    """
    lens = first_order(camera.prescription)
    pitch_mm = camera.sensor.pitch_mm
    behind_mm, ahead_mm = np.array(array.principal_mm).T[:, :, None]
    from_focus = z_mm - lens.front_focus_mm
    # a (z - F) for an image at distance a behind the array: finite even where that image lies at infinity.
    image_mm2 = from_focus * (ahead_mm - camera.sensor_distance_mm - lens.rear_focus_mm) + lens.newton_mm2
    relative = np.abs(1 - behind_mm / np.array(array.focal_lengths_mm)[:, None] - behind_mm * from_focus / image_mm2)
    sharpest = relative.argmin(axis=0), np.arange(len(z_mm))
    magnification = np.abs(lens.index_in_front * lens.efl_mm * behind_mm / image_mm2)
    return relative[sharpest] * array.aperture_mm / pitch_mm, magnification[sharpest] / pitch_mm
