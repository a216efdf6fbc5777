"""Task `image`: the image of one camera in one frame, linear and as a preview; joined from tiles if there are any."""

import dataclasses
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from pipeline.camera.tracer import Tracer
from pipeline.files.exr_bands import BandedPart, write_bands
from pipeline.files.png import write_png
from pipeline.render.spectral.spectra import srgb_preview
from pipeline.tasks.artefacts.cameras import Inputs, stacked, tracer_alone
from pipeline.tasks.image_tile import PIXELS, image_rows
from pipeline.tasks.params.images import Exposure
from pipeline.tasks.params.images import Image as Params

_PREVIEW_ROWS = 512
"""Rows of a preview that are converted at once: the formula takes some hundred bytes per pixel."""


def run(params: Params, inputs: Inputs, out: Path) -> None:
    """Write image.exr and image.png."""
    if params.tiles:
        _write(out, stacked(inputs, params.tiles, PIXELS), params, inputs)
    else:
        run_together([params], inputs, [out])


def run_together(params: Sequence[Params], inputs: Inputs, outs: Sequence[Path]) -> None:
    """Images without tiles of several frames, which share their rays."""
    views = [one.view for one in params if one.view]
    for pixels, one, out in zip(image_rows(params[0].exposure, views, inputs), params, outs, strict=True):
        _write(out, pixels, one, inputs)


def _write(out: Path, pixels: np.ndarray, params: Params, inputs: Inputs) -> None:
    write_image(out, "image", pixels, params.exposure, tracer_alone(inputs, params.exposure.seed))


def write_image(
    out: Path,
    name: str,
    pixels: np.ndarray,
    exposure: Exposure,
    tracer: Tracer,
    more: Sequence[BandedPart] = (),
) -> None:
    """Write `name`.exr, relative irradiance with its reference in the header, and `name`.png, an 8-bit preview."""
    by_area = tracer.camera.weight == "area"
    measure = "dA in the sampling plane" if by_area else "cos(theta) d omega"
    attributes = {
        "content": f"relative irradiance: integral of L {measure} over W_ref",
        "W_ref_mm2" if by_area else "W_ref_sr": tracer.reference_weight_sr,
        **labels_of(exposure),
    }
    write_bands(out / f"{name}.exr", [part_of(name, pixels, attributes), *more])
    bands = range(0, len(pixels), _PREVIEW_ROWS)
    preview = [srgb_preview(pixels[first : first + _PREVIEW_ROWS], 1.0) for first in bands]
    write_png(out / f"{name}.png", np.concatenate(preview))


def labels_of(exposure: Exposure) -> dict[str, Any]:
    """Attributes in the header of an image that describe its rays."""
    labels = dataclasses.asdict(dataclasses.replace(exposure, channel=None))
    del labels["channel"]
    if labels.pop("diffraction"):
        labels["diffraction"] = "of the stop, or of each microlens"
    return labels if exposure.channel is None else {**labels, "light": exposure.channel.text}


def part_of(name: str, pixels: np.ndarray, attributes: dict[str, Any]) -> BandedPart:
    """A part with one channel, (h, w)."""

    def rows(first: int, end: int) -> dict[str, np.ndarray]:
        return {"Y": pixels[first:end]}

    height, width = pixels.shape
    return BandedPart(name=name, shape=(height, width), channels=("Y",), rows=rows, attributes=attributes)
