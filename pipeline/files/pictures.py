"""Pictures of other programs, for surfaces and skies: PNG, JPEG and OpenEXR, as linear numbers."""

import io
import tempfile
from pathlib import Path

import numpy as np
from PIL import Image, UnidentifiedImageError

from pipeline.errors import PipelineError
from pipeline.files.exr import read_foreign_exr

_FORMATS = {".png": "PNG", ".jpg": "JPEG", ".jpeg": "JPEG"}
"""Formats of Pillow, by the end of the name of a file."""
_BLACK_LEVEL, _SLOPE, _OFFSET, _POWER = 0.04045, 12.92, 0.055, 2.4
"""Numbers of sRGB's transfer function [1]: IEC 61966-2-1:1999."""


def decoded(content: bytes, suffix: str, space: str) -> np.ndarray:
    """A picture as linear numbers, (h, w, 4) float32, the first row at the top; opaque without a fourth component.

    Parameters
    ----------
    space : str
        `sRGB`, `raw`, or `auto`: colours of 8 bits are sRGB, everything else is linear.

    Raises
    ------
    PipelineError
        The file cannot be read.
    """
    if suffix == ".exr":
        return _with_four(_from_exr(content))
    try:
        with Image.open(io.BytesIO(content), formats=[_FORMATS[suffix]]) as picture:
            deep = picture.mode.startswith("I;16")
            kind = picture.mode if deep else {"L": "L", "1": "L", "LA": "LA", "RGB": "RGB"}.get(picture.mode, "RGBA")
            pixels = np.array(picture if deep else picture.convert(kind))
    except (UnidentifiedImageError, OSError, SyntaxError, ValueError, Image.DecompressionBombError) as error:
        raise PipelineError(f"a picture cannot be read: {error}", hint="write it anew as PNG or JPEG") from error
    values = pixels.reshape(*pixels.shape[:2], -1) / (65535.0 if deep else 255.0)
    colours = values[..., : 1 if values.shape[2] < 3 else 3]
    if space == "sRGB" or (space == "auto" and colours.shape[2] == 3):
        low = colours / _SLOPE
        colours = np.where(colours <= _BLACK_LEVEL, low, ((colours + _OFFSET) / (1 + _OFFSET)) ** _POWER)
    return _with_four(np.concatenate([colours, values[..., colours.shape[2] :]], axis=2))


def _with_four(values: np.ndarray) -> np.ndarray:
    """Grey, grey with opacity, or colours without it, with all four components."""
    count = values.shape[2]
    colours = np.repeat(values[..., :1], 3, axis=2) if count < 3 else values[..., :3]
    opacity = values[..., -1:] if count in (2, 4) else np.ones_like(values[..., :1])
    return np.concatenate([colours, opacity], axis=2).astype(np.float32)


def _from_exr(content: bytes) -> np.ndarray:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "picture.exr"
        path.write_bytes(content)
        channels = read_foreign_exr(path)
    names = [name for name in "RGBA" if name in channels] if {"R", "G", "B"} <= set(channels) else ["Y"]
    if not set(names) <= set(channels):
        raise PipelineError(f"a picture has the channels {', '.join(sorted(channels))}", hint="it needs R, G, B or Y")
    return np.stack([np.asarray(channels[name], np.float64) for name in names], axis=2)
