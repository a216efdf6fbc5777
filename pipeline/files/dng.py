"""Digital negatives (DNG): a TIFF file whose further tags say what a raw converter has to know.

References
----------
Digital Negative (DNG) Specification, Version 1.4.0.0, Adobe 2012.
"""

import itertools
import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from pipeline.channel_names import COLOURS, colour_of
from pipeline.files.tiff import Kind, Name, Rows, Tag, write_tiff

_VERSION, _READABLE_SINCE = (1, 4, 0, 0), (1, 1, 0, 0)
"""Version of the specification, and the oldest whose readers can read it: everything here is as old as that."""
_LINEAR_RAW, _FILTER_ARRAY = 34892, 32803
"""Kinds of pixels: one plane without filters, and a mosaic."""
_MAKER = "plenoptic-pipeline"
_LIGHTS, _OTHER_LIGHT = {"A": 17, "B": 18, "C": 19, "D55": 20, "D65": 21, "D75": 22, "D50": 23}, 255
"""Illuminants that Exif numbers, and the number of all others."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Negative:
    """Facts of a raw image that a raw converter has to know.

    Attributes
    ----------
    model : str
        Name of the camera.
    black_dn : float
        Digital number of no light, without noise; kept to 1/65536.
    white_dn : int
        Value of saturation.
    filters : tuple of str
        Names with a colour of `COLOURS` of n x n pixels, row by row; one name: a camera without filters.
    exposure_time_s : float
        0: it is not stated.
    neutral : tuple of float
        What red, green and blue count of white, over the most; empty: unknown.
    from_xyz : dict of str to 3 rows
        What they count of CIE 1931 X, Y and Z, Y of white being 1, by names of lights: that of the scene, and another.
    """

    model: str
    black_dn: float
    white_dn: int
    filters: tuple[str, ...] = ("mono",)
    exposure_time_s: float = 0.0
    neutral: tuple[float, ...] = ()
    from_xyz: dict[str, list[list[float]]] = field(default_factory=dict)


def write_dng(path: str | Path, shape: tuple[int, int], rows: Rows, about: dict[str, Any], negative: Negative) -> None:
    """Write digital numbers band by band as a negative; the first five arguments as of `tiff.write_tiff`.

    Raises
    ------
    ValueError
        If a filter array names a colour that DNG does not know.
    """
    tags = (
        Tag(Name.SUBFILE, Kind.LONG, (0,)),
        Tag(Name.MAKE, Kind.ASCII, (_MAKER,)),
        Tag(Name.MODEL, Kind.ASCII, (_ascii(negative.model),)),
        Tag(Name.UNIQUE_MODEL, Kind.ASCII, (f"{_MAKER} {_ascii(negative.model)}",)),
        Tag(Name.DNG_VERSION, Kind.BYTE, _VERSION),
        Tag(Name.DNG_BACKWARD, Kind.BYTE, _READABLE_SINCE),
        Tag(Name.BLACK_SIZE, Kind.SHORT, (1, 1)),
        Tag(Name.BLACK, Kind.RATIONAL, (negative.black_dn,)),
        Tag(Name.WHITE, Kind.LONG, (negative.white_dn,)),
    )
    write_tiff(path, shape, rows, about, (*tags, *_of_filters(negative.filters), *_of_light(negative)))


def _of_light(negative: Negative) -> Iterator[Tag]:
    if negative.exposure_time_s > 0:
        yield Tag(Name.EXPOSURE_TIME, Kind.RATIONAL, (negative.exposure_time_s,))
    if negative.neutral:
        yield Tag(Name.NEUTRAL, Kind.RATIONAL, negative.neutral)
    for number, (light, rows) in enumerate(negative.from_xyz.items()):
        yield Tag(Name(Name.COLOUR_MATRIX + number), Kind.SRATIONAL, tuple(itertools.chain.from_iterable(rows)))
        yield Tag(Name(Name.ILLUMINANT + number), Kind.SHORT, (_LIGHTS.get(light, _OTHER_LIGHT),))


def nameless_filters(filters: Iterable[str]) -> list[str]:
    """Filters of a mosaic whose names state no colour that DNG knows; a sensor without a mosaic has none."""
    names = sorted(set(filters))
    return [name for name in names if colour_of(name) is None] if len(names) > 1 else []


def _of_filters(filters: tuple[str, ...]) -> tuple[Tag, ...]:
    if len(set(filters)) == 1:
        return (Tag(Name.PHOTOMETRIC, Kind.SHORT, (_LINEAR_RAW,)),)
    if unknown := nameless_filters(filters):
        raise ValueError(f"no DNG of the filters {', '.join(unknown)}: it knows {', '.join(COLOURS)}")
    edge, numbers = math.isqrt(len(filters)), tuple(COLOURS.index(colour_of(name) or "") for name in filters)
    return (
        Tag(Name.PHOTOMETRIC, Kind.SHORT, (_FILTER_ARRAY,)),
        Tag(Name.PATTERN_SIZE, Kind.SHORT, (edge, edge)),
        Tag(Name.PATTERN, Kind.BYTE, numbers),
        Tag(Name.PLANE_COLOURS, Kind.BYTE, tuple(sorted(set(numbers)))),
        Tag(Name.PATTERN_LAYOUT, Kind.SHORT, (1,)),
    )


def _ascii(text: str) -> str:
    """A text in ASCII: what TIFF cannot hold is written as Python writes it in a string."""
    return text.encode("ascii", "backslashreplace").decode()
