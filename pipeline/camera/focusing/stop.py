"""A camera whose stop is set: how wide the lens allows it, and to which F-number."""

import dataclasses
import math

from pipeline.camera.parts.camera import Camera
from pipeline.camera.parts.errors import CameraError
from pipeline.errors import PipelineError
from pipeline.optics.first_order import first_order
from pipeline.optics.prescription import Prescription


def stopped_down(camera: Camera, f_number: float) -> Camera:
    """The camera with its stop set to an F-number of its lens, focus unchanged.

    The F-number is that of camera.json, for objects at infinity: focal length over the diameter of the entrance pupil.
    What the microlenses see is the working F-number at their plane.

    Raises
    ------
    CameraError
        The lens does not open so far: the edge of another surface would limit the light on the axis.
    """
    lens = first_order(camera.prescription)
    diameter = lens.f_number / f_number * 2 * camera.prescription.stop.semi_diameter_mm
    ahead = camera.microlenses.principal_mm[0][1] if camera.microlenses else 0.0
    widest = widest_stop_mm(camera.prescription, camera.sensor_distance_mm - ahead)
    if diameter > widest:
        what = f"F/{f_number:g} needs a stop of {diameter:.4g} mm, wider than the lens lets through"
        raise CameraError(what, hint=f"the lens opens to F/{math.ceil(f_number * diameter / widest * 1e3) / 1e3:g}")
    try:
        return with_stop(camera, diameter)
    except PipelineError as error:
        raise CameraError(f"F/{f_number:g} needs a stop of {diameter:.4g} mm: {error.what}") from None


def with_stop(camera: Camera, diameter_mm: float) -> Camera:
    """The camera with another diameter of the circle around its stop."""
    prescription = camera.prescription
    surfaces = list(prescription.surfaces)
    surfaces[prescription.stop_index] = dataclasses.replace(prescription.stop, semi_diameter_mm=diameter_mm / 2)
    return dataclasses.replace(camera, prescription=dataclasses.replace(prescription, surfaces=tuple(surfaces)))


def widest_stop_mm(prescription: Prescription, film_mm: float) -> float:
    """Diameter at the stop of the paraxial cone from the axis of the film that all other surfaces let through."""
    surfaces, heights = prescription.surfaces, [0.0] * len(prescription.surfaces)
    height, slope = film_mm - prescription.vertices_from_stop_mm[-1], 1.0  # slope: times the index
    for i in reversed(range(len(surfaces))):
        heights[i] = height
        in_front = surfaces[i - 1].index if i else 1.0
        slope -= height * surfaces[i].power_per_mm(in_front)
        height += slope * surfaces[i - 1].thickness_mm / in_front if i else 0.0
    at_stop = abs(heights[prescription.stop_index])
    others = [(s, abs(y)) for s, y in zip(surfaces, heights, strict=True) if not s.is_stop and y]
    return 2 * min((s.semi_diameter_mm * at_stop / y for s, y in others), default=math.inf)


def shown_f_number(f_number: float) -> str:
    """An F-number in the name of a file: f8, f2.8."""
    return f"f{f_number!r}".removesuffix(".0")
