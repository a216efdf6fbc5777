"""The parts of a camera: plain records. The physics lives in the modules beside this one.

Distances along the axis are counted from the aperture stop, the origin of the camera frame.
"""

import math
from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np

from pipeline.camera.parts.errors import CameraError
from pipeline.camera.parts.microlens_array import LEAST_MM, MicrolensArray
from pipeline.camera.parts.spectrum import Channel, SpectralNode
from pipeline.frames import apply
from pipeline.optics.prescription import UPRIGHT_DEG, Prescription
from pipeline.optics.printed import Lost, PrintedLens
from pipeline.optics.table import UPRIGHT, Film
from pipeline.optics.windows import Windows
from pipeline.records.declared import settle
from pipeline.records.shapes import Float64

WEIGHTS = ("irradiance", "area")
REPLICAS = 4
"""Independently scrambled replicas of a bundle: their spread is the sampling error; more would have fewer rays each."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Sensor:
    """A plane of square pixels, perpendicular to the axis unless tilted.

    - `width_px`, `height_px`: number of pixels along x and y.
    - `pitch_mm`: distance of neighbouring pixel centres in x and in y.
    - `offset_x_mm`, `offset_y_mm`: where the optical axis meets the sensor, from its centre, sensor frame (x right, y
      down in the image).
    - `tilt_deg`: rotation about that point, first about x, then about the rotated y of the vision frame: tauX and tauY
      of OpenCV. The array is tilted with it.
    - `acceptance`: response of a pixel to a ray at the angle theta to its normal: `all`; `cosine`,
      cos^power(theta); `cone`, 1 up to the half angle, from there falling linearly with the angle to 0 over the
      roll-off.
    """

    width_px: int
    height_px: int
    pitch_mm: Annotated[float, "plen:pixelPitch"]
    offset_x_mm: float = 0.0
    offset_y_mm: float = 0.0
    tilt_deg: Annotated[tuple[float, float], "plen:tilt"] = (0.0, 0.0)
    acceptance: Annotated[str, "plen:acceptance"] = "all"
    acceptance_power: Annotated[float, "plen:acceptancePower"] = 1.0
    acceptance_half_angle_deg: Annotated[float, "plen:acceptanceHalfAngle"] = 90.0
    acceptance_roll_off_deg: Annotated[float, "plen:acceptanceRollOff"] = 0.0

    def __post_init__(self) -> None:
        settle(self, CameraError)  # types, NaN, magnitudes
        if self.acceptance not in ("all", "cosine", "cone"):
            raise CameraError(f'unknown pixel acceptance "{self.acceptance}"', hint="there are all, cosine and cone")
        if not (min(self.acceptance_power, self.acceptance_half_angle_deg) > 0 and self.acceptance_roll_off_deg >= 0):
            raise CameraError(
                f"acceptance_power {self.acceptance_power}, acceptance_half_angle_deg {self.acceptance_half_angle_deg},"
                f" acceptance_roll_off_deg {self.acceptance_roll_off_deg}",
                hint="power and half angle are positive, the roll-off is not negative",
            )
        if not all(abs(angle) < UPRIGHT_DEG for angle in self.tilt_deg):
            raise CameraError(f"a sensor is tilted by {self.tilt_deg} deg", hint="less than 90 deg either way")
        if self.width_px < 1 or self.height_px < 1 or not self.pitch_mm > 0:
            raise CameraError(f"a sensor of {self.width_px} x {self.height_px} pixels of {self.pitch_mm} mm")

    @property
    def size_px(self) -> tuple[int, int]:
        """Columns and rows."""
        return self.width_px, self.height_px

    @property
    def size_mm(self) -> tuple[float, float]:
        """Width and height."""
        return self.width_px * self.pitch_mm, self.height_px * self.pitch_mm

    @property
    def axis_px(self) -> tuple[float, float]:
        """Image position at which the optical axis meets the sensor."""
        x_px, y_px = self.offset_x_mm / self.pitch_mm, self.offset_y_mm / self.pitch_mm
        return x_px + (self.width_px - 1) / 2, y_px + (self.height_px - 1) / 2

    @property
    def farthest_corner_mm(self) -> np.ndarray:
        """The corner that is farthest from the axis, vision frame (2,)."""
        middle = np.array([self.offset_x_mm, self.offset_y_mm])
        half = np.array(self.size_mm) / 2
        return middle + np.where(middle < 0, -half, half)


@dataclass(frozen=True, slots=True, kw_only=True)
class Camera:
    """A main lens, a sensor and, for a plenoptic camera, a microlens array.

    - `sensor_distance_mm`: from the aperture stop to the sensor.
    - `circle_of_confusion_px`: blur-disc diameter that still counts as sharp, for the depth of field.
    - `near_mm`, `far_mm`: vision z of the planes of J_near and J_far; None: `focused` derives them.
    - `weight`: of a ray, besides its acceptance: `irradiance`, cos(theta) d omega at the sensor, or `area` of the
      sampling plane. Weights are in sr or in mm^2.
    - `spectrum`: wavelengths of its light, at least two; empty: that of the prescription's indices alone.
    """

    prescription: Prescription
    sensor: Sensor
    sensor_distance_mm: float
    microlenses: MicrolensArray | None = None
    circle_of_confusion_px: Annotated[float, "plen:camera:circleOfConfusion"] = 1.0
    near_mm: Annotated[float | None, "plen:camera:near"] = None
    far_mm: Annotated[float | None, "plen:camera:far"] = None
    weight: Annotated[str, "plen:camera:weight"] = "irradiance"
    spectrum: tuple[SpectralNode, ...] = ()

    def __post_init__(self) -> None:
        settle(self, CameraError, infinite=("near_mm", "far_mm"))
        if any(len(node.indices) != len(self.prescription.surfaces) for node in self.spectrum):
            raise CameraError(
                "a wavelength of the spectrum does not have one index for every surface of the lens",
                hint=f"the lens has {len(self.prescription.surfaces)} surfaces",
            )
        if not self.circle_of_confusion_px > 0:
            raise CameraError(f"a circle of confusion of {self.circle_of_confusion_px} px")
        if self.weight not in WEIGHTS:
            raise CameraError(f'rays know no weight "{self.weight}"', hint=f"one of: {', '.join(WEIGHTS)}")
        last_mm = self.prescription.vertices_from_stop_mm[-1]
        film_mm = self.sensor_distance_mm - (self.microlenses.reach_mm if self.microlenses else 0.0)
        if film_mm <= last_mm + LEAST_MM:
            film = "the microlens array" if self.microlenses else "the sensor"
            raise CameraError(
                f"{film} lies {film_mm} mm behind the stop, inside the lens, whose last vertex lies at {last_mm} mm"
            )
        self._check_tilt(last_mm)

    def _check_tilt(self, last_mm: float) -> None:
        """Check that the plane of a tilted sensor, or of its array, lies behind the rim of the last surface."""
        vision_from_film = self.film.vision_from_film
        if vision_from_film is None:
            return
        # Distance of the rim's nearest point from the plane, by the plane's normal.
        normal_x, normal_y, normal_z = vision_from_film[:3, 2].tolist()
        rear = self.prescription.surfaces[-1]
        to_rim_mm = self.sensor_distance_mm - last_mm - rear.sag_mm(rear.semi_diameter_mm)
        distance_mm = normal_z * to_rim_mm - math.hypot(normal_x, normal_y) * rear.semi_diameter_mm
        if distance_mm <= (self.microlenses.reach_mm if self.microlenses else 0.0) + LEAST_MM:
            raise CameraError(
                f"the plane of the sensor, tilted by {self.sensor.tilt_deg} deg, cuts the last surface of the lens",
                hint="tilt it less, or move it back",
                code="sensor-tilt",
            )

    @property
    def film(self) -> Film:
        """The plane in which rays start."""
        return Film(self.sensor.tilt_deg, -self.sensor_distance_mm) if any(self.sensor.tilt_deg) else UPRIGHT

    def in_vision(self, points_mm: Float64[np.ndarray, "n 3"]) -> np.ndarray:
        """Points of the film frame in the vision frame, (n, 3)."""
        vision_from_film = self.film.vision_from_film
        return points_mm if vision_from_film is None else apply(vision_from_film, points_mm)

    @property
    def is_centred(self) -> bool:
        """Whether the camera is symmetric about its axis, apertures and edges of the sensor left aside."""
        return self.prescription.is_centred and not any(self.sensor.tilt_deg)

    def at(self, node: SpectralNode) -> "Camera":
        """The camera at a single wavelength: only its refractive indices differ."""
        surfaces = zip(self.prescription.surfaces, node.indices, strict=True)
        refracting = tuple(replace(surface, index=index) for surface, index in surfaces)
        array = self.microlenses
        if array is not None and node.microlens_index is not None:
            array = array.with_index(node.microlens_index)
        prescription = replace(self.prescription, surfaces=refracting, index_in_front=node.index_in_front)
        return replace(self, prescription=prescription, microlenses=array, spectrum=())

    def behind(self, windows: Windows, wavelength_nm: float) -> "Camera":
        """The camera with windows in front of it; the wavelength is that of its own indices."""
        spectrum = []
        for node in self.spectrum:
            media = windows.at(node.wavelength_nm)
            indices = (*media.behind, *node.indices)
            spectrum.append(replace(node, indices=indices, index_in_front=media.index_in_front))
        return replace(self, prescription=windows.before(self.prescription, wavelength_nm), spectrum=tuple(spectrum))

    def in_light(self, channel: Channel) -> "Camera":
        """The camera in one of its channels; its own indices become those of the mean wavelength."""
        if len(channel.nodes) == 1:
            return self.at(channel.nodes[0])
        return replace(self.at(channel.middle), spectrum=channel.nodes)


@dataclass(frozen=True, slots=True, kw_only=True)
class Sampling:
    """Sampling of the bundles of a camera."""

    # K of the paper: position images are K times finer than the image along each axis
    supersampling: Annotated[int, "plen:truth:supersampling"] = 1
    # rays per position of a position image, over all replicas; four times a power of two
    samples: Annotated[int, "plen:truth:samples"] = 1024
    seed: int = 0  # `plen:seed` of the dataset


@dataclass(frozen=True, slots=True, kw_only=True)
class PrintedCamera:
    """A printed camera and its provenance; fields shared with `Camera` have the same meaning."""

    name: str  # for people
    provenance: tuple[str, ...] = ()  # paragraphs: where the numbers were read, notes
    lens: PrintedLens
    sensor: Sensor
    sensor_distance_mm: float
    microlenses: MicrolensArray | None = None
    near_mm: float | None = None
    far_mm: float | None = None
    lost: tuple[Lost, ...] = ()  # statements of the source that this record cannot hold, besides those of the lens
