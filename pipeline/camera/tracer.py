"""A camera as the arrays that kernels read: surfaces, outlines of pupils, microlenses.

Positions on the sensor and microlenses are in the film frame: the vision frame, tilted with the sensor about the point
where the axis meets it. Rays in front of the lens, and the scene, are in the vision frame.
"""

import math
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from pipeline.camera.integrating.quadrature import NOT_STAR_SHAPED, regions
from pipeline.camera.parts.camera import REPLICAS, Camera
from pipeline.camera.parts.errors import CameraError
from pipeline.camera.parts.lattice import Lattice, cell, lattice
from pipeline.camera.pupil.outlines import MARGIN, Outlines, grid_outlines, outlines
from pipeline.camera.tracing import bundle_kernels
from pipeline.camera.tracing.microlens_tables import camera_arrays
from pipeline.camera.tracing.moments import COLUMNS, FIRST, NORMAL, ORIGIN, SECOND, WEIGHT, mixed
from pipeline.camera.tracing.records import CameraArrays, Samples, Starts
from pipeline.camera.tracing.sampling_bounds import NO_MICROLENS, SKIP
from pipeline.camera.tracing.sobol import sobol_bits
from pipeline.frames import apply, inverse
from pipeline.optics.table import is_centred, towards_scene
from pipeline.records.shapes import Float64, Int64, Num

_REFERENCE_NODES, _REFERENCE_RAYS = (24, 256), 1 << 20
"""Quadrature nodes for the reference bundle, and random rays where that is not star-shaped."""
SEED_STEP = 0x9E3779B9
"""Distance between the seeds of two wavelengths: 2^32 over the golden ratio, odd, so that small seeds never meet."""


@dataclass(frozen=True)
class Tracer:
    """Traces bundles of a camera."""

    camera: Camera
    seed: int = 0  # `plen:seed` of the dataset
    margin: float = MARGIN  # inflation of the sampling bounds; results must not depend on it
    device: str | None = None  # device on which `moments` traces: a name from `pipeline.jit.device`, or the processor
    beside: "Tracer | None" = None  # tracer of a camera so similar that its outlines also bound these rays

    @cached_property
    def lights(self) -> tuple["Light", ...]:
        """The wavelengths of the light, each with its own random numbers; for a single one, this tracer alone."""
        nodes = self.camera.spectrum
        if not nodes:
            return (Light(1.0, self),)
        seeds = (self.seed + number * SEED_STEP for number in range(len(nodes)))
        similar = [light.tracer for light in self.beside.lights] if self.beside else [None] * len(nodes)
        return tuple(
            Light(node.weight, replace(self, camera=self.camera.at(node), seed=seed, beside=beside))
            for node, seed, beside in zip(nodes, seeds, similar, strict=True)
        )

    @cached_property
    def table(self) -> np.ndarray:
        """Surfaces towards the scene, (n, columns): rays enter in the film frame and leave in the vision frame."""
        return towards_scene(self.camera.prescription, self.camera.film)

    def next_to(self, camera: Camera) -> "Tracer":
        """The tracer of a camera so similar that the outlines of this one bound its rays."""
        return replace(self, camera=camera, beside=self)

    @property
    def stop_row(self) -> int:
        """Row of the aperture stop in `table`."""
        return len(self.camera.prescription.surfaces) - 1 - self.camera.prescription.stop_index

    @property
    def sensor_z_mm(self) -> float:
        """Vision z of the sensor (negative)."""
        return -self.camera.sensor_distance_mm

    @property
    def film_z_mm(self) -> float:
        """Vision z of the plane that the main lens images onto: the microlenses, or else the sensor."""
        array = self.camera.microlenses
        return self.sensor_z_mm + (array.distance_mm if array else 0.0)

    @cached_property
    def lattice(self) -> Lattice | None:
        """The microlenses, None for a conventional camera."""
        return lattice(self.camera.microlenses) if self.camera.microlenses else None

    @cached_property
    def vertices_mm(self) -> np.ndarray:
        """Microlens vertices across the optical axis, film frame (n, 2); none for a conventional camera."""
        if self.lattice is None:
            return np.zeros((0, 2))
        sensor = self.camera.sensor
        return -np.stack([self.lattice.x_mm - sensor.offset_x_mm, self.lattice.y_mm - sensor.offset_y_mm], axis=1)

    @cached_property
    def bounds(self) -> Outlines:
        """Outlines of the passing rays on the plane of microlenses or sensor; a grid for a lens that is not centred."""
        if self.beside is not None:
            return self.beside.bounds
        if not is_centred(self.table):
            return self._grid()
        sensor = self.camera.sensor
        reach = np.hypot(sensor.width_px + 1, sensor.height_px + 1) * sensor.pitch_mm / 2
        reach += np.hypot(sensor.offset_x_mm, sensor.offset_y_mm)
        if self.lattice:
            # Chief rays through vertices of a tilted array cross the untilted one at slopes below 1.
            reach = np.hypot(*self.vertices_mm.T).max() + np.abs(self.lattice.z_mm).max()
        return outlines(self.camera.prescription, self.film_z_mm, float(reach), self.margin)

    def _grid(self) -> Outlines:
        """Outlines over the extent of the microlenses, or of the sensor."""
        array, sensor = self.camera.microlenses, self.camera.sensor
        if array and self.lattice:
            extents = np.abs(self.vertices_mm).max(axis=0) + np.abs(self.lattice.z_mm).max()
            slack = np.hypot(*cell(array).T).max() * (1.0 if array.is_plain else 1.1)
        else:
            half = np.array(sensor.size_px) * sensor.pitch_mm / 2
            extents = half + np.abs([sensor.offset_x_mm, sensor.offset_y_mm])
            slack = sensor.pitch_mm * np.sqrt(0.5)
        middle = (0.0, 0.0, self.film_z_mm)
        reach = (float(extents[0]), float(extents[1]))
        return grid_outlines(self.camera.prescription, middle, reach, float(slack), self.margin, self.camera.film)

    def on_film(self, points_mm: Float64[np.ndarray, "n 2"]) -> np.ndarray:
        """Points (n, 2) of the plane of the microlenses or sensor as points of space (n, 3), film frame."""
        return np.column_stack([points_mm, np.full(len(points_mm), self.film_z_mm)])

    def arrivals(
        self, points_mm: Float64[np.ndarray, "n 3"], directions: Float64[np.ndarray, "n 3"]
    ) -> tuple[np.ndarray, np.ndarray]:
        """Intersections of rays behind the lens, vision frame, with that plane, and their slopes, film frame (n, 2)."""
        vision_from_film = self.camera.film.vision_from_film
        if vision_from_film is not None:
            points_mm = apply(inverse(vision_from_film), points_mm)
            directions = directions @ vision_from_film[:3, :3]
        slopes = directions[:, :2] / directions[:, 2:]
        return points_mm[:, :2] + (self.film_z_mm - points_mm[:, 2:]) * slopes, slopes

    @cached_property
    def arrays(self) -> CameraArrays:
        """The camera as the kernels read it."""
        return camera_arrays(self.camera, self.table, self.stop_row, self.lattice, self.vertices_mm, self.bounds)

    def positions_mm(self, x_px: Num[np.ndarray, "n"] | float, y_px: Num[np.ndarray, "n"] | float) -> np.ndarray:
        """Image positions as points of the sensor, film frame (n, 2)."""
        sensor = self.camera.sensor
        x = (np.asarray(x_px) - (sensor.width_px - 1) / 2) * sensor.pitch_mm - sensor.offset_x_mm
        y = (np.asarray(y_px) - (sensor.height_px - 1) / 2) * sensor.pitch_mm - sensor.offset_y_mm
        return np.stack([-x, -y], axis=-1)

    def pixels_at(self, positions_mm: Float64[np.ndarray, "n 2"]) -> np.ndarray:
        """Image positions of points of the sensor; inverse of `positions_mm`, (n, 2) [px]."""
        sensor = self.camera.sensor
        centre = (np.array(sensor.size_px) - 1) / 2
        offset = np.array([sensor.offset_x_mm, sensor.offset_y_mm])
        return (-np.asarray(positions_mm) + offset) / sensor.pitch_mm + centre

    def moments(
        self,
        positions_mm: Float64[np.ndarray, "n 2"],
        microlens: Int64[np.ndarray, "n"],
        planes: Float64[np.ndarray, "... 2 4 3"],
        samples: int,
        pixels: Num[np.ndarray, "n 2"],
        square_px: float = 0.0,
    ) -> np.ndarray:
        """Moments of the bundles of positions (n, 2) behind their microlenses (n,), each in its own region.

        Random numbers depend on the pixels (n, 2); everything else is as in `moments_of`.
        """
        return self.moments_of(Starts(pixels, positions_mm, positions_mm, microlens), planes, samples, square_px)

    def moments_of(
        self, starts: Starts, planes: Float64[np.ndarray, "... 2 4 3"], samples: int, square_px: float = 0.0
    ) -> np.ndarray:
        """Moments of bundles on two planes (2, 4, 3), or two of each position (n, 2, 4, 3); (n, COLUMNS).

        Rays start at the positions, or anywhere on squares of the edge `square_px` around them. They aim at points of
        the regions of anchors less than a pixel away: if positions move while anchors and pixels do not, moments change
        smoothly. See `camera.tracing.moments`.
        """
        if len(self.lights) > 1:
            samples = max(REPLICAS, self.samples_of_each(samples))
            parts = [light.tracer.moments_of(starts, planes, samples, square_px) for light in self.lights]
            return mixed(np.stack(parts, axis=1), np.array([light.share for light in self.lights]))
        result = np.empty((len(starts.positions), COLUMNS))
        planes = np.ascontiguousarray(planes.reshape(-1, 2, 4, 3))
        bits = sobol_bits(samples // REPLICAS)
        seed = self.seed & 0xFFFFFFFF ^ self.seed >> 32 & 0xFFFFFFFF
        draws = Samples(bits, seed, square_px * self.camera.sensor.pitch_mm)
        dtypes = np.int64, np.float64, np.float64, np.int64
        starts = Starts(*(np.ascontiguousarray(part, dtype) for part, dtype in zip(starts, dtypes, strict=True)))
        if self.device is not None:
            from pipeline.camera.on_device import moments_on_device

            moments_on_device(self.device, self.arrays, planes, draws, starts, result)
        else:
            bundle_kernels.bundle_moments(self.arrays, planes, draws, starts, result)
        bundle_kernels.bundle_moments.count(int(np.count_nonzero(starts.microlens != SKIP)) * samples, len(self.table))
        return result

    def samples_of_each(self, samples: int) -> int:
        """Samples of each wavelength, a power of two: in total `samples` or up to twice as many."""
        return max(1, samples >> (len(self.lights).bit_length() - 1))

    @property
    def reference(self) -> tuple[np.ndarray, np.ndarray]:
        """Position (1, 2) of the reference bundle and its microlens (1,).

        On the axis, or behind microlens (0, 0) along the axis.
        """
        array = self.camera.microlenses
        film = self.camera.film.vision_from_film
        if array is None or self.lattice is None:
            return np.zeros((1, 2)), np.array([NO_MICROLENS])
        microlens = np.flatnonzero((self.lattice.k == 0) & (self.lattice.l == 0))[:1]
        slope = np.zeros(2) if film is None else film[2, :2] / film[2, 2]
        return self.vertices_mm[microlens] - slope * array.distance_mm, microlens

    @cached_property
    def reference_weight_sr(self) -> float:
        """W_ref: weight that leaves from the sensor on the axis, or behind the centre of microlens (0, 0) [sr, or
        mm^2].

        By quadrature, right to 1e-8; by random rays, right to 3e-4, if the bundle is not star-shaped.

        Raises CameraError: nothing leaves there, so that no irradiance can be relative to it.
        """
        if len(self.lights) > 1:
            return math.fsum(light.share * light.tracer.reference_weight_sr for light in self.lights)
        position, microlens = self.reference
        planes = parallel_planes(1.0, 2.0)
        rows, status, _ = regions(self.arrays, position, microlens).moments(planes[None], _REFERENCE_NODES)
        if status[0] == NOT_STAR_SHAPED:
            rows = self.moments(position, microlens, planes, _REFERENCE_RAYS, np.array([[-1, -1]]))
        weight = float(rows[0, WEIGHT])
        if not 0 < weight < math.inf:
            start = "the sensor on the axis" if self.lattice is None else "the middle of the microlens in the middle"
            hint = (
                "is an aperture too small or decentred, a surface tilted too far, or a distance in other units than mm?"
            )
            raise CameraError(f"no light passes the lens from {start}", hint=hint)
        return weight


class Light(NamedTuple):
    """One wavelength of a camera's light."""

    share: float  # weight of this wavelength in the signal, if all pass alike
    tracer: Tracer  # tracer of the camera in this light alone


def parallel_planes(near_mm: float, far_mm: float) -> np.ndarray:
    """Two planes perpendicular to the axis with the vision frame's x and y, for the kernels, (2, 4, 3)."""
    planes = np.zeros((2, 4, 3))
    planes[:, ORIGIN, 2] = near_mm, far_mm
    planes[:, FIRST, 0] = planes[:, SECOND, 1] = planes[:, NORMAL, 2] = 1.0
    return planes


def target_plane(vision_from_target: Float64[np.ndarray, "4 4"]) -> np.ndarray:
    """A target's plane with its own x and y axes, for the kernels, (4, 3)."""
    return np.stack([vision_from_target[:3, 3], *vision_from_target[:3, :3].T])
