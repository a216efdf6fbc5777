"""Digital negatives (DNG): a TIFF file whose further tags say what a raw converter has to know.

References
----------
Digital Negative (DNG) Specification, Version 1.4.0.0, Adobe 2012.
"""

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from fractions import Fraction
from pathlib import Path
from typing import Any

from tifffile import DATATYPE, PHOTOMETRIC, TIFF

from pipeline.channel_names import COLOURS, colour_of
from pipeline.files.tiff import Rows, Tag, write_tiff

_VERSION, _READABLE_SINCE = (1, 4, 0, 0), (1, 1, 0, 0)
"""Version of the specification, and the oldest whose readers can read it: everything here is as old as that."""
_MAKER = "plenoptic-pipeline"
_LIGHTS, _OTHER_LIGHT = {"A": 17, "B": 18, "C": 19, "D55": 20, "D65": 21, "D75": 22, "D50": 23}, 255
"""Illuminants that Exif numbers, and the number of all others."""
_LARGEST = 2**31 - 1
"""Numerator and denominator of a fraction at most [1], also of one with a sign."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Negative:
    """Facts of a raw image that a raw converter has to know."""

    model: str  # name of the camera
    black_dn: float  # digital number of no light, without noise; kept to 1/65536
    white_dn: int  # value of saturation
    # Names with a colour of `COLOURS` of n x n pixels, row by row; one name: a camera without filters
    filters: tuple[str, ...] = ("mono",)
    exposure_time_s: float = 0.0  # 0: it is not stated
    neutral: tuple[float, ...] = ()  # what red, green and blue count of white, over the most; empty: unknown
    # Three rows each, what they count of CIE 1931 X, Y and Z, Y of white being 1, by names of lights: that of the
    # scene, and another
    from_xyz: dict[str, list[list[float]]] = field(default_factory=dict)


def write_dng(path: str | Path, shape: tuple[int, int], rows: Rows, about: dict[str, Any], negative: Negative) -> None:
    """Write digital numbers band by band as a negative; the first four arguments as of `tiff.write_tiff`.

    Raises ValueError: if a filter array names a colour that DNG does not know.
    """
    maker, model = _MAKER, negative.model.encode("ascii", "backslashreplace").decode()
    tags = [
        _tag("Make", DATATYPE.ASCII, maker),
        _tag("Model", DATATYPE.ASCII, model),
        _tag("UniqueCameraModel", DATATYPE.ASCII, f"{maker} {model}"),
        _tag("DNGVersion", DATATYPE.BYTE, bytes(_VERSION)),
        _tag("DNGBackwardVersion", DATATYPE.BYTE, bytes(_READABLE_SINCE)),
        _tag("BlackLevelRepeatDim", DATATYPE.SHORT, (1, 1)),
        _fractions("BlackLevel", DATATYPE.RATIONAL, (negative.black_dn,)),
        _tag("WhiteLevel", DATATYPE.LONG, (negative.white_dn,)),
        *_of_filters(negative.filters),
        *_of_light(negative),
    ]
    has_mosaic = len(set(negative.filters)) > 1
    write_tiff(path, shape, rows, about, PHOTOMETRIC.CFA if has_mosaic else PHOTOMETRIC.LINEAR_RAW, tags)


def _tag(name: str, kind: DATATYPE, values: str | bytes | tuple[int, ...]) -> Tag:
    return TIFF.TAGS[name], kind, len(values), values, True


def _fractions(name: str, kind: DATATYPE, values: Iterable[float]) -> Tag:
    """A tag of numbers as fractions, each as near to its number as TIFF can write it."""
    ratios = [
        Fraction(value).limit_denominator(max(1, int(_LARGEST / max(1.0, abs(value))))).as_integer_ratio()
        for value in values
    ]
    return TIFF.TAGS[name], kind, len(ratios), tuple(number for ratio in ratios for number in ratio), True


def _of_light(negative: Negative) -> Iterator[Tag]:
    if negative.exposure_time_s > 0:
        yield _fractions("ExposureTime", DATATYPE.RATIONAL, (negative.exposure_time_s,))
    if negative.neutral:
        yield _fractions("AsShotNeutral", DATATYPE.RATIONAL, negative.neutral)
    for number, (light, rows) in enumerate(negative.from_xyz.items(), start=1):
        yield _fractions(f"ColorMatrix{number}", DATATYPE.SRATIONAL, (value for row in rows for value in row))
        yield _tag(f"CalibrationIlluminant{number}", DATATYPE.SHORT, (_LIGHTS.get(light, _OTHER_LIGHT),))


def nameless_filters(filters: Iterable[str]) -> list[str]:
    """Filters of a mosaic whose names state no colour that DNG knows; a sensor without a mosaic has none."""
    names = sorted(set(filters))
    return [name for name in names if colour_of(name) is None] if len(names) > 1 else []


def _of_filters(filters: tuple[str, ...]) -> Iterator[Tag]:
    if len(set(filters)) == 1:
        return
    if unknown := nameless_filters(filters):
        raise ValueError(f"no DNG of the filters {', '.join(unknown)}: it knows {', '.join(COLOURS)}")
    edge, numbers = math.isqrt(len(filters)), [COLOURS.index(colour_of(name) or "") for name in filters]
    yield _tag("CFARepeatPatternDim", DATATYPE.SHORT, (edge, edge))
    yield _tag("CFAPattern", DATATYPE.BYTE, bytes(numbers))
    yield _tag("CFAPlaneColor", DATATYPE.BYTE, bytes(sorted(set(numbers))))
    yield _tag("CFALayout", DATATYPE.SHORT, (1,))
