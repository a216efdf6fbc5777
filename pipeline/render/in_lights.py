"""Images in light of several wavelengths: the sum of those in each, all relative to the white scene on the axis."""

from collections.abc import Sequence

import numpy as np

from pipeline.camera.rig import Rig
from pipeline.camera.tracer import Tracer
from pipeline.records.shapes import Float64
from pipeline.render.imaging import Rows, irradiance_and_crosstalk, pictures
from pipeline.render.inks import GlowingView
from pipeline.render.light import TargetLight
from pipeline.render.lighting.lit_scene import LitView


def white_parts(rig: Rig, samples: int, rows: Rows | None = None) -> np.ndarray:
    """The white image and its part through other microlenses than that of the pixel's cell, by wavelength.

    Returns
    -------
    (2, height, width, wavelengths) float64
        Each relative to the white scene on the axis in the same light; `in_all` sums them up.
    """
    shared = rig.tracer.samples_of_each(samples)
    parts = [irradiance_and_crosstalk(one, shared, None, rows) for one in rig.in_each_light]
    return np.stack([np.stack(part) for part in parts], axis=-1)


def pictures_in_lights(
    rig: Rig,
    samples: int,
    scenes: Sequence[TargetLight | GlowingView | LitView],
    white: Float64[np.ndarray, "2 height width wavelengths"],
    rows: Rows | None = None,
) -> np.ndarray:
    """Images of several scenes, (scenes, height, width), as `imaging.pictures`.

    Parameters
    ----------
    white : (2, height, width, wavelengths) float64
        Of `white_parts`, for the same rows.
    """
    shared, images = rig.tracer.samples_of_each(samples), []
    for number, one in enumerate(rig.in_each_light):
        all_of_it, foreign = np.ascontiguousarray(white[..., number])
        parts = np.array([all_of_it - foreign, foreign])
        seen = [scene.in_light(number, shared) for scene in scenes]
        images.append(pictures(one, shared, seen, parts, rows))
    return in_all(rig.tracer, np.stack(images, axis=-1))


def in_all(tracer: Tracer, by_wavelength: Float64[np.ndarray, "... wavelengths"]) -> np.ndarray:
    """Images in all light together from those each wavelength, (..., wavelengths), whose reference bundles differ."""
    if by_wavelength.shape[-1] == 1:
        return by_wavelength[..., 0]
    weight = np.array([light.share * light.tracer.reference_weight_sr for light in tracer.lights])
    return by_wavelength @ (weight / weight.sum())
