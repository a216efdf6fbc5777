"""The paraxial pinhole that sees what a camera sees, for viewers of USD, which know no lenses; lengths in mm.

Without a ray traced, for a picture; `camera.figures.equivalent_pinhole` is fitted to real rays, for numbers.
"""

import math
from dataclasses import dataclass

from pipeline.camera.focusing.depth_of_field import middle_focus
from pipeline.camera.parts.camera import Camera
from pipeline.optics.first_order import first_order


@dataclass(frozen=True, slots=True, kw_only=True)
class Viewfinder:
    """A pinhole before a film, both in the entrance pupil's place."""

    principal_mm: float  # distance from the pinhole to the film
    # Size of the film along x and y of the image; its middle, from the foot of the pinhole, x right and y up as the
    # viewer looks at the scene
    size_mm: tuple[float, float]
    offset_mm: tuple[float, float]
    focus_mm: float  # vision z of what is in focus, of the middle microlens type; may be inf
    # Principal distance over the diameter of the entrance pupil: a thin lens in the pinhole's place that is as wide
    f_number: float
    nearest_mm: float  # vision z of the first vertex: nothing nearer is ever seen


def viewfinder(camera: Camera) -> Viewfinder:
    """Find the viewfinder of a camera whose focus is solved."""
    lens, sensor = first_order(camera.prescription), camera.sensor
    principal_mm = lens.principal_distance_mm(camera.sensor_distance_mm)
    focus_mm = middle_focus(camera)
    return Viewfinder(
        principal_mm=principal_mm,
        size_mm=sensor.size_mm,
        # Offsets say where the axis meets the image, x right and y down: the image's middle lies on the other side.
        offset_mm=(0.0 - sensor.offset_x_mm, 0.0 + sensor.offset_y_mm),
        focus_mm=focus_mm if focus_mm > 0 else math.inf,
        f_number=principal_mm / lens.entrance_pupil.diameter_mm,
        nearest_mm=-camera.prescription.vertices_from_stop_mm[0],
    )
