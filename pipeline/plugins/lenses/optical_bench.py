"""Lenses of the Optical Bench of Photons to Photos (W. Claff): a text of sections in brackets, cells between tabs.

Rows of `[lens data]` are `id radius thickness nd diameter vd [glass vendor]` in mm, from the scene to the sensor. A
radius may be AS (aperture stop), FS (field stop) or CG (cover glass), a thickness the name of a row of `[variable
distances]`, which has one column per scenario: focal length and focus of a zoom. `[aspherical data]` are `id radius K`
and coefficients whose powers `[constants]` decides.
"""

import math
import re
from dataclasses import dataclass, field, replace
from pathlib import Path

from pipeline.optics.printed import Lost, PrintedLens, PrintedSurface
from pipeline.plugins.lenses.stated import remarks
from pipeline.plugins.lenses.text import UnreadableLens, number, read_lines

_Row = tuple[int, list[str]]
_STOP, _FLAT = "AS", ("FS", "CG", "INFINITY", "-INFINITY")
_UNREAD = ("diffractive data",)
_SKIPPED = ("descriptive data", "figure", "group data", "notes", "patent info", "report data")
_SAME_RADIUS = 1e-4
"""Relative difference of the two radii of an asphere that rounding explains: they are printed with five digits."""


@dataclass(slots=True)
class _Bench:
    """A file by its sections, and the selected scenario: the column of `[variable distances]`, counted from 0."""

    path: str | Path
    scenario: int
    sections: dict[str, list[_Row]] = field(default_factory=dict)
    lost: list[Lost] = field(default_factory=list)

    def number(self, line: int, text: str, quantity: str) -> float | None:
        """The number of a cell; None if it is empty."""
        return number(self.path, line, text, quantity) if text else None

    def rows(self, section: str) -> list[_Row]:
        """Rows of a section, empty if the file has none."""
        return self.sections.get(section, [])

    def value(self, name: str) -> float | None:
        """A figure of the scenario; None if it is absent or not stated."""
        for line, cells in self.rows("variable distances"):
            if cells[0] == name:
                text = cells[1 + self.scenario] if len(cells) > 1 + self.scenario else ""
                return None if text.casefold() in ("", "undefined", "infinity") else number(self.path, line, text, name)
        return None


def is_optical_bench(lines: list[str]) -> bool:
    """Whether a text begins with a section of the Optical Bench."""
    first = next((text for text in lines if text.strip() and not text.startswith("#")), "")
    return re.match(r"\[(descriptive data|constants|variable distances|lens data)\]", first.strip()) is not None


def read_optical_bench(path: str | Path, scenario: int | None = None) -> PrintedLens:
    """A lens of the Optical Bench; `scenario`, a column of its distances from 1, is by default the first."""
    bench = _Bench(path, 0 if scenario is None else scenario - 1)
    _split(bench)
    _choose(bench, scenario)
    rows = bench.rows("lens data")
    if not rows:
        raise UnreadableLens(path, "holds no rows in a section [lens data]")
    surfaces = [_surface(bench, line, cells) for line, cells in rows]
    stops = [line for (line, _), surface in zip(rows, surfaces, strict=True) if surface.is_stop]
    if len(stops) != 1:
        reason = f"{len(stops)} rows have AS for a radius, and one must be the aperture stop"
        hint = "write a row AS with the spaces before and behind it" if not stops else "write FS for the others"
        raise UnreadableLens(path, reason, line=stops[1] if stops else None, hint=hint)
    surfaces = _with_aspheres(bench, surfaces, [cells[0] for _, cells in rows])
    last = surfaces[-1].thickness_mm
    texts = {cells[0]: cells[1:] for _, cells in bench.rows("descriptive data")}
    lens = PrintedLens(
        name=" ".join(texts.get("title", ())).strip() or Path(path).stem,
        provenance=tuple(" ".join(cells).strip() for name, cells in texts.items() if name == "patent" and any(cells)),
        surfaces=tuple(surfaces),
        nominal_efl_mm=bench.value("Focal Length"),
        nominal_bfd_mm=last if last > 0 else None,
    )
    focus_mm = lens.nominal_bfd_mm if bench.value("d0") is None else None  # the focus of an infinite object
    return replace(lens, lost=(*bench.lost, *remarks(lens, bfd_mm=focus_mm, f_number=bench.value("F-Number"))))


def _split(bench: _Bench) -> None:
    """Collect the rows of each section; UnreadableLens for one that changes the lens and is not read."""
    rows: list[_Row] | None = None
    for line, text in enumerate(read_lines(bench.path), 1):
        cells = [cell.strip() for cell in text.split("\t")]
        if heading := re.fullmatch(r"\[(.+)\]", cells[0]):
            name = heading[1].casefold()
            if name in _UNREAD:
                raise UnreadableLens(bench.path, f"[{name}] makes surfaces diffract, which we cannot", line=line)
            if name not in (*_SKIPPED, "constants", "variable distances", "lens data", "aspherical data"):
                bench.lost.append(Lost(f"section [{name}] is not read", line))
            rows = bench.sections.setdefault(name, [])
        elif rows is not None and cells[0] and not cells[0].startswith("#"):
            rows.append((line, cells))


def _choose(bench: _Bench, number: int | None) -> None:
    """Check the scenario; report it where the file has several, and where its object is near."""
    rows = {cells[0]: (line, [cell for cell in cells[1:] if cell]) for line, cells in bench.rows("variable distances")}
    line, lengths = rows.get("Focal Length", (None, []))
    count = max((len(values) for _, values in rows.values()), default=1)
    if bench.scenario not in range(count):
        reason = f"has no scenario {bench.scenario + 1}; its [variable distances] have {count}"
        raise UnreadableLens(bench.path, reason, line=line, hint=f"--scenario 1 to {count}")
    if count > 1 and number is None:
        lengths_text = ", ".join(lengths) or "not stated"
        statement = f"scenario 1 of {count} was read (focal lengths {lengths_text}); --scenario takes another"
        bench.lost.append(Lost(statement, line))
    if (near_mm := bench.value("d0")) is not None:
        statement = f"the scenario is focused on an object {near_mm:g} mm away; a rig of this lens has its own focus"
        bench.lost.append(Lost(statement, rows["d0"][0]))


def _surface(bench: _Bench, line: int, cells: list[str]) -> PrintedSurface:
    """A row of the lens data as a surface."""
    cells = cells + [""] * (8 - len(cells))
    shape, space, index, diameter, abbe, glass, vendor = cells[1:8]
    is_stop = shape.upper() == _STOP
    plane = is_stop or shape.upper() in _FLAT
    wide_mm = bench.value("Aperture Diameter") if is_stop else None
    wide_mm = wide_mm or bench.number(line, diameter, "the diameter")
    index_value = bench.number(line, index, "the index") or 1.0
    return PrintedSurface(
        radius_mm=math.inf if plane else bench.number(line, shape, "the radius") or math.inf,
        thickness_mm=_space_mm(bench, line, space),
        semi_diameter_mm=wide_mm / 2 if wide_mm else None,
        index=index_value,
        abbe=bench.number(line, abbe, "the Abbe number") if index_value != 1 else None,
        glass=f"{vendor.casefold()}:{glass}" if glass and vendor else glass,
        is_stop=is_stop,
    )


def _space_mm(bench: _Bench, line: int, text: str) -> float:
    """A thickness, or the value of the distance of that name."""
    if not text[:1].isalpha():
        return bench.number(line, text, "the thickness") or 0.0
    distance = bench.value(text)
    if distance is None:
        names = [cells[0] for _, cells in bench.rows("variable distances")]
        flaw = f"has no value in scenario {bench.scenario + 1}" if text in names else "is not in [variable distances]"
        reason = f'the distance "{text}" {flaw}'
        raise UnreadableLens(bench.path, reason, line=line, hint="write its value there, in mm")
    return distance


def _with_aspheres(bench: _Bench, surfaces: list[PrintedSurface], ids: list[str]) -> list[PrintedSurface]:
    """The surfaces with the conics and even or odd terms of their section."""
    shaped = list(surfaces)
    counts = [(line, cells) for line, cells in bench.rows("constants") if cells[0] == "AsphericalOddCount"]
    odd = next((int(number(bench.path, line, cells[1], cells[0])) for line, cells in counts if len(cells) > 1), 0)
    if odd and bench.rows("aspherical data"):
        statement = f"AsphericalOddCount {odd}: coefficients were read as odd powers from 3 and all even ones from 4 on"
        bench.lost.append(Lost(statement, bench.rows("aspherical data")[0][0]))
    for line, cells in bench.rows("aspherical data"):
        if cells[0] not in ids:
            raise UnreadableLens(bench.path, f'[aspherical data] of "{cells[0]}", which is no surface', line=line)
        i = ids.index(cells[0])
        _, radius, *terms = cells + [""] * (2 - len(cells))
        numbers = [bench.number(line, cell, "a coefficient") or 0.0 for cell in terms]
        radius_mm = math.inf if radius.upper() in _FLAT else number(bench.path, line, radius, "the radius")
        if not math.isclose(radius_mm, surfaces[i].radius_mm, rel_tol=_SAME_RADIUS):
            reason = f"surface {cells[0]} has radius {surfaces[i].radius_mm:g} mm, and {radius_mm:g} as an asphere"
            raise UnreadableLens(bench.path, reason, line=line)
        powers = _powers(bench, odd, len(numbers) - 1)
        asphere = tuple((power, value) for power, value in zip(powers, numbers[1:], strict=True) if value)
        shaped[i] = replace(surfaces[i], conic=numbers[0] if numbers else 0.0, asphere=asphere)
    return shaped


def _powers(bench: _Bench, odd: int, count: int) -> list[int]:
    """Powers of the height to which `count` coefficients belong: 4, 6, 8 …, with A2 from 2, with `AsphericalOddCount` n
    the odd powers 3, 5 … in between as long as there are n of them.
    """
    count = max(count, 0)
    powers = [2 * i + 3 for i in range(min(odd, count))] + [2 * i + 4 for i in range(count)]
    has_2 = not odd and any(cells[0] == "AsphericalA2" for _, cells in bench.rows("constants"))
    return sorted([2] * has_2 + powers)[:count]
