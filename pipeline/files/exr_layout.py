"""The container of a tiled OpenEXR file: headers, tables of offsets, chunks.

As in https://openexr.com/en/latest/OpenEXRFileLayout.html. Values of headers and the content of chunks, as the binding
wrote them, pass through as bytes. All numbers are little-endian.
"""

import io
import struct
from dataclasses import dataclass
from typing import BinaryIO

_MAGIC, _MULTIPART = b"v/1\x01", 0x1000
_CHANNEL = 16
"""Bytes that follow the name of a channel: pixel type, flags, sampling."""
_LONGEST = 1 << 20
"""Longest header [bytes]: ours have a few hundred."""


class UnknownLayout(ValueError):
    """The bytes are not a file with this layout."""


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
        return Header(
            {name: (kind, values.get(name, value)) for name, (kind, value) in self.attributes.items()},
        )

    def _value(self, name: str, kind: str) -> bytes:
        stored, value = self.attributes.get(name, ("", b""))
        if stored != kind:
            raise UnknownLayout(f"no attribute {name} of type {kind}")
        return value


def box(shape: tuple[int, int]) -> bytes:
    """A window from (0, 0) with a number of rows and columns, as bytes."""
    return struct.pack("<4i", 0, 0, shape[1] - 1, shape[0] - 1)


def bytes_of(headers: list[Header]) -> bytes:
    """Bytes of everything before the tables of offsets."""
    result = [_MAGIC, struct.pack("<I", 2 | (_MULTIPART if len(headers) > 1 else 0x200))]
    for header in headers:
        for name, (kind, value) in header.attributes.items():
            result += [name.encode(), b"\0", kind.encode(), b"\0", struct.pack("<i", len(value)), value]
        result.append(b"\0")
    return b"".join([*result, b"\0" if len(headers) > 1 else b""])


def read_headers(stream: BinaryIO) -> list[Header]:
    """Headers of a file; afterwards the stream is at the tables of offsets.

    Raises UnknownLayout: the file is not of this layout, or ends.
    """
    magic, version = stream.read(4), stream.read(4)
    if magic != _MAGIC or len(version) < 4:
        raise UnknownLayout("not an OpenEXR file")
    data = stream.read(_LONGEST)
    many, taken = bool(struct.unpack("<I", version)[0] & _MULTIPART), io.BytesIO(data)
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


@dataclass(frozen=True, slots=True)
class Chunk:
    """A tile as stored in a file: its column and row among tiles, and its compressed pixels."""

    column: int
    row: int
    data: bytes

    def to_bytes(self, part: int | None) -> bytes:
        """Bytes of the chunk in a file of several parts, or of one (None)."""
        head = struct.pack("<5i", self.column, self.row, 0, 0, len(self.data))
        return (b"" if part is None else struct.pack("<i", part)) + head + self.data


def read_chunk(stream: BinaryIO, offset: int, part: int | None) -> Chunk:
    """The chunk at an offset of a file.

    Raises UnknownLayout: the offset holds another chunk.
    """
    stream.seek(offset)
    stored_part = None if part is None else struct.unpack("<i", _exactly(stream, 4))[0]
    column, row, *level, size = struct.unpack("<5i", _exactly(stream, 20))
    if stored_part != part or level != [0, 0]:
        raise UnknownLayout("a tile of another part")
    return Chunk(column, row, _exactly(stream, size))
