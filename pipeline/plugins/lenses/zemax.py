"""Zemax lens files (`.zmx`): keyword lines, one block per surface, object and image among them.

Unsupported statements that change the lens are reported with their line, or refused if the numbers would have another
meaning without them.
"""

import math
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from pipeline.frames import inverse
from pipeline.optics.glass.row import MAX_INDEX_DIFFERENCE
from pipeline.optics.printed import D_LINE_NM, Lost, PrintedLens, PrintedSurface
from pipeline.plugins.lenses import text
from pipeline.plugins.lenses.axis import about_one_axis, frame
from pipeline.plugins.lenses.glasses import Glasses
from pipeline.plugins.lenses.names import AIR, Named
from pipeline.plugins.lenses.sizing import Beam, opened, sized
from pipeline.plugins.lenses.text import UnreadableLens, number, read_lines

_UNITS_MM = {"MM": 1.0, "CM": 10.0, "IN": 25.4, "INCH": 25.4, "METER": 1000.0, "M": 1000.0}
_POWER_OF_TERM = {"EVENASPH": 2, "ODDASPHE": 1}  # times the number of the parameter
_BREAK, _TILTED = "COORDBRK", "TILTSURF"
_PLACEHOLDER = (1.5, 40.0)
"""Index and Abbe number that Zemax writes where it keeps none."""
_NO_GAP = 1e-6
"""Distance of surfaces that an optimiser's rounding explains, in the unit of the file: some are negative."""
_STANDARD_AIR = [20.0, 1.0]
"""Temperature [°C] and pressure [atm] of ENVD for which catalogues have their indices."""
_APERTURES = ("ELAP", "UDAD", "SPID", "UDOB", "OBEL", "OBSQ", "OBDC")
# Indented or not
_OF_SURFACE = ("TYPE", "CURV", "CONI", "PARM", "DISZ", "GLAS", "DIAM", "CLAP", "OBSC", "SQAP", "STOP")
_VIGNETTING = ("VDXN", "VDYN", "VCXN", "VCYN", "VANN")
# Drawing, analysis, merit functions, couplings, settings of the editor.
_SILENT = """
VERS MODE PFIL LANG NOTE GFAC GSTD ROPD PICB FWGT FWGN ZVAN ZVDX ZVDY SDMA RAIM PUSH PUPD EFFL CONF GLCZ WAVL WWGT WWGN
PWAV POLS GLRS NSCD COFN SLAB FIMP HIDE MIRR PICK VPAR VCUR OPDX PZUP LABL MEMA MAZH CFGO TOL MOFF PLIM DMFS SCED EGDS
COMM FLAP WAVN MNCA MNEA MXCA MXEA MNCG MNEG MXCG MXEG BLNK DPTH OPOV POPS PCON RSCE RWRE NSCS DRAX DGEO STAR HYPR TCED
TCMM VDSZ CRSR DISG FIXD PPAR MNUM ATYP AUTH RAYX PRWL TOLR PFLD OMMA ISNA FCOM
"""

# Named in one line: coatings, tolerances of the editor, identifiers.
_NO_CONCERN = "COAT LUID EERA SSID IWDP OEMA DBDT TOLE SCOL VCON ZVCX ZVCY CHZH USAP STUD NOID"


@dataclass(slots=True)
class _Row:
    """A surface as the lines of its block describe it, in the unit of the file."""

    line: int
    type_name: str = "STANDARD"
    type_line: int = 0
    curvature: float = 0.0
    conic: float = 0.0
    parameters: dict[int, float] = field(default_factory=dict)
    thickness: float = 0.0
    glass: list[str] = field(default_factory=list)
    glass_line: int = 0
    semi_diameter: float | None = None
    is_automatic: bool = False
    has_ring: bool = False
    inner: float = 0.0
    half_widths: tuple[float, float] | None = None
    is_stop: bool = False


class _System:
    """Statements of a file, line by line."""

    def __init__(self, path: str | Path, glasses: Glasses) -> None:
        self.path = path
        self.glasses = glasses
        self.name = ""
        self.vendors: list[str] = []
        self.unit_mm: float | None = None
        self.beam = Beam()
        self.working_f_number = False
        self.stop_floats = False
        self.field_is_angle = True
        self.wavelength_count = 24  # as many as a file lists, used or not
        self.wavelengths_um = dict[int, float]()  # by number
        self.primary = 1
        self.rows: list[_Row] = []
        self.lost: list[Lost] = []
        self.unread: dict[str, int] = {}

    @property
    def surfaces(self) -> list[tuple[int, _Row]]:
        """Rows between object and image with their numbers, without coordinate breaks that are not the stop."""
        return [(i, row) for i, row in enumerate(self.rows[1:-1], 1) if row.type_name != _BREAK or row.is_stop]

    @property
    def opens_stop(self) -> bool:
        """Whether the system aperture determines the stop."""
        return self.beam.is_known and not self.stop_floats

    def obey(self, line: int, row: str) -> None:
        """Read a line: it begins a surface, belongs to the last one, or describes the system."""
        keyword, _, values = row.strip().partition(" ")
        words = values.split()
        if keyword == "SURF":
            self.rows.append(_Row(line=line))
        elif self.rows and (row[:1].isspace() or keyword in _OF_SURFACE):
            self._of_surface(line, keyword, words)
        else:
            self._of_system(line, keyword, words)

    def _first(self, line: int, keyword: str, words: list[str], index: int = 0) -> float:
        if len(words) <= index:
            raise UnreadableLens(self.path, f"{keyword} has no value", line=line)
        return number(self.path, line, words[index], keyword)

    def _of_system(self, line: int, keyword: str, words: list[str]) -> None:
        """A line about the system: name, unit, aperture, fields, wavelengths, or what is lost."""
        if keyword == "NAME":
            self.name = " ".join(words)
        elif keyword == "GCAT":
            self.vendors = words
        elif keyword == "UNIT":
            self.unit_mm = _UNITS_MM.get(words[0].upper()) if words else None
            if self.unit_mm is None:
                raise UnreadableLens(self.path, f"unknown unit {' '.join(words[:1])}", line=line)
        elif keyword in ("ENPD", "FNUM", "FLOA"):
            self._system_aperture(line, keyword, words)
        elif keyword == "FTYP":
            self.field_is_angle = self._first(line, keyword, words) == 0
            if len(words) > 3:
                self.wavelength_count = int(self._first(line, keyword, words, 3))
        elif keyword in ("XFLN", "YFLN", "XFLD", "YFLD"):
            self.beam.fields += [number(self.path, line, word, keyword) for word in words]
        elif keyword == "WAVM":
            if self._first(line, keyword, words) <= self.wavelength_count:
                self.wavelengths_um[int(self._first(line, keyword, words))] = self._first(line, keyword, words, 1)
        elif keyword == "PWAV":
            self.primary = int(self._first(line, keyword, words))
        elif keyword == "ENVD":
            if [number(self.path, line, word, keyword) for word in words[:2]] != _STANDARD_AIR:
                statement = f"ENVD {' '.join(words[:2])}: indices and lengths are those at 20 degrees Celsius and 1 atm"
                self.lost.append(Lost(statement, line))
        elif keyword == "MNUM" and self._first(line, keyword, words) > 1:
            current = f"number {words[1]}, which" if len(words) > 1 else "the one that"
            statement = f"{words[0]} configurations; this lens is {current} was current when the file was saved"
            self.lost.append(Lost(statement, line))
        elif keyword in _VIGNETTING:
            if any(number(self.path, line, word, keyword) for word in words):
                self.lost.append(Lost(f"{keyword}: vignetting factors; only semi-diameters block rays", line))
        elif keyword and not self.rows and keyword not in _SILENT.split():  # behind them: merit function
            self.unread.setdefault(keyword, line)

    def _system_aperture(self, line: int, keyword: str, words: list[str]) -> None:
        """ENPD or FNUM determine the stop; with FLOA, "float by stop size", its own semi-diameter does."""
        if keyword == "FLOA":
            self.stop_floats = True
        elif (value := self._first(line, keyword, words)) > 0:
            self.beam.pupil, self.beam.f_number = (value, None) if keyword == "ENPD" else (None, value)
            self.beam.stated = f"{keyword} {value:g}"
            self.beam.line = line
            self.working_f_number = keyword == "FNUM" and len(words) > 1 and self._first(line, keyword, words, 1) == 1

    def _of_surface(self, line: int, keyword: str, words: list[str]) -> None:
        """A line of the block of the last surface."""
        row = self.rows[-1]
        if keyword == "TYPE":
            row.type_name = words[0].upper() if words else "STANDARD"
            row.type_line = line
        elif keyword == "CURV":
            row.curvature = self._first(line, keyword, words)
        elif keyword == "CONI":
            row.conic = self._first(line, keyword, words)
        elif keyword == "PARM":
            row.parameters[int(self._first(line, keyword, words))] = self._first(line, keyword, words, 1)
        elif keyword == "DISZ":
            is_infinite = bool(words) and words[0].upper() == "INFINITY"
            row.thickness = math.inf if is_infinite else self._first(line, keyword, words)
        elif keyword == "GLAS":
            row.glass, row.glass_line = words, line
        elif keyword in ("DIAM", "CLAP", "OBSC", "SQAP"):
            self._aperture(line, row, keyword, words)
        elif keyword == "STOP":
            row.is_stop = True
        elif keyword == "SCBD" and any(number(self.path, line, word, keyword) for word in words[3:]):
            raise UnreadableLens(self.path, f"surface {len(self.rows) - 1} is tilted or decentred (SCBD)", line=line)
        elif keyword in _APERTURES:
            statement = f"surface {len(self.rows) - 1}: {keyword}, an aperture that is no circle"
            self.lost.append(Lost(statement, line))
        elif keyword and keyword not in _SILENT.split():
            self.unread.setdefault(keyword, line)

    def _aperture(self, line: int, row: _Row, keyword: str, words: list[str]) -> None:
        """DIAM is a semi-diameter, only for drawing unless it is fixed; CLAP is a hard ring and overrides it.

        OBSC blocks what lies between two radii, SQAP what lies outside a rectangle of two half widths.
        """
        first, second = (0.0, 0.0) if keyword == "DIAM" else (self._first(line, keyword, words, i) for i in (0, 1))
        if keyword == "CLAP":
            row.inner = first
            row.semi_diameter = second
            row.is_automatic = False
            row.has_ring = True
        elif keyword == "OBSC" and first == 0:
            row.inner = second
        elif keyword == "OBSC":
            loss = f"an obstruction from {first:g} to {second:g}, which leaves a hole inside"
            self.lost.append(Lost(f"surface {len(self.rows) - 1}: {loss}", line))
        elif keyword == "SQAP":
            row.half_widths = (first, second)
        elif row.semi_diameter is None or row.is_automatic:
            row.semi_diameter = self._first(line, keyword, words) or None
            row.is_automatic = len(words) < 2 or number(self.path, line, words[1], keyword) == 0


def read_zemax(path: str | Path, glasses: Glasses, raw: bytes | None = None) -> PrintedLens:
    """A lens from a `.zmx` file, or from its bytes if it is not a file of its own."""
    system = _System(path, glasses)
    for line, words in enumerate(read_lines(path, raw), 1):
        system.obey(line, words)
    if system.unit_mm is None:
        raise UnreadableLens(path, "does not say its unit", hint="add a line UNIT MM")
    for i, row in enumerate(system.rows[1:-1], 1):
        if not math.isfinite(row.thickness):
            raise UnreadableLens(path, f"surface {i} is infinitely far from the next one", line=row.line)
    if len(system.rows) < 3:
        raise UnreadableLens(path, "holds no surface between object and image")
    if not system.field_is_angle:
        system.beam.fields.clear()
    rows = system.surfaces
    media = [_medium(system, number, row) for number, row in rows]
    primary_um = system.wavelengths_um.get(system.primary)
    nm = glasses.wavelength_nm(media, primary_um and 1000 * primary_um)
    surfaces = tuple(
        _printed(system, number, row, glasses.printed(row.glass_line, number, glass, nm))
        for (number, row), glass in zip(rows, media, strict=True)
    )
    lens = PrintedLens(
        name=system.name or Path(path).stem,
        surfaces=surfaces,
        wavelength_nm=nm or D_LINE_NM,
        lost=(*glasses.finish(), *_lost(system, nm)),
    )
    if any(row.type_name in (_BREAK, _TILTED) for row in system.rows[1:]):
        lens = about_one_axis(path, lens, _frames(system, system.unit_mm))
    lens = sized(path, lens, system.beam, system.unit_mm)
    if not system.opens_stop:
        return lens
    has_ring = any(row.is_stop and row.has_ring for row in system.rows)
    return opened(path, lens, system.beam, system.unit_mm, has_ring)


def _frames(system: _System, unit_mm: float) -> list[np.ndarray]:
    """Frames of all surfaces and of the image plane in that of the first row behind the object, (4, 4) each.

    A coordinate break decentres before it turns about x, y and z, or with a sixth parameter turns about z, y and x
    before it decentres. A tilted plane states its slopes.
    """
    pose = np.eye(4)
    frames = []
    for row in system.rows[1:]:
        values = [row.parameters.get(i, 0.0) for i in range(1, 7)]
        if row.type_name == _BREAK:
            x, y, *turns, is_reverse = np.multiply(values, -1.0 if values[5] else 1.0)
            displacement = frame(x * unit_mm, y * unit_mm, 0.0, *turns)
            pose = pose @ (inverse(displacement) if is_reverse else displacement)
        plane = pose
        if row.type_name == _TILTED:
            about_x = math.atan(values[1])
            about_y = -math.atan(values[0] * math.cos(about_x))
            plane = pose @ frame(0.0, 0.0, 0.0, math.degrees(about_x), math.degrees(about_y), 0.0)
        if row.type_name != _BREAK or row.is_stop:
            frames.append(plane)
        pose = pose @ frame(0.0, 0.0, row.thickness * unit_mm)
    return frames


def _lost(system: _System, wavelength_nm: float | None) -> list[Lost]:
    """Losses of the file, completed by those that depend on more than one of its lines."""
    lost = list(system.lost)
    first = system.rows[0]
    image = system.rows[-1]
    if math.isfinite(first.thickness) and first.thickness < 1e8:
        statement = f"the object distance of {first.thickness:g}: a dataset says where its targets are"
        lost.append(Lost(statement, first.line))
        if system.working_f_number:
            system.beam.f_number = None
            statement = (
                f"{system.beam.stated}, a working f-number at that distance; the semi-diameter of the stop is taken"
            )
            lost.append(Lost(statement, system.beam.line))
    if image.curvature:
        lost.append(Lost("the image surface is curved; sensors are flat", image.line))
    automatic = [
        i
        for i, row in system.surfaces
        if row.is_automatic and row.semi_diameter and not row.half_widths and not (row.is_stop and system.opens_stop)
    ]
    if automatic:
        numbers = ", ".join(map(str, automatic))
        lost.append(Lost(f"surfaces {numbers} have automatic semi-diameters, for drawing; here they block rays"))
    lost += text.other_wavelengths([1000 * w for w in dict.fromkeys(system.wavelengths_um.values())], wavelength_nm)
    idle = [word for word in system.unread if word in _NO_CONCERN.split()]
    lost += [Lost(f"{word} is not read", line) for word, line in system.unread.items() if word not in idle]
    return lost + ([Lost(f"of no concern to the lens: {', '.join(idle)}")] if idle else [])


def _printed(system: _System, number: int, row: _Row, medium: tuple[float, float | None, str]) -> PrintedSurface:
    """A surface in millimetres; UnreadableLens if it cannot be represented."""
    unit_mm = system.unit_mm or 1.0
    is_cylinder = row.type_name == "TOROIDAL" and not any(row.parameters.values())
    if not is_cylinder and row.type_name not in ("STANDARD", "PARAXIAL", _BREAK, _TILTED, *_POWER_OF_TERM):
        reason = f"surface {number} is of type {row.type_name}, which cannot be represented"
        raise UnreadableLens(system.path, reason, line=row.type_line)
    index, abbe, glass = medium
    step = _POWER_OF_TERM.get(row.type_name, 0)
    terms = {step * i: value for i, value in sorted(row.parameters.items()) if value and step}
    ideal = row.parameters.get(1, 100.0) if row.type_name == "PARAXIAL" else None
    edge = row.semi_diameter
    if row.half_widths and (edge is None or row.is_automatic):
        edge = math.hypot(*row.half_widths)
    # A tilted plane has the aperture that it shows along the axis.
    slopes = [row.parameters.get(i, 0.0) if row.type_name == _TILTED else 0.0 for i in (1, 2)]
    x_mm, y_mm = (math.hypot(1, slope) * unit_mm for slope in slopes)
    return PrintedSurface(
        radius_mm=text.radius_mm(row.curvature / unit_mm),
        thickness_mm=row.thickness * unit_mm if abs(row.thickness) > _NO_GAP else 0.0,
        semi_diameter_mm=None if edge is None else edge * unit_mm * math.hypot(1, *slopes),
        inner_semi_diameter_mm=row.inner * unit_mm,
        focal_length_mm=None if ideal is None else ideal * unit_mm,
        half_widths_mm=row.half_widths and (row.half_widths[0] * x_mm, row.half_widths[1] * y_mm),
        is_cylinder=is_cylinder,
        index=index,
        glass=glass,
        abbe=abbe,
        is_stop=row.is_stop,
        conic=row.conic,
        asphere=tuple((power, value * unit_mm ** (1 - power)) for power, value in terms.items()),
    )


def _medium(system: _System, surface: int, row: _Row) -> Named:
    """The medium behind a surface: the named glass, whatever else is stated, or a model of two numbers."""
    if not row.glass:
        return AIR
    line = row.glass_line
    name = row.glass[0]
    kind = row.glass[1] if len(row.glass) > 1 else "0"
    if name.upper() == "MIRROR":
        raise UnreadableLens(system.path, f"surface {surface} is a mirror", line=line)
    numbers = [number(system.path, line, word, "GLAS") for word in row.glass[3:5]]
    if name == "___BLANK" and kind == "2":  # as behind an earlier surface, which may be air
        source = system.rows[min(int(number(system.path, line, row.glass[2], "GLAS")), len(system.rows) - 1)]
        return _medium(system, surface, source) if source.line < row.line else AIR
    stated = numbers if len(numbers) == 2 and tuple(numbers) != _PLACEHOLDER and numbers[0] > 1 else []
    if kind == "1" or name == "___BLANK":
        if len(numbers) < 2:
            raise UnreadableLens(
                system.path, f"surface {surface}: a model glass needs index and Abbe number", line=line
            )
        return system.glasses.model(line, surface, (numbers[0], numbers[1]), "" if name == "___BLANK" else name)
    listed = system.glasses.look_up(line, surface, name, system.vendors)
    nd = listed.medium.nd
    if stated and nd is not None and listed is not AIR and abs(nd - stated[0]) > MAX_INDEX_DIFFERENCE:
        remark = f"index {stated[0]:g} beside glass {name} is left over; the glass has {nd:.6g}"
        system.glasses.remark(line, surface, remark)
    return listed
