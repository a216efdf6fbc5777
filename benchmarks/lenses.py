"""Lenses to race with, and the rays that race: numbers with their sources, lengths in mm."""

import dataclasses
import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np

import pipeline
from pipeline.optics.first_order import first_order
from pipeline.optics.prescription import Prescription, Surface
from pipeline.optics.table import towards_sensor

EXAMPLES = Path(__file__).resolve().parent.parent / "examples"

# CODE V 10.8 listing of its sample lens "Double Gauss F/2 - Available Glasses", as distributed with ray-optics
# (BSD-3-Clause, ag_dblgauss.lis), at 587.6 nm. Semi-diameters are not part of the listing: largest listed ray height,
# rounded up; of the stop the paraxial marginal height.
_CODEV = (
    # curvature 1/mm, thickness, index behind, semi-diameter
    (0.01779284094091543, 8.75, 1.6222915007887073, 28.2),
    (0.006566600536925569, 0.5, 1.0, 27.15),
    (0.02653743294670983, 12.5, 1.6073788585843214, 24.65),
    (0.0, 3.8, 1.6034171781909698, 22.9),
    (0.04126892878570084, 16.36944492653564, 1.0, 17.3),
    (0.0, 13.74795696388906, 1.0, 15.8525),
    (-0.03523942654429074, 3.8, 1.6034171781909698, 15.15),
    (0.0, 11.0, 1.6204079330698105, 17.25),
    (-0.02636750828657709, 0.5, 1.0, 18.95),
    (0.005636604951748545, 7.0, 1.6204079330698105, 20.36),
    (-0.0125926458590576, 61.4875364179821 - 0.4002686453541377, 1.0, 20.8),
)
_CODEV_STOP = 5
_TRONNIER_STOP_MM = 17.1
"""Semi-diameter of the stop as the prescription prints it; the examples stop the lens down."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Race:
    """A lens with an image plane behind it, traversed from the scene.

    Attributes
    ----------
    image_mm : float
        Of the image plane, from the last vertex.
    """

    name: str
    prescription: Prescription
    image_mm: float

    @property
    def surface_count(self) -> int:
        """Surfaces that a ray meets, the stop and the image plane included."""
        return len(self.prescription.surfaces) + 1

    def rays(self, count: int, field_deg: float) -> tuple[np.ndarray, np.ndarray]:
        """Points in front of the lens and unit directions of a parallel beam over the entrance pupil, each (n, 3).

        Lens frame: origin at the first vertex, +z towards the sensor. The pupil is filled evenly by a sunflower spiral.
        """
        pupil = first_order(self.prescription).entrance_pupil
        angle = math.radians(field_deg)
        direction = np.tile([0.0, math.sin(angle), math.cos(angle)], (count, 1))
        i = np.arange(count)
        radius = np.sqrt((i + 0.5) / count) * pupil.diameter_mm / 2
        turn = i * math.pi * (3 - math.sqrt(5))
        pupil_mm = self.prescription.vertices_mm[self.prescription.stop_index] - pupil.z_mm
        crossing = np.stack([radius * np.cos(turn), radius * np.sin(turn), np.full(count, pupil_mm)], axis=1)
        # Ten millimetres before the first vertex, i.e. in front of every point of a convex first surface.
        position = crossing - direction * ((pupil_mm + 10.0) / direction[:, 2:])
        return position, direction


def codev_double_gauss() -> Race:
    """Ten refracting surfaces and a stop, f/2: the lens whose ray listing the trace is proved with."""
    surfaces = tuple(
        Surface(
            radius_mm=1 / curvature if curvature else math.inf,
            thickness_mm=thickness,
            index=index,
            semi_diameter_mm=semi_diameter,
            is_stop=i == _CODEV_STOP,
        )
        for i, (curvature, thickness, index, semi_diameter) in enumerate(_CODEV)
    )
    return Race(
        name="CODE V double Gauss f/2",
        prescription=Prescription(surfaces=surfaces),
        image_mm=surfaces[-1].thickness_mm,
    )


def tronnier() -> Race:
    """The lens of both examples at full aperture, focused at infinity."""
    camera = pipeline.open_dataset(EXAMPLES / "01_conventional" / "dataset.usda").cameras[0].camera
    surfaces = tuple(
        dataclasses.replace(surface, semi_diameter_mm=_TRONNIER_STOP_MM) if surface.is_stop else surface
        for surface in camera.prescription.surfaces
    )
    prescription = Prescription(surfaces=surfaces)
    return Race(name="Tronnier double Gauss f/2", prescription=prescription, image_mm=first_order(prescription).bfd_mm)


def table_of(race: Race) -> np.ndarray:
    """Table of the surfaces of a race, its image plane behind them."""
    prescription = race.prescription
    table = towards_sensor(prescription)
    plane = np.zeros((1, table.shape[1]))
    plane[0, :4] = prescription.vertices_from_stop_mm[-1] + race.image_mm, 0.0, 1.0, np.inf
    return np.vstack([table, plane])
