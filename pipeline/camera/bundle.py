"""The bundle of one image position as rays, for notebooks and for the study of single rays."""

from dataclasses import dataclass

import numpy as np

from pipeline.camera.parts.camera import Camera
from pipeline.camera.parts.errors import CameraError
from pipeline.camera.rig import Rig
from pipeline.camera.tracer import Tracer
from pipeline.camera.tracing import bundle_kernels
from pipeline.camera.tracing.records import Leaving, Samples, Squares, no_diffraction
from pipeline.camera.tracing.sobol import sobol_bits
from pipeline.records.declared import integer, number
from pipeline.records.shapes import Float64

_FARTHEST_PX = 1 << 23
"""Farthest image position [px]: half the distance between streams of random numbers, wider than any sensor."""
_MOST_RAYS = 1 << 24
"""Most rays of a call: they take 1 GiB."""
_LAST_SEED = (1 << 31) - 1
"""Largest seed: that of a stage, `plen:seed`, is a signed integer of 32 bits."""


@dataclass(frozen=True, slots=True)
class Bundle:
    """Rays from one sensor position that leave the camera, vision frame.

    - `origin_mm`, `direction`: a point of each ray on the front surface of the lens, and its unit direction.
    - `weight_sr`: contribution to the integral of cos(theta) d omega at the sensor; of a camera that weighs area in
      mm^2.
    """

    origin_mm: Float64[np.ndarray, "n 3"]
    direction: Float64[np.ndarray, "n 3"]
    weight_sr: Float64[np.ndarray, "n"]

    def at_distance(self, z_mm: float) -> np.ndarray:
        """Crossings with the plane at vision z, (n, 2) [mm]."""
        z_mm = number("z_mm", z_mm, CameraError)
        t = (z_mm - self.origin_mm[:, 2]) / self.direction[:, 2]
        return (self.origin_mm + t[:, None] * self.direction)[:, :2]

    def mean_at(self, z_mm: float) -> np.ndarray:
        """Weighted mean of the crossings: the position image's value there, (2,) [mm]; NaN for an empty bundle."""
        z_mm = number("z_mm", z_mm, CameraError)
        if not self.weight_sr.any():
            return np.full(2, np.nan)
        return np.average(self.at_distance(z_mm), axis=0, weights=self.weight_sr)


def bundle(camera: Camera, x_px: float, y_px: float, *, samples: int = 1024, seed: int = 0) -> Bundle:
    """Trace the bundle of one image position, in a plenoptic camera only through the microlens of its cell.

    `x_px`, `y_px`: image position, (0, 0) is the centre of the top-left pixel.
    `samples`: rays to start for each wavelength of the camera's light, a power of two; blocked ones are left out.

    Raises CameraError: an argument is out of range.
    """
    x_px, y_px = (
        number(name, value, CameraError, -_FARTHEST_PX, _FARTHEST_PX)
        for name, value in (("x_px", x_px), ("y_px", y_px))
    )
    samples = integer("samples", samples, CameraError, 1, _MOST_RAYS)
    seed = integer("seed", seed, CameraError, 0, _LAST_SEED)
    if samples & (samples - 1):
        raise CameraError(f"samples is {samples}", hint=f"a power of two, e.g. {1 << samples.bit_length() - 1}")
    tracer = Tracer(camera, seed)
    position = tracer.positions_mm(np.array([x_px]), np.array([y_px]))
    return bundle_behind(tracer, x_px, y_px, int(Rig.of(tracer).microlens_at(position)[0]), samples)


def bundle_behind(
    tracer: Tracer, x_px: float, y_px: float, microlens: int, samples: int, drawn_at: tuple[int, int] | None = None
) -> Bundle:
    """The bundle of one image position through one microlens, given by its row in the lattice or NO_MICROLENS.

    `samples`: rays to start for each wavelength, a power of two. Positions in the same pixel share their random
    numbers, so that differences between them are smooth.
    `drawn_at`: another pixel whose random numbers the rays take.
    """
    position = tracer.positions_mm(np.array([x_px]), np.array([y_px]))
    pixel = np.array([drawn_at or (round(x_px), round(y_px))])
    squares = Squares(pixel, position, np.array([[microlens]]), np.array([[samples]]), np.array([[0]]))
    bundles = []
    for share, traced in tracer.lights:
        rays = Leaving.empty(samples)
        random = Samples(sobol_bits(samples), traced.seed, 0.0)
        count = bundle_kernels.image_rays(traced.arrays, random, squares, no_diffraction(), rays)
        origin, direction, weight, _ = rays.first(count)
        bundles.append((origin, direction, share * weight))
    return Bundle(*map(np.concatenate, zip(*bundles, strict=True)))
