"""TIFF files of raw images: one plane of 16-bit digital numbers, uncompressed, in one strip behind its tags.

Any reader of TIFF opens them, and so does a memory map. The description is a JSON object of what the numbers mean, with
the CRC-32 of itself and the pixels, by which a reader of ours knows damage.

References
----------
TIFF, Revision 6.0, Adobe 1992.
"""

import enum
import json
import struct
import zlib
from collections.abc import Callable
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np

from pipeline.files.damaged import DamagedFile

CRC = "content_crc32"
"""Key of the checksum in the description."""

_BLACK_IS_ZERO = 1
"""How a viewer shows a plane of numbers: 0 is black."""
_BAND_PX = 1 << 20
"""Pixels that are made and written at once: 2 MB, and what makes them takes some hundred bytes a pixel."""
_LARGEST_BYTES = 2**32
"""Bytes that a TIFF file may have: its offsets have 32 bits."""
_HEAD_BYTES = 1 << 10
"""Bytes that hold the directory: a dozen bytes each for some thirty tags."""
_LARGEST = 2**31 - 1
"""Numerator and denominator of a fraction at most [1], also of one with a sign."""


class Kind(enum.IntEnum):
    """Types of values, as TIFF numbers them."""

    BYTE = 1
    ASCII = 2
    SHORT = 3
    LONG = 4
    RATIONAL = 5
    SRATIONAL = 10


class Name(enum.IntEnum):
    """Tags, as TIFF 6.0, TIFF/EP and DNG number them."""

    SUBFILE = 254
    WIDTH = 256
    HEIGHT = 257
    BITS = 258
    COMPRESSION = 259
    PHOTOMETRIC = 262
    DESCRIPTION = 270
    MAKE = 271
    MODEL = 272
    OFFSETS = 273
    ORIENTATION = 274
    SAMPLES = 277
    ROWS_PER_STRIP = 278
    BYTE_COUNTS = 279
    PLANAR = 284
    PATTERN_SIZE = 33421
    PATTERN = 33422
    EXPOSURE_TIME = 33434
    DNG_VERSION = 50706
    DNG_BACKWARD = 50707
    UNIQUE_MODEL = 50708
    PLANE_COLOURS = 50710
    PATTERN_LAYOUT = 50711
    BLACK_SIZE = 50713
    BLACK = 50714
    WHITE = 50717
    COLOUR_MATRIX = 50721
    COLOUR_MATRIX_2 = 50722
    NEUTRAL = 50728
    ILLUMINANT = 50778
    ILLUMINANT_2 = 50779


_FORMATS = {Kind.BYTE: "B", Kind.ASCII: "s", Kind.SHORT: "H", Kind.LONG: "I", Kind.RATIONAL: "II", Kind.SRATIONAL: "ii"}

Rows = Callable[[int, int], np.ndarray]
"""First and end row to digital numbers, (rows, w) uint16."""


@dataclass(frozen=True, slots=True)
class Tag:
    """A tag of a TIFF file: its number, the type of its values, and these."""

    number: Name
    kind: Kind
    values: tuple[Any, ...]

    @property
    def data(self) -> bytes:
        """The values as they are stored."""
        if self.kind == Kind.ASCII:
            return str(self.values[0]).encode("ascii") + b"\0"
        if self.kind in (Kind.RATIONAL, Kind.SRATIONAL):
            finest = [max(1, int(_LARGEST / max(1.0, abs(value)))) for value in self.values]
            fractions = map(Fraction.limit_denominator, map(Fraction, self.values), finest)
            return b"".join(struct.pack(f"<{_FORMATS[self.kind]}", *one.as_integer_ratio()) for one in fractions)
        return struct.pack(f"<{len(self.values)}{_FORMATS[self.kind]}", *self.values)

    @property
    def count(self) -> int:
        """Number of values; of a text its bytes."""
        return len(self.data) if self.kind == Kind.ASCII else len(self.values)


def write_tiff(
    path: str | Path, shape: tuple[int, int], rows: Rows, about: dict[str, Any], more: tuple[Tag, ...] = ()
) -> None:
    """Write a plane of digital numbers band by band; the same pixels, the same bytes.

    Parameters
    ----------
    shape : (int, int)
        Height and width [px].
    rows : callable
        Called for one band after the other, from the top.
    about : dict
        Meaning of the numbers as plain values: the description.
    more : tuple of Tag
        Further tags, which take the place of ours of the same number.
    """
    height, width = shape
    if 2 * height * width > _LARGEST_BYTES // 2:
        raise ValueError(f"{path}: {height} x {width} pixels are more than a TIFF file holds")
    with Path(path).open("wb") as stream:
        head = _head(shape, about, 0, more)
        stream.write(head)
        crc = zlib.crc32(_text(about).encode())
        band = max(1, _BAND_PX // width)
        for first in range(0, height, band):
            end = min(first + band, height)
            pixels = np.ascontiguousarray(rows(first, end), "<u2")
            if pixels.shape != (end - first, width):
                raise ValueError(f"{path}: rows {first} to {end} are {pixels.shape}")
            crc = zlib.crc32(pixels.data, crc)
            stream.write(pixels.data)
        stream.seek(0)
        stream.write(_head(shape, about, crc, more))


def _head(shape: tuple[int, int], about: dict[str, Any], crc: int, more: tuple[Tag, ...]) -> bytes:
    """Everything before the pixels: as long for any checksum."""
    text = _text({**about, CRC: f"{crc:08x}"})
    plain = (
        Tag(Name.WIDTH, Kind.LONG, (shape[1],)),
        Tag(Name.HEIGHT, Kind.LONG, (shape[0],)),
        Tag(Name.BITS, Kind.SHORT, (16,)),
        Tag(Name.COMPRESSION, Kind.SHORT, (1,)),
        Tag(Name.PHOTOMETRIC, Kind.SHORT, (_BLACK_IS_ZERO,)),
        Tag(Name.DESCRIPTION, Kind.ASCII, (text,)),
        Tag(Name.OFFSETS, Kind.LONG, (0,)),
        Tag(Name.ORIENTATION, Kind.SHORT, (1,)),
        Tag(Name.SAMPLES, Kind.SHORT, (1,)),
        Tag(Name.ROWS_PER_STRIP, Kind.LONG, (shape[0],)),
        Tag(Name.BYTE_COUNTS, Kind.LONG, (2 * shape[0] * shape[1],)),
        Tag(Name.PLANAR, Kind.SHORT, (1,)),
    )
    tags = {tag.number: tag for tag in (*plain, *more)}
    length = len(_laid_out(tags))
    return _laid_out({**tags, Name.OFFSETS: Tag(Name.OFFSETS, Kind.LONG, (length,))})


def _text(about: dict[str, Any]) -> str:
    return json.dumps(about, ensure_ascii=True, allow_nan=False)


def _laid_out(tags: dict[Name, Tag]) -> bytes:
    """Header, directory, and the values that do not fit into the directory's four bytes."""
    at = 8 + 2 + 12 * len(tags) + 4
    directory, values = struct.pack("<H", len(tags)), b""
    for number in sorted(tags):
        tag = tags[number]
        data = tag.data
        if len(data) > 4:
            data += b"\0" * (-len(data) % 4)
            field, values = struct.pack("<I", at + len(values)), values + data
        else:
            field = data.ljust(4, b"\0")
        directory += struct.pack("<HHI", number, tag.kind, tag.count) + field
    return b"II*\0" + struct.pack("<I", 8) + directory + struct.pack("<I", 0) + values


def read_tiff(path: str | Path) -> tuple[np.ndarray, dict[str, Any]]:
    """Digital numbers and description of a file that `write_tiff` or `dng.write_dng` wrote.

    Returns
    -------
    (h, w) uint16
    dict

    Raises
    ------
    DamagedFile
        If it is truncated, altered, or not from `write_tiff`.
    """
    data = Path(path).read_bytes()
    try:
        found = _directory(data)
        height, width, start = (
            int.from_bytes(found[number], "little") for number in (Name.HEIGHT, Name.WIDTH, Name.OFFSETS)
        )
        about = json.loads(found[Name.DESCRIPTION].rstrip(b"\0"))
        crc = about.pop(CRC)
    except (struct.error, KeyError, ValueError, AttributeError, IndexError, RecursionError) as error:
        raise DamagedFile(path, f"not a readable TIFF file of this program ({error})") from error
    pixels, described = memoryview(data)[start:], zlib.crc32(_text(about).encode())
    if len(pixels) != 2 * height * width or f"{zlib.crc32(pixels, described):08x}" != crc:
        raise DamagedFile(path, "the content does not match its checksum")
    return np.frombuffer(pixels, "<u2").reshape(height, width).astype(np.uint16), about


def mapped(path: str | Path) -> np.ndarray:
    """Digital numbers of a file of ours that was just written, (h, w) uint16, read where they are asked for."""
    with Path(path).open("rb") as stream:
        found = _directory(stream.read(_HEAD_BYTES))
    height, width, start = (
        int.from_bytes(found[number], "little") for number in (Name.HEIGHT, Name.WIDTH, Name.OFFSETS)
    )
    return np.memmap(path, "<u2", "r", start, (height, width))


def _directory(data: bytes) -> dict[int, bytes]:
    """Bytes of the values of each tag."""
    if data[:8] != b"II*\0" + struct.pack("<I", 8):
        raise ValueError("another header")
    (count,) = struct.unpack_from("<H", data, 8)
    found = {}
    for number in range(count):
        tag, kind, values, field = struct.unpack_from("<HHI4s", data, 10 + 12 * number)
        size = values * struct.calcsize(f"<{_FORMATS[kind]}")
        at = struct.unpack("<I", field)[0] if size > 4 else 18 + 12 * number
        found[tag] = data[at : at + size]
    return found
