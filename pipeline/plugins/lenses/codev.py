"""CODE V sequences (`.seq`): one lens of spheres, conics and even aspheres, object side first.

A sequence is a program. Each command is obeyed, ignored because it leaves the lens unchanged, or refused with its line.
It may address a surface (THI S2), a field (VUY F2) or a zoom position (THI S2 Z3), of which the first one is read.
"""

import math
import re
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from pipeline.frames import inverse
from pipeline.optics.glass.row import medium
from pipeline.optics.printed import D_LINE_NM, Lost, PrintedLens, PrintedSurface
from pipeline.plugins.lenses.axis import about_one_axis, frame, is_possible
from pipeline.plugins.lenses.glasses import Glasses
from pipeline.plugins.lenses.names import AIR, Named
from pipeline.plugins.lenses.sizing import Beam, opened, sized
from pipeline.plugins.lenses.text import UnreadableLens, number, other_wavelengths, radius_mm, read_lines

_UNITS_MM = {"M": 1.0, "C": 10.0, "I": 25.4}
_COEFFICIENTS = {letter: 4 + 2 * i for i, letter in enumerate("ABCDEFGHJ")}
_EDGES = ("CIR", "REX", "REY", "ARO")
_FAR = 1e8
"""Distance from which it counts as infinite, in the unit of the file."""
_MODES = ("DAR", "REV", "BEN")
_DISPLACED = ("XDE", "YDE", "ZDE", "ADE", "BDE", "CDE")
_REFUSED = ("CUF", "CUX", "RDX", "XTO", "YTO", "CYL", "SPS", "UDS", "GRT", "HOE", "DIF")
_SOLVE = "a solve; values are taken as written"
_NAMED = {
    **dict.fromkeys(("VUX", "VLX"), "vignetting factors; only semi-diameters block rays"),
    **dict.fromkeys(("ELX", "ELY", "HOL", "OBS", "ADX", "ADY"), "an aperture that is no centred circle or rectangle"),
    **dict.fromkeys(("PIM", "PIK", "SLV", "RED", "UMY", "UCY", "IMY", "ICY", "AMY", "ACY", "HMY", "HCY"), _SOLVE),
    **dict.fromkeys(("NAO", "NA"), "a numerical aperture; the stop decides"),
    **dict.fromkeys(("XOB", "YOB", "XIM", "YIM", "XRI", "YRI"), "fields as heights; only angles size a lens"),
    "CA": "which apertures block rays; here all of them do",
    "TEM": "a temperature; the lens is that of its indices",
}
# Labels, weights, drawing; axes about surfaces that are not displaced; couplings of the optimiser; tolerances.
_SILENT = """
LEN VER INI WTW WTF CWL WID PRE POL DDM CLS UID SLB COM DOR SAV GO CHK CON ASP SPH SPG CUM THM
POS THC CCY CCX GLC CUC KC AC BC CC DC EC FC GC HC JC DES DER XDC YDC ZDC ADC BDC CDC
DLF DLR DLC DLT DLN DLV DLH DLS DLX DLY DLZ DLA DLB DLG CYD CYN IRR TIR TIL TRX TRY ROL BTI BTX BTY DIS DSX DSY CMP
"""


@dataclass(slots=True)
class _Row:
    """A surface as the commands so far describe it, in the unit of the file."""

    line: int = 0
    radius_or_curvature: float = 0.0
    is_radius: bool | None = None  # or a curvature; None where the file has not said it
    thickness: float = 0.0
    glass: str = ""
    is_stop: bool = False
    conic: float = 0.0
    coefficients: dict[int, float] = field(default_factory=dict)
    semi_diameter: float | None = None
    inner: float = 0.0
    half_widths: dict[str, float] = field(default_factory=dict)
    displaced: dict[str, float] = field(default_factory=dict)
    mode: str = ""
    rotation_deg: float = 0.0
    medium: tuple[float, float | None, str] = (1.0, None, "")  # index, Abbe number and name


class _Sequence:
    """Statements of a file, command by command."""

    def __init__(self, path: str | Path, glasses: Glasses) -> None:
        self.path = path
        self.glasses = glasses
        self.title = ""
        self.is_radius: bool | None = None
        self.unit_mm: float | None = None
        self.wavelengths: list[float] = []
        self.reference = [1.0]
        self.beam = Beam()
        self.lists = {"WL": self.wavelengths, "YAN": self.beam.fields, "XAN": self.beam.along_x}
        self.lists |= {"VUY": self.beam.upper, "VLY": self.beam.lower, "REF": self.reference}
        self.rows = [_Row(thickness=math.inf)]  # the object first
        self.image = self.current = _Row()
        self.positions = 1
        self.private: dict[str, tuple[int, list[float], list[str]]] = {}
        self.private_wavelengths: list[float] | None = None
        self.lost: list[Lost] = []

    def obey(self, line: int, words: list[str]) -> None:
        """Read a command: its name, addresses and values."""
        name = words[0].upper()
        name = name[:3] if name.isalpha() else name  # TITLE and STOP are TIT and STO
        positions = [int(word[1:]) for word in words[1:] if re.fullmatch(r"[Zz]\d{1,4}", word)]
        values = [word for word in words[1:] if word not in ("Z1", "z1")]
        if self.private_wavelengths is not None and words[0].upper() not in ("PWL", "END"):
            self.private[words[0].upper()] = line, self.private_wavelengths, words[1:]
        elif name in ("PRV", "PWL"):
            self.private_wavelengths = self.numbers(line, name, values) if values else []
        elif name == "END":
            self.private_wavelengths = None
        elif max(positions, default=1) > 1:
            self.positions = max(self.positions, *positions)
        elif name == "TIT":
            self.title = self.title or " ".join(values)
        elif name == "RDM":
            self.is_radius = not "".join(values).upper().startswith("N")
        elif name == "DIM":
            self.unit_mm = _UNITS_MM.get(values[0].upper()[:1]) if values else None
            if self.unit_mm is None:
                raise UnreadableLens(self.path, f"DIM {' '.join(values)}: M, C or I expected", line=line)
        elif name == "ZOO":
            self._zoom(line, values)
        elif re.fullmatch(r"S(O|I|\d*)", name):
            self._surface(line, name, values)
        elif name in ("STO", "THI", "RDY", "CUY", "GLA", "K", *_EDGES, *_COEFFICIENTS, *_DISPLACED, *_MODES):
            self._of_surface(line, name, values)
        else:
            self._setting(line, name, values)

    def numbers(self, line: int, name: str, values: list[str]) -> list[float]:
        if not values:
            raise UnreadableLens(self.path, f"{name} has no value", line=line)
        return [number(self.path, line, value, name) for value in values]

    def lose(self, line: int | None, statement: str) -> None:
        self.lost.append(Lost(statement, line))

    def _setting(self, line: int, name: str, values: list[str]) -> None:
        """A command about the system; UnreadableLens for one that may change the lens and is not read."""
        is_zero = bool(values) and not any(value.strip("+-0.") for value in values)
        if name in ("EPD", "FNO"):
            value = number(self.path, line, " ".join(values), name)
            self.beam.pupil, self.beam.f_number = (value, None) if name == "EPD" else (None, value)
            self.beam.stated = f"{name} {value:g}"
            self.beam.line = line
        elif name in self.lists:
            single = re.fullmatch(r"[FfWw]([1-9]\d?)", values[0]) if values else None  # of one field or wavelength
            start, end = (int(single[1]) - 1, int(single[1])) if single else (0, None)
            self.lists[name][start:end] = self.numbers(line, name, values[1:] if single else values)
        elif name in _NAMED:
            if not is_zero and (name, *values) not in (("TEM", "20"), ("TEM", "20.0")):
                self.lose(line, f"{name}: {_NAMED[name]}")
        elif name in _REFUSED and not is_zero:
            raise UnreadableLens(self.path, f"{name}: a surface of another kind cannot be represented", line=line)
        elif name not in (*_REFUSED, *_SILENT.split()) or (name == "LEN" and len(self.rows) > 1):
            hint = "keep what WRL of CODE V writes, one lens alone, without analysis, macros and formulas"
            raise UnreadableLens(self.path, f"{name} may change the lens, and is not read", line=line, hint=hint)

    def _zoom(self, line: int, values: list[str]) -> None:
        """`ZOO 4`, or a command with a value for each position, the first of which is used."""
        first = 2 if values[1:] and re.fullmatch(r"[SFW](\d+|O|I)", values[1].upper()) else 1
        if values[:1] and values[0].isdigit():
            self.positions = int(values[0][:4])
        elif values[first:]:
            self.obey(line, values[: first + 1])

    def _surface(self, line: int, name: str, values: list[str]) -> None:
        """Begin a surface: `S`, its radius or curvature, thickness and glass."""
        if name[1:] not in ("", "O", "I", "0", f"{len(self.rows)}"):
            raise UnreadableLens(self.path, f"{name} stands where S{len(self.rows)} is due", line=line)
        thicknesses = [f"{_FAR}" if value.upper() in ("INF", "INFINITY") else value for value in values[1:2]]
        radius_or_curvature, *stated = self.numbers(line, name, [*values[:1], *thicknesses])
        thickness = stated[0] if stated else 0.0
        self.current = _Row(line, radius_or_curvature, self.is_radius, thickness, glass=" ".join(values[2:]))
        if name in ("SO", "S0"):
            self.rows[0] = self.current
        elif name == "SI":
            self.image = self.current
        else:
            self.rows.append(self.current)

    def _of_surface(self, line: int, name: str, values: list[str]) -> None:
        """A command about the addressed surface."""
        row, words = self._addressed(line, name, values)
        if name == "STO":
            for other in self.rows:
                other.is_stop = other is row
        elif name == "GLA":
            row.glass = " ".join(words)
            row.line = line
        elif name in _MODES:
            row.mode = name
        elif name in _EDGES:
            self._edge(line, row, name, words)
        elif words and words[0].isalpha():
            self.lose(line, f"{name} {words[0].upper()}: {_SOLVE}")
        else:
            self._assign(line, row, name, number(self.path, line, " ".join(words), name))

    def _assign(self, line: int, row: _Row, name: str, value: float) -> None:
        if name in ("THI", "K"):
            setattr(row, "conic" if name == "K" else "thickness", value)
        elif name in _COEFFICIENTS:
            row.coefficients[_COEFFICIENTS[name]] = value
        elif name in ("RDY", "CUY"):
            row.radius_or_curvature = value
            row.is_radius = name == "RDY"
        else:
            row.displaced[name] = value

    def _edge(self, line: int, row: _Row, name: str, words: list[str]) -> None:
        """An aperture: clear, or with a qualifier an edge, a hole or an obstruction; L'a' is its label."""
        kind, *_ = [word for word in map(str.upper, words[:1]) if word in ("CLR", "EDG", "OBS", "HOL")] or [""]
        words = words[1:] if kind else words
        words = words[2:] if words[:1] in (["L"], ["l"]) else words
        value = number(self.path, line, " ".join(words), name)
        if name == "CIR" and kind == "OBS":
            row.inner = value
        elif kind in ("OBS", "HOL"):
            self.lose(line, f"{name} {kind}: only clear apertures block rays")
        elif kind == "EDG":
            pass  # where the glass ends, for drawings
        elif name == "CIR":
            row.semi_diameter = value
        elif name == "ARO":
            row.rotation_deg = value
        else:
            row.half_widths[name] = value

    def _addressed(self, line: int, name: str, values: list[str]) -> tuple[_Row, list[str]]:
        """The surface that a command refers to, named as S3, SO, SI or else the current one, and the other words."""
        word = values[0].upper() if values else ""
        row = self.current
        words = values[1:]
        surface = int(word[1:]) if re.fullmatch(r"S\d{1,6}", word) else 0 if word == "SO" else len(self.rows)
        if not re.match(r"S($|\d|A$|[OI])", word):
            words = values
        elif surface < len(self.rows):
            row = self.rows[surface]
        elif word in ("SI", f"S{len(self.rows)}"):
            row = self.image
        else:
            row = _Row()
        if not row.line:
            raise UnreadableLens(self.path, f"{name} {word}: there is no surface of that name yet", line=line)
        return row, words


def read_codev(path: str | Path, glasses: Glasses) -> PrintedLens:
    """A lens from a `.seq` file."""
    sequence = _Sequence(path, glasses)
    for line, words in _commands(read_lines(path)):
        sequence.obey(line, words)
    first = sequence.rows[0]
    image, beam = sequence.image, sequence.beam
    if len(sequence.rows) == 1:
        raise UnreadableLens(path, "holds no surfaces")
    if first.glass.upper() not in ("", "AIR"):
        raise UnreadableLens(path, f"the object is in {first.glass}; a lens begins in air", line=first.line)
    if first.thickness < _FAR:
        sequence.lose(first.line, f"the object distance of {first.thickness:g}: a dataset says where its targets are")
        if beam.f_number is not None:
            beam.f_number = None
            sequence.lose(beam.line, f"{beam.stated}, an F-number at that distance; the stop decides")
    if image.radius_or_curvature:
        sequence.lose(image.line, "the image surface is curved; sensors are flat")
    if image.thickness:
        sequence.lose(image.line, f"a defocus of {image.thickness:g}: the camera says where the sensor is")
    if sequence.positions > 1:
        sequence.lose(None, f"{sequence.positions} zoom positions; the first one is read")
    if not any(row.is_stop for row in sequence.rows):
        sequence.rows[1].is_stop = True
        sequence.lose(None, "no STO: surface 1 is the stop, CODE V's default")
    if sequence.unit_mm is None:
        sequence.lose(None, "no DIM: lengths are millimetres, CODE V's default")
    rows = list(enumerate(sequence.rows[1:], 1))
    media = [_medium(sequence, surface, row) for surface, row in rows]
    nm = glasses.wavelength_nm(media, dict(enumerate(sequence.wavelengths, 1)).get(int(sequence.reference[0])))
    for (surface, row), named in zip(rows, media, strict=True):
        row.medium = glasses.printed(row.line, surface, named, nm)
    sequence.lost += [*other_wavelengths(sequence.wavelengths, nm), *glasses.finish()]
    return replace(_decided(sequence), wavelength_nm=nm or D_LINE_NM)


def _decided(sequence: _Sequence) -> PrintedLens:
    """The lens with curvatures, CODE V's default without RDM, or with radii if curvatures make surfaces cross."""
    if all(row.is_radius is not None for row in sequence.rows[1:] if row.radius_or_curvature):
        return _lens(sequence, is_radius=True)
    for is_radius, name in ((False, "curvatures, CODE V's default"), (True, "radii; as curvatures they make no lens")):
        with suppress(UnreadableLens):
            lens = _lens(sequence, is_radius)
            if is_possible(lens.surfaces):
                return replace(lens, lost=(Lost(f"no RDM: the numbers of surfaces are {name}"), *lens.lost))
    return _lens(sequence, is_radius=False)


def _lens(sequence: _Sequence, is_radius: bool) -> PrintedLens:
    """The lens with all semi-diameters; `is_radius` settles the meaning of numbers that the file leaves open."""
    path = sequence.path
    unit_mm = sequence.unit_mm or 1.0
    surfaces = tuple(_printed(sequence, i, row, is_radius) for i, row in enumerate(sequence.rows[1:], 1))
    lens = PrintedLens(name=sequence.title or Path(path).stem, surfaces=surfaces, lost=tuple(sequence.lost))
    if any(any(row.displaced.values()) for row in (*sequence.rows[1:], sequence.image)):
        lens = about_one_axis(path, lens, _frames(sequence, unit_mm))
    # CIR blocks rays
    return opened(path, sized(path, lens, sequence.beam, unit_mm), sequence.beam, unit_mm, has_ring=True)


def _frames(sequence: _Sequence, unit_mm: float) -> list[np.ndarray]:
    """Frames of all surfaces and of the image plane in that of surface 1 before it is displaced, (4, 4) each.

    A surface is decentred before it is turned about x, y and z; turns about x and y are left-handed. What follows goes
    on from there, with DAR from the old axis; with REV the turn back comes behind the surface, in reverse order.
    """
    pose = np.eye(4)
    frames = []
    for row in (*sequence.rows[1:], sequence.image):
        x, y, z, alpha, beta, gamma = (row.displaced.get(name, 0.0) for name in _DISPLACED)
        if row.mode == "BEN" and any(row.displaced.values()):
            raise UnreadableLens(sequence.path, "BEN: only mirrors bend the axis", line=row.line)
        step = frame(x * unit_mm, y * unit_mm, z * unit_mm, -alpha, -beta, gamma)
        frames.append(pose if row.mode == "REV" else pose @ step)
        pose = pose @ inverse(step) if row.mode == "REV" else pose if row.mode == "DAR" else pose @ step
        pose = pose @ frame(0.0, 0.0, row.thickness * unit_mm)
    return frames


def _commands(lines: list[str]) -> Iterator[tuple[int, list[str]]]:
    """Commands with their lines: `;` separates, `&` continues, `!` begins a comment, quotes hold words together."""
    pending, start = "", 0  # text and first line of a command that goes on
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


def _printed(sequence: _Sequence, surface: int, row: _Row, is_radius: bool) -> PrintedSurface:
    """A surface in millimetres; UnreadableLens if it cannot be represented."""
    unit_mm = sequence.unit_mm or 1.0
    is_radius = is_radius if row.is_radius is None else row.is_radius
    curvature = 1 / row.radius_or_curvature if is_radius and row.radius_or_curvature else row.radius_or_curvature
    if row.thickness >= _FAR:
        raise UnreadableLens(sequence.path, f"surface {surface} is infinitely far from the next one", line=row.line)
    half_widths_mm = None
    if row.half_widths:
        if len(row.half_widths) != 2:
            reason = f"surface {surface} has {next(iter(row.half_widths))}, and a rectangle needs REX and REY"
            raise UnreadableLens(sequence.path, reason, line=row.line)
        half_widths_mm = row.half_widths["REX"] * unit_mm, row.half_widths["REY"] * unit_mm
    semi_diameter_mm = None if row.semi_diameter is None else row.semi_diameter * unit_mm
    if semi_diameter_mm is None and half_widths_mm:
        semi_diameter_mm = math.hypot(*half_widths_mm)
    return PrintedSurface(
        radius_mm=radius_mm(curvature / unit_mm),
        thickness_mm=row.thickness * unit_mm,
        semi_diameter_mm=semi_diameter_mm,
        inner_semi_diameter_mm=row.inner * unit_mm,
        half_widths_mm=half_widths_mm,
        aperture_rotation_deg=row.rotation_deg if half_widths_mm else 0.0,
        index=row.medium[0],
        abbe=row.medium[1],
        glass=row.medium[2],
        is_stop=row.is_stop,
        conic=row.conic,
        asphere=tuple((p, value * unit_mm ** (1 - p)) for p, value in sorted(row.coefficients.items()) if value),
    )


def _medium(sequence: _Sequence, surface: int, row: _Row) -> Named:
    """The medium behind a surface: a private glass, or one of a name or code."""
    if row.glass.upper() in ("", "AIR"):
        return AIR
    if row.glass.upper() in ("REFL", "MIRROR"):
        raise UnreadableLens(sequence.path, f"surface {surface} is a mirror", line=row.line)
    if row.glass.upper() in sequence.private:
        return _private(sequence, surface, row.glass.upper())
    name, _, vendor = row.glass.replace(" ", ":").partition("_")  # nd and Vd may be two numbers
    return sequence.glasses.look_up(row.line, surface, name, [vendor] if vendor else [])


def _private(sequence: _Sequence, surface: int, glass: str) -> Named:
    """A glass of the file's own: Laurent's equation of the squared index, or nd and Vd of a table."""
    line, wavelengths, words = sequence.private[glass]
    if words[:1] in (["LAU"], ["lau"]) and len(words) <= 7:  # powers 0, 2, -2, -4, -6, -8 of the wavelength
        terms = sequence.numbers(line, glass, [*words[1:], *"00000"])[:6]
        formula = f"schott({', '.join(map(repr, terms))})"
        return Named(medium=medium(glass=formula, index=None, abbe=None, wavelength_nm=D_LINE_NM), glass=formula)
    if words and words[0].isalpha():
        hint = "write its indices at a PWL of 656.3 587.6 486.1"
        raise UnreadableLens(sequence.path, f"private glass {glass}: {words[0]} is not read", line=line, hint=hint)
    table = dict(zip(wavelengths, sequence.numbers(line, glass, words), strict=False))
    nd = next((n for wavelength, n in table.items() if abs(wavelength - 587.6) < 0.1), None)
    if nd is None:
        raise UnreadableLens(sequence.path, f"private glass {glass} has no index at 587.6 nm", line=line)
    # The lines F and C, or between wavelengths that are listed.
    blue, red = np.interp((486.1**-2, 656.3**-2), *np.transpose(sorted((w**-2, n) for w, n in table.items())))
    vd = float((nd - 1) / (blue - red)) if blue > red and min(table) < 486.5 and max(table) > 656 else None
    sequence.glasses.remark(line, surface, f"private glass {glass} is n_d {nd:g}, V_d {vd and round(vd, 2)}")
    return sequence.glasses.model(line, surface, (nd, vd), "" if vd else f"constant({nd!r})")
