"""CODE V sequences (`.seq`): one lens of spheres, conics and even aspheres, object side first.

Only commands that make a lens are obeyed. Commands that change it in a way that we cannot represent are reported,
each with its line; a few, which would change the meaning of the numbers, are refused.
"""

import math
import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

from pipeline.files.lenses.sizing import Beam, opened, sized
from pipeline.files.lenses.text import AIR, Medium, UnreadableLens, glass_of, number, other_wavelengths, read_lines
from pipeline.optics.printed import Lost, PrintedLens, PrintedSurface

_UNITS_MM = {"M": 1.0, "C": 10.0, "I": 25.4}
_COEFFICIENTS = {letter: 4 + 2 * i for i, letter in enumerate("ABCDEFGHJ")}
_EDGES = ("CIR", "REX", "REY", "ARO")
_REFUSED = {
    **dict.fromkeys(("XDE", "YDE", "ZDE", "ADE", "BDE", "CDE", "DAR", "BEN", "GLB"), "a decentred or tilted surface"),
    **dict.fromkeys(("XTO", "YTO", "CYL", "SPS", "UDS", "GRT", "HOE", "DIF"), "a surface that is not of revolution"),
}
_NAMED = {
    **dict.fromkeys(("VUX", "VLX"), "vignetting factors; only semi-diameters block rays"),
    **dict.fromkeys(("ELX", "ELY", "HOL", "OBS", "ADX", "ADY"), "an aperture that is no centred circle or rectangle"),
    **dict.fromkeys(("ZOO",), "zoom positions; only the first one is read"),
    **dict.fromkeys(("PIM", "PIK", "SLV"), "a solve; thicknesses are taken as written"),
    **dict.fromkeys(("NAO", "NA"), "a numerical aperture; the stop decides"),
}
# Analysis, labels, couplings of the optimiser.
_SILENT = "LEN REF VERSION INI WTW WTF GO SLB THC CCY GLC CUC KC AC BC CC DC EC FC GC HC JC DES DER"


@dataclass(slots=True)
class _Row:
    line: int
    shape: float
    thickness: float
    glass: str = ""
    is_stop: bool = False
    conic: float = 0.0
    coefficients: dict[int, float] = field(default_factory=dict)
    semi_diameter: float | None = None
    inner: float = 0.0
    half_widths: dict[str, float] = field(default_factory=dict)
    rotation_deg: float = 0.0


class _Sequence:
    """Statements of a file, command by command."""

    def __init__(self, path: str | Path) -> None:
        self.path = path
        self.title = ""
        self.shape: str | None = None
        self.unit_mm: float | None = None
        self.wavelengths: list[float] = []
        self.beam = Beam()
        self.rows: list[_Row] = []
        self.current: _Row | None = None
        self.private: dict[str, float] = {}
        self.private_wavelengths: list[float] | None = None
        self.lost: list[Lost] = []

    def obey(self, line: int, words: list[str]) -> None:
        name, values = words[0].upper(), words[1:]
        if self.private_wavelengths is not None:
            self._private(line, name, words)
        elif name in ("TIT", "TITLE"):
            self.title = " ".join(values)
        elif name == "RDM":
            self.shape = "curvature" if values[:1] and values[0].upper() == "N" else "radius"
        elif name == "DIM":
            self.unit_mm = _UNITS_MM.get(values[0].upper()) if values else None
            if self.unit_mm is None:
                raise UnreadableLens(self.path, f"DIM {' '.join(values)}: M, C or I expected", line=line)
        elif name == "PRV":
            self.private_wavelengths = []
        elif name in ("SO", "SI", "S") or re.fullmatch(r"S\d+", name):
            self._surface(line, name, values)
        else:
            self._setting(line, name, values)

    def _numbers(self, line: int, name: str, values: list[str]) -> list[float]:
        if not values:
            raise UnreadableLens(self.path, f"{name} has no value", line=line)
        return [number(self.path, line, value, name) for value in values]

    def _lose(self, line: int, what: str) -> None:
        self.lost.append(Lost(what=what, line=line))

    def _setting(self, line: int, name: str, values: list[str]) -> None:
        if name in ("EPD", "FNO"):
            value = self._numbers(line, name, values)[0]
            self.beam.pupil, self.beam.f_number = (value, None) if name == "EPD" else (None, value)
            self.beam.stated, self.beam.line = f"{name} {value:g}", line
        elif name == "WL":
            self.wavelengths = self._numbers(line, name, values)
        elif name in ("XAN", "YAN"):
            (self.beam.fields if name == "YAN" else self.beam.others).extend(self._numbers(line, name, values))
        elif name in ("VUY", "VLY"):
            (self.beam.upper if name == "VUY" else self.beam.lower).extend(self._numbers(line, name, values))
        elif name in _REFUSED:
            raise UnreadableLens(self.path, f"{name}: {_REFUSED[name]} cannot be represented", line=line)
        elif name in _NAMED:
            self._lose(line, f"{name}: {_NAMED[name]}")
        elif not self._of_surface(line, name, values) and name not in _SILENT.split():
            self._lose(line, f"{name} is not read")

    def _surface(self, line: int, name: str, values: list[str]) -> None:
        shape, thickness = [*self._numbers(line, name, values[:2]), 0.0][:2]
        self.current = None
        if name == "SO":
            if not thickness >= 1e8:
                self._lose(line, f"the object distance of {thickness:g}: a dataset says where its targets are")
        elif name == "SI":
            if shape:
                self._lose(line, "the image surface is curved; sensors are flat")
            if thickness:
                self._lose(line, f"a defocus of {thickness:g}: the camera says where the sensor is")
        else:
            glass = values[2] if len(values) > 2 else ""
            self.current = _Row(line=line, shape=shape, thickness=thickness, glass=glass)
            self.rows.append(self.current)

    def _of_surface(self, line: int, name: str, values: list[str]) -> bool:
        row, rest = self._addressed(line, values)
        if name == "STO":
            if row:
                row.is_stop = True
            return row is not None
        if name not in ("K", "CON", "ASP", "SPH", *_EDGES, *_COEFFICIENTS):
            return False
        if row is None:
            self._lose(line, f"{name} {' '.join(values)} of no lens surface")
        elif name == "K":
            row.conic = self._numbers(line, name, rest)[0]
        elif name in _COEFFICIENTS:
            row.coefficients[_COEFFICIENTS[name]] = self._numbers(line, name, rest)[0]
        elif name in _EDGES:
            self._edge(line, row, name, rest)
        return True

    def _edge(self, line: int, row: _Row, name: str, rest: list[str]) -> None:
        """An aperture: clear, or with a qualifier before its value an edge, a hole or an obstruction."""
        kind = rest[0].upper() if rest and rest[0].upper() in ("CLR", "EDG", "OBS", "HOL") else ""
        value = self._numbers(line, name, rest[1:] if kind else rest)[0]
        if name == "CIR" and kind == "OBS":
            row.inner = value
        elif kind not in ("", "CLR"):
            self._lose(line, f"{name} {kind}: only clear apertures block rays")
        elif name == "CIR":
            row.semi_diameter = value
        elif name == "ARO":
            row.rotation_deg = value
        else:
            row.half_widths[name] = value

    def _addressed(self, line: int, values: list[str]) -> tuple[_Row | None, list[str]]:
        """The surface that a command refers to, named as S3 or else the current one, and the other words."""
        named = re.fullmatch(r"S(\d+)", values[0].upper()) if values else None
        if not named:
            return self.current, values
        place = int(named[1])
        if not 1 <= place <= len(self.rows):
            raise UnreadableLens(self.path, f"there is no surface S{place} yet", line=line)
        return self.rows[place - 1], values[1:]

    def _private(self, line: int, name: str, words: list[str]) -> None:
        assert self.private_wavelengths is not None
        if name == "END":
            self.private_wavelengths = None
        elif name == "PWL":
            self.private_wavelengths = self._numbers(line, name, words[1:])
        else:
            listed = self._numbers(line, words[0], words[1:])
            # The wavelength that is the d line, among those listed.
            near = [n for w, n in zip(self.private_wavelengths, listed, strict=False) if abs(w - 587.6) < 0.1]
            if not near:
                raise UnreadableLens(self.path, f"private glass {words[0]} has no index at 587.6 nm", line=line)
            self.private[words[0].upper()] = near[0]


def read_codev(path: str | Path) -> PrintedLens:
    """A lens from a `.seq` file."""
    sequence = _Sequence(path)
    for line, words in _commands(read_lines(path)):
        sequence.obey(line, words)
    if sequence.shape is None:
        hint = "add RDM (radii) or RDM N (curvatures) at its beginning"
        raise UnreadableLens(path, "does not say whether surfaces have radii or curvatures", hint=hint)
    if sequence.unit_mm is None:
        raise UnreadableLens(path, "does not say its unit", hint="add DIM M (mm), C (cm) or I (inches)")
    if not sequence.rows:
        raise UnreadableLens(path, "holds no surfaces")
    surfaces = tuple(_printed(sequence, i, row) for i, row in enumerate(sequence.rows, 1))
    sequence.lost += other_wavelengths(sequence.wavelengths)
    lens = PrintedLens(name=sequence.title or Path(path).stem, surfaces=surfaces, lost=tuple(sequence.lost))
    lens = sized(path, lens, sequence.beam, sequence.unit_mm)
    return opened(path, lens, sequence.beam, sequence.unit_mm, has_ring=True)  # CIR blocks rays


def _commands(lines: list[str]) -> Iterator[tuple[int, list[str]]]:
    """Commands with their lines: `;` separates, `&` continues, `!` begins a comment, quotes hold words together."""
    pending, start = "", 0
    for i, text in enumerate(lines, 1):
        body = re.sub(r"""('[^']*'|"[^"]*")|!.*""", lambda match: match[1] or "", text).rstrip()
        start = start or i
        if body.endswith("&"):
            pending += body[:-1] + " "
            continue
        for command in re.findall(r"""(?:'[^']*'|"[^"]*"|[^;'"])+""", pending + body):
            words = [word.strip("'\"") for word in re.findall(r"""'[^']*'|"[^"]*"|[^\s'"]+""", command)]
            if words and words[0]:
                yield start, words
        pending, start = "", 0


def _printed(sequence: _Sequence, place: int, row: _Row) -> PrintedSurface:
    unit_mm = sequence.unit_mm or 1.0
    radius = (row.shape if sequence.shape == "radius" else 1 / row.shape) if row.shape else math.inf
    index, abbe, glass = _medium(sequence, place, row)
    half_widths_mm = None
    if row.half_widths:
        if len(row.half_widths) != 2:
            reason = f"surface {place} has {next(iter(row.half_widths))}, and a rectangle needs REX and REY"
            raise UnreadableLens(sequence.path, reason, line=row.line)
        half_widths_mm = row.half_widths["REX"] * unit_mm, row.half_widths["REY"] * unit_mm
    semi_diameter_mm = None if row.semi_diameter is None else row.semi_diameter * unit_mm
    if semi_diameter_mm is None and half_widths_mm:
        semi_diameter_mm = math.hypot(*half_widths_mm)
    return PrintedSurface(
        radius_mm=radius * unit_mm,
        thickness_mm=row.thickness * unit_mm,
        semi_diameter_mm=semi_diameter_mm,
        inner_semi_diameter_mm=row.inner * unit_mm,
        half_widths_mm=half_widths_mm,
        aperture_rotation_deg=row.rotation_deg if half_widths_mm else 0.0,
        index=index,
        glass=glass,
        abbe=abbe,
        is_stop=row.is_stop,
        conic=row.conic,
        asphere=tuple((p, value * unit_mm ** (1 - p)) for p, value in sorted(row.coefficients.items()) if value),
    )


def _medium(sequence: _Sequence, place: int, row: _Row) -> Medium:
    """Index, Abbe number and name: a private glass, a fictitious one (620410.603236 or 620.603), or a catalogue's."""
    glass = row.glass
    if not glass or glass.upper() == "AIR":
        return AIR
    if glass.upper() in ("REFL", "MIRROR"):
        raise UnreadableLens(sequence.path, f"surface {place} is a mirror", line=row.line)
    if glass.upper() in sequence.private:
        return Medium(sequence.private[glass.upper()], None, glass)
    if fictitious := re.fullmatch(r"(\d{3,})\.(\d{3,})", glass):
        return Medium(float(f"1.{fictitious[1]}"), float(f"{fictitious[2][:2]}.{fictitious[2][2:]}"), glass)
    name, _, vendor = glass.partition("_")
    return glass_of(sequence.path, row.line, place, name, [vendor] if vendor else [])
