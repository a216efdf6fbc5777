"""Everything needed to map between the image and the scene: tracer, micro-images, and the definition of J."""

import functools
from dataclasses import dataclass, replace

import numpy as np

from pipeline.camera.micro_images.centres import MicroImages, micro_images
from pipeline.camera.parts.camera import Camera
from pipeline.camera.tracer import Tracer
from pipeline.camera.tracing.moments import FREE_WEIGHT, WEIGHT
from pipeline.camera.tracing.records import Diffraction, no_diffraction
from pipeline.camera.tracing.sampling_bounds import NO_MICROLENS
from pipeline.camera.wave.spread import Middle, spread_of
from pipeline.records.shapes import Float64, Int64


@dataclass(frozen=True, slots=True)
class Rig:
    """A tracer with the data of one image: outlines of micro-images, the definition of J, diffraction, the device."""

    tracer: Tracer
    images: MicroImages | None  # None for a conventional camera
    square_px: float = 0.0  # edge of the square around a position that the rays of J start on; 0: the position itself
    # Wavelength whose diffraction images have, if its light has one; None: images are those of geometry, as J is
    diffraction_nm: float | None = None
    # Device that traces the rays of images, in single precision: a name from `pipeline.jit.device`, or the processor
    device: str | None = None

    @staticmethod
    def of(tracer: Tracer, square_px: float = 0.0) -> "Rig":
        """The rig of a tracer, with its micro-images."""
        images = micro_images(tracer) if tracer.camera.microlenses else None
        return Rig(tracer, images, square_px)

    @property
    def in_each_light(self) -> tuple["Rig", ...]:
        """The rig in each wavelength of its light, in the order of `Tracer.lights`; itself if there is only one."""
        if len(self.tracer.lights) == 1:
            return (self,)
        diffracts = self.diffraction_nm is not None
        rigs = (
            _in_light(light.tracer, self.square_px, node.wavelength_nm if diffracts else None)
            for light, node in zip(self.tracer.lights, self.tracer.camera.spectrum, strict=True)
        )
        return tuple(replace(rig, device=self.device) for rig in rigs)

    @property
    def diffraction(self) -> Diffraction:
        """Spread of a point's light in the image by the apertures, at one wavelength."""
        if self.diffraction_nm is None:
            return no_diffraction()
        return _diffraction(self.tracer.camera, self.diffraction_nm, self.middles)

    @property
    def middles(self) -> tuple[Middle, ...]:
        """Centre of the micro-image and row of the middle microlens of each type; empty without microlenses."""
        if self.images is None or self.tracer.lattice is None:
            return ()
        types = self.tracer.lattice.type
        middles = []
        for number in range(types.max() + 1):
            rows = np.flatnonzero(types == number)
            nearest = rows[np.argmin(np.hypot(*self.tracer.vertices_mm[rows].T))]
            middles.append((*self.images.centre_mm[nearest].tolist(), int(nearest)))
        return tuple(middles)

    @property
    def axial(self) -> np.ndarray:
        """k and l of every cell, (m, 2); zeros for a conventional camera."""
        lattice = self.tracer.lattice
        return np.zeros((1, 2), np.int64) if lattice is None else np.stack([lattice.k, lattice.l], axis=1)

    def microlens(self, cell: Int64[np.ndarray, "n"]) -> np.ndarray:
        """Row of the microlens of each cell, or NO_MICROLENS."""
        return cell if self.images is not None else np.full(len(cell), NO_MICROLENS)

    def microlens_at(self, positions_mm: Float64[np.ndarray, "n 2"]) -> np.ndarray:
        """Row of the microlens in whose cell each position of the sensor (n, 2) lies, or NO_MICROLENS."""
        return np.full(len(positions_mm), NO_MICROLENS) if self.images is None else self.images.owner(positions_mm)

    def home_px(self, cell: Int64[np.ndarray, "n"]) -> np.ndarray:
        """Position in each cell where light surely arrives: the centre of the micro-image, or of the image."""
        if self.images is not None:
            return self.tracer.pixels_at(self.images.centre_mm[cell])
        return np.tile((np.array(self.tracer.camera.sensor.size_px) - 1) / 2, (len(cell), 1))

    def in_image(self, x_px: Float64[np.ndarray, "n 2"], grace_px: float = 0.0) -> np.ndarray:
        """Whether positions lie in the image, or at most `grace_px` outside."""
        size = np.array(self.tracer.camera.sensor.size_px)
        return np.all(np.abs(x_px - (size - 1) / 2) <= size / 2 + grace_px, axis=1)

    def in_cell(
        self, x_px: Float64[np.ndarray, "n 2"], cell: Int64[np.ndarray, "n"], grace_px: float = 0.0
    ) -> np.ndarray:
        """Whether positions lie in their own cell, or at most `grace_px` nearer to another centre."""
        if self.images is None:
            return np.ones(len(cell), bool)
        x = self.tracer.positions_mm(*x_px.T)
        if grace_px == 0:
            return self.images.owner(x) == cell
        to_own_mm = np.hypot(*(x - self.images.centre_mm[cell]).T)
        to_nearest_mm = self.images.nearby.nearest(x)[0][:, 0]
        return to_own_mm - to_nearest_mm <= grace_px * self.tracer.camera.sensor.pitch_mm

    def hit_fraction(self, moments: Float64[np.ndarray, "n COLUMNS"]) -> np.ndarray:
        """Weight of the light that leaves over that of the free bundle."""
        free = moments[:, FREE_WEIGHT] if self.images is not None else self.tracer.reference_weight_sr
        return moments[:, WEIGHT] / free


@functools.lru_cache(maxsize=8)
def _in_light(tracer: Tracer, square_px: float, diffraction_nm: float | None) -> Rig:
    """The rig of one wavelength, remembered for the tiles and frames of an image: micro-images take time."""
    return replace(Rig.of(tracer, square_px), diffraction_nm=diffraction_nm)


@functools.lru_cache(maxsize=8)
def _diffraction(camera: Camera, wavelength_nm: float, middles: tuple[Middle, ...]) -> Diffraction:
    """The spread of a camera's apertures, remembered for the tiles and frames of an image."""
    return spread_of(Tracer(camera), wavelength_nm, middles)
