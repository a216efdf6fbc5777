"""TIFF files of raw images: one plane of 16-bit digital numbers, uncompressed, in one strip behind its tags.

tifffile writes the tags; the numbers follow band by band, so that a full disk is an error of the system. Any TIFF
reader opens the files, and so does a memory map. The description is a JSON object that states the meaning of the
numbers, with the CRC-32 of itself and the pixels, by which our reader detects damage. A file holds no date and no
program name: equal images give equal bytes.

A digital negative (DNG) is such a file with further tags for raw converters: Digital Negative (DNG) Specification,
Version 1.4.0.0, Adobe 2012.
"""

import io
import json
import math
import struct
import zlib
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from fractions import Fraction
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import tifffile
from tifffile import DATATYPE, PHOTOMETRIC, TIFF

from pipeline.channel_names import COLOURS, colour_of
from pipeline.files.damaged import DamagedFile
from pipeline.records.plain import Json

CRC = "content_crc32"
"""Key of the checksum in the description."""

_BAND_PX = 1 << 20
"""Pixels computed and written at once: 2 MB, and computing them takes some hundred bytes per pixel."""
_LARGEST_BYTES = 2**31
"""Bytes of an image at most: half of what the offsets of a TIFF file, of 32 bits, reach."""
_VERSION, _READABLE_SINCE = (1, 4, 0, 0), (1, 1, 0, 0)
"""Version of the specification, and the oldest version whose readers suffice: every tag here is as old as that."""
_MAKER = "plenoptic-pipeline"
_LIGHTS, _OTHER_LIGHT = {"A": 17, "B": 18, "C": 19, "D55": 20, "D65": 21, "D75": 22, "D50": 23}, 255
"""Exif numbers of illuminants, and the number of all others."""
_TO_EXIF, _EXIF_VERSION = 34665, 36864
"""Tags of the offset of the Exif directory, and of its version, here 2.3, which every such directory needs."""
_LARGEST = 2**31 - 1
"""Largest numerator and denominator of a fraction [1], valid also for signed ones."""

Rows = Callable[[int, int], np.ndarray]
"""Function from first and end row to digital numbers, (rows, w) uint16."""
Tag = tuple[int, int, int, Any, bool]
"""A tag as tifffile takes it: number, type, count, values, and True."""


class Tags(NamedTuple):
    """Further tags that make a TIFF file a negative."""

    photometric: int
    more: Sequence[Tag]
    exif: Mapping[int, float]  # positive fractions by their tags, of a directory of Exif behind the pixels


def write_tiff(
    path: str | Path,
    shape: tuple[int, int],
    rows: Rows,
    about: Json,
    negative_tags: Tags | None = None,
) -> None:
    """Write a plane of digital numbers band by band; equal pixels give equal bytes.

    `shape`: height and width [px].
    `rows`: called for one band after the other, from the top.
    `about`: meaning of the numbers as plain values: the description.
    """
    height, width = shape
    photometric, more, exif = negative_tags or Tags(PHOTOMETRIC.MINISBLACK, (), {})
    if 2 * height * width > _LARGEST_BYTES:
        raise ValueError(f"{path}: {height} x {width} pixels are more than a TIFF file holds")
    directory: list[Tag] = [(_TO_EXIF - 1, DATATYPE.LONG, 1, 0, True)] if exif else []  # tifffile writes no ExifTag
    with tifffile.TiffWriter(path, byteorder="<") as file:
        plane = file.write(
            shape=shape,
            dtype=np.uint16,
            photometric=PHOTOMETRIC.MINISBLACK,
            rowsperstrip=height,
            description=_text({**about, CRC: "0" * 8}),
            metadata=None,
            software=False,
            subfiletype=0,
            extratags=[(274, DATATYPE.SHORT, 1, 1, True), *more, *directory],
            returnoffset=True,
        )
    assert plane is not None, "a plane that is not compressed is in one place"
    crc = zlib.crc32(_text(about).encode())
    band = max(1, _BAND_PX // width)
    with Path(path).open("r+b") as stream:
        stream.seek(plane[0])
        for first in range(0, height, band):
            end = min(first + band, height)
            pixels = np.ascontiguousarray(rows(first, end), "<u2")
            if pixels.shape != (end - first, width):
                raise ValueError(f"{path}: rows {first} to {end} are {pixels.shape}")
            crc = zlib.crc32(pixels.data, crc)
            stream.write(pixels.data)
        directory_at = stream.tell()
        if exif:
            stream.write(_directory(exif, directory_at))
    with tifffile.TiffFile(path, mode="r+") as file:
        tags = file.pages.first.tags
        if exif:
            to_exif = tags[_TO_EXIF - 1].overwrite(directory_at)
            file.filehandle.seek(to_exif.offset)
            file.filehandle.write(_TO_EXIF.to_bytes(2, "little"))
        tags["ImageDescription"].overwrite(_text({**about, CRC: f"{crc:08x}"}))
        tags["PhotometricInterpretation"].overwrite(photometric)  # tifffile writes no linear raw of one plane


def _directory(fractions: Mapping[int, float], at: int) -> bytes:
    """An Exif directory at this offset of the file, followed by its fractions."""
    entries = {_EXIF_VERSION: struct.pack("<HHI4s", _EXIF_VERSION, DATATYPE.UNDEFINED, 4, b"0230")}
    first_fraction = at + 2 + 12 * (len(fractions) + 1) + 4  # behind the count, the entries, and the end mark
    for number, tag in enumerate(fractions):
        entries[tag] = struct.pack("<HHII", tag, DATATYPE.RATIONAL, 1, first_fraction + 8 * number)
    values = (struct.pack("<II", *_fraction(value)) for value in fractions.values())
    return b"".join([struct.pack("<H", len(entries)), *(entries[tag] for tag in sorted(entries)), bytes(4), *values])


def _text(about: Json) -> str:
    return json.dumps(about, ensure_ascii=True, allow_nan=False)


def read_tiff(path: str | Path) -> tuple[np.ndarray, Json]:
    """Digital numbers (h, w) uint16 and description of a file of this module; DamagedFile if foreign or altered."""
    data = Path(path).read_bytes()
    try:
        with tifffile.TiffFile(io.BytesIO(data)) as file:
            page = file.pages.first
            start = page.dataoffsets[0]
            shape = (page.imagelength, page.imagewidth)
            about = json.loads(page.description)
        crc = about.pop(CRC)
    except Exception as error:  # a damaged tag may lead tifffile anywhere
        raise DamagedFile(path, f"not a readable TIFF file of this program ({error})") from error
    pixels = memoryview(data)[start : start + 2 * shape[0] * shape[1]]
    described = zlib.crc32(_text(about).encode())
    if len(pixels) != 2 * shape[0] * shape[1] or f"{zlib.crc32(pixels, described):08x}" != crc:
        raise DamagedFile(path, "the content does not match its checksum")
    return np.frombuffer(pixels, "<u2").reshape(shape).astype(np.uint16), about


def mapped(path: str | Path) -> np.ndarray:
    """Memory map of the digital numbers of a file that was just written, (h, w) uint16."""
    with tifffile.TiffFile(path) as file:
        page = file.pages.first
        return np.memmap(path, "<u2", "r", page.dataoffsets[0], (page.imagelength, page.imagewidth))


@dataclass(frozen=True, slots=True, kw_only=True)
class Negative:
    """Facts of a raw image that a raw converter needs."""

    model: str  # name of the camera
    black_dn: float  # digital number of no light, without noise; kept to 1/65536
    white_dn: int  # value of saturation
    # Names with a colour of `COLOURS` of n x n pixels, row by row; one name: a camera without filters
    filters: tuple[str, ...] = ("mono",)
    # Of its exposure and its lens; 0: not stated
    exposure_time_s: float = 0.0
    f_number: float = 0.0
    focal_length_mm: float = 0.0
    neutral: tuple[float, ...] = ()  # what red, green and blue count of white, over the most; empty: unknown
    # Three rows each, what they count of CIE 1931 X, Y and Z, Y of white being 1, by names of lights: that of the
    # scene, and another
    from_xyz: dict[str, list[list[float]]] = field(default_factory=dict)


def write_dng(path: str | Path, shape: tuple[int, int], rows: Rows, about: Json, negative: Negative) -> None:
    """Write a negative as `write_tiff` does; ValueError if a filter array names a colour that DNG lacks."""
    model = negative.model.encode("ascii", "backslashreplace").decode()
    tags = [
        _tag("Make", DATATYPE.ASCII, _MAKER),
        _tag("Model", DATATYPE.ASCII, model),
        _tag("UniqueCameraModel", DATATYPE.ASCII, f"{_MAKER} {model}"),
        _tag("DNGVersion", DATATYPE.BYTE, bytes(_VERSION)),
        _tag("DNGBackwardVersion", DATATYPE.BYTE, bytes(_READABLE_SINCE)),
        _tag("BlackLevelRepeatDim", DATATYPE.SHORT, (1, 1)),
        _fractions("BlackLevel", DATATYPE.RATIONAL, (negative.black_dn,)),
        _tag("WhiteLevel", DATATYPE.LONG, (negative.white_dn,)),
        *_filter_tags(negative.filters),
        *_colour_tags(negative),
    ]
    facts = {
        "ExposureTime": negative.exposure_time_s,
        "FNumber": negative.f_number,
        "FocalLength": negative.focal_length_mm,
    }
    exif = {TIFF.EXIF_TAGS[name]: value for name, value in facts.items() if 0 < value < math.inf}
    has_mosaic = len(set(negative.filters)) > 1
    kind = PHOTOMETRIC.CFA if has_mosaic else PHOTOMETRIC.LINEAR_RAW
    write_tiff(path, shape, rows, about, Tags(kind, tags, exif))


def _tag(name: str, kind: DATATYPE, values: str | bytes | tuple[int, ...]) -> Tag:
    return TIFF.TAGS[name], kind, len(values), values, True


def _fractions(name: str, kind: DATATYPE, values: Iterable[float]) -> Tag:
    """A tag of numbers as fractions, each as near to its number as TIFF can write it."""
    ratios = [_fraction(value) for value in values]
    return TIFF.TAGS[name], kind, len(ratios), tuple(number for ratio in ratios for number in ratio), True


def _fraction(value: float) -> tuple[int, int]:
    return Fraction(value).limit_denominator(max(1, int(_LARGEST / max(1.0, abs(value))))).as_integer_ratio()


def _colour_tags(negative: Negative) -> Iterator[Tag]:
    """Tags of the white point, and of a colour matrix for each illuminant."""
    if negative.neutral:
        yield _fractions("AsShotNeutral", DATATYPE.RATIONAL, negative.neutral)
    for number, (light, rows) in enumerate(negative.from_xyz.items(), start=1):
        yield _fractions(f"ColorMatrix{number}", DATATYPE.SRATIONAL, (value for row in rows for value in row))
        yield _tag(f"CalibrationIlluminant{number}", DATATYPE.SHORT, (_LIGHTS.get(light, _OTHER_LIGHT),))


def nameless_filters(filters: Iterable[str]) -> list[str]:
    """Filters of a mosaic whose names state no colour of DNG; a sensor without a mosaic has none."""
    names = sorted(set(filters))
    return [name for name in names if colour_of(name) is None] if len(names) > 1 else []


def _filter_tags(filters: tuple[str, ...]) -> Iterator[Tag]:
    """Tags of the mosaic of a sensor; none without one."""
    if len(set(filters)) == 1:
        return
    if unknown := nameless_filters(filters):
        raise ValueError(f"no DNG of the filters {', '.join(unknown)}: it knows {', '.join(COLOURS)}")
    edge = math.isqrt(len(filters))
    numbers = [COLOURS.index(colour_of(name) or "") for name in filters]
    yield _tag("CFARepeatPatternDim", DATATYPE.SHORT, (edge, edge))
    yield _tag("CFAPattern", DATATYPE.BYTE, bytes(numbers))
    yield _tag("CFAPlaneColor", DATATYPE.BYTE, bytes(sorted(set(numbers))))
    yield _tag("CFALayout", DATATYPE.SHORT, (1,))
