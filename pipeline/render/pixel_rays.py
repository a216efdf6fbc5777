"""Rays that leave a camera from the squares of pixels, for rows of an image, and its passes, until the noise is as low
as requested.

The first pass takes some samples of each replica, and every further one as many as all before it together. So the
samples of a pass continue the Sobol sequence of those before, and after each pass they are evenly spread again.
Replicas are scrambled independently: the spread of their images estimates the noise of their mean, which a single
low-discrepancy sequence cannot do (randomised quasi-Monte Carlo: Owen 1997).
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from pipeline.camera.micro_images.centres import pixel_strata, positions_of
from pipeline.camera.rig import Rig
from pipeline.camera.tracing import bundle_kernels
from pipeline.camera.tracing.records import Leaving, Samples, Squares
from pipeline.camera.tracing.sampling_bounds import SKIP
from pipeline.camera.tracing.sobol import sobol_bits
from pipeline.records.shapes import Float64, Int64

_REPLICA_STEP = 0x85EBCA77
"""Distance of the seeds of two replicas [1]: a prime of xxHash, so large that small seeds of wavelengths never meet."""
_SEED_BITS = 0xFFFFFFFF
"""Mask of the bits of a seed."""


@dataclass(frozen=True, slots=True)
class Batch:
    """Samples of one replica in one pass."""

    first: int  # samples of the first pass through a microlens, a power of two
    number: int = 0  # the pass, from 0
    replica: int = 0

    @property
    def samples(self) -> int:
        """Samples of this pass: the first ones, or as many as all passes before it."""
        return self.first << max(0, self.number - 1)

    @property
    def end(self) -> int:
        """Samples of all passes up to this one."""
        return self.first << self.number

    def seed(self, of_camera: int) -> int:
        """Seed of the replica's random numbers; of the first replica it is the camera's own."""
        return (of_camera + self.replica * _REPLICA_STEP) & _SEED_BITS


def batch_of(samples: int | Batch) -> Batch:
    """These samples as the only batch."""
    return samples if isinstance(samples, Batch) else Batch(samples)


def joined(earlier: Float64[np.ndarray, "..."] | None, new: Float64[np.ndarray, "..."]) -> np.ndarray:
    """Means over all samples, from those over all earlier passes and over a new one, which has as many."""
    return new if earlier is None else 0.5 * (earlier + new)


def standard_error(replicas: Float64[np.ndarray, "replicas ..."]) -> np.ndarray:
    """Standard error of the mean of independent images, (...), pixel by pixel; its square is unbiased."""
    return np.std(replicas, axis=0, ddof=1) / math.sqrt(len(replicas))  # type: ignore[no-any-return]


def noise_of(error: Float64[np.ndarray, "..."]) -> float:
    """Root mean square of the standard errors of all pixels that have any; 0 if none has."""
    positive = error[error > 0]
    return float(np.sqrt(np.mean(positive**2))) if len(positive) else 0.0


_RAYS_PER_CHUNK = 1 << 15
"""Rays traced before they are shaded, 64 bytes each, so that they stay in the cache."""
_RAYS_ON_DEVICE = 1 << 21
"""Rays on a device at a time, 28 bytes each."""


Rows = tuple[int, int]
"""First and end of some rows, or columns, of an image."""


@dataclass(frozen=True, slots=True)
class Band:
    """Rows of an image, or some columns of them."""

    rig: Rig
    rows: Rows
    columns: Rows
    positions_mm: Float64[np.ndarray, "n 2"]  # centres of their pixels on the sensor, row by row, vision frame
    strata: Int64[np.ndarray, "n s"]  # microlenses that light each pixel, see `camera.micro_images.centres`

    @classmethod
    def of(cls, rig: Rig, rows: Rows | None = None, columns: Rows | None = None) -> "Band":
        """The band of some rows and columns, by default all."""
        width_px, height_px = rig.tracer.camera.sensor.size_px
        rows = rows or (0, height_px)
        columns = columns or (0, width_px)
        strata = pixel_strata(rig.tracer, rig.images, rows, rig.diffraction.reach_mm, columns)
        return cls(rig, rows, columns, positions_of(rig.tracer, rows, columns), strata)

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns."""
        return self.rows[1] - self.rows[0], self.columns[1] - self.columns[0]


@dataclass(frozen=True, slots=True)
class PixelRays:
    """Rays of some pixels."""

    pixels: Int64[np.ndarray, "m"]  # the pixels, counted from the first row that is wanted
    squares: Squares  # of these pixels
    # owners are indices of pixels in `pixels` times the number of microlenses in `squares`, plus the microlens
    leaving: Leaving
    # both parts of the owner of each ray; `route` 0: the microlens of the pixel's cell
    row: Int64[np.ndarray, "n"]
    route: Int64[np.ndarray, "n"]
    seed: int  # that of the random numbers of these rays


@dataclass(frozen=True, slots=True)
class _RayRequest:
    """Requested rays of a band: number per pixel and microlens, and the samples that they are."""

    band: Band
    batch: Batch
    counts: Int64[np.ndarray, "n s"]

    @property
    def samples(self) -> Samples:
        tracer = self.band.rig.tracer
        return Samples(sobol_bits(self.batch.end), self.batch.seed(tracer.seed), tracer.camera.sensor.pitch_mm)

    def squares(self, indices: Int64[np.ndarray, "m"]) -> Squares:
        """Squares of some pixels of the band, from which their rays start."""
        row, column = np.divmod(indices, self.band.shape[1])
        counts = self.counts[indices]
        strata = np.where(counts > 0, self.band.strata[indices], SKIP)
        pixels = np.stack([column + self.band.columns[0], row + self.band.rows[0]], axis=1)
        return Squares(pixels, self.band.positions_mm[indices], strata, counts, counts * (self.batch.number > 0))

    def rays(self, indices: Int64[np.ndarray, "m"], squares: Squares, leaving: Leaving) -> PixelRays:
        row, route = np.divmod(leaving.owner, self.counts.shape[1])
        return PixelRays(indices, squares, leaving, row, route, self.batch.seed(self.band.rig.tracer.seed))


def rays_of(band: Band, batch: Batch, counts: Int64[np.ndarray, "n s"]) -> Iterator[PixelRays]:
    """Rays of all pixels, this many through each microlens; the next stretch reuses the arrays of the last."""
    request = _RayRequest(band, batch, counts)
    return _by_processor(request) if band.rig.device is None else _by_device(request)


def _by_processor(request: _RayRequest) -> Iterator[PixelRays]:
    """Rays traced by the processor, in stretches that stay in its cache."""
    tracer = request.band.rig.tracer
    samples = request.samples
    buffer = Leaving.empty(0)
    rays_of_pixel = request.counts.sum(axis=1)
    pixels = np.flatnonzero(rays_of_pixel)
    for first, end in _stretches(rays_of_pixel[pixels], _RAYS_PER_CHUNK):
        stretch = pixels[first:end]
        started = int(rays_of_pixel[stretch].sum())
        if len(buffer.share) < started:
            buffer = Leaving.empty(started)
        squares = request.squares(stretch)
        leaving = bundle_kernels.image_rays(tracer.arrays, samples, squares, request.band.rig.diffraction, buffer)
        bundle_kernels.image_rays.count(started, len(tracer.table))
        yield request.rays(stretch, squares, buffer.first(leaving))


def _by_device(request: _RayRequest) -> Iterator[PixelRays]:
    """Rays traced on a device for large groups of pixels, but handed on in stretches as short as `_by_processor` has:
    processors shade them, and a stretch stays in their cache.
    """
    from pipeline.camera.on_device import ImageRays, leaving_rays

    tracer = request.band.rig.tracer
    rays_of_pixel = request.counts.sum(axis=1)
    buffer = Leaving.empty(_RAYS_PER_CHUNK)
    assert request.band.rig.device is not None
    tracing = ImageRays(request.band.rig.device, tracer.arrays, request.samples, request.band.rig.diffraction)
    pixels = np.flatnonzero(rays_of_pixel)
    for first, end in _stretches(rays_of_pixel[pixels], _RAYS_ON_DEVICE):
        # Trace all rays that start at a group of pixels; those that are blocked keep their positions among them.
        group = pixels[first:end]
        rays = tracing.started(request.squares(group))
        # Copy those that leave the camera, stretch by stretch. A pixel with more rays than a stretch needs more room.
        started_before = 0
        for low, high in _stretches(rays_of_pixel[group], _RAYS_PER_CHUNK):
            stretch = group[low:high]
            squares = request.squares(stretch)
            started = int(rays_of_pixel[stretch].sum())
            buffer = buffer if started <= len(buffer.share) else Leaving.empty(started)
            leaving = leaving_rays(rays, started_before, squares.counts, buffer)
            yield request.rays(stretch, squares, buffer.first(leaving))
            started_before += started


def _stretches(rays: Int64[np.ndarray, "n"], most_rays: int) -> Iterator[tuple[int, int]]:
    """First and end of stretches of pixels that start so many rays together at most; a pixel with more is alone."""
    before = np.concatenate([[0], np.cumsum(rays)])  # rays of all pixels before each
    first = 0
    while first < len(rays):
        end = int(np.searchsorted(before, before[first] + most_rays, side="right")) - 1
        end = min(max(end, first + 1), len(rays))
        yield first, end
        first = end
