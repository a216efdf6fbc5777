"""Images: relative irradiance of every pixel, by tracing rays from the pixel's square through the camera.

The rays that leave the camera do not depend on the scene, so images of several scenes share them. Pixels that see
one colour take no rays of their own: they are that colour times the light of a white scene.
"""

from collections.abc import Callable, Sequence

import numpy as np

from pipeline.camera.rig import Rig
from pipeline.camera.tracing.sampling_bounds import SKIP
from pipeline.records.shapes import Float64
from pipeline.render.band import Band, Rows
from pipeline.render.footprints import Footprints
from pipeline.render.glow import TargetLight
from pipeline.render.lighting.lit_scene import LitScene
from pipeline.render.passes import Batch, batch_of
from pipeline.render.pixel_rays import rays_of

Radiance = Callable[[np.ndarray, np.ndarray], np.ndarray]
"""(n, 3) origins and directions, vision frame, to (n,) radiances."""

_FEWEST = 4
"""Inverse of the least share of the samples: with fewer rays a single rare one would be visible."""


def irradiance(rig: Rig, samples: int, radiance: Radiance | None, rows: Rows | None = None) -> np.ndarray:
    """Integral of L over each pixel's rays, by the camera's weight, relative to that of a white scene on the axis.

    Light through neighbouring microlenses is included.

    `samples`: rays per pixel and microlens, a power of two.
    `radiance`: None stands for a white scene: the white image.
    `rows`: first and end row to compute; values are those of the whole image.
    Returns (height, width) float64.
    """
    return irradiance_and_crosstalk(rig, samples, radiance, rows)[0]


def irradiance_and_crosstalk(
    rig: Rig, samples: int | Batch, radiance: Radiance | None, rows: Rows | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """The image, and its part that came through other microlenses than that of the pixel's cell.

    `samples`: see `irradiance`; or which of them.
    Returns (height, width) float64, (height, width) float64: see `irradiance`.
    """
    band, batch = Band.of(rig, rows), batch_of(samples)
    result, foreign = np.zeros((2, len(band.strata)))
    for rays in rays_of(band, batch, np.where(band.strata == SKIP, 0, batch.samples)):
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

    `white`: the white image of the same rows in these two parts, relative; a conventional camera has no second one, and
        the noise of its rays in images only if its white image is of the same rays.
    """
    band, parts = Band.of(rig, rows), white.reshape(2, -1)
    colour, known = colours(band, scenes), parts[0] if rig.images is None else None
    image = np.where(np.isnan(colour), sampled(band, Batch(samples), scenes, parts, colour, known), colour * parts)
    return image.sum(axis=1).reshape(-1, *white.shape[1:])


def colours(band: Band, scenes: Sequence[TargetLight | LitScene]) -> np.ndarray:
    """Colour of both parts of each pixel, (scenes, 2, n); NaN where it must be sampled."""
    sight = Footprints(band)
    return np.array([scene.seen(sight) for scene in scenes])


def sampled(
    band: Band,
    batch: Batch,
    scenes: Sequence[TargetLight | LitScene],
    white: Float64[np.ndarray, "2 n"],
    colour: Float64[np.ndarray, "scenes 2 n"],
    known: Float64[np.ndarray, "n"] | None,
) -> np.ndarray:
    """Sampled light of both parts of each pixel, relative, (scenes, 2, n); 0 where `colour` is known.

    `white`: the white image in these two parts, by whose light rays are shared out.
    `known`: the white image of a conventional camera without noise, by which images are steadied.
    """
    count, wanted = len(band.strata), np.isnan(colour)
    counts = _counts(batch.first, white, wanted.any(axis=0), band.strata) * (batch.samples // batch.first)
    result, flux = np.zeros((len(scenes), 2 * count)), np.zeros(count)
    for rays in rays_of(band, batch, counts):
        part = rays.pixels[rays.row] + count * (rays.way > 0)
        flux[rays.pixels] = np.bincount(rays.row, rays.leaving.share, minlength=len(rays.pixels))
        for scene, is_sampled, image in zip(scenes, wanted, result, strict=True):
            scene.add(rays, part, is_sampled.ravel(), image)
    result, flux = _relative(band.rig, result), _relative(band.rig, flux)
    if known is not None:
        with np.errstate(invalid="ignore", divide="ignore"):
            seen = np.where(wanted[:, 0], np.where(flux > 0, result[:, :count] / flux, np.nan), colour[:, 0])
        for is_sampled, image, radiance in zip(wanted[:, 0], result, seen, strict=True):
            image[:count][is_sampled] += _steadied(radiance.reshape(band.shape), known - flux)[is_sampled]
    return result.reshape(wanted.shape)


def _steadied(seen: Float64[np.ndarray, "y x"], missing: Float64[np.ndarray, "n"]) -> np.ndarray:
    """Light to be added to each pixel because its rays happen to carry more or less flux than is known, (n,).

    A control variate: the missing flux times the radiance that the pixel and those on both sides see, of the darkest
    one. Where all see one radiance, no noise of rays is left; at an edge nothing of the bright side comes to the dark
    one. The pixels beside have random numbers of their own, so that they bring no bias. A pixel darker than both
    becomes the mean radiance of its rays times the known flux: weights of rays that leave differ by a thousandth, and
    so little is the bias of such a quotient.
    """
    beside = np.pad(seen, ((0, 0), (1, 1)), constant_values=np.nan)
    darkest = np.fmin(np.fmin(beside[:, :-2], beside[:, 2:]), seen)
    return np.asarray(np.nan_to_num(darkest).ravel() * missing)


def _counts(samples: int, white: np.ndarray, wanted: np.ndarray, strata: np.ndarray) -> np.ndarray:
    """Rays through each microlens that lights a pixel, (n, s): all samples for the ones with most of its light,
    fewer for others.

    For a given total error the number of samples should grow with the root of the light; a quarter of them is the
    least.

    `white`, `wanted`, (2, n) float64, (2, n) bool: light of both parts of each pixel, and whether it is sampled.
    `strata`, (n, s) int64.
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


def _relative(rig: Rig, flux: np.ndarray) -> np.ndarray:
    """Integrals of pixels, over that of a white scene on the axis."""
    return flux / rig.tracer.reference_weight_sr
