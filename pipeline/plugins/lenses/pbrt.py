"""Lens tables of the renderer pbrt: rows `radius thickness index diameter` in mm, object side first.

There are two traps. The fourth column is the full diameter. And some files in circulation state the space before each
surface, whereas pbrt itself reads the space behind it; `spacing_of` decides between them.
"""

import math
from dataclasses import replace
from pathlib import Path

from pipeline.optics.printed import Lost, PrintedLens, PrintedSurface
from pipeline.plugins.lenses.axis import is_possible
from pipeline.plugins.lenses.text import UnreadableLens, number, read_lines

_OTHER = {"before": "after", "after": "before"}


def read_pbrt(path: str | Path, spacing: str | None = None) -> PrintedLens:
    """A lens from a `.dat` file; the meaning of its second column, `spacing`, is by default decided by numbers."""
    comments, nominal_mm, rows = _parsed(path)
    surfaces = _with_stop(path, rows)
    meaning, rule = (spacing, "as told") if spacing else spacing_of(path, surfaces)
    name = comments[0].strip(" \"'.") if comments and comments[0].strip() else Path(path).stem
    lost = [Lost(f"thicknesses were read as the space {meaning} each surface ({rule})")]
    lost.append(Lost("pbrt files state no wavelength for their indices and no dispersion; taken as the d line"))
    return PrintedLens(
        name=name,
        provenance=tuple(line.strip() for line in comments[1:] if line.strip(" -=#")),
        surfaces=tuple(_shifted(surfaces) if meaning == "before" else surfaces),
        nominal_efl_mm=nominal_mm,
        lost=tuple(lost),
    )


def spacing_of(path: str | Path, surfaces: list[PrintedSurface]) -> tuple[str, str]:
    """Meaning of the second column, and the rule that decides it.

    A first thickness of 0 means "before": no lens begins with an element of no thickness. A last thickness of 0 means
    "after": there is always a space before the last surface. Otherwise the reading wins in which no surfaces cross
    inside their clear apertures and every glass has a thickness, if it is the only such one.
    """
    first, last = surfaces[0].thickness_mm, surfaces[-1].thickness_mm
    if first == 0 and last != 0:
        return "before", "the first row has thickness 0"
    if last == 0 and first != 0:
        return "after", "the last row has thickness 0"
    readings = {"after": surfaces, "before": _shifted(surfaces)}
    possible = [
        name
        for name, read in readings.items()
        if is_possible(read) and not any(front.index > 1 and front.thickness_mm <= 0 for front in read[:-1])
    ]
    if len(possible) == 1:
        return possible[0], f'read as "{_OTHER[possible[0]]}", surfaces would cross'
    reason = "its thicknesses can be the spaces before or after each surface"
    if not possible:
        reason = "its surfaces cross, whether the thicknesses are the spaces before or after each surface"
    raise UnreadableLens(path, reason, hint="say which: --spacing after (as pbrt reads it) or --spacing before")


def _parsed(path: str | Path) -> tuple[list[str], float | None, list[tuple[int, list[float]]]]:
    """Comments, focal length if stated, and rows with their lines."""
    comments: list[str] = []
    nominal_mm = None
    rows: list[tuple[int, list[float]]] = []
    for line, text in enumerate(read_lines(path), 1):
        body, mark, comment = text.partition("#")
        if mark and not rows:
            comments.append(comment)
        cells = body.split()
        if len(cells) == 1 and not rows and nominal_mm is None:
            nominal_mm = number(path, line, cells[0], "the focal length")  # older files begin with it
        elif len(cells) == 4:
            rows.append((line, [number(path, line, cell, "a column of a lens table") for cell in cells]))
        elif cells:
            reason = f"a row has {len(cells)} columns, not 4: radius thickness index diameter"
            raise UnreadableLens(path, reason, line=line)
    if not rows:
        raise UnreadableLens(path, "holds no surfaces")
    return comments, nominal_mm, rows


def _with_stop(path: str | Path, rows: list[tuple[int, list[float]]]) -> list[PrintedSurface]:
    """Rows as surfaces; the stop is the only row of radius 0 in air."""
    surfaces, stops = [], []
    index_before = 1.0
    for i, (line, (radius, thickness, listed, diameter)) in enumerate(rows):
        index = listed or 1.0  # 0 is air
        if radius == 0 and index == 1 and index_before == 1:
            stops.append(i)
        if not diameter > 0:
            raise UnreadableLens(path, f"surface {i + 1} has diameter {diameter:g} mm", line=line)
        surfaces.append(
            PrintedSurface(
                radius_mm=radius or math.inf, thickness_mm=thickness, semi_diameter_mm=diameter / 2, index=index
            )
        )
        index_before = index
    if len(stops) != 1:
        reason = f"{len(stops)} rows of radius 0 are in air, and only the stop may be one"
        lines = [rows[i][0] for i in stops]
        raise UnreadableLens(path, reason, line=lines[1] if lines else None, hint="leave one such row: the stop")
    surfaces[stops[0]] = replace(surfaces[stops[0]], is_stop=True)
    return surfaces


def _shifted(surfaces: list[PrintedSurface]) -> list[PrintedSurface]:
    """Spaces before each surface converted to spaces behind it; the last one is unknown, so 0."""
    behind = [surface.thickness_mm for surface in surfaces[1:]] + [0.0]
    return [replace(surface, thickness_mm=space) for surface, space in zip(surfaces, behind, strict=True)]
