"""Plain tables of a lens, as typed from a patent or a book: one row per surface, and a header that names the columns.

docs/lenses.md is the contract. A quantity may have any of its usual names; beyond these, the meaning of a column or row
is never guessed.
"""

import math
import re
from dataclasses import dataclass, field
from pathlib import Path

from pipeline.optics.printed import D_LINE_NM, Lost, PrintedLens, PrintedSurface
from pipeline.plugins.lenses.glasses import Glasses
from pipeline.plugins.lenses.sizing import Beam
from pipeline.plugins.lenses.text import UnreadableLens, number, read_lines
from pipeline.spelling import nearest

NAMES = {
    "radius": ("radius", "r", "roc", "curvature radius", "radius of curvature"),
    "curvature": ("curvature", "c", "cv"),
    "thickness": ("thickness", "d", "t", "th", "distance", "separation", "spacing"),
    "index": ("nd", "n", "n_d", "index", "refractive index", "ior"),
    "abbe": ("vd", "v", "v_d", "abbe", "abbe number", "v-no", "vno", "νd", "ν"),
    "glass": ("glass", "material", "medium"),
    "semi-diameter": ("semi_diameter", "semidiameter", "sd", "sa", "semi aperture", "clear semi diameter"),
    "diameter": ("diameter", "dia", "aperture", "clear aperture", "ca", "clear diameter"),
    "conic": ("conic", "k", "cc", "kappa", "conic constant"),
    "stop": ("stop", "is_stop", "aperture stop"),
    "label": ("surface", "surf", "no", "nr", "#", "s", "i", "type", "name", "comment", "remark", "note"),
}
"""Names of columns, in any case, with blanks, hyphens or underscores, and a unit in brackets behind it."""

_QUANTITY = {re.sub(r"[\s_-]+", " ", name): quantity for quantity, names in NAMES.items() for name in names}
_LARGEST_INDEX = 5.0
"""Largest plausible index: germanium, the highest of the usual media, has 4.0 in the infrared. Larger numbers are
radii or thicknesses in a wrong column.
"""
_UNITS_MM = {"mm": 1.0, "cm": 10.0, "in": 25.4, "inch": 25.4}
_STOP_WORDS = {"stop", "ast", "aperture stop", "iris", "diaphragm"}
_MARKED = {"1", "x", "yes", "true", "*", "s"}
_SKIPPED = {"object", "obj", "image", "img"}
_PLANE = {"", "inf", "infinity", "∞", "plane", "plano", "flat", "-", "0"}
_AIR = {"", "air", "-", "1", "0", "vacuum"}
_SETTINGS = ("name", "unit", "wavelength", "f-number", "half-field", "efl", "bfd")


@dataclass(slots=True)
class _Table:
    """The columns of a table, and what its comments state."""

    path: str | Path
    glasses: Glasses
    delimiter: str | None
    columns: list[str | None]
    settings: dict[str, tuple[str, int]] = field(default_factory=dict)
    remarks: list[str] = field(default_factory=list)
    lost: list[Lost] = field(default_factory=list)

    def setting(self, name: str) -> float | None:
        """A number from the comments above the table."""
        if name not in self.settings:
            return None
        text, line = self.settings[name]
        return number(self.path, line, text, name)


def read_table(path: str | Path, glasses: Glasses) -> tuple[PrintedLens, Beam]:
    """A lens from a plain table, and the beam stated in its comments; semi-diameters may be missing."""
    lines = read_lines(path)
    first, header = next(((line, text) for line, text in enumerate(lines, 1) if _is_row(text)), (0, ""))
    table = _columns(path, glasses, first, header)
    for line, text in enumerate(lines, 1):
        if text.lstrip().startswith("#"):
            _comment(table, line, text.lstrip().lstrip("# ").strip())
    rows = [(line, text) for line, text in enumerate(lines[first:], first + 1) if _is_row(text)]
    surfaces = [
        surface for number, row in enumerate(rows, 1) if (surface := _surface(table, number, *row, rows[-1][0]))
    ]
    if not surfaces:
        raise UnreadableLens(path, "holds no surfaces")
    stops = sum(surface.is_stop for surface in surfaces)
    if stops != 1:
        reason = f"{stops} rows are marked as the aperture stop, one must be"
        raise UnreadableLens(path, reason, hint='write "stop" into a cell of its row, e.g. of a column "surface"')
    lens = PrintedLens(
        name=table.settings["name"][0] if "name" in table.settings else Path(path).stem,
        provenance=(" ".join(table.remarks),) if table.remarks else (),
        surfaces=tuple(surfaces),
        wavelength_nm=table.setting("wavelength") or D_LINE_NM,
        nominal_efl_mm=table.setting("efl"),
        nominal_bfd_mm=table.setting("bfd"),
        lost=(*table.lost, *glasses.finish()),
    )
    half_field = table.setting("half-field")
    return lens, Beam(f_number=table.setting("f-number"), fields=[] if half_field is None else [0.0, half_field])


def _is_row(text: str) -> bool:
    return bool(text.strip(" \t;,")) and not text.lstrip().startswith("#")


def _cells(text: str, delimiter: str | None) -> list[str]:
    return [cell.strip().strip('"') for cell in text.split(delimiter)]


def _quantity(name: str) -> str | None:
    """Quantity of a column, None if its name is unknown: one of NAMES, or `A4`, `A6` … of an asphere."""
    plain = re.sub(r"[\s_-]+", " ", re.sub(r"[\[(].*?[\])]|[_ ]mm$", "", name.casefold())).strip()
    if term := re.fullmatch(r"a ?0*([1-9]\d?)", plain):
        return f"A{term[1]}"
    return _QUANTITY.get(plain)


def _columns(path: str | Path, glasses: Glasses, line: int, header: str) -> _Table:
    """The empty table of a header; UnreadableLens if it lacks a needed column or repeats one."""
    delimiter = next((mark for mark in "\t;," if mark in header), None)  # None: blanks
    names = _cells(header, delimiter)
    quantities = [_quantity(name) for name in names]
    table = _Table(path, glasses, delimiter, quantities)
    for name, quantity in zip(names, quantities, strict=True):
        if quantity is None and name:
            near = nearest(name.casefold(), _QUANTITY)
            hint = f'; "{near}" would be' if near else ""
            table.lost.append(Lost(f'column "{name}" is not known{hint}', line))
    double = sorted({q for q in quantities if q and q != "label" and quantities.count(q) > 1})
    missing = [] if {"radius", "curvature"} & set(quantities) else ["a radius"]
    missing += [] if "thickness" in quantities else ["a thickness"]
    missing += [] if {"index", "glass"} & set(quantities) else ["an index or a glass"]
    if missing or double:
        reason = f"the header has no column for {' and '.join(missing)}" if missing else f"two columns hold {double[0]}"
        hint = "e.g. surface,radius,thickness,nd,vd,semi_diameter; docs/lenses.md lists the names"
        if len(missing) == 3:
            hint = "where nobody knows the surfaces, `pipeline new rig --focal-length MM --f-number N` takes"
            hint += " a thin lens"
        raise UnreadableLens(path, reason, line=line, hint=hint)
    return table


def _comment(table: _Table, line: int, text: str) -> None:
    """Read a comment: a setting, such as `f-number: 4.5`, or a remark about the source of the lens."""
    name, colon, value = text.partition(":")
    name = re.sub(r"[\s_]+", "-", name.strip().casefold())
    if not colon or name not in _SETTINGS:
        table.remarks += [text] if text else []
    elif not value.strip():
        raise UnreadableLens(table.path, f"{name} has no value", line=line)
    else:
        table.settings[name] = (value.strip(), line)


def _surface(table: _Table, number: int, line: int, text: str, last_line: int) -> PrintedSurface | None:
    """A row as a surface; None for object and image."""
    cells = _cells(text, table.delimiter)
    if len(cells) > len(table.columns):
        reason = f"a row has {len(cells)} columns, the header {len(table.columns)}"
        hint = "write decimals with a point, not a comma" if table.delimiter == "," else None
        raise UnreadableLens(table.path, reason, line=line, hint=hint)
    values = {quantity: cell for quantity, cell in zip(table.columns, cells, strict=False) if quantity}
    words = {cell.casefold() for cell in cells}
    if words & _SKIPPED:
        return None
    unit, unit_line = table.settings.get("unit", ("mm", 0))
    unit_mm = _UNITS_MM.get(unit.casefold())
    if unit_mm is None:
        hint = f"known are {', '.join(_UNITS_MM)}"
        raise UnreadableLens(table.path, f'unknown unit "{unit}"', line=unit_line, hint=hint)
    index, abbe, glass = _medium(table, number, line, values)
    return PrintedSurface(
        radius_mm=_radius(table, line, values) * unit_mm,
        thickness_mm=_thickness(table, line, values, is_last=line == last_line) * unit_mm,
        semi_diameter_mm=_semi_diameter(table, line, values, unit_mm),
        index=index,
        abbe=abbe,
        glass=glass,
        is_stop=bool(words & _STOP_WORDS) or values.get("stop", "").casefold() in _MARKED,
        conic=_value(table, line, values, "conic") or 0.0,
        asphere=tuple(
            (power, value * unit_mm ** (1 - power))
            for power in range(1, 100)
            if (value := _value(table, line, values, f"A{power}"))
        ),
    )


def _value(table: _Table, line: int, values: dict[str, str], name: str) -> float | None:
    text = values.get(name, "")
    if text in ("", "-"):
        return None
    if text.count(",") == 1:
        hint = "write decimals with a point, not a comma"
        raise UnreadableLens(table.path, f'{name} must be a number, not "{text}"', line=line, hint=hint)
    return number(table.path, line, text, name)


def _radius(table: _Table, line: int, values: dict[str, str]) -> float:
    """Radius of curvature, as `radius` or as its reciprocal; infinite for a plane and for a stop in air."""
    if "curvature" in table.columns:
        curvature = _value(table, line, values, "curvature")
        return 1 / curvature if curvature else math.inf
    text = values.get("radius", "").casefold().lstrip("+-") or values.get("radius", "").strip("+-")
    if text in _PLANE | _STOP_WORDS:
        return math.inf
    return _value(table, line, values, "radius") or math.inf


def _thickness(table: _Table, line: int, values: dict[str, str], *, is_last: bool) -> float:
    text = values.get("thickness", "")
    if is_last and text.casefold() in _PLANE:
        return 0.0
    value = _value(table, line, values, "thickness")
    if value is None:
        raise UnreadableLens(table.path, "has no thickness", line=line, hint="only the last row may leave it out")
    return value


def _semi_diameter(table: _Table, line: int, values: dict[str, str], unit_mm: float) -> float | None:
    """Semi-diameter of a row; None if it is 0 or its cell is empty."""
    semi, diameter = (_value(table, line, values, name) for name in ("semi-diameter", "diameter"))
    half_width = semi or (diameter / 2 if diameter else None)
    return half_width * unit_mm if half_width else None


def _medium(table: _Table, number: int, line: int, values: dict[str, str]) -> tuple[float, float | None, str]:
    """Index, Abbe number and name behind a surface: printed numbers, else those of the catalogue for the glass."""
    printed, name = values.get("index", ""), values.get("glass", "")
    glass = "" if name.casefold() in _AIR | _STOP_WORDS else name
    index = None if printed.casefold() in _AIR else _value(table, line, values, "index")
    if index is None and glass:
        named = table.glasses.look_up(line, number, glass)
        return table.glasses.printed(line, number, named, table.setting("wavelength"))
    if index is None or index == 1:
        return 1.0, None, ""
    if not 1 < index < _LARGEST_INDEX:
        hint = "does a decimal comma, or a missing cell, shift the columns?"
        raise UnreadableLens(table.path, f"no medium has an index of {index:g}", line=line, hint=hint)
    return index, _value(table, line, values, "abbe") or None, glass
