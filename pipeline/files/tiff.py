"""TIFF files of raw images: one plane of 16-bit digital numbers, uncompressed, in one strip behind its tags.

tifffile writes the tags; the numbers follow band by band, so that a full disk is an error of the system. Any reader of
TIFF opens the files, and so does a memory map. The description is a JSON object of what the numbers mean, with the
CRC-32 of itself and the pixels, by which a reader of ours knows damage. No date and no program is in a file: the same
image gives the same bytes.
"""

import io
import json
import zlib
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import tifffile

from pipeline.files.damaged import DamagedFile

CRC = "content_crc32"
"""Key of the checksum in the description."""

_BAND_PX = 1 << 20
"""Pixels that are made and written at once: 2 MB, and what makes them takes some hundred bytes a pixel."""
_LARGEST_BYTES = 2**31
"""Bytes of an image at most: half of what the offsets of a TIFF file, of 32 bits, reach."""

Rows = Callable[[int, int], np.ndarray]
"""First and end row to digital numbers, (rows, w) uint16."""
Tag = tuple[int, int, int, Any, bool]
"""A tag as tifffile takes it: number, type, count, values, and True."""


def write_tiff(
    path: str | Path,
    shape: tuple[int, int],
    rows: Rows,
    about: dict[str, Any],
    photometric: int = tifffile.PHOTOMETRIC.MINISBLACK,
    more: Sequence[Tag] = (),
) -> None:
    """Write a plane of digital numbers band by band; the same pixels, the same bytes.

    `shape`: (int, int), height and width [px].
    `rows`: called for one band after the other, from the top.
    `about`: meaning of the numbers as plain values: the description.
    `photometric`: kind of the pixels, as TIFF numbers it.
    `more`: sequence of Tag, further tags.
    """
    height, width = shape
    if 2 * height * width > _LARGEST_BYTES:
        raise ValueError(f"{path}: {height} x {width} pixels are more than a TIFF file holds")
    with tifffile.TiffWriter(path, byteorder="<") as file:
        placed = file.write(
            shape=shape,
            dtype=np.uint16,
            photometric=tifffile.PHOTOMETRIC.MINISBLACK,
            rowsperstrip=height,
            description=_text({**about, CRC: "0" * 8}),
            metadata=None,
            software=False,
            subfiletype=0,
            extratags=[(274, tifffile.DATATYPE.SHORT, 1, 1, True), *more],
            returnoffset=True,
        )
    assert placed is not None, "a plane that is not compressed is in one place"
    crc = zlib.crc32(_text(about).encode())
    band = max(1, _BAND_PX // width)
    with Path(path).open("r+b") as stream:
        stream.seek(placed[0])
        for first in range(0, height, band):
            end = min(first + band, height)
            pixels = np.ascontiguousarray(rows(first, end), "<u2")
            if pixels.shape != (end - first, width):
                raise ValueError(f"{path}: rows {first} to {end} are {pixels.shape}")
            crc = zlib.crc32(pixels.data, crc)
            stream.write(pixels.data)
    with tifffile.TiffFile(path, mode="r+") as file:
        tags = file.pages.first.tags
        tags["ImageDescription"].overwrite(_text({**about, CRC: f"{crc:08x}"}))
        tags["PhotometricInterpretation"].overwrite(photometric)  # tifffile writes no linear raw of one plane


def _text(about: dict[str, Any]) -> str:
    return json.dumps(about, ensure_ascii=True, allow_nan=False)


def read_tiff(path: str | Path) -> tuple[np.ndarray, dict[str, Any]]:
    """Digital numbers and description of a file that `write_tiff` or `dng.write_dng` wrote.

    Returns (h, w) uint16.
    Returns dict.
    Raises DamagedFile: if it is truncated, altered, or not from `write_tiff`.
    """
    data = Path(path).read_bytes()
    try:
        with tifffile.TiffFile(io.BytesIO(data)) as file:
            page = file.pages.first
            start, shape, about = page.dataoffsets[0], (page.imagelength, page.imagewidth), json.loads(page.description)
        crc = about.pop(CRC)
    except Exception as error:  # a damaged tag may lead tifffile anywhere
        raise DamagedFile(path, f"not a readable TIFF file of this program ({error})") from error
    pixels, described = memoryview(data)[start:], zlib.crc32(_text(about).encode())
    if len(pixels) != 2 * shape[0] * shape[1] or f"{zlib.crc32(pixels, described):08x}" != crc:
        raise DamagedFile(path, "the content does not match its checksum")
    return np.frombuffer(pixels, "<u2").reshape(shape).astype(np.uint16), about


def mapped(path: str | Path) -> np.ndarray:
    """Digital numbers of a file of ours that was just written, (h, w) uint16, read where they are asked for."""
    with tifffile.TiffFile(path) as file:
        page = file.pages.first
        return np.memmap(path, "<u2", "r", page.dataoffsets[0], (page.imagelength, page.imagewidth))
