"""First-order (paraxial) optics of a prescription: focal length, pupils, principal planes, conjugates.

Positions are vision z, counted from the aperture stop and positive towards the scene. Matrices act on (height, index
times slope); Hecht, Optics, chapter "Analytical ray tracing".
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pipeline.optics.prescription import Prescription, PrescriptionError, Surface
from pipeline.optics.printed import PrintedSurface

_LEAST_POWER_PER_MM = 1e-9
"""Power below which a lens has no focus [1/mm]: a focal length of a thousand kilometres."""
_AT_FOCUS_MM = 1e-9
"""Distance from the rear focus below which an image belongs to an object at infinity [mm]: rounding decides the rest.
Behind a lens of 10 mm such an object is a hundred thousand kilometres away."""


_TELECENTRIC = 1e-9
"""Slope of a chief ray outside of the lens, over its slope at the stop, below which the pupil there lies at infinity
[1]. Such a pupil is placed where this slope would put it, so that derived figures stay finite, right to nine digits."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Pupil:
    """Paraxial image of the stop: position as vision z, diameter, magnification over the stop (signed)."""

    z_mm: float
    diameter_mm: float
    magnification: float

    @property
    def is_infinite(self) -> bool:
        """Whether it represents a pupil at infinity: chief rays are parallel to the axis on its side of the lens."""
        return abs(self.magnification * _TELECENTRIC) > 1 / 2


@dataclass(frozen=True, slots=True, kw_only=True)
class FirstOrder:
    """First-order constants of a lens with air behind it; planes and points are vision z."""

    efl_mm: float  # from the rear principal plane to the rear focus
    bfd_mm: float  # last vertex to rear focus
    front_focus_mm: float
    rear_focus_mm: float
    front_principal_mm: float
    rear_principal_mm: float
    entrance_pupil: Pupil
    exit_pupil: Pupil
    index_in_front: float = 1.0  # of the medium of the scene

    @property
    def f_number(self) -> float:
        """Focal length over entrance-pupil diameter; 0 for a pupil at infinity, where the stop bounds no beam."""
        return 0.0 if self.entrance_pupil.is_infinite else self.efl_mm / self.entrance_pupil.diameter_mm

    @property
    def pupil_magnification(self) -> float:
        """Exit-pupil over entrance-pupil diameter."""
        return self.exit_pupil.diameter_mm / self.entrance_pupil.diameter_mm

    def principal_distance_mm(self, sensor_distance_mm: float) -> float:
        """Principal distance for a sensor at this distance behind the stop: exit pupil to sensor over pupil
        magnification.

        It is the height in the image over the slope of the chief ray in the scene, whose medium makes it longer.
        """
        return self.index_in_front * (self.exit_pupil.z_mm + sensor_distance_mm) / self.pupil_magnification

    @property
    def newton_mm2(self) -> float:
        """Product f f' of both focal lengths in Newton's equation [mm^2]."""
        return self.index_in_front * self.efl_mm**2

    def image_mm(self, object_mm: float) -> float:
        """Vision z of the image of an axial object at vision z (Newton's equation x x' = f f')."""
        return self.rear_focus_mm - self.newton_mm2 / (object_mm - self.front_focus_mm)

    def object_mm(self, image_mm: float) -> float:
        """Vision z of the object whose image lies at vision z, inf for the rear focus; inverse of `image_mm`."""
        if abs(image_mm - self.rear_focus_mm) < _AT_FOCUS_MM:
            return float("inf")
        return self.front_focus_mm + self.newton_mm2 / (self.rear_focus_mm - image_mm)

    def magnification(self, object_mm: float) -> float:
        """Lateral magnification for an object at vision z; negative: inverted."""
        return -self.index_in_front * self.efl_mm / (object_mm - self.front_focus_mm)


def first_order(prescription: Prescription) -> FirstOrder:
    """First-order constants at the prescription's wavelength; a PrescriptionError if the lens is afocal."""
    surfaces = prescription.surfaces
    stop = prescription.stop_index
    vertices = prescription.vertices_from_stop_mm
    index = prescription.index_in_front
    system = _matrix(surfaces, index)
    if abs(system[1, 0]) < _LEAST_POWER_PER_MM:
        hint = "so is any that is telecentric on both sides: cameras need a lens with power"
        raise PrescriptionError("the lens is afocal: it has no focal length", hint=hint)
    efl = float(-1.0 / system[1, 0])
    bfd = float(-system[0, 0] / system[1, 0])
    front_focus = -(vertices[0] + index * float(system[1, 1] / system[1, 0]))
    rear_focus = -(vertices[-1] + bfd)
    return FirstOrder(
        efl_mm=efl,
        bfd_mm=bfd,
        front_focus_mm=front_focus,
        rear_focus_mm=rear_focus,
        front_principal_mm=front_focus - index * efl,
        rear_principal_mm=rear_focus + efl,
        entrance_pupil=_entrance_pupil(prescription, surfaces[:stop]),
        exit_pupil=exit_pupil(prescription),
        index_in_front=index,
    )


def paraxial_ray(
    surfaces: Sequence[Surface | PrintedSurface], height: float, slope: float, index: float = 1.0
) -> tuple[list[float], float]:
    """Heights of a paraxial ray at all surfaces, and its slope times the index behind the last one.

    `height`, `slope`: at the first vertex, the slope times the index of the medium in front.
    `index`: of that medium.
    """
    heights = list[float]()
    for i, surface in enumerate(surfaces):
        if i:
            height += surfaces[i - 1].thickness_mm * slope / index
        heights.append(height)
        slope -= surface.power_per_mm(index) * height
        index = surface.index
    return heights, slope


def _matrix(surfaces: tuple[Surface, ...], index: float) -> np.ndarray:
    """System matrix from just before the first surface to just behind the last one; `index`: of the medium in front."""
    matrix = np.eye(2)
    for i, surface in enumerate(surfaces):
        if i:
            matrix = np.array([[1.0, surfaces[i - 1].thickness_mm / index], [0.0, 1.0]]) @ matrix
        power = surface.power_per_mm(index)
        matrix = np.array([[1.0, 0.0], [-power, 1.0]]) @ matrix
        index = surface.index
    return matrix


def exit_pupil(prescription: Prescription) -> Pupil:
    """Image of the stop through the surfaces behind it."""
    rear = prescription.surfaces[prescription.stop_index :]
    stop = prescription.stop_index
    before = prescription.surfaces[stop - 1].index if stop else prescription.index_in_front
    # The stop is imaged at a distance s behind the last vertex, in air, where B + D s = 0; the image is A + C s wide.
    (a, b), (c, d) = _matrix(rear, before)
    behind_mm = float(-b / _off_zero(d, b))
    scale = float(a + behind_mm * c)
    z_mm = -(prescription.vertices_from_stop_mm[-1] + behind_mm)
    return Pupil(z_mm=z_mm, diameter_mm=2 * prescription.stop.semi_diameter_mm * abs(scale), magnification=scale)


def _off_zero(slope: float, height_mm: float) -> float:
    """The slope, or for a pupil at infinity one that puts it far behind the lens, as seen from scene or sensor.

    `height_mm`: the ray's height where it leaves the lens, whose sign the slope gets.
    """
    return slope if abs(slope) > _TELECENTRIC else math.copysign(_TELECENTRIC, height_mm)


def _entrance_pupil(prescription: Prescription, front: tuple[Surface, ...]) -> Pupil:
    """Object whose image through the front group is the stop."""
    diameter = 2 * prescription.stop.semi_diameter_mm
    if not front:
        return Pupil(z_mm=0.0, diameter_mm=diameter, magnification=1.0)
    matrix = _matrix(front, prescription.index_in_front)
    last = front[-1]
    matrix = np.array([[1.0, last.thickness_mm / last.index], [0.0, 1.0]]) @ matrix
    # An object at distance s before the first vertex, in a medium n, images onto the stop where B + A s / n = 0.
    scale = float(_off_zero(matrix[0, 0], matrix[0, 1]))
    before_mm = prescription.index_in_front * float(-matrix[0, 1] / scale)
    z_mm = -(prescription.vertices_from_stop_mm[0] - before_mm)
    return Pupil(z_mm=z_mm, diameter_mm=diameter / abs(scale), magnification=1.0 / scale)
