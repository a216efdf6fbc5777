"""Rays that leave a camera from the squares of its pixels, stretch by stretch."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from pipeline.camera.tracing import bundle_kernels
from pipeline.camera.tracing.records import Leaving, Samples, Squares, room_for
from pipeline.camera.tracing.sampling_bounds import SKIP
from pipeline.camera.tracing.sobol import sobol_bits
from pipeline.records.shapes import Int64
from pipeline.render.band import Band
from pipeline.render.passes import Batch

_RAYS_PER_CHUNK = 1 << 15
"""Rays that are traced before they are shaded, 64 bytes each, so that they stay in the cache."""


@dataclass(frozen=True, slots=True)
class PixelRays:
    """Rays of some pixels.

    Attributes
    ----------
    pixels : (m,) int64
        The pixels, counted from the first row that is wanted.
    squares : Squares
        Of these pixels.
    leaving : Leaving
        Owners are the place of a pixel in `pixels` times the number of microlenses in `squares`, plus the microlens.
    row, way : (n,) int64
        Both parts of the owner of each ray; `way` 0: the microlens of the pixel's cell.
    seed : int
        Of the random numbers of these rays.
    """

    pixels: Int64[np.ndarray, "m"]
    squares: Squares
    leaving: Leaving
    row: Int64[np.ndarray, "n"]
    way: Int64[np.ndarray, "n"]
    seed: int


def rays_of(band: Band, batch: Batch, counts: Int64[np.ndarray, "n s"]) -> Iterator[PixelRays]:
    """Rays of all pixels, so many through each microlens; the next stretch takes the arrays of the last."""
    tracer = band.rig.tracer
    width = tracer.camera.sensor.width_px
    random = Samples(sobol_bits(batch.end), batch.seed(tracer.seed), tracer.camera.sensor.pitch_mm)
    of_pixel, skipped = counts.sum(axis=1), counts * (batch.number > 0)
    pixels = np.flatnonzero(of_pixel)
    room = room_for(0)
    for first, end in _stretches(of_pixel[pixels]):
        some = pixels[first:end]
        most = int(of_pixel[some].sum())
        if len(room.share) < most:
            room = room_for(most)
        y_px, x_px = np.divmod(some + band.rows[0] * width, width)
        strata = np.where(counts[some] > 0, band.strata[some], SKIP)
        squares = Squares(np.stack([x_px, y_px], axis=1), band.positions_mm[some], strata, counts[some], skipped[some])
        count = bundle_kernels.image_rays(tracer.arrays, random, squares, band.rig.diffraction, room)
        bundle_kernels.image_rays.count(most, len(tracer.table))
        leaving = room.first(count)
        yield PixelRays(some, squares, leaving, *np.divmod(leaving.owner, strata.shape[1]), random.seed)


def _stretches(rays: Int64[np.ndarray, "n"]) -> Iterator[tuple[int, int]]:
    """First and end of stretches of pixels, at least one each, that start about `_RAYS_PER_CHUNK` rays together."""
    before = np.concatenate([[0], np.cumsum(rays)])
    first = 0
    while first < len(rays):
        end = int(np.searchsorted(before, before[first] + _RAYS_PER_CHUNK, side="right")) - 1
        end = min(max(end, first + 1), len(rays))
        yield first, end
        first = end
