"""Lens files of Zemax and CODE V and glass catalogues, read naively, and the paraxial focal length by y-nu tables.

Shares nothing with the importers: it knows lenses that are refractive, centred complete, and believes what it reads.
"""

import math
import re
from typing import NamedTuple

SELLMEIER, POWERS = (2, 6, 11), {1: (0, 2, -2, -4, -6, -8), 12: (0, 2, -2, -4, -6, -8, 4, 6)}
"""Formulas of AGF catalogues by number: sums of b w^2 / (w^2 - c), and of powers of w [um] in the squared index."""


class Row(NamedTuple):
    """A surface in millimetres, and the words that its file has for what is behind it."""

    curvature: float
    thickness: float
    glass: list[str]
    focal_length: float | None = None


def text_of(raw: bytes) -> str:
    for mark, encoding in ((b"\xff\xfe", "utf-16"), (b"\xfe\xff", "utf-16"), (b"\xef\xbb\xbf", "utf-8-sig")):
        if raw.startswith(mark):
            return raw.decode(encoding)
    return raw.decode("latin-1")


def zemax(text: str) -> tuple[list[Row], list[str]]:
    """Surfaces between object and image, and the glass catalogues."""
    head, *blocks = re.split(r"(?m)^SURF ", text)
    unit = {"MM": 1.0, "CM": 10.0, "IN": 25.4, "METER": 1000.0}[re.search(r"(?m)^UNIT (\w+)", head)[1]]
    rows = []
    for block in blocks[1:-1]:
        lines = {words[0]: words[1:] for words in map(str.split, reversed(block.splitlines())) if words}
        terms = {int(i): float(value) for i, value in re.findall(r"PARM (\d+) (\S+)", block)}
        kind = lines.get("TYPE", ["STANDARD"])[0]
        square = terms.get({"EVENASPH": 1, "ODDASPHE": 2}.get(kind, 0), 0.0)
        curvature = float(lines.get("CURV", [0])[0]) + 2 * square
        ideal = terms.get(1, 100.0) * unit if kind == "PARAXIAL" else None
        rows.append(Row(curvature / unit, float(lines["DISZ"][0]) * unit, lines.get("GLAS", []), ideal))
    catalogues = re.search(r"(?m)^GCAT (.*)", head)
    return rows, catalogues[1].split() if catalogues else []


def codev(text: str, is_radius: bool) -> list[Row]:
    """Surfaces of a sequence; `is_radius`: what its numbers are, if it has no RDM."""
    body = re.sub(r"!.*|\"[^\"]*\"", "", text).replace("'", "")
    unit = {"M": 1.0, "C": 10.0, "I": 25.4}[(re.search(r"(?i)\bDIM\s+(\w)", body) or ["", "M"])[1].upper()]
    if mode := re.search(r"(?im)(?:^|;)\s*RDM *(N?)", body):
        is_radius = not mode[1]
    # A private glass of a table is its index at the d line.
    private = re.search(r"(?is)PRV\s*PWL(.*?)END", re.sub(r"&\s*\n", " ", body))
    tables = [line.split() for line in private[1].splitlines() if line.strip()] if private else [[]]
    lines = {name: dict(zip(tables[0], n, strict=False)).get("587.6", name) for name, *n in tables[1:]}
    rows = []
    for shape, thickness, glass in re.findall(r"(?im)^\s*S\s+(\S+)\s+(?:&\s*)?(\S+) *([^\s;&]*)", body):
        value = float(shape)
        curvature = (1 / value if is_radius else value) if value else 0.0
        rows.append(Row(curvature / unit, float(thickness) * unit, [lines.get(glass, glass)] if glass else []))
    return rows


def focal_length(rows: list[Row], indices: list[float]) -> float:
    """Of surfaces with the index behind each, by tracing the ray that enters parallel to the axis at height 1."""
    height, angle, before = 1.0, 0.0, 1.0  # angle: index times slope
    for row, behind in zip(rows, indices, strict=True):
        power = (behind - before) * row.curvature if row.focal_length is None else 1 / row.focal_length
        angle -= height * power
        height, before = height + angle * row.thickness / behind, behind
    return -1 / angle if angle else math.inf


def catalogue(text: str) -> dict[str, tuple[int, list[float]]]:
    """Formula and coefficients of each glass of an AGF file, by its name in capitals."""
    glasses, name = {}, ""
    for words in map(str.split, text.splitlines()):
        if words[:1] == ["NM"]:
            name, formula = words[1].upper(), int(float(words[2]))
        elif words[:1] == ["CD"] and name:
            glasses[name] = formula, list(map(float, words[1:]))
    return glasses


def index(formula: int, numbers: list[float], um: float) -> float:
    if formula in SELLMEIER:
        return math.sqrt(1 + sum(b * um**2 / (um**2 - c) for b, c in zip(numbers[0::2], numbers[1::2], strict=False)))
    return math.sqrt(sum(a * um**power for a, power in zip(numbers, POWERS[formula], strict=False)))
