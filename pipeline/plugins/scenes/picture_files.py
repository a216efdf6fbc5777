"""Decoders of pictures on surfaces and in the sky: the formats of USD's own reader, as linear numbers."""

import io
import re
import tempfile
from typing import Any

import numpy as np
from PIL import Image, UnidentifiedImageError

from pipeline.errors import PipelineError
from pipeline.files.damaged import DamagedFile
from pipeline.files.exr import read_foreign_exr
from pipeline.limits import how_to_raise, limits

_FORMATS = {".png": "PNG", ".jpg": "JPEG", ".jpeg": "JPEG", ".tga": "TGA", ".bmp": "BMP"}
"""Pillow's formats by file extension."""
SUFFIXES = (*_FORMATS, ".exr", ".hdr")
"""Readable file extensions."""
_HDR_SIZE = re.compile(rb"\n[-+]Y (\d{1,9}) [-+]X (\d{1,9})\n")
_BLACK_LEVEL, _SLOPE, _OFFSET, _POWER = 0.04045, 12.92, 0.055, 2.4
"""Constants of sRGB's transfer function [1]: IEC 61966-2-1:1999."""
_BITS, _DEEP, _WHITE = 16, 65535.0, 255.0
"""Bits of a deep component, and the values of white in deep and 8-bit components."""
_LARGEST = 1e9
"""Largest number of a pixel [1]: the sun is about 1e5 times as bright as its sky, and single precision ends at 3e38."""


def decoded(content: bytes, suffix: str, space: str) -> np.ndarray:
    """A picture as linear numbers, (h, w, 4) float32, the first row at the top; opaque without a fourth component.

    `space`: `sRGB`, `raw`, or `auto`: colours of 8 bits are sRGB, everything else is linear.
    Raises PipelineError: the file cannot be read, has too many pixels, or holds a number that is not finite.
    """
    is_float = suffix not in _FORMATS
    pixels, scale = (_floats(content, suffix), 1.0) if is_float else _from_8_or_16_bits(content, suffix)
    values = pixels.reshape(*pixels.shape[:2], -1) / scale
    colours = values[..., : 1 if values.shape[2] < 3 else 3]
    if space == "sRGB" or (space == "auto" and colours.shape[2] == 3 and scale == _WHITE):
        low, high = colours / _SLOPE, np.maximum(colours, _BLACK_LEVEL)
        colours = np.where(colours <= _BLACK_LEVEL, low, ((high + _OFFSET) / (1 + _OFFSET)) ** _POWER)
    return _with_four(np.concatenate([colours, values[..., colours.shape[2] :]], axis=2))


def ends_of(content: bytes, suffix: str) -> tuple[float, float, float]:
    """Bounds below and above all pixels of a picture as `decoded` returns them [1], and the least of the fourth
    components; raises as `decoded`.
    """
    ends = (0.0, 1.0)
    scale = 1.0
    if suffix in _FORMATS:
        values, scale = _from_8_or_16_bits(content, suffix)
    else:
        values = _floats(content, suffix)
        ends = float(values.min()), float(values.max())
    has_opacity = values.ndim > 2 and values.shape[2] in _WITH_OPACITY
    return *ends, float(values[..., -1].min()) / scale if has_opacity else 1.0


def _from_8_or_16_bits(content: bytes, suffix: str) -> tuple[np.ndarray, float]:
    """Pixels of a PNG or JPEG file, (h, w) or (h, w, c), and the value of white."""
    try:
        with Image.open(io.BytesIO(content), formats=[_FORMATS[suffix]]) as picture:
            _require_few(4 * picture.width * picture.height)
            is_deep = picture.mode.startswith("I;16")
            kind = picture.mode if is_deep else {"L": "L", "1": "L", "LA": "LA", "RGB": "RGB"}.get(picture.mode, "RGBA")
            if "transparency" in picture.info and not is_deep:  # a colour that stands for a hole
                kind = "LA" if kind == "L" else "RGBA"
            if picture.format == "PNG" and content[24] == _BITS and not is_deep:
                return _by_opencv(content), _DEEP  # Pillow keeps 8 bits of each
            tile: Any = picture.tile[0] if picture.format == "BMP" else None
            if tile and "BGRX" in tile.args:  # opacity, which Pillow leaves out; where all of it is zero it is none
                raw = Image.frombytes("RGBA", picture.size, content[tile.offset :], "raw", "BGRA", *tile.args[1:])
                if (pixels := np.array(raw))[..., 3].any():
                    return pixels, _WHITE
            pixels = np.array(picture if is_deep else picture.convert(kind))
    except (OSError, SyntaxError, ValueError, Image.DecompressionBombError) as error:
        reason = "" if isinstance(error, UnidentifiedImageError) else f": {error}"
        hint = "write it anew as PNG or JPEG"
        raise PipelineError(f"is no {_FORMATS[suffix]} that can be read{reason}", hint=hint) from error
    return pixels, _DEEP if is_deep else _WHITE


def _by_opencv(content: bytes) -> np.ndarray:
    """Pixels of a picture that OpenCV reads, (h, w, 3 or 4), in the order red, green, blue; ValueError if it cannot."""
    import cv2

    pixels = cv2.imdecode(np.frombuffer(content, np.uint8), cv2.IMREAD_UNCHANGED)
    if pixels is None or pixels.ndim < 3:
        raise ValueError("it is damaged")
    return pixels[..., [2, 1, 0, 3][: pixels.shape[2]]]


_WITH_OPACITY = (2, 4)
"""Numbers of components of which the last is opacity [1]."""


def _with_four(values: np.ndarray) -> np.ndarray:
    """Four components of grey, of grey with opacity, or of colours."""
    count = values.shape[2]
    colours = np.repeat(values[..., :1], 3, axis=2) if count < 3 else values[..., :3]
    opacity = values[..., -1:] if count in _WITH_OPACITY else np.ones_like(values[..., :1])
    return np.concatenate([colours, opacity], axis=2).astype(np.float32)


def _require_few(values: int) -> None:
    """Refuse an array of this many numbers, four for each pixel, before memory is allocated for it."""
    pixels = -(-values // 4)
    most = limits().picture_pixels
    if pixels > most:
        message = f"has {values:,} numbers, as {pixels:,} pixels do; a picture may have {most:,} pixels"
        raise PipelineError(message, hint=how_to_raise("picture_pixels", pixels))


def _floats(content: bytes, suffix: str) -> np.ndarray:
    values = np.asarray((_from_exr if suffix == ".exr" else _from_hdr)(content), np.float32)
    count = int(np.count_nonzero(~(np.abs(values) <= _LARGEST)))
    if count:
        hint = "denoise it, or clip it where the sun is"
        raise PipelineError(f"has {count:,} numbers that are not finite, or beyond {_LARGEST:g}", hint=hint)
    return values


def _from_hdr(content: bytes) -> np.ndarray:
    """Colours of a Radiance HDR file, (h, w, 3)."""
    size = _HDR_SIZE.search(content)
    try:
        if not size:
            raise ValueError("it states no size")
        _require_few(4 * int(size[1]) * int(size[2]))
        return _by_opencv(content)
    except ValueError as error:
        raise PipelineError(f"is no Radiance HDR that can be read: {error}", hint="write it anew") from error


def _from_exr(content: bytes) -> np.ndarray:
    # OpenEXR reads named files alone.
    with tempfile.NamedTemporaryFile() as file:
        file.write(content)
        file.flush()
        try:
            channels = read_foreign_exr(file.name, _require_few)
        except DamagedFile as error:
            message = f"is no OpenEXR file that can be read: {error.reason.replace(file.name, 'it')}"
            raise PipelineError(message, hint="write it anew") from error
    names = [name for name in "RGBA" if name in channels] if {"R", "G", "B"} <= set(channels) else ["Y"]
    if not set(names) <= set(channels):
        raise PipelineError(f"has the channels {', '.join(sorted(channels))}", hint="it needs R, G, B or Y")
    return np.stack([channels[name] for name in names], axis=2)
