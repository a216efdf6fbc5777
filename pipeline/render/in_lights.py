"""Images in light of several wavelengths: the sum of those in each, all relative to the white scene on the axis."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from pipeline.camera.rig import Rig
from pipeline.camera.tracer import Tracer
from pipeline.records.shapes import Float64
from pipeline.render.band import Band
from pipeline.render.glow import GlowingView, TargetLight
from pipeline.render.imaging import Rows, colours, irradiance_and_crosstalk, pictures, sampled
from pipeline.render.known_flux import known_flux
from pipeline.render.lighting.lit_scene import LitView
from pipeline.render.passes import Batch, batch_of


def white_parts(rig: Rig, samples: int | Batch, rows: Rows | None = None) -> np.ndarray:
    """The white image and its part through other microlenses than that of the pixel's cell, by wavelength.

    `samples`: as in `imaging.irradiance_and_crosstalk`, of all wavelengths together.
    Returns (2, height, width, wavelengths) float64: each relative to the white scene on the axis in the same light;
        `in_all` sums them up.
    """
    shared = _shared(rig.tracer, batch_of(samples))
    parts = [irradiance_and_crosstalk(in_light, shared, None, rows) for in_light in rig.in_each_light]
    return np.stack([np.stack(part) for part in parts], axis=-1)


def known_white_parts(rig: Rig, rows: Rows | None = None) -> np.ndarray | None:
    """The arrays of `white_parts` by quadrature, without noise; None where `known_flux` knows nothing."""
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
    scenes: Sequence[TargetLight | GlowingView | LitView],
    white: Float64[np.ndarray, "2 height width wavelengths"],
    rows: Rows | None = None,
) -> np.ndarray:
    """Images of several scenes, (scenes, height, width), as `imaging.pictures`.

    `white`: result of `white_parts` for the same rows.
    """
    shared, parts, images = rig.tracer.samples_of_each(samples), own_and_foreign(white), []
    for number, in_light in enumerate(rig.in_each_light):
        seen = [scene.in_light(number) for scene in scenes]
        images.append(pictures(in_light, shared, seen, np.ascontiguousarray(parts[..., number]), rows))
    return in_all(rig.tracer, np.stack(images, axis=-1))


def colours_in_lights(rig: Rig, scene: TargetLight | GlowingView | LitView, rows: Rows | None = None) -> np.ndarray:
    """Colour of both parts of each pixel at each wavelength, (2, h, w, wavelengths); NaN where it must be sampled."""
    images = []
    for number, in_light in enumerate(rig.in_each_light):
        band = Band.of(in_light, rows)
        images.append(colours(band, [scene.in_light(number)])[0].reshape(2, *band.shape))
    return np.stack(images, axis=-1)


def sampled_in_lights(
    rig: Rig,
    batch: Batch,
    scene: TargetLight | GlowingView | LitView,
    white: Float64[np.ndarray, "2 height width wavelengths"],
    colour: Float64[np.ndarray, "2 height width wavelengths"],
    rows: Rows | None = None,
) -> np.ndarray:
    """The part of an image that a batch samples, (h, w), relative; `white` and `colour` as of the functions above."""
    shared, images = _shared(rig.tracer, batch), []
    for number, in_light in enumerate(rig.in_each_light):
        band = Band.of(in_light, rows)
        parts, known = (values[..., number].reshape(2, -1) for values in (own_and_foreign(white), colour))
        flux = known_flux(band) if isinstance(scene, LitView) else None
        steady = None if flux is None else flux / in_light.tracer.reference_weight_sr
        light = sampled(band, shared, [scene.in_light(number)], parts, known[None], steady)
        images.append(light[0].sum(axis=0).reshape(band.shape))
    return in_all(rig.tracer, np.stack(images, axis=-1))


def known_in_lights(
    tracer: Tracer,
    white: Float64[np.ndarray, "2 height width wavelengths"],
    colour: Float64[np.ndarray, "2 height width wavelengths"],
) -> np.ndarray:
    """The part of an image that is colour times white, (h, w); 0 where it is sampled."""
    return in_all(tracer, np.nansum(colour * own_and_foreign(white), axis=0))


def own_and_foreign(white: Float64[np.ndarray, "2 height width wavelengths"]) -> np.ndarray:
    """White images, of all light and of that through other microlenses, as the two parts that make up all light."""
    return np.array([white[0] - white[1], white[1]])


def _shared(tracer: Tracer, batch: Batch) -> Batch:
    """The batch of each wavelength."""
    return replace(batch, first=tracer.samples_of_each(batch.first))


def in_all(tracer: Tracer, by_wavelength: Float64[np.ndarray, "... wavelengths"]) -> np.ndarray:
    """Images in all light together from those each wavelength, (..., wavelengths), whose reference bundles differ."""
    if by_wavelength.shape[-1] == 1:
        return by_wavelength[..., 0]
    weight = np.array([light.share * light.tracer.reference_weight_sr for light in tracer.lights])
    return by_wavelength @ (weight / weight.sum())
