"""Lens files of Zemax and CODE V and glass catalogues, read naively; focal lengths by y-nu tables, rays by Snell's law.

Shares nothing with the importers: it knows lenses that are refractive and complete, and believes what it reads. Frames
are those of the manuals: a break of Zemax decentres, then turns about x, y and z, right-handed, or with its order
flag the other way round (OpticStudio's help, "Coordinate Break"); a surface of CODE V is decentred, then turned, with
alpha and beta left-handed.
"""

import math
import re
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

SELLMEIER, POWERS = (2, 6, 11), {1: (0, 2, -2, -4, -6, -8), 12: (0, 2, -2, -4, -6, -8, 4, 6)}
"""Formulas of AGF catalogues by number: sums of b w^2 / (w^2 - c), and of powers of w [um] in the squared index."""


class Row(NamedTuple):
    """A surface in millimetres, and the words that its file has for what is behind it."""

    curvature: float
    glass: list[str]
    focal_length: float | None = None
    turn: np.ndarray = np.eye(3)
    vertex: np.ndarray = np.zeros(3)


def text_of(raw: bytes) -> str:
    for mark, encoding in ((b"\xff\xfe", "utf-16"), (b"\xfe\xff", "utf-16"), (b"\xef\xbb\xbf", "utf-8-sig")):
        if raw.startswith(mark):
            return raw.decode(encoding)
    return raw.decode("latin-1")


def zemax(text: str) -> tuple[list[Row], list[str]]:
    """Surfaces between object and image, and the glass catalogues."""
    head, *blocks = re.split(r"(?m)^SURF ", text)
    unit = {"MM": 1.0, "CM": 10.0, "IN": 25.4, "METER": 1000.0}[re.search(r"(?m)^UNIT (\w+)", head)[1]]
    rows, here, turn = [], np.zeros(3), np.eye(3)
    for block in blocks[1:-1]:
        lines = {words[0]: words[1:] for words in map(str.split, reversed(block.splitlines())) if words}
        terms = {int(i): float(value) for i, value in re.findall(r"PARM (\d+) (\S+)", block)}
        kind = lines.get("TYPE", ["STANDARD"])[0]
        square = terms.get({"EVENASPH": 1, "ODDASPHE": 2}.get(kind, 0), 0.0)
        curvature = float(lines.get("CURV", [0])[0]) + 2 * square
        ideal = terms.get(1, 100.0) * unit if kind == "PARAXIAL" else None
        x, y, a, b, c, order = (terms.get(i, 0.0) for i in range(1, 7))
        own, along = np.eye(3), float(lines["DISZ"][0]) * unit
        if kind == "COORDBRK" and not order:
            here, turn = here + turn @ [x * unit, y * unit, 0], turn @ turned("XYZ", a, b, c)
        elif kind == "COORDBRK":
            turn = turn @ turned("ZYX", c, b, a)
            here = here + turn @ [x * unit, y * unit, 0]
        elif kind == "TILTSURF":
            own = Rotation.align_vectors([[-x, -y, 1.0]], [[0, 0, 1.0]])[0].as_matrix()
        glass = lines.get("GLAS", [])
        if glass[:2] == ["___BLANK", "2"]:  # as behind another surface
            glass = [line.split()[1:] for line in blocks[int(glass[2])].splitlines() if "GLAS " in line]
            glass = glass[0] if glass else []
        if kind != "COORDBRK" or "STOP" in lines:
            rows.append(Row(curvature / unit, glass, ideal, turn @ own, here))
        here = here + turn @ [0, 0, along]
    catalogues = re.search(r"(?m)^GCAT (.*)", head)
    return rows, catalogues[1].split() if catalogues else []


def turned(axes: str, *degrees: float) -> np.ndarray:
    """Turns about axes one after the other, each about the axis as the former ones have turned it."""
    return Rotation.from_euler(axes, degrees, degrees=True).as_matrix()


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
    rows, here, turn = [], np.zeros(3), np.eye(3)
    surface = r"(?ims)^\s*S[ \t]+(\S+)\s+(?:&\s*)?(\S+) *([^\s;&]*)(.*?)(?=^\s*S[ \t]|^\s*SI\b|\Z)"
    for shape, thickness, glass, rest in re.findall(surface, body):
        value, along = float(shape), float(thickness) * unit
        curvature = (1 / value if is_radius else value) if value else 0.0
        given = {name.upper(): float(n) for name, n in re.findall(r"(?i)\b([XYZABC]DE)\s+([-+.\deE]+)", rest)}
        x, y, z, a, b, c = (given.get(f"{letter}DE", 0.0) for letter in "XYZABC")
        shift, own = np.array([x, y, z]) * unit, turned("XYZ", -a, -b, c)
        old, stood = turn, here
        if not re.search(r"(?i)\bREV\b", rest):
            turn, here = turn @ own, here + turn @ shift
        rows.append(Row(curvature / unit, [lines.get(glass, glass)] if glass else [], None, turn, here))
        if re.search(r"(?i)\bREV\b", rest):
            turn, here = turn @ own.T, here - turn @ own.T @ shift
        elif re.search(r"(?i)\bDAR\b", rest):
            turn, here = old, stood
        here = here + turn @ [0, 0, along]
    return rows


def is_displaced(rows: list[Row]) -> bool:
    return any(np.abs(np.r_[row.turn[:2, 2], row.vertex[:2]]).max() > 1e-9 for row in rows)


def follow(rows: list[Row], indices: list[float], point: np.ndarray, direction: np.ndarray) -> tuple[np.ndarray, ...]:
    """A point and the direction behind spheres, planes and ideal thin lenses of rays (n, 3) before them."""
    before = 1.0
    for row, behind in zip(rows, indices, strict=True):
        p, d, c = (point - row.vertex) @ row.turn, direction @ row.turn, row.curvature
        # c |p + t d|^2 = 2 z, and the root that goes to the plane's where c goes to 0.
        half, rest = d[:, 2] - c * (p * d).sum(axis=1), c * (p * p).sum(axis=1) - 2 * p[:, 2]
        p = p + (rest / (half + np.sign(d[:, 2]) * np.sqrt(half**2 - c * rest)))[:, None] * d
        normal = np.array([0, 0, 1.0]) - c * p
        if row.focal_length is not None:
            slope = d[:, :2] / d[:, 2:] - p[:, :2] / row.focal_length
            d = np.column_stack([slope, np.ones(len(slope))])
            d /= np.linalg.norm(d, axis=1)[:, None]
        ratio, cosine = before / behind, (d * normal).sum(axis=1)
        bent = np.sqrt(1 - ratio**2 * (1 - cosine**2)) - ratio * cosine
        point, direction, before = (
            p @ row.turn.T + row.vertex,
            (ratio * d + bent[:, None] * normal) @ row.turn.T,
            behind,
        )
    return point, direction


def focal_length(rows: list[Row], indices: list[float]) -> float:
    """Of surfaces with the index behind each, by tracing the ray that enters parallel to the axis at height 1."""
    height, angle, before = 1.0, 0.0, 1.0  # angle: index times slope
    for row, behind, following in zip(rows, indices, [*rows[1:], rows[-1]], strict=True):
        power = (behind - before) * row.curvature if row.focal_length is None else 1 / row.focal_length
        angle -= height * power
        height, before = height + angle * (following.vertex[2] - row.vertex[2]) / behind, behind
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
