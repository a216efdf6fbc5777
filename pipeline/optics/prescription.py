"""A lens as its designer prints it: surfaces in the order in which light from the scene meets them."""

import math
from dataclasses import dataclass

from pipeline.errors import PipelineError


class PrescriptionError(PipelineError):
    """A lens that cannot exist, or cannot be traced."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Surface:
    """One row of a prescription: a sphere or plane about the axis.

    Attributes
    ----------
    radius_mm : float
        Radius of curvature, positive when the centre lies towards the sensor; `inf` is a plane.
    thickness_mm : float
        Distance along the axis to the next vertex; of the last surface: the back focus as printed, unused.
    semi_diameter_mm : float
        Half the clear aperture: a hard edge that blocks rays.
    index : float
        Refractive index of the medium behind the surface, relative to air, at the prescription's wavelength.
    is_stop : bool
        Whether this is the aperture stop.
    """

    radius_mm: float = math.inf
    thickness_mm: float = 0.0
    semi_diameter_mm: float
    index: float = 1.0
    is_stop: bool = False

    def __post_init__(self) -> None:
        if self.radius_mm == 0 or math.isnan(self.radius_mm):
            raise PrescriptionError(f"a surface has radius {self.radius_mm}", hint="a plane has radius inf")
        if not self.semi_diameter_mm > 0:
            raise PrescriptionError(f"a surface has semi-diameter {self.semi_diameter_mm} mm")
        if self.semi_diameter_mm > abs(self.radius_mm):
            raise PrescriptionError(
                f"semi-diameter {self.semi_diameter_mm} mm reaches beyond a sphere of radius {self.radius_mm} mm"
            )
        if not self.index >= 1:
            raise PrescriptionError(f"refractive index {self.index} is below 1")

    @property
    def curvature_per_mm(self) -> float:
        """1 / radius, 0 for a plane."""
        return 0.0 if math.isinf(self.radius_mm) else 1.0 / self.radius_mm

    def sag_mm(self, height_mm: float) -> float:
        """Depth of the surface at a height above the axis, from its vertex [mm]."""
        c = self.curvature_per_mm
        return c * height_mm**2 / (1.0 + math.sqrt(1.0 - (c * height_mm) ** 2))


@dataclass(frozen=True, slots=True, kw_only=True)
class Prescription:
    """Surfaces from the scene to the sensor, with exactly one aperture stop.

    Lens frame: origin at the first vertex, +z from scene to sensor.
    """

    surfaces: tuple[Surface, ...]

    def __post_init__(self) -> None:
        stops = sum(surface.is_stop for surface in self.surfaces)
        if stops != 1:
            raise PrescriptionError(f"a prescription needs exactly one aperture stop, this one has {stops}")

    @property
    def vertices_mm(self) -> tuple[float, ...]:
        """z of each vertex in the lens frame [mm]."""
        positions = [0.0]
        for surface in self.surfaces[:-1]:
            positions.append(positions[-1] + surface.thickness_mm)
        return tuple(positions)

    @property
    def stop_index(self) -> int:
        """Which surface is the aperture stop, counted from 0."""
        return next(i for i, surface in enumerate(self.surfaces) if surface.is_stop)

    @property
    def stop(self) -> Surface:
        """The aperture stop."""
        return self.surfaces[self.stop_index]

    @property
    def vertices_from_stop_mm(self) -> tuple[float, ...]:
        """z of each vertex, counted from the stop, + towards the sensor [mm]."""
        stop_mm = self.vertices_mm[self.stop_index]
        return tuple(z - stop_mm for z in self.vertices_mm)
