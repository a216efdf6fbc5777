"""Apertures for files that print none: nearly all of CODE V, some of Zemax."""

from dataclasses import dataclass, field, replace
from itertools import zip_longest
from pathlib import Path

from pipeline.files.lenses.text import UnreadableLens
from pipeline.optics.clear_apertures import Field, with_clear_apertures
from pipeline.optics.first_order import first_order
from pipeline.optics.prescription import PrescriptionError
from pipeline.optics.printed import Lost, PrintedLens, prescription_of


@dataclass(slots=True)
class Beam:
    """The beam of a file: diameter of the entrance pupil [unit of the file] or f-number, and fields.

    `said` and `line` are the text of the file for the pupil or f-number, and its line.
    """

    pupil: float | None = None
    f_number: float | None = None
    said: str = ""
    line: int | None = None
    fields: list[float] = field(default_factory=list)
    upper: list[float] = field(default_factory=list)
    lower: list[float] = field(default_factory=list)
    others: list[float] = field(default_factory=list)

    def add(self, angles_deg: list[float], along_y: bool = True) -> None:
        """Field angles; those along x are taken without vignetting."""
        (self.fields if along_y else self.others).extend(angles_deg)

    def vignet(self, upper: bool, fractions: list[float]) -> None:
        """Note the loss of the pupil at its upper or lower edge, for each field along y."""
        (self.upper if upper else self.lower).extend(fractions)

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
        return along_y + [Field(angle_deg=angle) for angle in self.others]


def sized(path: str | Path, lens: PrintedLens, beam: Beam, unit_mm: float) -> PrintedLens:
    """The lens with all semi-diameters known: as printed, or as large as the beam of the file requires, which is
    then reported.

    Raises
    ------
    UnreadableLens
        A semi-diameter is unknown, and so is the beam.
    """
    unknown = [i for i, surface in enumerate(lens.surfaces, 1) if surface.semi_diameter_mm is None]
    if not unknown:
        ignored = Lost(what="vignetting factors; only semi-diameters block rays")
        return replace(lens, lost=(*lens.lost, ignored)) if beam.is_vignetted else lens
    fields = beam.all_fields()
    shown = ", ".join(map(str, unknown))
    if not beam.is_known or not fields:
        reason = f"surfaces {shown} have no semi-diameter, and the file has no pupil and field to compute them from"
        hint = "write clear apertures, or pupil diameter and field angles"
        if Path(path).suffix.lower() in (".csv", ".tsv", ".txt"):
            hint = "write clear apertures, or give --f-number N and --half-field DEGREES to compute them"
        raise UnreadableLens(path, reason, hint=hint)
    try:
        wide_mm = pupil_mm(lens, beam, unit_mm)
        found = with_clear_apertures(lens, wide_mm, fields)
    except PrescriptionError as error:
        raise UnreadableLens(path, error.what, hint=error.hint) from None
    vignetted = " with its vignetting factors" if beam.is_vignetted else ""
    what = (
        f"surfaces {shown} have no semi-diameter; written is what the beam{vignetted} needs, to first order"
        f" (entrance pupil {wide_mm:g} mm, half field {max(abs(one.angle_deg) for one in fields):g} degrees)"
    )
    return replace(found, lost=(*found.lost, Lost(what=what)))


def pupil_mm(lens: PrintedLens, beam: Beam, unit_mm: float) -> float:
    """Diameter of the entrance pupil for a known beam [mm].

    Raises
    ------
    PrescriptionError
        Only an f-number is known, and the lens has no focal length.
    """
    return beam.pupil * unit_mm if beam.pupil is not None else efl_mm(lens) / (beam.f_number or 1)


def efl_mm(lens: PrintedLens) -> float:
    """Focal length, positive; semi-diameters do not matter.

    Raises
    ------
    PrescriptionError
        The lens is afocal, or cannot be represented.
    """
    open_wide = tuple(replace(surface, semi_diameter_mm=1e-9) for surface in lens.surfaces)
    return abs(first_order(prescription_of(replace(lens, surfaces=open_wide))).efl_mm)
