"""Images: relative irradiance of every pixel, by tracing rays from the pixel's square through the camera.

Light of several wavelengths is summed, all relative to the white scene on the axis. The rays that leave the camera do
not depend on the scene, so images of several scenes share them. A pixel of uniform colour takes no rays of its own: it
is that colour times the light of a white scene. Random rays only estimate that light; without microlenses it varies
smoothly over the sensor, and is computed by quadrature at a few positions and interpolated by cubics.
"""

import itertools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import ClassVar, Protocol

import numpy as np

from pipeline.camera.integrals import Bundles, integrals
from pipeline.camera.rig import Rig
from pipeline.camera.tracer import Tracer, parallel_planes
from pipeline.camera.tracing.moments import WEIGHT
from pipeline.camera.tracing.sampling_bounds import NO_MICROLENS, SKIP
from pipeline.records.shapes import Bool, Float64, Int64
from pipeline.render.footprints import Footprints
from pipeline.render.pixel_rays import Band, Batch, PixelRays, Rows, batch_of, rays_of

_STEP_PX = 16
"""Most pixels between two positions."""
_STEPS = 40
"""Least number of steps along the longer edge, unless there are fewer pixels [1]: cubics are then right to 1e-4 rms, to
1.5e-3 where vignetting begins at the edge of the image, and to 1e-6 without vignetting.
"""
_CUBIC = 4
"""Positions that a cubic interpolates."""
_LEVEL = 1
"""Level of quadrature, see `integrals`: right to 1e-6."""


class Scene(Protocol):
    """Everything before a camera at one wavelength of an image, such as `glow.TargetLight`."""

    def uniform(self, sight: Footprints, /) -> np.ndarray:
        """Colour of both parts of each pixel, (2, n); NaN where it must be sampled."""
        ...

    def add(
        self,
        of_pixels: PixelRays,
        pixels: Int64[np.ndarray, "n"],
        wanted: Bool[np.ndarray, "m"],
        image: Float64[np.ndarray, "m"],
        /,
    ) -> None:
        """Add the light of rays to their pixels (n,) of an image, if these are wanted."""
        ...


class SceneView(Protocol):
    """Everything before a camera."""

    is_sampled: ClassVar[bool]
    """Whether its light is known by rays alone: passes are then steadied by the known flux of a pixel's rays."""

    def in_light(self, number: int, /) -> Scene:
        """The view at one wavelength, in the order of `Rig.in_each_light`."""
        ...


def known_flux(band: Band) -> np.ndarray | None:
    """Integral of the weight of all rays that leave from each pixel of a band, (n,); None if it is not smooth enough.

    That is so behind microlenses, with diffraction, for images of fewer than four pixels along an edge, and where
    bundles are empty, in pieces or have holes.
    """
    sensor = band.rig.tracer.camera.sensor
    size_px = sensor.height_px, sensor.width_px
    if band.rig.images is not None or band.rig.diffraction_nm is not None or min(size_px) < _CUBIC:
        return None
    step_px = min(float(_STEP_PX), max(1.0, max(size_px) / _STEPS))
    rows = _Cubics.of(sensor.height_px, np.arange(*band.rows), step_px)
    columns = _Cubics.of(sensor.width_px, np.arange(*band.columns), step_px)
    y_px, x_px = np.meshgrid(rows.positions_px, columns.positions_px, indexing="ij")
    positions = np.stack([x_px.ravel(), y_px.ravel()], axis=1)
    planes = np.broadcast_to(parallel_planes(1.0, 2.0), (len(positions), 2, 4, 3))
    integral = integrals(band.rig.tracer, Bundles(positions, np.full(len(positions), NO_MICROLENS), planes), _LEVEL)
    flux = integral.moments[:, WEIGHT]
    if integral.is_random.any() or not (flux > 0).all():
        return None
    return _between(flux.reshape(y_px.shape), rows, columns).ravel()


@dataclass(frozen=True, slots=True)
class _Cubics:
    """Cubics through positions along an edge of an image."""

    positions_px: np.ndarray  # (m,), all lie in the image; a pixel has the same four whichever others are asked for
    # (n, 4), those of each pixel, and their weights in its value, by Lagrange
    nodes: np.ndarray
    weight: np.ndarray

    @staticmethod
    def of(size_px: int, pixels: Int64[np.ndarray, "n"], step_px: float) -> "_Cubics":
        """Cubics for some pixels of an edge of this length, through positions at most a step apart."""
        count = max(_CUBIC, math.ceil((size_px - 1) / step_px) + 1)
        step = (size_px - 1) / (count - 1)
        first = np.clip((pixels / step).astype(int) - 1, 0, count - _CUBIC)
        nodes = first[:, None] + np.arange(_CUBIC)
        from_node = pixels[:, None] / step - nodes
        weight = np.ones(nodes.shape)
        for node, other in itertools.permutations(range(_CUBIC), 2):
            weight[:, node] *= from_node[:, other] / (node - other)
        used = np.unique(nodes)
        return _Cubics(used * step, np.searchsorted(used, nodes), weight)


def _between(values: Float64[np.ndarray, "y x"], rows: _Cubics, columns: _Cubics) -> np.ndarray:
    """Values of all pixels, summed term by term: a product of matrices would round differently for other rows."""
    result = np.zeros((len(rows.nodes), len(columns.nodes)))
    for i, j in itertools.product(range(_CUBIC), repeat=2):
        weight = rows.weight[:, i, None] * columns.weight[None, :, j]
        result += weight * values[rows.nodes[:, i, None], columns.nodes[None, :, j]]
    return result


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
    """
    return irradiance_and_crosstalk(rig, samples, radiance, rows)[0]


def irradiance_and_crosstalk(
    rig: Rig, samples: int | Batch, radiance: Radiance | None, rows: Rows | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """The image, and its part through microlenses other than that of the pixel's cell, (h, w) each: see `irradiance`.

    `samples`: their number, or a batch of them.
    """
    band = Band.of(rig, rows)
    batch = batch_of(samples)
    result, foreign = np.zeros((2, len(band.strata)))
    for rays in rays_of(band, batch, np.where(band.strata == SKIP, 0, batch.samples)):
        origin, direction, share, _ = rays.leaving
        value = share if radiance is None else share * radiance(origin, direction)
        other = rays.route > 0
        result[rays.pixels] = np.bincount(rays.row, value, minlength=len(rays.pixels))
        foreign[rays.pixels] = np.bincount(rays.row[other], value[other], minlength=len(rays.pixels))
    return _relative(rig, result).reshape(band.shape), _relative(rig, foreign).reshape(band.shape)


def pictures(
    rig: Rig,
    samples: int,
    scenes: Sequence[Scene],
    white: Float64[np.ndarray, "2 height width"],
    rows: Rows | None = None,
    columns: Rows | None = None,
) -> np.ndarray:
    """Images of several scenes, (scenes, height, width); each is identical, to the bit, to the image computed alone.

    So are some rows, and some columns but for the first and the last of them: neighbouring pixels of a conventional
    camera share a control variate.

    Light through the microlens of a pixel's cell and light through other microlenses are treated separately: a part of
    one colour is that colour times `white`; other parts are sampled.

    `white`: the white image of the same pixels in these two parts, relative. For a conventional camera there is no
    second part, and the noise of its rays enters images only if its white image is of the same rays.
    """
    band = Band.of(rig, rows, columns)
    parts = white.reshape(2, -1)
    colour = colours(band, scenes)
    exact = parts[0] if rig.images is None else None
    image = np.where(np.isnan(colour), sampled(band, Batch(samples), scenes, parts, colour, exact), colour * parts)
    return image.sum(axis=1).reshape(-1, *white.shape[1:])


def colours(band: Band, scenes: Sequence[Scene]) -> np.ndarray:
    """Colour of both parts of each pixel, (scenes, 2, n); NaN where it must be sampled."""
    sight = Footprints(band)
    return np.array([scene.uniform(sight) for scene in scenes])


def sampled(
    band: Band,
    batch: Batch,
    scenes: Sequence[Scene],
    white: Float64[np.ndarray, "2 n"],
    colour: Float64[np.ndarray, "scenes 2 n"],
    exact: Float64[np.ndarray, "n"] | None,
) -> np.ndarray:
    """Sampled light of both parts of each pixel, relative, (scenes, 2, n); 0 where `colour` is decided.

    `white`: the white image in these two parts, by whose light rays are shared out.
    `exact`: the white image of a conventional camera without noise, the control variate of images.
    """
    count = len(band.strata)
    wanted = np.isnan(colour)
    counts = _counts(batch.first, white, wanted.any(axis=0), band.strata) * (batch.samples // batch.first)
    result = np.zeros((len(scenes), 2 * count))
    flux = np.zeros(count)
    for rays in rays_of(band, batch, counts):
        part = rays.pixels[rays.row] + count * (rays.route > 0)
        flux[rays.pixels] = np.bincount(rays.row, rays.leaving.share, minlength=len(rays.pixels))
        for scene, is_sampled, image in zip(scenes, wanted, result, strict=True):
            scene.add(rays, part, is_sampled.ravel(), image)
    result = _relative(band.rig, result)
    flux = _relative(band.rig, flux)
    if exact is not None:
        with np.errstate(invalid="ignore", divide="ignore"):
            mean = np.where(wanted[:, 0], np.where(flux > 0, result[:, :count] / flux, np.nan), colour[:, 0])
        for is_sampled, image, radiance in zip(wanted[:, 0], result, mean, strict=True):
            correction = _control_variate(radiance.reshape(band.shape), exact - flux)
            image[:count][is_sampled] += correction[is_sampled]
    return result.reshape(wanted.shape)


def _control_variate(radiance: Float64[np.ndarray, "y x"], missing_flux: Float64[np.ndarray, "n"]) -> np.ndarray:
    """Light to add to each pixel because its rays carry less flux than the exact flux, or more, (n,).

    It is the missing flux times a radiance: of those that the pixel and its neighbours on both sides see, the least.
    Where all see one radiance, no noise of rays is left; at an edge nothing of the bright side comes to the dark one.
    Neighbours have random numbers of their own, so that they bring no bias. A pixel darker than both becomes the mean
    radiance of its rays times the known flux: weights of rays that leave differ by a thousandth, and so little is the
    bias of such a quotient.
    """
    padded = np.pad(radiance, ((0, 0), (1, 1)), constant_values=np.nan)
    darkest = np.fmin(np.fmin(padded[:, :-2], padded[:, 2:]), radiance)
    return np.asarray(np.nan_to_num(darkest).ravel() * missing_flux)


def _counts(samples: int, white: np.ndarray, wanted: np.ndarray, strata: np.ndarray) -> np.ndarray:
    """Rays through each microlens that lights a pixel, (n, s): all samples for those with most of its light.

    For a given total error the number of samples should grow with the root of the light; a quarter of them is the
    least. `white` and `wanted`, (2, n): light of both parts of each pixel, and whether it is sampled.
    """
    with np.errstate(invalid="ignore"):  # dark pixels
        share = np.sqrt(white / white.sum(axis=0))
    least = max(1, samples // _FEWEST)
    number = np.full(share.shape, samples)
    # Halve numbers as long as they stay enough: a number that is a power of two keeps Sobol points even.
    while (is_halved := (number // 2 >= least) & (share * samples <= number // 2)).any():
        number[is_halved] //= 2
    number[~wanted] = 0
    part = (np.arange(strata.shape[1]) > 0).astype(int)  # the first microlens is that of the pixel's cell
    return np.where(strata == SKIP, 0, number[part].T)


def _relative(rig: Rig, flux: np.ndarray) -> np.ndarray:
    """Integrals of pixels, over that of a white scene on the axis."""
    return flux / rig.tracer.reference_weight_sr


def white_parts(rig: Rig, samples: int | Batch, rows: Rows | None = None) -> np.ndarray:
    """The white image and its part through microlenses other than that of the pixel's cell, by wavelength.

    `samples`: as in `irradiance_and_crosstalk`, of all wavelengths together.
    Returns (2, height, width, wavelengths) float64: each relative to the white scene on the axis in the same light;
        `over_wavelengths` is their mean.
    """
    shared = _shared(rig.tracer, batch_of(samples))
    parts = [irradiance_and_crosstalk(in_light, shared, None, rows) for in_light in rig.in_each_light]
    return np.stack([np.stack(part) for part in parts], axis=-1)


def known_white_parts(rig: Rig, rows: Rows | None = None) -> np.ndarray | None:
    """The arrays of `white_parts` by quadrature, without noise; None where `known_flux` is None."""
    parts = []
    for in_light in rig.in_each_light:
        band = Band.of(in_light, rows)
        flux = known_flux(band)
        if flux is None:
            return None
        parts.append(flux.reshape(band.shape) / in_light.tracer.reference_weight_sr)
    white = np.stack(parts, axis=-1)
    return np.stack([white, np.zeros_like(white)])


def pictures_in_lights(
    rig: Rig,
    samples: int,
    scenes: Sequence[SceneView],
    white: Float64[np.ndarray, "2 height width wavelengths"],
    rows: Rows | None = None,
    columns: Rows | None = None,
) -> np.ndarray:
    """Images of several scenes, (scenes, height, width), as `pictures`; `white` of the same pixels by `white_parts`."""
    shared = rig.tracer.samples_of_each(samples)
    parts = own_and_foreign(white)
    images = []
    for number, in_light in enumerate(rig.in_each_light):
        views = [scene.in_light(number) for scene in scenes]
        images.append(pictures(in_light, shared, views, np.ascontiguousarray(parts[..., number]), rows, columns))
    return over_wavelengths(rig.tracer, np.stack(images, axis=-1))


def bands_in_lights(rig: Rig, rows: Rows | None = None, columns: Rows | None = None) -> list[Band]:
    """Some rows and columns at each wavelength, by default all."""
    return [Band.of(in_light, rows, columns) for in_light in rig.in_each_light]


def colours_in_lights(bands: Sequence[Band], scenes: Sequence[SceneView]) -> np.ndarray:
    """Colour of both parts of each pixel in each scene and wavelength, (scenes, 2, h, w, wavelengths); NaN where it
    must be sampled.
    """
    images = []
    for number, band in enumerate(bands):
        colour = colours(band, [scene.in_light(number) for scene in scenes])
        images.append(colour.reshape(len(scenes), 2, *band.shape))
    return np.stack(images, axis=-1)


def sampled_in_lights(
    rig: Rig,
    bands: Sequence[Band],
    batch: Batch,
    scenes: Sequence[SceneView],
    white: Float64[np.ndarray, "2 height width wavelengths"],
    colour: Float64[np.ndarray, "scenes 2 height width wavelengths"],
) -> np.ndarray:
    """The part of images of several scenes of one kind that a batch samples, (scenes, h, w), relative; `white` and
    `colour` as for the functions above.
    """
    shared = _shared(rig.tracer, batch)
    images = []
    for number, band in enumerate(bands):
        parts = own_and_foreign(white)[..., number].reshape(2, -1)
        decided = colour[..., number]
        flux = known_flux(band) if scenes[0].is_sampled else None
        steady = None if flux is None else flux / band.rig.tracer.reference_weight_sr
        views = [scene.in_light(number) for scene in scenes]
        light = sampled(band, shared, views, parts, decided.reshape(len(scenes), 2, -1), steady)
        images.append(light.sum(axis=1).reshape(-1, *band.shape))
    return over_wavelengths(rig.tracer, np.stack(images, axis=-1))


def known_in_lights(
    tracer: Tracer,
    white: Float64[np.ndarray, "2 height width wavelengths"],
    colour: Float64[np.ndarray, "2 height width wavelengths"],
) -> np.ndarray:
    """The part of an image that is colour times white, (h, w); 0 where it is sampled."""
    return over_wavelengths(tracer, np.nansum(colour * own_and_foreign(white), axis=0))


def own_and_foreign(white: Float64[np.ndarray, "2 height width wavelengths"]) -> np.ndarray:
    """White images, of all light and of that through other microlenses, as two parts that add up to all light."""
    return np.array([white[0] - white[1], white[1]])


def _shared(tracer: Tracer, batch: Batch) -> Batch:
    """The batch of each wavelength."""
    return replace(batch, first=tracer.samples_of_each(batch.first))


def over_wavelengths(tracer: Tracer, by_wavelength: Float64[np.ndarray, "... wavelengths"]) -> np.ndarray:
    """Mean over wavelengths of images (..., wavelengths), weighted by the share of each wavelength in the light times
    the weight of its reference bundle, to which its image is relative.
    """
    if by_wavelength.shape[-1] == 1:
        return by_wavelength[..., 0]
    weight = np.array([light.share * light.tracer.reference_weight_sr for light in tracer.lights])
    return by_wavelength @ (weight / weight.sum())
