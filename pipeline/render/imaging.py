"""Images: relative irradiance of every pixel, by tracing rays from the pixel's square through the camera.

The rays that leave the camera do not depend on the scene, so images of several scenes share them. Pixels that see
one colour take no rays of their own: they are that colour times the light of a white scene.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from pipeline.camera.rig import Rig
from pipeline.camera.tracing import bundle_kernels
from pipeline.camera.tracing.records import Leaving, Samples, Squares, room_for
from pipeline.camera.tracing.sampling_bounds import SKIP
from pipeline.camera.tracing.sobol import sobol_bits
from pipeline.records.shapes import Float64
from pipeline.render.band import Band, Rows
from pipeline.render.footprints import Sight
from pipeline.render.glow.light import TargetLight
from pipeline.render.lighting.lit_scene import LitScene
from pipeline.render.passes import Batch, batch_of

Radiance = Callable[[np.ndarray, np.ndarray], np.ndarray]
"""(n, 3) origins and directions, vision frame, to (n,) radiances."""

_RAYS_PER_CHUNK = 1 << 15
"""Rays that are traced before they are shaded, 64 bytes each, so that they stay in the cache."""
_FEWEST = 4
"""Inverse of the least share of the samples: with fewer rays a single rare one would be visible."""


def irradiance(rig: Rig, samples: int, radiance: Radiance | None, rows: Rows | None = None) -> np.ndarray:
    """Integral of L over each pixel's rays, by the camera's weight, relative to that of a white scene on the axis.

    Light through neighbouring microlenses is included.

    Parameters
    ----------
    samples : int
        Rays per pixel and microlens, a power of two.
    radiance : callable or None
        None stands for a white scene: the white image.
    rows : (int, int), optional
        First and end row to compute; values are those of the whole image.

    Returns
    -------
    (height, width) float64
    """
    return irradiance_and_crosstalk(rig, samples, radiance, rows)[0]


def irradiance_and_crosstalk(
    rig: Rig, samples: int | Batch, radiance: Radiance | None, rows: Rows | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """The image, and its part that came through other microlenses than that of the pixel's cell.

    Parameters
    ----------
    samples : int or Batch
        See `irradiance`; or which of them.

    Returns
    -------
    (height, width) float64, (height, width) float64
        See `irradiance`.
    """
    band, batch = Band.of(rig, rows), batch_of(samples)
    result, foreign = np.zeros((2, len(band.strata)))
    for rays in _rays(band, batch, np.where(band.strata == SKIP, 0, batch.samples)):
        origin, direction, share, _ = rays.leaving
        value = share if radiance is None else share * radiance(origin, direction)
        other = rays.way > 0
        result[rays.pixels] = np.bincount(rays.row, value, minlength=len(rays.pixels))
        foreign[rays.pixels] = np.bincount(rays.row[other], value[other], minlength=len(rays.pixels))
    return _relative(rig, result).reshape(band.shape), _relative(rig, foreign).reshape(band.shape)


def pictures(
    rig: Rig,
    samples: int,
    scenes: Sequence[TargetLight | LitScene],
    white: Float64[np.ndarray, "2 height width"],
    rows: Rows | None = None,
) -> np.ndarray:
    """Images of several scenes, (scenes, height, width); each is identical, to the bit, to the image computed alone.

    Light through the microlens of a pixel's cell and light through other microlenses are treated separately: a part
    of one colour is that colour times `white`; other parts are sampled.

    Parameters
    ----------
    white : (2, height, width) float64
        The white image of the same rows in these two parts, relative; a conventional camera has no second one.
    """
    band, parts = Band.of(rig, rows), white.reshape(2, -1)
    colour = colours(band, scenes)
    image = np.where(np.isnan(colour), sampled(band, Batch(samples), scenes, parts, colour), colour * parts)
    return image.sum(axis=1).reshape(-1, *white.shape[1:])


def colours(band: Band, scenes: Sequence[TargetLight | LitScene]) -> np.ndarray:
    """Colour of both parts of each pixel, (scenes, 2, n); NaN where it must be sampled."""
    sight = Sight(band)
    return np.array([scene.seen(sight) for scene in scenes])


def sampled(
    band: Band,
    batch: Batch,
    scenes: Sequence[TargetLight | LitScene],
    white: Float64[np.ndarray, "2 n"],
    colour: Float64[np.ndarray, "scenes 2 n"],
) -> np.ndarray:
    """Sampled light of both parts of each pixel, relative, (scenes, 2, n); 0 where `colour` is known.

    Parameters
    ----------
    white : (2, n) float64
        The white image in these two parts, by whose light rays are shared out.
    """
    count, wanted = len(band.strata), np.isnan(colour)
    counts = _counts(batch.first, white, wanted.any(axis=0), band.strata) * (batch.samples // batch.first)
    result = np.zeros((len(scenes), 2 * count))
    for rays in _rays(band, batch, counts):
        part = rays.pixels[rays.row] + count * (rays.way > 0)
        for scene, own, image in zip(scenes, wanted, result, strict=True):
            scene.add(rays.leaving, part, own.ravel(), image)
    return _relative(band.rig, result).reshape(wanted.shape)


def _counts(samples: int, white: np.ndarray, wanted: np.ndarray, strata: np.ndarray) -> np.ndarray:
    """Rays through each microlens that lights a pixel, (n, s): all samples for the ones with most of its light,
    fewer for others.

    For a given total error the number of samples should grow with the root of the light; a quarter of them is the
    least.

    Parameters
    ----------
    white, wanted : (2, n) float64, (2, n) bool
        Light of both parts of each pixel, and whether it is sampled.
    strata : (n, s) int64
    """
    with np.errstate(invalid="ignore"):  # dark pixels
        share = np.sqrt(white / white.sum(axis=0))
    least = max(1, samples // _FEWEST)
    number = np.full(share.shape, samples)
    while (fewer := (number // 2 >= least) & (share * samples <= number // 2)).any():
        number[fewer] //= 2
    number[~wanted] = 0
    places = (np.arange(strata.shape[1]) > 0).astype(int)
    return np.where(strata == SKIP, 0, number[places].T)


@dataclass(frozen=True, slots=True)
class _Rays:
    """Rays of some pixels.

    Attributes
    ----------
    pixels : (m,) int64
        The pixels, counted from the first row that is wanted.
    leaving : Leaving
    row, way : (n,) int64
        Place of the ray's pixel in `pixels`, and that of the microlens among those that light it; 0: its cell's.
    """

    pixels: np.ndarray
    leaving: Leaving
    row: np.ndarray
    way: np.ndarray


def _relative(rig: Rig, flux: np.ndarray) -> np.ndarray:
    """Integrals of pixels, over that of a white scene on the axis."""
    return flux / rig.tracer.reference_weight_sr


def _rays(band: Band, batch: Batch, counts: np.ndarray) -> Iterator[_Rays]:
    """Rays of all pixels, so many through each microlens (n, s); the next stretch takes the arrays of the last."""
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
        yield _Rays(some, leaving, *np.divmod(leaving.owner, band.strata.shape[1]))


def _stretches(rays: np.ndarray) -> Iterator[tuple[int, int]]:
    """First and end of stretches of pixels, at least one each, that start about `_RAYS_PER_CHUNK` rays together."""
    before = np.concatenate([[0], np.cumsum(rays)])
    first = 0
    while first < len(rays):
        end = int(np.searchsorted(before, before[first] + _RAYS_PER_CHUNK, side="right")) - 1
        end = min(max(end, first + 1), len(rays))
        yield first, end
        first = end
