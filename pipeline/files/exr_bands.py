"""OpenEXR files larger than memory, written band by band.

OpenEXR's binding takes whole files only. So its own encoder makes a file of each band, and their compressed tiles are
strung together: the bytes are those of `exr.write_exr`, whatever the height of a band. Headers, too, are the binding's,
of one-pixel parts, with other windows. Only the container is ours: headers, tables of offsets and chunks, as in
https://openexr.com/en/latest/OpenEXRFileLayout.html; all numbers are little-endian.

OpenImageIO 3.2 writes bands, too, but also the time of day into each header, so that no two files are alike; tests use
it as a referee.
"""

import io
import math
import struct
import zlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import BinaryIO

import numpy as np

from pipeline.files.exr import CRC, RESERVED, TILE_PX, Part, write_exr

_MAGIC, _MULTIPART = b"v/1\x01", 0x1000
_LONGEST = 1 << 20
"""Longest header [bytes]: ours have a few hundred."""
Rows = Callable[[int, int], np.ndarray]
"""Function from first and end row to pixels (rows, w, channels), or (rows, w) for one channel."""
_BAND_PX = 1 << 20
"""Pixels of a band: 4 MB per channel, and computing them takes some hundred bytes per pixel. A band of an image wider
than 8,192 pixels is one row of tiles.
"""
_PROBED_BYTES = 1 << 16
"""Size of a test write [bytes] that shows whether the disk is full."""
_POLYNOMIAL, _ONE, _BYTE = 0xEDB88320, 1 << 31, 1 << 23
"""CRC-32 (ISO-HDLC) arithmetic over GF(2), bit-reversed: x^32 reduced by the generator polynomial; x^0; x^8."""
Header = dict[str, tuple[str, bytes]]
"""Attributes of a part by name, each with its type and value as bytes, in the order of the file."""


class UnknownLayout(ValueError):
    """The bytes are not a file with this layout, or end too early."""


def _read_headers(stream: BinaryIO) -> list[Header]:
    """Headers of a file; afterwards the stream is at the tables of offsets."""
    magic = _exactly(stream, 4)
    version = _exactly(stream, 4)
    if magic != _MAGIC:
        raise UnknownLayout("not an OpenEXR file")
    data = io.BytesIO(stream.read(_LONGEST))
    headers = [_header(data)]
    while struct.unpack("<I", version)[0] & _MULTIPART and (following := _header(data)):
        headers.append(following)
    stream.seek(8 + data.tell())
    return headers


def _header(stream: io.BytesIO) -> Header:
    attributes = {}
    while name := _name(stream):
        kind = _name(stream)
        (size,) = struct.unpack("<i", _exactly(stream, 4))
        attributes[name] = kind, _exactly(stream, size)
    return attributes


def _name(stream: io.BytesIO) -> str:
    name = bytearray()
    while (byte := _exactly(stream, 1)) != b"\0":
        name += byte
    return name.decode()


def _exactly(stream: BinaryIO, size: int) -> bytes:
    data = stream.read(size) if size >= 0 else b""
    if size < 0 or len(data) < size:
        raise UnknownLayout("the file ends too early")
    return data


def _changed(header: Header, **values: bytes) -> Header:
    """The same header with other values for some of its attributes."""
    return {name: (kind, values.get(name, value)) for name, (kind, value) in header.items()}


def _box(shape: tuple[int, int]) -> bytes:
    """A window from (0, 0) with this number of rows and columns, as bytes."""
    return struct.pack("<4i", 0, 0, shape[1] - 1, shape[0] - 1)


def _grid(shape: tuple[int, int]) -> tuple[int, int]:
    """Rows and columns of tiles."""
    return -(-shape[0] // TILE_PX), -(-shape[1] // TILE_PX)


def _head(headers: list[Header], tables: list[np.ndarray]) -> bytes:
    """Bytes of everything before the chunks: headers and tables of offsets."""
    result = [_MAGIC, struct.pack("<I", 2 | (_MULTIPART if len(headers) > 1 else 0x200))]
    for header in headers:
        for name, (kind, value) in header.items():
            result += [name.encode(), b"\0", kind.encode(), b"\0", struct.pack("<i", len(value)), value]
        result.append(b"\0")
    return b"".join([*result, b"\0" if len(headers) > 1 else b"", *(table.tobytes() for table in tables)])


@dataclass(frozen=True, slots=True, kw_only=True)
class BandedPart:
    """A part of a file whose pixels are computed while they are written."""

    name: str
    shape: tuple[int, int]  # height and width [px]
    channels: tuple[str, ...]
    rows: Rows  # called for each band in turn, from the top
    attributes: dict[str, str | float | int] = field(default_factory=dict)  # as of `exr.Part`


def write_bands(path: str | Path, parts: list[BandedPart]) -> None:
    """Write the file that `exr.write_exr` writes for the same parts, with one band of a part in memory."""
    path = Path(path)
    band_file = path.with_name(f"{path.name}.band")
    try:
        headers = _headers(band_file, parts)
        tables = [np.zeros(_grid(part.shape), "<u8") for part in parts]
        with path.open("wb") as stream:
            stream.write(_head(headers, tables))
            for number, part in enumerate(parts):
                crcs = dict.fromkeys(sorted(part.channels), 0)
                part_number = number if len(parts) > 1 else None  # chunks of a single part have none
                for first, band in _bands(part):
                    for channel in crcs:
                        crcs[channel] = zlib.crc32(band.channels[channel].data, crcs[channel])
                    write_exr(band_file, [band])
                    above = first // TILE_PX
                    _append(stream, band_file, tables[number][above : above + _grid(band.shape)[0]], above, part_number)
                headers[number] = _changed(headers[number], **{CRC: _content_crc(part, headers[number], crcs)})
            stream.seek(0)
            stream.write(_head(headers, tables))
    except UnknownLayout:  # OpenEXR drops the error of a full disk when it closes a file; this write raises it
        with band_file.open("ab") as stream:
            stream.write(bytes(_PROBED_BYTES))
        raise
    finally:
        band_file.unlink(missing_ok=True)


def _headers(scratch: Path, parts: list[BandedPart]) -> list[Header]:
    """Headers of the complete file; their checksums are placeholders."""
    pixel = np.zeros((1, 1), np.float32)
    small = [Part(name=p.name, channels=dict.fromkeys(p.channels, pixel), attributes=p.attributes) for p in parts]
    write_exr(scratch, small)
    with scratch.open("rb") as stream:
        headers = _read_headers(stream)
    display = _box((max(part.shape[0] for part in parts), max(part.shape[1] for part in parts)))
    chunks = [struct.pack("<i", math.prod(_grid(part.shape))) for part in parts]
    return [
        _changed(header, dataWindow=_box(part.shape), displayWindow=display, chunkCount=count)
        for header, part, count in zip(headers, parts, chunks, strict=True)
    ]


def _bands(part: BandedPart) -> Iterator[tuple[int, Part]]:
    """First row and pixels of each band, whose height is a multiple of the tile size."""
    height, width = part.shape
    rows = TILE_PX * max(1, _BAND_PX // (TILE_PX * width))
    for first in range(0, height, rows):
        end = min(first + rows, height)
        pixels = np.atleast_3d(part.rows(first, end))
        if pixels.shape != (end - first, width, len(part.channels)):
            raise ValueError(f'part "{part.name}": rows {first} to {end} are {pixels.shape}')
        planes = (np.ascontiguousarray(plane, np.float32) for plane in np.moveaxis(pixels, -1, 0))
        yield first, Part(name=part.name, channels=dict(zip(part.channels, planes, strict=True)))


def _append(stream: BinaryIO, band_file: Path, table: np.ndarray, above: int, part: int | None) -> None:
    """Append the tiles of a band, below `above` rows of tiles, to a file, and note their positions in its table."""
    with band_file.open("rb") as band:
        _read_headers(band)
        for offset in np.frombuffer(_exactly(band, table.nbytes), "<u8"):
            band.seek(int(offset))
            column, row, *level, size = struct.unpack("<5i", _exactly(band, 20))
            table[row, column] = stream.tell()
            stream.write(b"" if part is None else struct.pack("<i", part))
            stream.write(struct.pack("<5i", column, above + row, *level, size) + _exactly(band, size))


def _content_crc(part: BandedPart, header: Header, crcs: dict[str, int]) -> bytes:
    """The checksum of `exr`, over the channels one after the other, from the checksum of each."""
    strings = ((name, value) for name, (kind, value) in header.items() if kind == "string")
    texts = sorted((name, value.decode()) for name, value in strings if name not in RESERVED)
    checksum = zlib.crc32(repr((part.name, texts)).encode())
    for channel, crc in crcs.items():
        checksum = zlib.crc32(f"{channel} {part.shape}".encode(), checksum)
        checksum = _joined(checksum, crc, 4 * part.shape[0] * part.shape[1])
    return f"{checksum:08x}".encode()


def _joined(first: int, second: int, second_bytes: int) -> int:
    """CRC-32 of two concatenated pieces, from their CRCs and the length of the second.

    The first CRC is multiplied by x^(8 n) for the n bytes that follow it, by repeated squaring.
    """
    shift = _ONE
    power = _BYTE
    while second_bytes:
        if second_bytes & 1:
            shift = _product(shift, power)
        power = _product(power, power)
        second_bytes = second_bytes >> 1
    return _product(first, shift) ^ second


def _product(a: int, b: int) -> int:
    """Product of two polynomials over GF(2), reduced by the generator of CRC-32."""
    result = 0
    for bit in range(31, -1, -1):
        if a >> bit & 1:
            result ^= b
        b = (b >> 1) ^ (_POLYNOMIAL if b & 1 else 0)
    return result
