"""Focus, depth of field, and near and far planes of a camera. Paraxial; positions are vision z [mm].

A conventional camera is judged on its sensor, a focused plenoptic one in its micro-images, and an unfocused one in its
views: the pixels at one position of all micro-images form the picture of a camera whose sensor is the array, whose
pixels are the microlenses, and whose pupil is the part of the exit pupil that one pixel sees (Ng, "Digital Light Field
Photography").

Formulas: microlens imaging 1/B = 1/f + 1/a for the virtual object at distance a behind the array (Perwass and Wietzke,
"Single lens 3D-camera with extended depth-of-field", 2012); blur-disc diameters by similar triangles.
"""

import functools
import math
from dataclasses import dataclass, replace

from pipeline.camera.focusing.focus_request import KEPT, FocusRequest, solved, with_stop
from pipeline.camera.parts.camera import Camera
from pipeline.camera.parts.errors import CameraError
from pipeline.optics.first_order import FirstOrder, first_order

_LEAST_SPAN = 0.1
"""Least distance of both planes from the middle focus, over the focus distance [1]: closer planes are
ill-conditioned."""
_FARTHEST = 2.0
"""Distance of the farthest far plane over that of the middle focus [1]: a depth of field may end at infinity."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Focus:
    """Object side of the sensor alone, or of one microlens type."""

    focus_distance_mm: float  # in-focus object distance from the stop
    # Objects in between blur to at most the circle of confusion; the far end may be inf
    depth_of_field_mm: tuple[float, float]
    # Distance of the in-focus virtual object from the array over the array's distance from the sensor
    virtual_depth: float | None = None


def view_of(camera: Camera) -> Camera:
    """The middle view of an unfocused plenoptic camera, as a camera of its own; any other camera itself."""
    array = camera.microlenses
    sensor = camera.sensor
    if array is None or not array.is_unfocused(sensor.pitch_mm):
        return camera
    behind_mm, ahead_mm = array.principal_mm[0]
    pupil = first_order(camera.prescription).exit_pupil
    film_mm = camera.sensor_distance_mm - ahead_mm
    # The part of the exit pupil that one pixel sees through the vertex of its microlens becomes the view's pupil.
    visible_mm = sensor.pitch_mm * (pupil.z_mm + film_mm) / behind_mm
    width, height = (max(1, round(size_mm / array.pitch_mm)) for size_mm in sensor.size_mm)
    coarse = replace(sensor, width_px=width, height_px=height, pitch_mm=array.pitch_mm)
    view = replace(camera, microlenses=None, sensor=coarse, sensor_distance_mm=film_mm)
    return with_stop(view, 2 * camera.prescription.stop.semi_diameter_mm * min(1.0, visible_mm / pupil.diameter_mm))


def foci(camera: Camera) -> tuple[Focus, ...]:
    """One focus per microlens type, all equal in an unfocused camera, or the single one of a conventional camera."""
    types = foci_on_sensor(camera)
    view = view_of(camera)
    if view is camera:
        return types
    return tuple(replace(foci(view)[0], virtual_depth=kind.virtual_depth) for kind in types)


def foci_on_sensor(camera: Camera) -> tuple[Focus, ...]:
    """Foci as seen from one position of the sensor, also in unfocused cameras, whose views are sharp elsewhere."""
    lens = first_order(camera.prescription)
    confusion_mm = camera.circle_of_confusion_px * camera.sensor.pitch_mm
    if camera.microlenses is None:
        return (_sensor_focus(lens, -camera.sensor_distance_mm, confusion_mm),)
    array = camera.microlenses
    return tuple(
        _microlens_focus(lens, ahead_mm - camera.sensor_distance_mm, focal, behind_mm, confusion_mm / array.aperture_mm)
        for focal, (behind_mm, ahead_mm) in zip(array.focal_lengths_mm, array.principal_mm, strict=True)
    )


def _sensor_focus(lens: FirstOrder, sensor_z: float, confusion_mm: float) -> Focus:
    """Blur disc D_xp |s - i| / |i| for an image at distance i behind the exit pupil, the sensor at distance s."""
    # A pupil as narrow as the circle of confusion sees the front focus sharply, and a narrower one virtual images, too.
    pupil = lens.exit_pupil
    relative = confusion_mm / lens.exit_pupil.diameter_mm
    to_sensor = pupil.z_mm - sensor_z
    # Blur is the circle of confusion for images at distances s / (1 - c / D) and s / (1 + c / D).
    near = lens.front_focus_mm
    far = _object(lens, pupil.z_mm - to_sensor / (1 + relative))
    if relative != 1:
        near = (_object if relative < 1 else FirstOrder.object_mm)(lens, pupil.z_mm - to_sensor / (1 - relative))
    return Focus(focus_distance_mm=_object(lens, sensor_z), depth_of_field_mm=(near, far))


def _microlens_focus(lens: FirstOrder, array_z: float, focal: float, behind: float, relative_confusion: float) -> Focus:
    """Blur disc D_ml |1 - B/f - B/a| for a virtual object at distance a behind the array (negative: in front of it)."""
    reciprocal = 1 - behind / focal

    def object_at(vergence: float) -> float:
        """Object whose image by the main lens has the vergence B / a; an image at infinity is that of the focus."""
        if vergence == 0:
            return lens.front_focus_mm
        return _object(lens, array_z - behind / vergence)

    # An object moves away as the vergence grows, up to infinity before 0, and from the front focus behind it.
    low, high = reciprocal - relative_confusion, reciprocal + relative_confusion
    nearest = lens.front_focus_mm if low <= 0 <= reciprocal else object_at(low)
    farthest = math.inf if reciprocal < 0 <= high else object_at(high)
    depth = math.inf if reciprocal == 0 else abs(1 / reciprocal)
    return Focus(focus_distance_mm=object_at(reciprocal), depth_of_field_mm=(nearest, farthest), virtual_depth=depth)


def _object(lens: FirstOrder, image_z: float) -> float:
    """Object of an image at vision z; inf where the image lies at or in front of the rear focus."""
    return lens.object_mm(image_z) if image_z < lens.rear_focus_mm else math.inf


def middle_focus(camera: Camera) -> float:
    """In-focus object distance of a conventional camera, or of the middle microlens type; may be inf. [mm]"""
    distances = sorted(focus.focus_distance_mm for focus in foci(camera))
    return distances[len(distances) // 2]


@functools.lru_cache(maxsize=KEPT)
def focused(camera: Camera | FocusRequest) -> Camera:
    """The camera with its focus solved and its near and far planes settled.

    Unless authored, the planes are the ends of the depth of field (the union over microlens types), at least 10 %
    before and behind the focus distance (of the middle type), at most twice it, and in front of the first vertex. The
    choice affects conditioning only: results for a target depend on it only by the rounding of stored images.
    """
    camera = solved(camera)
    focus_of_types = foci(camera)
    middle = middle_focus(camera)
    if not math.isfinite(first_order(camera.prescription).efl_mm):
        raise CameraError("a lens without power focuses nothing")
    if camera.near_mm is not None and camera.far_mm is not None:
        return camera
    front = -camera.prescription.vertices_from_stop_mm[0]
    if not math.isfinite(middle) or middle <= front:
        distance = f"{middle:.3f} mm from the stop, inside the lens" if math.isfinite(middle) else "infinity or beyond"
        raise CameraError(
            f"the camera is focused at {distance}, so near and far planes cannot be derived",
            hint="author plen:camera:near and plen:camera:far",
        )
    near = min(min(focus.depth_of_field_mm[0] for focus in focus_of_types), (1 - _LEAST_SPAN) * middle)
    far = max(max(focus.depth_of_field_mm[1] for focus in focus_of_types), (1 + _LEAST_SPAN) * middle)
    near = max(near, (front + middle) / 2)
    far = min(far, _FARTHEST * middle)
    return replace(
        camera,
        near_mm=near if camera.near_mm is None else camera.near_mm,
        far_mm=far if camera.far_mm is None else camera.far_mm,
    )
