"""Files of an image: its parts in one EXR, a preview, and an array for tasks that read it."""

import dataclasses
from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

import numpy as np

from pipeline.camera.tracer import Tracer
from pipeline.files.exr_bands import BandedPart, write_bands
from pipeline.files.npy import write_npy
from pipeline.files.png import write_png
from pipeline.products.cameras import in_bands, light_file
from pipeline.products.light import Exposure
from pipeline.render.spectral.preview import srgb_preview


class Rendered(NamedTuple):
    """An image, (h, w) float64 relative irradiance, with further parts of its file and attributes of the first part."""

    pixels: np.ndarray
    parts: tuple[BandedPart, ...] = ()
    labels: Mapping[str, str | float | int] | None = None


def part_of(name: str, pixels: np.ndarray, attributes: dict[str, str | float | int]) -> BandedPart:
    """A part of a file with one channel, (h, w)."""
    height, width = pixels.shape

    def rows(first: int, end: int) -> np.ndarray:
        return pixels[first:end]

    return BandedPart(name=name, shape=(height, width), channels=("Y",), rows=rows, attributes=attributes)


def write_image(out: Path, name: str, image: Rendered, exposure: Exposure, tracer: Tracer) -> None:
    """Write `name`.exr, relative irradiance with its reference in the header, `name`.png, an 8-bit preview, and for
    tasks that read it an array."""
    by_area = tracer.camera.weight == "area"
    measure = "dA in the sampling plane" if by_area else "cos(theta) d omega"
    attributes = {
        "content": f"relative irradiance: integral of L {measure} over W_ref",
        "W_ref_mm2" if by_area else "W_ref_sr": tracer.reference_weight_sr,
        **labels_of(exposure),
        **(image.labels or {}),
    }
    write_bands(out / f"{name}.exr", [part_of(name, image.pixels, attributes), *image.parts])
    write_npy(out / light_file(name), image.pixels.astype(np.float32))
    preview = in_bands(len(image.pixels), lambda first, end: srgb_preview(image.pixels[first:end], 1.0))
    write_png(out / f"{name}.png", preview)


def labels_of(exposure: Exposure) -> dict[str, str | float | int]:
    """Attributes in the header of an image that describe its rays."""
    labels = dataclasses.asdict(dataclasses.replace(exposure, channel=None))
    del labels["channel"]
    if device := labels.pop("device"):
        labels["rays"] = f"float32, {device}"
    if labels.pop("diffraction"):
        labels["diffraction"] = "of the stop, or of each microlens"
    return labels if exposure.channel is None else {**labels, "light": exposure.channel.text}
