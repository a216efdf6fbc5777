"""Apertures for files that print none, nearly all of CODE V and some of Zemax, and the stop of a system aperture (ENPD
and FNUM of Zemax, EPD and FNO of CODE V).
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import zip_longest
from pathlib import Path

from pipeline.optics.first_order import first_order, paraxial_ray
from pipeline.optics.prescription import PrescriptionError
from pipeline.optics.printed import Lost, PrintedLens, prescription_of
from pipeline.plugins.lenses.axis import in_order
from pipeline.plugins.lenses.text import UnreadableLens

_SAME = 1e-6
"""Relative difference between two semi-diameters of the stop that rounding in a file explains."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Field:
    """An object point at infinity: its angle, and the shares of the pupil's semi-diameter lost above and below."""

    angle_deg: float
    upper: float = 0.0
    lower: float = 0.0


@dataclass(slots=True)
class Beam:
    """The beam of a file: diameter of the entrance pupil or f-number, and fields."""

    pupil: float | None = None  # in the unit of the file
    f_number: float | None = None
    stated: str = ""  # text of the file for pupil or f-number
    line: int | None = None  # its line
    fields: list[float] = field(default_factory=list)  # angles along y [degrees]
    upper: list[float] = field(default_factory=list)  # share of the pupil lost at its edge, for each of these
    lower: list[float] = field(default_factory=list)
    along_x: list[float] = field(default_factory=list)  # angles along x, taken without vignetting

    @property
    def is_known(self) -> bool:
        """Whether the file states the width of the beam."""
        return self.pupil is not None or self.f_number is not None

    @property
    def is_vignetted(self) -> bool:
        """Whether any field loses light."""
        return any(self.upper) or any(self.lower)

    def all_fields(self) -> list[Field]:
        """Fields along y with their vignetting, then those along x."""
        rows = zip_longest(self.fields, self.upper[: len(self.fields)], self.lower[: len(self.fields)], fillvalue=0.0)
        along_y = [Field(angle_deg=angle, upper=upper, lower=lower) for angle, upper, lower in rows]
        return along_y + [Field(angle_deg=angle) for angle in self.along_x]


def sized(path: str | Path, lens: PrintedLens, beam: Beam, unit_mm: float) -> PrintedLens:
    """The lens with all semi-diameters known: as printed, or as the beam of the file requires, which is reported."""
    fields = beam.all_fields()
    is_sized = beam.is_known and bool(fields)
    lens = in_order(lens, is_sized)
    unknown = [i for i, surface in enumerate(lens.surfaces, 1) if surface.semi_diameter_mm is None]
    if not unknown:
        ignored = Lost("vignetting factors; only semi-diameters block rays")
        return replace(lens, lost=(*lens.lost, ignored)) if beam.is_vignetted else lens
    numbers = ", ".join(map(str, unknown))
    if not is_sized:
        reason = f"surfaces {numbers} have no semi-diameter, and the file has no pupil and field to compute them from"
        hint = "write clear apertures, or pupil diameter and field angles"
        if Path(path).suffix.lower() in (".csv", ".tsv", ".txt"):
            hint = "write clear apertures, or give --f-number N and --half-field DEGREES to compute them"
        raise UnreadableLens(path, reason, hint=hint)
    try:
        wide_mm = pupil_mm(lens, beam, unit_mm)
        open_lens = with_clear_apertures(lens, wide_mm, fields)
    except PrescriptionError as error:
        raise UnreadableLens(path, error.message, hint=error.hint) from None
    vignetted = " with its vignetting factors" if beam.is_vignetted else ""
    statement = (
        f"surfaces {numbers} have no semi-diameter; written is what the beam{vignetted} needs, to first order"
        f" (entrance pupil {wide_mm:g} mm, half field {max(abs(field.angle_deg) for field in fields):g} degrees)"
    )
    return replace(open_lens, lost=(*open_lens.lost, Lost(statement)))


def with_clear_apertures(lens: PrintedLens, entrance_pupil_mm: float, fields: Sequence[Field]) -> PrintedLens:
    """The lens with each unknown semi-diameter filled in: the largest height of a marginal ray of any field.

    At the stop it is the height of the axial marginal ray. The rays are paraxial: a real ray at the edge of a fast lens
    passes somewhat further out. The object is at infinity; the beam through the entrance pupil along the axis counts
    besides `fields`.

    Raises PrescriptionError: there is not exactly one stop, or it lies in a focus of the surfaces before it.
    """
    stops = [i for i, surface in enumerate(lens.surfaces) if surface.is_stop]
    if len(stops) != 1:
        raise PrescriptionError(f"a prescription needs exactly one aperture stop, this one has {len(stops)}")
    parallel, oblique = (paraxial_ray(lens.surfaces, *start)[0] for start in ((1.0, 0.0), (0.0, 1.0)))
    if not parallel[stops[0]]:
        raise PrescriptionError(
            "the entrance pupil lies at infinity, and its diameter opens no stop", hint="state the stop's semi-diameter"
        )
    # A chief ray starts where it will pass the centre of the stop.
    start = -oblique[stops[0]] / parallel[stops[0]]
    surfaces = []
    for surface, a, b in zip(lens.surfaces, parallel, oblique, strict=True):
        rim = a * entrance_pupil_mm / 2
        chief = a * start + b
        heights = [abs(rim)]
        for point in () if surface.is_stop else fields:
            centre = chief * math.tan(math.radians(point.angle_deg))
            heights += [abs(centre + rim * (1 - point.upper)), abs(centre - rim * (1 - point.lower))]
        is_given = surface.semi_diameter_mm is not None
        surfaces.append(surface if is_given else replace(surface, semi_diameter_mm=max(heights)))
    return replace(lens, surfaces=tuple(surfaces))


def pupil_mm(lens: PrintedLens, beam: Beam, unit_mm: float) -> float:
    """Diameter of the entrance pupil of a beam [mm].

    Raises PrescriptionError: only an f-number is given, and the lens has no focal length.
    """
    return beam.pupil * unit_mm if beam.pupil is not None else efl_mm(lens) / (beam.f_number or 1)


def efl_mm(lens: PrintedLens) -> float:
    """Focal length, positive, whatever the semi-diameters; PrescriptionError if the lens is afocal, or impossible."""
    open_wide = tuple(replace(surface, semi_diameter_mm=1e-9) for surface in lens.surfaces)
    return abs(first_order(prescription_of(replace(lens, surfaces=open_wide))).efl_mm)


def opened(path: str | Path, lens: PrintedLens, beam: Beam, unit_mm: float, has_ring: bool) -> PrintedLens:
    """The lens with the stop that the system aperture requires, to first order; a difference is reported.

    Lens design programs launch rays into the entrance pupil of the system aperture and print at the stop the size
    that they draw. A hard ring there blocks rays outside it: if it is smaller, it remains.
    """
    stops = [i for i, surface in enumerate(lens.surfaces) if surface.is_stop]
    if len(stops) != 1 or not beam.is_known:
        return lens  # several stops are refused later
    stop = lens.surfaces[stops[0]]
    index = stops[0]
    printed_mm = stop.semi_diameter_mm or 0.0
    unsized = _with_stop(lens, index, None)
    try:
        wide_mm = pupil_mm(lens, beam, unit_mm)
        rim_mm = with_clear_apertures(unsized, wide_mm, ()).surfaces[index].semi_diameter_mm or 0.0
    except PrescriptionError as error:
        raise UnreadableLens(path, f"{beam.stated}: {error.message}", line=beam.line, hint=error.hint) from None
    if math.isclose(rim_mm, printed_mm, rel_tol=_SAME):
        return lens
    required = _f_number(lens, wide_mm)
    printed = _f_number(lens, wide_mm * printed_mm / rim_mm)
    statement = f"{beam.stated} is {required}: the stop, surface {index + 1}, "
    if stop.half_widths_mm or (has_ring and printed_mm < rim_mm):
        shape = "a rectangle" if stop.half_widths_mm else f"a ring of semi-diameter {printed_mm:.6g} mm, {printed},"
        return replace(lens, lost=(*lens.lost, Lost(f"{statement}is {shape} and stays", beam.line)))
    statement += f"gets semi-diameter {rim_mm:.6g} mm in place of {printed_mm:.6g} mm, {printed}"
    return replace(_with_stop(lens, index, rim_mm), lost=(*lens.lost, Lost(statement, beam.line)))


def _with_stop(lens: PrintedLens, index: int, semi_diameter_mm: float | None) -> PrintedLens:
    stop = replace(lens.surfaces[index], semi_diameter_mm=semi_diameter_mm)
    return replace(lens, surfaces=(*lens.surfaces[:index], stop, *lens.surfaces[index + 1 :]))


def _f_number(lens: PrintedLens, wide_mm: float) -> str:
    try:
        return f"f/{efl_mm(lens) / wide_mm:.3g}"
    except PrescriptionError:  # without a focal length; other problems are reported when the lens is built
        return f"an entrance pupil of {wide_mm:.6g} mm"
