"""PNG files: 8-bit pictures and 16-bit raw images."""

import io
import zlib
from pathlib import Path

import numpy as np
from PIL import Image, UnidentifiedImageError

from pipeline.files.damaged import MAX_COMPRESSION_RATIO, DamagedFile

_COMPRESS_LEVEL = 6
"""Compression level, stated explicitly because the default of the library may change and with it the bytes."""


def write_png(path: str | Path, image: np.ndarray) -> None:
    """Write an image to a file of any name. Equal pixels give equal bytes; no time, no text, no colour profile.

    `image`: (h, w, 3) uint8, (h, w) uint8 or (h, w) uint16, RGB, grey, or raw digital numbers; row 0 is the top.
    """
    Path(path).write_bytes(png_bytes(image))


def png_bytes(image: np.ndarray) -> bytes:
    """The file that `write_png` writes."""
    grey = image.ndim == 2 and image.dtype in (np.uint8, np.uint16)
    colour = image.ndim == 3 and image.shape[2] == 3 and image.dtype == np.uint8
    if not (grey or colour) or image.size == 0:
        raise ValueError(f"no PNG for {image.dtype} of shape {image.shape}: (h, w, 3) uint8, (h, w) uint8 or uint16")
    stream = io.BytesIO()
    Image.fromarray(np.ascontiguousarray(image)).save(stream, format="PNG", compress_level=_COMPRESS_LEVEL)
    return stream.getvalue()


def read_png(path: str | Path) -> np.ndarray:
    """Read an image of `write_png`; DamagedFile if it is no PNG file, damaged, or has pixels of another kind."""
    data = Path(path).read_bytes()
    width_px, height_px = _size(path, data)
    if width_px * height_px > 8 * MAX_COMPRESSION_RATIO * len(data):  # a pixel has a bit or more
        raise DamagedFile(path, f"{width_px} x {height_px} pixels cannot come from so short a file")
    try:
        with Image.open(io.BytesIO(data), formats=["PNG"]) as picture:
            mode = picture.mode
            pixels = np.array(picture)
    except (UnidentifiedImageError, OSError, SyntaxError, ValueError, zlib.error) as error:
        raise DamagedFile(path, f"not a readable PNG file ({error})") from error
    if mode not in ("RGB", "L", "I;16"):
        raise DamagedFile(path, f'pixels of kind "{mode}"; expected RGB, 8-bit grey or 16-bit grey')
    return pixels


def png_size(path: str | Path) -> tuple[int, int]:
    """Width and height in px, from the header alone; DamagedFile if it is not a PNG file."""
    with Path(path).open("rb") as file:
        return _size(path, file.read(24))


def _size(path: str | Path, head: bytes) -> tuple[int, int]:
    if len(head) < 24 or head[12:16] != b"IHDR":
        raise DamagedFile(path, "not a PNG file")
    return int.from_bytes(head[16:20], "big"), int.from_bytes(head[20:24], "big")
