"""OpenEXR files with several named parts of float32 channels.

The Python binding can lose data silently; this module prevents that:

- It ignores strides: a transposed or flipped array would be written wrong. Every channel is copied to C order.
- Float attributes shrink to float32 and integers beyond 32 bits become 0. Numbers in headers are `repr` strings.
- It reports a full disk only in the text of a message.
- It only warns when pixels cannot be decoded, and drops the parts that a truncated file lacks. Every part therefore
  carries the CRC-32 of its content and the number of parts, and a reader refuses what does not match.
"""

import errno
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
"""Edge of a tile [px], 64 KiB per channel: large enough to compress well, small beside the part of an image that a
viewer shows.
"""

# Lossless, and every reader of multi-part files knows it. Zstandard packs tighter and a third faster, but only the
# newest readers know that.
_COMPRESSION = OpenEXR.ZIP_COMPRESSION

_IN_CALLING_THREAD = 0
"""Number of further threads that encode: more are not faster at our sizes, and workers share the machine."""

CRC, PART_COUNT = "content_crc32", "part_count"
PRIMARIES_XY = "primaries_xy"
"""Attribute with x and y of red, green, blue and white; viewers look for it in `chromaticities`, single precision."""

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
        if taken := sorted(RESERVED & self.attributes.keys()):
            raise ValueError(f'part "{self.name}": OpenEXR or this module uses the attributes {taken} itself')

    @property
    def shape(self) -> tuple[int, int]:
        """Height and width [px]."""
        return np.shape(next(iter(self.channels.values())))  # type: ignore[return-value]


def write_exr(path: str | Path, parts: list[Part]) -> None:
    """Write parts, which may differ in size, to a file of any name in a folder that exists. Same parts, same bytes."""
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
        known = next((number for number in errno.errorcode if os.strerror(number) in str(error)), None)
        if known is None:
            raise
        raise OSError(known, os.strerror(known), str(path)) from error


def read_exr(path: str | Path) -> dict[str, Part]:
    """Parts of a file that `write_exr` wrote, by name in its order; DamagedFile if it is cut, altered or not of it."""
    path = Path(path)
    with path.open("rb"):  # a missing or unreadable file is an error of the system, not damage
        pass
    try:
        _require_plausible_size(path, OpenEXR.File(str(path), header_only=True, num_threads=_IN_CALLING_THREAD))
        file = OpenEXR.File(str(path), separate_channels=True, num_threads=_IN_CALLING_THREAD)
    except (RuntimeError, ValueError) as error:
        raise DamagedFile(path, f"not a readable OpenEXR file ({error})") from error
    parts = [_decode(path, encoded) for encoded in file.parts]
    counts = {encoded.header[PART_COUNT] for encoded in file.parts}
    if counts != {str(len(parts))}:
        raise DamagedFile(path, f"{len(parts)} parts can be read, {'/'.join(sorted(counts)) or 'more'} were written")
    return {part.name: part for part in parts}


def read_foreign_exr(path: str | Path, require_few: Callable[[int], None]) -> dict[str, np.ndarray]:
    """Channels (h, w) of the first part of a file of any program, by name; `require_few` may refuse the count of all.

    Raises DamagedFile: it is no OpenEXR file, its size is implausible, or its channels differ in size.
    """
    path = Path(path)
    try:
        headers = OpenEXR.File(str(path), header_only=True, num_threads=_IN_CALLING_THREAD)
        first, last = headers.parts[0].header["dataWindow"]
        width, height = (int(side) for side in last.astype(np.int64) - first + 1)
        if 4 * width * height > MAX_COMPRESSION_RATIO * path.stat().st_size:
            raise DamagedFile(path, f"{width} x {height} pixels cannot come from so short a file")
        require_few(sum(_values(part) for part in headers.parts))
        file = OpenEXR.File(str(path), separate_channels=True, num_threads=_IN_CALLING_THREAD)
        channels = {name: np.asarray(content.pixels) for name, content in file.parts[0].channels.items()}
    except (RuntimeError, ValueError, TypeError, LookupError, ArithmeticError, MemoryError) as error:
        raise DamagedFile(path, f"its header or its pixels are damaged ({error})") from error
    if any(pixels.shape != (height, width) for pixels in channels.values()):
        raise DamagedFile(path, "its channels differ in size")
    return channels


def _require_plausible_size(path: Path, headers: OpenEXR.File) -> None:
    """Refuse an implausible size before OpenEXR allocates memory: one wrong bit can ask for minutes and all memory."""
    for part in headers.parts:
        tile = part.header.get("tiles")
        if tile is not None and (tile.xSize, tile.ySize) != (TILE_PX, TILE_PX):
            raise DamagedFile(path, f"tiles of {tile.xSize} x {tile.ySize} pixels, not of {TILE_PX}")
    size = 4 * sum(_values(part) for part in headers.parts)
    if size > MAX_COMPRESSION_RATIO * path.stat().st_size:
        raise DamagedFile(path, f"{size} bytes of pixels cannot come from so short a file")


def _values(part: OpenEXR.Part) -> int:
    """Count of the numbers of a part, by its header."""
    first, last = part.header["dataWindow"]
    extent = last.astype(np.int64) - first + 1
    return len(part.header["channels"]) * int(extent[0]) * int(extent[1])


def _encode(part: Part, display: tuple[int, int], part_count: int) -> OpenEXR.Part:
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


def _decode(path: Path, encoded: OpenEXR.Part) -> Part:
    header, name = encoded.header, encoded.name()
    if CRC not in header or PART_COUNT not in header:
        raise DamagedFile(path, f'part "{name}" carries no checksum: this program did not write it')
    channels = {channel: content.pixels for channel, content in encoded.channels.items()}
    attributes = {key: value for key, value in header.items() if key not in RESERVED}
    if not all(isinstance(value, str) for value in [header[PART_COUNT], *attributes.values()]):
        raise DamagedFile(path, f'the header of part "{name}" holds more than text')
    if any(pixels is None for pixels in channels.values()) or _crc32(name, channels, attributes) != header[CRC]:
        raise DamagedFile(path, f'the content of part "{name}" does not match its checksum')
    return Part(name=name, channels=channels, attributes=attributes)


def _text(part: Part, name: str, value: object) -> str:
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
