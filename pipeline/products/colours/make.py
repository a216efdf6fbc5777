"""Task `colour_image`: the images of all channels of a camera in one file, as a picture and, of a spectral camera, as
other programs read spectra.
"""

from pathlib import Path

import numpy as np

from pipeline.channel_names import colour_of
from pipeline.files.exr import PRIMARIES_XY, texts_of
from pipeline.files.exr_bands import BandedPart, write_bands
from pipeline.files.png import write_png
from pipeline.products.cameras import Inputs, in_bands, light_file
from pipeline.products.colours.params import SPECTRAL, ColourImage
from pipeline.render.spectral.preview import srgb_preview

_LETTERS = {"red": "R", "green": "G", "blue": "B", "mono": "Y"}
"""Names that other programs expect of channels in OpenEXR files, by colours, and of a sensor without channels. Other
channels have their own names there."""


def colour_image(params: ColourImage, inputs: Inputs, out: Path) -> None:
    """Write `name`.exr, relative irradiance of each channel, and `name`.png, an 8-bit preview."""
    name = params.name
    files = [inputs[f"channel{i}"] for i in range(len(params.channels))]
    images = [np.load(of_channel[light_file(name)], mmap_mode="r") for of_channel in files]
    headers = [texts_of(of_channel[f"{name}.exr"], name) for of_channel in files]
    letters = [_LETTERS.get(colour_of(channel.name) or channel.name, channel.name) for channel in params.channels]
    attributes: dict[str, str | float | int] = {
        "content": "relative irradiance of each channel: 1 is a white scene on the axis",
        **{f"light_{letter}": channel.text for letter, channel in zip(letters, params.channels, strict=True)},
    }
    for letter, header in zip(letters, headers, strict=True):
        if "noise" in header:
            attributes[f"noise_{letter}"] = float(header["noise"])
    if params.colorimetry is not None:
        text = "of the sensor, not of Rec. 709: chromaticities hold the matrix to XYZ that is best for a ColorChecker"
        attributes["colours"] = f"{text} in {params.colorimetry.illuminant}"
        attributes[PRIMARIES_XY] = " ".join(map(repr, params.colorimetry.chromaticities))
    device = {"rays": headers[0]["rays"]} if "rays" in headers[0] else {}  # the same one for all channels
    part = _part(name, images, letters, {**attributes, **device})
    write_bands(out / f"{name}.exr", [part])

    def preview(first: int, end: int) -> np.ndarray:
        return picture(dict(zip(letters, np.moveaxis(part.rows(first, end), -1, 0), strict=True)))

    write_png(out / f"{name}.png", in_bands(part.shape[0], preview))
    if params.is_spectral:
        _write_spectral(out / SPECTRAL, images, params, device)


def _write_spectral(path: Path, images: list[np.ndarray], params: ColourImage, device: dict[str, str]) -> None:
    """Write the image as a spectrum in each pixel: relative to white in the same light, as a reflectance is.

    Source: Fichet, Pacanowski and Wilkie, "An OpenEXR Layout for Spectral Images", JCGT 10(3), 2021.
    """
    wavelengths = [repr(channel.wavelengths_nm[0]).replace(".", ",") for channel in params.channels]
    names = [f"T.{wavelength}nm" for wavelength in wavelengths]
    attributes: dict[str, str | float | int] = {
        "spectralLayoutVersion": "1.0",
        "content": "relative irradiance at each wavelength: 1 is a white scene on the axis in the same light",
    }
    write_bands(path, [_part("spectral", images, names, {**attributes, **device})])


def _part(
    name: str, images: list[np.ndarray], channels: list[str], attributes: dict[str, str | float | int]
) -> BandedPart:
    """The images of all channels, (h, w) each, as one part."""

    def rows(first: int, end: int) -> np.ndarray:
        return np.stack([image[first:end] for image in images], axis=-1)

    return BandedPart(name=name, shape=images[0].shape, channels=tuple(channels), rows=rows, attributes=attributes)


def picture(channels: dict[str, np.ndarray]) -> np.ndarray:
    """Red, green and blue as they are, because a white scene is white in all of them; else the mean of all channels."""
    if channels.keys() >= set("RGB"):
        return np.stack([srgb_preview(channels[letter], 1.0)[..., 0] for letter in "RGB"], axis=-1)
    return srgb_preview(np.mean(list(channels.values()), axis=0), 1.0)
