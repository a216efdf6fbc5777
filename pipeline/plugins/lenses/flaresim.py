"""Lenses of FlareSim: rows `radius thickness ior abbe semi_ap coating` in mm from the scene to the sensor; radius 0 is
a plane and `stop` the aperture stop.

The files in circulation were converted from the Optical Bench, which has consequences. The column named semi_ap holds
full diameters (`meaning_of` decides). Aspheric terms are not part of the format. And rows that the converter did not
understand (a stop named 5AS, cover glasses, field stops) are missing, together with the space behind them.
"""

import math
import re
from dataclasses import dataclass, replace
from pathlib import Path

from pipeline.optics.printed import Lost, PrintedLens, PrintedSurface
from pipeline.plugins.lenses.axis import is_possible
from pipeline.plugins.lenses.stated import figures, remarks
from pipeline.plugins.lenses.text import UnreadableLens, number, read_lines

_COLUMNS = ("radius", "thickness", "ior", "abbe", "semi_ap", "coating")
_FACTOR = {"diameter": 0.5, "semi-diameter": 1.0}
_SAME_F_NUMBER = 1.4
"""Largest ratio of two F-numbers that mean the same stop: half of the factor 2 between the readings, by ratio."""


@dataclass(slots=True)
class _File:
    """The parts of a file: comments, the text before the rows, and the rows with their lines."""

    comments: list[str]
    settings: dict[str, tuple[int, str]]
    rows: list[tuple[int, list[str]]]

    @property
    def f_number(self) -> float | None:
        """F-number of the comment that counts surfaces."""
        match = re.search(r"\d+ surfaces, .*\bf/(\d+\.?\d*)", "\n".join(self.comments))
        return float(match[1]) or None if match else None


def read_flaresim(path: str | Path, apertures: str | None = None) -> PrintedLens:
    """A lens from a `.lens` file; the meaning of its semi_ap, `apertures`, is by default decided from the numbers."""
    file = _parsed(path)
    line, text = file.settings.get("focal_length", (0, ""))
    efl_mm = number(path, line, text, "focal_length") if text else None
    name = file.settings.get("name", (0, ""))[1] or Path(path).stem
    surfaces = [_surface(path, line, cells) for line, cells in file.rows]
    lens = PrintedLens(
        name=name,
        provenance=tuple(text for text in file.comments if text and text != name),
        surfaces=tuple(surfaces),
        nominal_efl_mm=efl_mm,
        nominal_bfd_mm=surfaces[-1].thickness_mm if surfaces[-1].thickness_mm > 0 else None,
    )
    _check_stop(path, file, lens)
    meaning, rule = (apertures, "as told") if apertures else meaning_of(path, lens, file.f_number)
    lens = scaled(lens, meaning)
    decided = Lost(f"the column semi_ap was read as {meaning} ({rule})")
    last = file.rows[-1][0]
    stated = {"bfd_mm": lens.nominal_bfd_mm, "f_number": file.f_number}
    return replace(lens, lost=(decided, *remarks(lens, **stated, without_aspheres=True, line=last)))


def meaning_of(path: str | Path, lens: PrintedLens, f_number: float | None) -> tuple[str, str]:
    """Meaning of the column semi_ap, whose numbers are semi-diameters of `lens`, and the rule that decides it."""
    by_shape = None if is_possible(lens.surfaces) else "diameter"
    by_stop = next((meaning for meaning in _FACTOR if _has_f_number(scaled(lens, meaning), f_number)), None)
    if by_shape and by_stop in (by_shape, None):
        return by_shape, "as semi-diameters its numbers reach beyond spheres or across the next surface"
    if by_stop and by_shape is None:
        return by_stop, f"only so the stop gives f/{f_number:g}"
    reason = "its column semi_ap can be diameters, as in most such files, or semi-diameters"
    if by_shape:
        computed = figures(scaled(lens, by_shape))
        f_text = f"f/{abs(computed.f_number):.3g}" if computed else "no F-number"
        reason += (
            f": as semi-diameters surfaces would cross, as diameters the stop gives {f_text} in place of f/{f_number:g}"
        )
    raise UnreadableLens(path, reason, hint="say which: --apertures diameter or --apertures semi-diameter")


def scaled(lens: PrintedLens, meaning: str) -> PrintedLens:
    """The lens with its semi-diameters as they are, or halved if they are diameters."""
    factor = _FACTOR[meaning]
    surfaces = tuple(replace(s, semi_diameter_mm=(s.semi_diameter_mm or 0.0) * factor) for s in lens.surfaces)
    return replace(lens, surfaces=surfaces)


def _parsed(path: str | Path) -> _File:
    """Comments, settings and rows of a file."""
    file = _File([], {}, [])
    begun = False
    for line, text in enumerate(read_lines(path), 1):
        body = text.strip()
        if body.startswith("#"):
            file.comments += [] if begun else [body.lstrip("# ")]
        elif body == "surfaces:":
            begun = True
        elif body and begun:
            file.rows.append((line, body.split()))
        elif body:
            key, colon, value = body.partition(":")
            if not colon:
                raise UnreadableLens(path, f'"{body}" stands before the line "surfaces:"', line=line)
            file.settings[key.strip()] = line, value.strip()
    if not file.rows:
        raise UnreadableLens(path, 'holds no rows behind a line "surfaces:"')
    return file


def _surface(path: str | Path, line: int, cells: list[str]) -> PrintedSurface:
    """A row as a surface whose semi-diameter is the unscaled number of the file."""
    if len(cells) not in (len(_COLUMNS) - 1, len(_COLUMNS)):
        raise UnreadableLens(
            path, f"a row has {len(cells)} columns, not {len(_COLUMNS)}: {' '.join(_COLUMNS)}", line=line
        )
    is_stop = cells[0].casefold() == "stop"
    numbers = [number(path, line, cell, name) for cell, name in zip(cells[is_stop:5], _COLUMNS[is_stop:5], strict=True)]
    thickness, index, abbe, aperture = numbers[-4:]
    if not aperture > 0:
        raise UnreadableLens(path, f"a surface has semi_ap {aperture:g}", line=line, hint="write its clear diameter")
    return PrintedSurface(
        radius_mm=math.inf if is_stop else numbers[0] or math.inf,
        thickness_mm=thickness,
        semi_diameter_mm=aperture,
        index=index,
        abbe=(abbe or None) if index != 1 else None,
        is_stop=is_stop,
    )


def _check_stop(path: str | Path, file: _File, lens: PrintedLens) -> None:
    """UnreadableLens unless exactly one row is the stop, with the focal length of the rows without one."""
    stops = [line for (line, _), surface in zip(file.rows, lens.surfaces, strict=True) if surface.is_stop]
    if len(stops) == 1:
        return
    if stops:
        reason = f"{len(stops)} rows are the aperture stop, one must be"
        raise UnreadableLens(path, reason, line=stops[1], hint="write 0 for the radius of the others")
    first = replace(lens, surfaces=(replace(lens.surfaces[0], is_stop=True), *lens.surfaces[1:]))
    computed = figures(scaled(first, "diameter"))
    lengths = f"; without one the rows have the focal length {computed.efl_mm:.6g} mm" if computed else ""
    lengths += f", and {lens.nominal_efl_mm:g} mm is stated" if computed and lens.nominal_efl_mm else ""
    raise UnreadableLens(
        path,
        f"has no stop{lengths}",
        hint='add its row (radius "stop", space behind it) from the source, and the space before it: converters drop'
        " both where they cannot read the row",
    )


def _has_f_number(lens: PrintedLens, f_number: float | None) -> bool:
    """Whether the lens has that F-number, within the tolerance."""
    computed = figures(lens)
    if computed is None or not f_number:
        return False
    return abs(math.log(abs(computed.f_number) / f_number)) < math.log(_SAME_F_NUMBER)
