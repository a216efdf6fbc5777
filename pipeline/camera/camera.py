"""What a camera is made of. Plain records; the physics that reads them lives beside this module.

Distances along the axis are counted from the aperture stop, the origin of the camera frame.
"""

from dataclasses import dataclass
from typing import TYPE_CHECKING

from pipeline.errors import PipelineError
from pipeline.optics.prescription import Prescription

if TYPE_CHECKING:
    from pipeline.camera.bundle import Bundle


class CameraError(PipelineError):
    """A camera that cannot be built from its parts."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Sensor:
    """A plane of square pixels, perpendicular to the axis.

    Attributes
    ----------
    width_px, height_px : int
        Number of pixels along x and y.
    pitch_mm : float
        Distance of neighbouring pixel centres, the same in x and y.
    offset_x_mm, offset_y_mm : float
        Where the optical axis meets the sensor, from the image centre, sensor frame (x right, y down in the image).
    """

    width_px: int
    height_px: int
    pitch_mm: float
    offset_x_mm: float = 0.0
    offset_y_mm: float = 0.0

    def __post_init__(self) -> None:
        if self.width_px < 1 or self.height_px < 1 or not self.pitch_mm > 0:
            raise CameraError(f"a sensor of {self.width_px} x {self.height_px} pixels of {self.pitch_mm} mm")


@dataclass(frozen=True, slots=True, kw_only=True)
class MicrolensArray:
    """Microlenses on a regular lattice, perpendicular to the axis. Lattice and types: CONVENTIONS.md.

    Attributes
    ----------
    layout : str
        `hexagonal`, rows along +x.
    pitch_mm : float
        Distance of neighbouring vertices.
    focal_lengths_mm : tuple of float
        One per type; a lens (k, l) has type (k - l) mod 3 when there are three.
    width_mm, height_mm : float
        Extent of the array: a lens exists where its vertex lies inside.
    distance_mm : float
        From the principal plane of the microlenses to the sensor.
    rotation_deg : float
        Of the lattice, from +x towards +y of the sensor frame.
    offset_x_mm, offset_y_mm : float
        Of lens (0, 0) from the sensor's centre, sensor frame: array and sensor move together.
    """

    layout: str = "hexagonal"
    pitch_mm: float
    focal_lengths_mm: tuple[float, ...]
    width_mm: float
    height_mm: float
    distance_mm: float
    rotation_deg: float = 0.0
    offset_x_mm: float = 0.0
    offset_y_mm: float = 0.0

    def __post_init__(self) -> None:
        if self.layout != "hexagonal":
            raise CameraError(f'microlens layout "{self.layout}" is not supported yet')
        if len(self.focal_lengths_mm) not in (1, 3):
            raise CameraError(f"{len(self.focal_lengths_mm)} microlens types; the type rule knows 1 or 3")
        if not min(self.pitch_mm, self.distance_mm, *self.focal_lengths_mm) > 0:
            raise CameraError("microlens pitch, distance and focal lengths must be positive")


@dataclass(frozen=True, slots=True, kw_only=True)
class Camera:
    """A main lens, a sensor and, for a plenoptic camera, a microlens array.

    Attributes
    ----------
    sensor_distance_mm : float
        From the aperture stop to the sensor.
    circle_of_confusion_px : float
        Blur-disc diameter that still counts as sharp, for the depth of field.
    near_mm, far_mm : float or None
        Vision z of the planes of J_near and J_far; None: derived from the depth of field by `focused`.
    """

    prescription: Prescription
    sensor: Sensor
    sensor_distance_mm: float
    microlenses: MicrolensArray | None = None
    circle_of_confusion_px: float = 1.0
    near_mm: float | None = None
    far_mm: float | None = None

    def __post_init__(self) -> None:
        last_mm = self.prescription.vertices_from_stop_mm[-1]
        film_mm = self.sensor_distance_mm - (self.microlenses.distance_mm if self.microlenses else 0.0)
        if film_mm <= last_mm:
            what = "the microlens array" if self.microlenses else "the sensor"
            raise CameraError(
                f"{what} lies {film_mm} mm behind the stop, inside the lens, whose last vertex lies at {last_mm} mm"
            )

    def bundle(self, x_px: float, y_px: float, *, samples: int = 1024, seed: int = 0) -> "Bundle":
        """Trace the rays of one image position into the scene; see `camera.bundle.bundle`."""
        from pipeline.camera.bundle import bundle

        return bundle(self, x_px, y_px, samples=samples, seed=seed)


@dataclass(frozen=True, slots=True, kw_only=True)
class Sampling:
    """How the bundles of a camera are sampled.

    Attributes
    ----------
    supersampling : int
        K of the paper: position images are K times finer than the image along each axis.
    samples : int
        Rays per position of a position image, over all replicas; four times a power of two.
    seed : int
        `plen:seed` of the dataset.
    """

    supersampling: int = 1
    samples: int = 1024
    seed: int = 0


REPLICAS = 4
"""Independently scrambled replicas of every bundle; their spread gives the sampling error."""
