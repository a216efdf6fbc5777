"""Model cameras: the rig with an ideal lens in place of its prescription, as calibrations assume one.

The lens is a plane in the aperture stop, the origin of the camera, with the focal length of the real one: a
collineation, without aberrations, glass or assembly errors, optionally with Brown's distortion. The object plane in
focus, counted from the stop, is unchanged.
"""

import math
from dataclasses import replace

from pipeline.camera.focusing.focus_request import FocusRequest, solved
from pipeline.camera.parts.camera import Camera
from pipeline.camera.parts.errors import CameraError
from pipeline.optics.brown import largest_radius
from pipeline.optics.first_order import FirstOrder, first_order
from pipeline.optics.prescription import Prescription, Surface

PRESCRIPTION, PINHOLE, THIN_LENS = "prescription", "pinhole", "thinLens"
_PINHOLE_SEMI_DIAMETER_MM = 1e-4
"""Semi-diameter of the stop of a pinhole [mm]. J depends on its square over that of the object's distance: at 10 mm by
1e-10 of the distance from the axis, and farther away by less than rounding."""
_COEFFICIENTS = 5
"""Number of distortion coefficients: k1, k2, p1, p2, k3 of OpenCV."""
_AT_FOCUS = 1e-9
"""Distance from the front focus over the focal length below which an object has no image [1]: rounding."""


def with_ideal_lens(
    camera: Camera | FocusRequest, model: str, distortion: tuple[float, ...] = ()
) -> Camera | FocusRequest:
    """The camera with a thin lens or a pinhole in place of its lens; `prescription` leaves it unchanged.

    A thin lens has the real entrance pupil's diameter, and so its F-number. The sensor and its array move until the
    object plane that the real lens images onto sensor or array is in focus again.

    `distortion`: k1, k2, p1, p2, k3 of OpenCV in the plane of the sensor, or of the microlenses; empty: none. A camera
        with distortion is focused at once, because its image plane must be known.
    Raises CameraError or PrescriptionError: the lens has no positive focal length, nothing before it is in focus, or
        its distortion folds the image.
    """
    if model == PRESCRIPTION:
        return camera
    if len(distortion) not in (0, _COEFFICIENTS):
        raise CameraError(
            f"plen:camera:distortion has {len(distortion)} coefficients, and Brown's model {_COEFFICIENTS}",
            hint="write k1, k2, p1, p2, k3, with 0 for those that are not there",
            code="distortion",
        )
    ideal = _focused_alike(camera, model)
    return _distorted(solved(ideal), distortion) if any(distortion) else ideal


def _focused_alike(camera: Camera | FocusRequest, model: str) -> Camera | FocusRequest:
    """The camera with an ideal lens of the same focal length and aperture, focused on the same object plane."""
    real = first_order(camera.prescription)
    if not real.efl_mm > 0:
        raise CameraError(f"a lens of focal length {real.efl_mm:g} mm has no {model} that images like it")
    if real.entrance_pupil.is_infinite:
        raise CameraError(f"a telecentric lens has no {model} that images like it: its entrance pupil is at infinity")
    pupil_radius_mm = abs(real.entrance_pupil.diameter_mm) / 2
    semi_diameter_mm = _PINHOLE_SEMI_DIAMETER_MM if model == PINHOLE else pupil_radius_mm
    stop = Surface(focal_length_mm=real.efl_mm, semi_diameter_mm=semi_diameter_mm, is_stop=True)
    ideal = Prescription(surfaces=(stop,))
    if isinstance(camera, Camera):
        return replace(camera, prescription=ideal, sensor_distance_mm=_sensor_mm(camera, real, first_order(ideal)))
    request = replace(camera, prescription=ideal, focus_groups=(), match_stop=camera.match_stop and model != PINHOLE)
    if camera.focus_distance_mm is not None:
        return replace(request, sensor_distance_mm=None)
    return replace(request, sensor_distance_mm=_sensor_mm(camera, real, first_order(ideal)))


def _sensor_mm(camera: Camera | FocusRequest, real: FirstOrder, ideal: FirstOrder) -> float:
    """Distance from the ideal lens to the sensor that keeps the object plane in focus. [mm]"""
    if camera.sensor_distance_mm is None:
        raise CameraError("neither a sensor distance nor a focus distance is given", hint="give one of them")
    reach_mm = camera.microlenses.reach_mm if camera.microlenses else 0.0
    in_focus_mm = real.object_mm(reach_mm - camera.sensor_distance_mm)
    has_image = abs(in_focus_mm - ideal.front_focus_mm) > _AT_FOCUS * ideal.efl_mm
    if not has_image or not ideal.image_mm(in_focus_mm) < 0:
        raise CameraError(
            f"the lens images {in_focus_mm:g} mm before its stop onto the sensor, which no thin lens in the stop does"
        )
    return reach_mm - ideal.image_mm(in_focus_mm)


def _distorted(camera: Camera, distortion: tuple[float, ...]) -> Camera:
    """The camera of one ideal lens with its image distorted on sensor or array."""
    reach_mm = camera.microlenses.reach_mm if camera.microlenses else 0.0
    sensor = camera.sensor
    image_mm = camera.sensor_distance_mm - reach_mm
    corner = math.hypot(*sensor.farthest_corner_mm) / image_mm
    largest = largest_radius(distortion, corner)
    if largest < corner:
        raise CameraError(
            f"plen:camera:distortion folds the image: its radius grows to {largest * image_mm:.4g} mm at most,"
            f" and the corner of the sensor is {corner * image_mm:.4g} mm from the axis",
            hint="k1, k2 and k3 belong to radii over the image distance, as OpenCV's do to those over fx",
            code="distortion",
        )
    (lens,) = camera.prescription.surfaces
    distorting = replace(lens, distortion=distortion, image_distance_mm=image_mm)
    return replace(camera, prescription=Prescription(surfaces=(distorting,)))
