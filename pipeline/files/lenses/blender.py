"""Lens tables of the Blender add-on for plenoptic cameras: `radius;thickness;material;index;v-no;sa` in mm.

An empty radius is a plane, an empty index or 0 is air. The stop is the second of the first two consecutive rows whose
material is exactly `air`.
"""

import math
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

from pipeline.files.lenses.text import UnreadableLens, number, read_lines
from pipeline.optics.printed import PrintedLens, PrintedSurface

_COLUMNS = ("radius", "thickness", "material", "index", "v-no", "sa")


def is_blender(lines: list[str]) -> bool:
    """Whether a file begins like a file of the add-on: a lens table or a camera."""
    header = [cell.strip().lower() for cell in lines[0].split(";")] if lines else []
    return tuple(header[: len(_COLUMNS)]) == _COLUMNS or any(line.startswith(("prop_", "objective_")) for line in lines)


def read_blender(path: str | Path) -> PrintedLens:
    """A lens from a CSV file of the add-on.

    Raises UnreadableLens: the file is not a lens table of the add-on, or has no stop.
    """
    lines = read_lines(path)
    header = [cell.strip().lower() for cell in lines[0].split(";")] if lines else []
    if any(text.startswith(("prop_", "objective_")) for text in lines):
        raise UnreadableLens(path, "is a camera of the add-on, and no lens table", hint="pipeline import camera FILE")
    if tuple(header[: len(_COLUMNS)]) != _COLUMNS:
        raise UnreadableLens(path, f'the first line must be "{";".join(_COLUMNS)}"', line=1)
    rows = [(line, text) for line, text in enumerate(lines[1:], 2) if text.strip("; \t")]
    surfaces = [_surface(path, line, text) for line, text in rows]
    if not surfaces:
        raise UnreadableLens(path, "holds no surfaces")
    # Not stripped: the add-on takes a row with another spelling for glass.
    materials = [text.split(";")[2] for _, text in rows]
    pairs = (i for i, pair in enumerate(pairwise(materials), 1) if pair == ("air", "air"))
    stop = next(pairs, None)
    if stop is None:
        reason = 'has no stop: no two consecutive rows have the material "air"'
        hint = "add a row for the stop, with its semi-diameter; the add-on itself invents one before the first vertex"
        raise UnreadableLens(path, reason, hint=hint)
    if not math.isinf(surfaces[stop].radius_mm):
        raise UnreadableLens(path, "the row of the stop has a radius", line=rows[stop][0])
    surfaces[stop] = replace(surfaces[stop], is_stop=True)
    back_mm = surfaces[-1].thickness_mm
    return PrintedLens(name=Path(path).stem, surfaces=tuple(surfaces), nominal_bfd_mm=back_mm if back_mm > 0 else None)


def _surface(path: str | Path, line: int, text: str) -> PrintedSurface:
    cells = [cell.strip() for cell in text.split(";")]
    if len(cells) < len(_COLUMNS):
        raise UnreadableLens(path, f"a row has {len(cells)} columns, not {len(_COLUMNS)}", line=line)
    values = dict(zip(_COLUMNS, cells, strict=False))

    def cell(name: str) -> float | None:
        return number(path, line, values[name], f'"{name}"') if values[name] else None

    index = cell("index") or 1.0
    glass = "" if values["material"].lower() == "air" else values["material"]
    if glass and index == 1:
        reason = f"glass {glass} has no index"
        raise UnreadableLens(path, reason, line=line, hint="write its index into the fourth column")
    if not glass and index != 1:
        raise UnreadableLens(path, f"air has index {index:g}", line=line)
    radius, semi_diameter = cell("radius"), cell("sa")
    return PrintedSurface(
        radius_mm=math.inf if radius is None else radius,
        thickness_mm=cell("thickness") or 0.0,
        semi_diameter_mm=semi_diameter,
        index=index,
        glass=glass,
        abbe=(cell("v-no") or None) if glass else None,
    )
