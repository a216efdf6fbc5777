"""OpenEXR files with several named parts of float32 channels.

The Python binding can lose data silently; this module prevents that:

- It ignores strides: a transposed or flipped array would be written wrong. Every channel is copied to C order.
- Float attributes shrink to float32 and integers beyond 32 bits become 0. Numbers in headers are `repr` strings.
- It reports a full disk only in the text of a message.
- It only warns when pixels cannot be decoded, drops the parts that a truncated file lacks, and gives whole files only.
  Our files are therefore read here, by windows of rows; every part carries the CRC-32 of its content and the number of
  parts, and what does not match is refused.
"""

import contextlib
import errno
import io
import os
import struct
import zlib
from collections.abc import Callable
from dataclasses import dataclass, field
from numbers import Integral, Real
from pathlib import Path
from typing import Any, BinaryIO

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

MAGIC, MULTIPART = b"v/1\x01", 0x1000
_CHANNEL = 16
"""Bytes that follow the name of a channel: pixel type, flags, sampling."""
_LONGEST = 1 << 20
"""Longest header [bytes]: ours have a few hundred."""

CRC, PART_COUNT = "content_crc32", "part_count"
PRIMARIES_XY = "primaries_xy"
"""Attribute with x and y of red, green, blue and white; viewers look for it in `chromaticities`, single precision."""

_STRUCTURE = {"channels", "chunkCount", "compression", "lineOrder", "name", "tiles", "type", "version", "view"}
_GEOMETRY = {"dataWindow", "displayWindow", "pixelAspectRatio", "screenWindowCenter", "screenWindowWidth"}
_REQUIRED = _STRUCTURE - {"chunkCount", "version", "view"} | _GEOMETRY
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
    file, parts = ExrWindows(path), dict[str, Part]()
    for name, header in file.headers.items():
        channels = {channel: np.empty(header.shape, np.float32) for channel in header.channels}
        for first in range(0, header.shape[0], TILE_PX):  # a file may be as large as half of the memory
            for channel, pixels in file.rows(name, first, min(first + TILE_PX, header.shape[0])).items():
                channels[channel][first : first + TILE_PX] = pixels
        texts = header.texts
        attributes: dict[str, str | float | int] = {key: text for key, text in texts.items() if key not in RESERVED}
        if _crc32(name, channels, attributes) != texts.get(CRC):
            raise DamagedFile(Path(path), f'the content of part "{name}" does not match its checksum')
        parts[name] = Part(name=name, channels=channels, attributes=attributes)
    return parts


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
        with contextlib.redirect_stdout(io.StringIO()):  # of pixels that are damaged it prints warnings, and has none
            file = OpenEXR.File(str(path), separate_channels=True, num_threads=_IN_CALLING_THREAD)
        channels = {name: np.asarray(content.pixels) for name, content in file.parts[0].channels.items()}
    except (RuntimeError, ValueError, TypeError, LookupError, ArithmeticError, MemoryError) as error:
        raise DamagedFile(path, f"its header or its pixels are damaged ({error})") from error
    if any(pixels.shape != (height, width) for pixels in channels.values()):
        raise DamagedFile(path, "its channels differ in size")
    return channels


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


class UnknownLayout(ValueError):
    """The bytes are not a file with this layout, or end too early."""


@dataclass(frozen=True, slots=True)
class Header:
    """Header of a part: attributes by name, each with its type and value as bytes, in the order of the file."""

    attributes: dict[str, tuple[str, bytes]]

    @property
    def texts(self) -> dict[str, str]:
        """Attributes that are text."""
        return {name: value.decode() for name, (kind, value) in self.attributes.items() if kind == "string"}

    @property
    def channels(self) -> list[str]:
        """Names of the channels, in the order of the pixels."""
        names, data = [], self._value("channels", "chlist")
        while data and data[0]:
            name, _, rest = data.partition(b"\0")
            names.append(name.decode())
            data = rest[_CHANNEL:]
        return names

    @property
    def shape(self) -> tuple[int, int]:
        """Height and width [px]."""
        left, top, right, bottom = struct.unpack("<4i", self._value("dataWindow", "box2i"))
        if not 0 <= right - left < 1 << 30 or not 0 <= bottom - top < 1 << 30:
            raise UnknownLayout("a part without pixels")
        return bottom - top + 1, right - left + 1

    @property
    def tile_px(self) -> int:
        """Edge of its square tiles."""
        across, down, _ = struct.unpack("<IIB", self._value("tiles", "tiledesc"))
        if across != down or not 0 < across <= 1 << 12:
            raise UnknownLayout(f"tiles of {across} x {down} pixels")
        return int(across)

    @property
    def grid(self) -> tuple[int, int]:
        """Rows and columns of tiles."""
        height, width = self.shape
        return -(-height // self.tile_px), -(-width // self.tile_px)

    def having(self, **values: bytes) -> "Header":
        """The same header with other values for some of its attributes."""
        return Header({name: (kind, values.get(name, value)) for name, (kind, value) in self.attributes.items()})

    def _value(self, name: str, kind: str) -> bytes:
        stored, value = self.attributes.get(name, ("", b""))
        if stored != kind:
            raise UnknownLayout(f"no attribute {name} of type {kind}")
        return value


def read_headers(stream: BinaryIO) -> list[Header]:
    """Headers of a file; afterwards the stream is at the tables of offsets."""
    magic, version = stream.read(4), stream.read(4)
    if magic != MAGIC or len(version) < 4:
        raise UnknownLayout("not an OpenEXR file")
    data = stream.read(_LONGEST)
    many, taken = bool(struct.unpack("<I", version)[0] & MULTIPART), io.BytesIO(data)
    headers = [_header(taken)]
    while many and (following := _header(taken)).attributes:
        headers.append(following)
    stream.seek(8 + taken.tell())
    return headers


def _header(stream: io.BytesIO) -> Header:
    attributes = {}
    while name := _name(stream):
        kind, size = _name(stream), struct.unpack("<i", _exactly(stream, 4))[0]
        attributes[name.decode()] = kind.decode(), _exactly(stream, size)
    return Header(attributes)


def _name(stream: io.BytesIO) -> bytes:
    name = bytearray()
    while (byte := _exactly(stream, 1)) != b"\0":
        name += byte
    return bytes(name)


def _exactly(stream: BinaryIO, size: int) -> bytes:
    data = stream.read(size) if size >= 0 else b""
    if size < 0 or len(data) < size:
        raise UnknownLayout("the file ends too early")
    return data


def tile_at(stream: BinaryIO, offset: int, part: int | None) -> tuple[tuple[int, int], bytes]:
    """Column and row of the tile at an offset, and its compressed pixels; `part` is None in a file of one."""
    stream.seek(offset)
    stored_part = None if part is None else struct.unpack("<i", _exactly(stream, 4))[0]
    column, row, *level, size = struct.unpack("<5i", _exactly(stream, 20))
    if stored_part != part or level != [0, 0]:
        raise UnknownLayout("a tile of another part")
    return (column, row), _exactly(stream, size)


class ExrWindows:
    """A file that `write_exr` or `write_bands` wrote, opened to read rows of its parts.

    Of each part the rows of tiles that were read last are kept, so that overlapping windows decode a tile once. Every
    tile carries a checksum of its own; that of the whole part is not looked at.

    Raises DamagedFile: it is not of that layout, truncated, or a tile is damaged; also later, when rows are read.
    """

    def __init__(self, path: str | Path) -> None:
        self._path = Path(path)
        with self._path.open("rb") as stream:
            try:
                headers = read_headers(stream)
                self.headers = {header.texts["name"]: header for header in headers}
                sizes = [8 * header.grid[0] * header.grid[1] for header in headers]
                room = os.fstat(stream.fileno()).st_size
                known = all(header.channels and header.attributes.keys() >= _REQUIRED for header in headers)
                counts = {header.texts[PART_COUNT] for header in headers}
                if not known or counts != {str(len(headers))} or sum(sizes) > room:
                    raise UnknownLayout("parts are missing")
                self._tables = [
                    np.frombuffer(stream.read(size), "<u8").reshape(header.grid)
                    for size, header in zip(sizes, headers, strict=True)
                ]
                if any(table.max() > room for table in self._tables):
                    raise UnknownLayout("tiles are missing")
            except (ValueError, KeyError, struct.error) as error:
                raise DamagedFile(self._path, f"not a readable OpenEXR file of this program ({error})") from error
        self._decoded: dict[str, dict[int, np.ndarray]] = {}

    def rows(self, name: str, first: int, end: int) -> dict[str, np.ndarray]:
        """Channels of the rows [first, end) of a part, (end - first, w) float32 each."""
        header = self.headers[name]
        edge, kept = header.tile_px, self._decoded.get(name, {})
        wanted = range(first // edge, (end - 1) // edge + 1)
        self._decoded[name] = {row: kept[row] if row in kept else self._tiles(name, row) for row in wanted}
        pixels = np.concatenate(list(self._decoded[name].values()), axis=1)[:, first - wanted[0] * edge :]
        return dict(zip(header.channels, pixels[:, : end - first], strict=True))

    def _tiles(self, name: str, row: int) -> np.ndarray:
        """A row of tiles, (channels, h, w) float32."""
        header, number = self.headers[name], list(self.headers).index(name)
        (height, width), edge = header.shape, header.tile_px
        result = np.empty((len(header.channels), min(edge, height - row * edge), width), np.float32)
        with self._path.open("rb") as stream:
            try:
                for column, offset in enumerate(self._tables[number][row]):
                    stored, data = tile_at(stream, int(offset), number if len(self.headers) > 1 else None)
                    here = result[:, :, column * edge : (column + 1) * edge]
                    if stored != (column, row):
                        raise UnknownLayout("another tile")
                    pixels = np.frombuffer(_pixels(data, here.nbytes), "<f4")
                    here[:] = pixels.reshape(here.shape[1], here.shape[0], here.shape[2]).transpose(1, 0, 2)
            except (ValueError, OverflowError, struct.error, zlib.error) as error:
                raise DamagedFile(self._path, f'a tile of part "{name}" cannot be read ({error})') from error
        return result


def _pixels(data: bytes, size: int) -> np.ndarray:
    """Bytes of a tile, from its chunk: as they are, or deflated differences of halves (`ZIP_COMPRESSION`)."""
    if len(data) == size:
        return np.frombuffer(data, np.uint8)
    inflated = zlib.decompressobj().decompress(data, size + 1)
    if len(inflated) != size:
        raise UnknownLayout("a tile of another size")
    differences = np.frombuffer(inflated, np.uint8).copy()
    differences[1:] -= 128
    halves = np.cumsum(differences, dtype=np.uint8)
    result = np.empty(size, np.uint8)
    result[0::2], result[1::2] = halves[: (size + 1) // 2], halves[(size + 1) // 2 :]
    return result
