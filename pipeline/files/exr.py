"""OpenEXR files with several named parts of float32 channels.

The Python binding can lose data silently; this module prevents that:

- It ignores strides: a transposed or flipped array would be written wrong. Every channel is copied to C order.
- Float attributes shrink to float32 and integers beyond 32 bits become 0. Numbers in headers are `repr` strings.
- It reports a full disk only in the text of a message.
- It only warns when pixels cannot be decoded, and drops the parts that a truncated file lacks. Every part carries the
  CRC-32 of its content and the number of parts; a mismatch is refused.
"""

import contextlib
import errno
import io
import os
import zlib
from collections.abc import Callable
from dataclasses import dataclass, field
from numbers import Integral, Real
from pathlib import Path
from typing import Any

import numpy as np
import OpenEXR

from pipeline.files.damaged import MAX_COMPRESSION_RATIO, DamagedFile

TILE_PX = 128
"""Edge of a tile [px], 64 KiB per channel: large enough to compress well, small against the part of an image that a
viewer shows.
"""

# Lossless, and every reader of multi-part files knows it. Zstandard packs tighter and a third faster, but only the
# newest readers know that.
_COMPRESSION = OpenEXR.ZIP_COMPRESSION

_IN_CALLING_THREAD = 0
"""Number of further encoding threads: more are not faster at our sizes, and workers share the machine."""

CRC, PART_COUNT = "content_crc32", "part_count"
PRIMARIES_XY = "primaries_xy"
"""Attribute with x and y of red, green, blue and white; viewers read `chromaticities`, of single precision."""

_STRUCTURE = {"channels", "chunkCount", "compression", "lineOrder", "name", "tiles", "type", "version", "view"}
_GEOMETRY = {"dataWindow", "displayWindow", "pixelAspectRatio", "screenWindowCenter", "screenWindowWidth"}
RESERVED = _STRUCTURE | _GEOMETRY | {CRC, PART_COUNT, "chromaticities"}


@dataclass(frozen=True, slots=True, kw_only=True)
class Part:
    """One named image of a multi-part file."""

    name: str  # unique within the file
    # (h, w) each, written as float32, NaN included; a file holds them sorted by name
    channels: dict[str, np.ndarray]
    # Written as text, numbers by `repr`, so that `float(attributes[name])` gives back all digits. A part that was read
    # holds strings only.
    attributes: dict[str, str | float | int] = field(default_factory=dict)

    def __post_init__(self) -> None:
        shapes = {np.shape(pixels) for pixels in self.channels.values()}
        if len(shapes) != 1 or len(next(iter(shapes))) != 2 or 0 in next(iter(shapes)):
            raise ValueError(f'part "{self.name}" needs channels of one shape (h, w), not {sorted(shapes)}')
        if reserved := sorted(RESERVED & self.attributes.keys()):
            raise ValueError(f'part "{self.name}": OpenEXR or this module uses the attributes {reserved} itself')

    @property
    def shape(self) -> tuple[int, int]:
        """Height and width [px]."""
        return np.shape(next(iter(self.channels.values())))  # type: ignore[return-value]


def write_exr(path: str | Path, parts: list[Part]) -> None:
    """Write parts, which may differ in size, to a file in an existing folder. Equal parts give equal bytes."""
    names = [part.name for part in parts]
    if not names or len(set(names)) != len(names):
        raise ValueError(f"{path}: an EXR file needs parts with different names, not {names}")
    path = Path(path)
    if not path.parent.is_dir():
        raise FileNotFoundError(f"{path.parent}: no such folder")
    # The display window is one for the whole file: that of the largest part. Each part's own size is its data window.
    display = (max(part.shape[0] for part in parts), max(part.shape[1] for part in parts))
    encoded = [_encode(part, display, len(parts)) for part in parts]
    try:
        OpenEXR.File(encoded, num_threads=_IN_CALLING_THREAD).write(str(path))
    except RuntimeError as error:  # OpenEXR names an error of the system, such as a full disk, only in its message
        number = next((number for number in errno.errorcode if os.strerror(number) in str(error)), None)
        if number is None:
            raise
        raise OSError(number, os.strerror(number), str(path)) from error


def read_exr(path: str | Path) -> dict[str, Part]:
    """Parts of a file that `write_exr` wrote, by name in its order; DamagedFile if truncated, altered or foreign."""
    path = Path(path)
    parts = dict[str, Part]()
    file = _opened(path)
    for part in file.parts:
        texts = _texts(part)
        name = part.header.get("name", "")
        channels = {channel: np.asarray(content.pixels) for channel, content in part.channels.items()}
        attributes: dict[str, str | float | int] = {key: text for key, text in texts.items() if key not in RESERVED}
        if texts.get(PART_COUNT) != str(len(file.parts)) or _crc32(name, channels, attributes) != texts.get(CRC):
            raise DamagedFile(path, f'the content of part "{name}" does not match its checksum, or parts are missing')
        parts[name] = Part(name=name, channels=channels, attributes=attributes)
    return parts


def texts_of(path: str | Path, part: str) -> dict[str, str]:
    """Text attributes of a part of a file of ours."""
    headers = OpenEXR.File(str(path), header_only=True, num_threads=_IN_CALLING_THREAD)
    return next(_texts(header) for header in headers.parts if header.header["name"] == part)


def _texts(part: OpenEXR.Part) -> dict[str, str]:
    return {name: value for name, value in part.header.items() if isinstance(value, str)}


def read_foreign_exr(path: str | Path, require_few: Callable[[int], None]) -> dict[str, np.ndarray]:
    """Channels (h, w) of the first part of a file of any program, by name; `require_few` may refuse their total count.

    Raises DamagedFile: it is no OpenEXR file, its size is implausible, or its channels differ in size.
    """
    file = _opened(Path(path), require_few)
    channels = {name: np.asarray(content.pixels) for name, content in file.parts[0].channels.items()}
    if len({pixels.shape for pixels in channels.values()}) > 1:
        raise DamagedFile(path, "its channels differ in size")
    return channels


def _opened(path: Path, require_few: Callable[[int], None] = lambda values: None) -> OpenEXR.File:
    """A file with the pixels of all parts; DamagedFile if it is no OpenEXR file, truncated, or of implausible size."""
    with path.open("rb"):
        pass  # a file that is not there is no damage
    try:
        # Read the headers, and refuse sizes that a file of this length cannot have.
        headers = OpenEXR.File(str(path), header_only=True, num_threads=_IN_CALLING_THREAD)
        if 4 * sum(map(_values, headers.parts)) > MAX_COMPRESSION_RATIO * path.stat().st_size:
            raise DamagedFile(path, "so many pixels cannot come from so short a file")
        require_few(sum(map(_values, headers.parts)))
        # Read the pixels; the binding prints warnings about damaged ones, and leaves them out.
        with contextlib.redirect_stdout(io.StringIO()):
            file = OpenEXR.File(str(path), separate_channels=True, num_threads=_IN_CALLING_THREAD)
        if not file.parts or len(file.parts) != len(headers.parts):
            raise DamagedFile(path, "parts are missing")
        # Compare the pixels of each channel with the size in the header.
        for part in file.parts:
            first, last = part.header["dataWindow"]
            width, height = (int(side) for side in last.astype(np.int64) - first + 1)
            if any(np.shape(content.pixels) != (height, width) for content in part.channels.values()):
                raise DamagedFile(path, "its pixels are damaged, or its channels differ in size")
    except (RuntimeError, ValueError, TypeError, LookupError, ArithmeticError, MemoryError, AttributeError) as error:
        raise DamagedFile(path, f"its header or its pixels are damaged ({error})") from error
    return file


def _values(part: OpenEXR.Part) -> int:
    """Count of the numbers in a part, or in one of its tiles if these are larger, by its header."""
    first, last = part.header["dataWindow"]
    extent = last.astype(np.int64) - first + 1
    tiles = part.header.get("tiles")
    of_tile = tiles.xSize * tiles.ySize if tiles else 0
    return len(part.header["channels"]) * max(int(extent[0]) * int(extent[1]), of_tile)


def _encode(part: Part, display: tuple[int, int], part_count: int) -> OpenEXR.Part:
    """A part as the binding takes it, tiled, with its checksum; `display` is the shape of the largest part."""
    channels = {name: np.array(pixels, dtype=np.float32, order="C") for name, pixels in sorted(part.channels.items())}
    header: dict[str, Any] = {name: _text(part, name, value) for name, value in sorted(part.attributes.items())}
    header |= {CRC: _crc32(part.name, channels, header), PART_COUNT: str(part_count)}
    header |= {"compression": _COMPRESSION, "dataWindow": _window(part.shape), "displayWindow": _window(display)}
    if PRIMARIES_XY in header:
        header["chromaticities"] = tuple(map(float, header[PRIMARIES_XY].split()))
    header |= {"type": OpenEXR.tiledimage, "tiles": OpenEXR.TileDescription()}
    header["tiles"].xSize = header["tiles"].ySize = TILE_PX
    header["tiles"].mode = OpenEXR.ONE_LEVEL
    return OpenEXR.Part(header, channels, part.name)


def _text(part: Part, name: str, value: object) -> str:
    """An attribute as text that keeps all digits of a number."""
    if isinstance(value, str):
        return value
    if isinstance(value, Integral):
        return repr(int(value))
    if isinstance(value, Real):
        return repr(float(value))
    raise TypeError(f'part "{part.name}": the attribute "{name}" is a {type(value).__name__}, not text or a number')


def _window(shape: tuple[int, int]) -> tuple[np.ndarray, np.ndarray]:
    return np.zeros(2, np.int32), np.array([shape[1] - 1, shape[0] - 1], np.int32)


def _crc32(part_name: str, channels: dict[str, np.ndarray], attributes: dict[str, Any]) -> str:
    crc = zlib.crc32(repr((part_name, sorted(attributes.items()))).encode())
    for name, pixels in sorted(channels.items()):
        crc = zlib.crc32(np.ascontiguousarray(pixels).data, zlib.crc32(f"{name} {pixels.shape}".encode(), crc))
    return f"{crc:08x}"
