"""Task `image`: the image of one camera in one frame, linear and as a preview; joined from tiles if there are any."""

import dataclasses
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from pipeline.camera.tracer import Tracer
from pipeline.files.exr_bands import BandedPart, write_bands
from pipeline.files.npy import read_npy
from pipeline.files.png import write_png
from pipeline.render.in_lights import known_in_lights
from pipeline.render.spectral.preview import srgb_preview
from pipeline.tasks.artefacts.cameras import Inputs, stacked, tracer_alone
from pipeline.tasks.artefacts.passes import COLOURS, MEANS, ended, part_of
from pipeline.tasks.image_tile import PIXELS, image_rows
from pipeline.tasks.params.images import STRIP, Exposure
from pipeline.tasks.params.images import Image as Params

_PREVIEW_ROWS = 512
"""Rows of a preview that are converted at once: the formula takes some hundred bytes per pixel."""


class Rendered(NamedTuple):
    """Content of the file of an image.

    Attributes
    ----------
    pixels : (h, w) float64
        Relative irradiance.
    parts : tuple of BandedPart
        Further parts of the file.
    labels : dict
        Further attributes of the first part.
    """

    pixels: np.ndarray
    parts: tuple[BandedPart, ...] = ()
    labels: Mapping[str, str | float | int] | None = None


def run(params: Params, inputs: Inputs, out: Path) -> None:
    """Write image.exr and image.png."""
    if params.noise is not None:
        _write(out, _from_passes(params.noise, params.exposure, inputs), params, inputs)
    elif params.tiles:
        _write(out, Rendered(stacked(inputs, params.tiles, PIXELS)), params, inputs)
    else:
        run_together([params], inputs, [out])


def run_together(params: Sequence[Params], inputs: Inputs, outs: Sequence[Path]) -> None:
    """Images without tiles of several frames, which share their rays."""
    views = [one.view for one in params if one.view]
    for pixels, one, out in zip(image_rows(params[0].exposure, views, inputs), params, outs, strict=True):
        _write(out, Rendered(pixels), one, inputs)


def _write(out: Path, image: Rendered, params: Params, inputs: Inputs) -> None:
    write_image(out, "image", image, params.exposure, tracer_alone(inputs, params.exposure.seed))


def _from_passes(noise: float, exposure: Exposure, inputs: Inputs) -> Rendered:
    """The image after the last passes over it and over the white image; each replica takes the same one of both."""
    tracer = tracer_alone(inputs, exposure.seed)

    def replicas(strip: int) -> np.ndarray:
        colour = read_npy(inputs[f"first{strip}"][COLOURS])
        known = [known_in_lights(tracer, white, colour) for white in read_npy(inputs[f"white{strip}"][MEANS])]
        return read_npy(inputs[f"{STRIP}{strip}"][MEANS]) + np.array(known)  # type: ignore[no-any-return]

    image = ended(inputs, noise, replicas)
    return Rendered(image.pixels, (image.part,), image.labels)


def write_image(out: Path, name: str, image: Rendered, exposure: Exposure, tracer: Tracer) -> None:
    """Write `name`.exr, relative irradiance with its reference in the header, and `name`.png, an 8-bit preview."""
    by_area, pixels = tracer.camera.weight == "area", image.pixels
    measure = "dA in the sampling plane" if by_area else "cos(theta) d omega"
    attributes = {
        "content": f"relative irradiance: integral of L {measure} over W_ref",
        "W_ref_mm2" if by_area else "W_ref_sr": tracer.reference_weight_sr,
        **labels_of(exposure),
        **(image.labels or {}),
    }
    write_bands(out / f"{name}.exr", [part_of(name, pixels, attributes), *image.parts])
    bands = range(0, len(pixels), _PREVIEW_ROWS)
    preview = [srgb_preview(pixels[first : first + _PREVIEW_ROWS], 1.0) for first in bands]
    write_png(out / f"{name}.png", np.concatenate(preview))


def labels_of(exposure: Exposure) -> dict[str, str | float | int]:
    """Attributes in the header of an image that describe its rays."""
    labels = dataclasses.asdict(dataclasses.replace(exposure, channel=None))
    del labels["channel"]
    if device := labels.pop("device"):
        labels["rays"] = f"float32, {device}"
    if labels.pop("diffraction"):
        labels["diffraction"] = "of the stop, or of each microlens"
    return labels if exposure.channel is None else {**labels, "light": exposure.channel.text}
