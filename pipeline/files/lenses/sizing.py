"""Apertures for files that print none: of CODE V nearly always, of Zemax sometimes."""

from dataclasses import dataclass, replace
from pathlib import Path

from pipeline.files.lenses.text import UnreadableLens
from pipeline.optics.clear_apertures import with_clear_apertures
from pipeline.optics.first_order import first_order
from pipeline.optics.prescription import PrescriptionError
from pipeline.optics.printed import Lost, PrintedLens, prescription_of


@dataclass(slots=True)
class Beam:
    """What a file says about the beam: diameter of the entrance pupil [unit of the file] or f-number, half field."""

    pupil: float | None = None
    f_number: float | None = None
    field_deg: float | None = None


def sized(path: str | Path, lens: PrintedLens, beam: Beam, unit_mm: float) -> PrintedLens:
    """The lens with every semi-diameter known: as printed, or as large as the beam of the file needs, and then named.

    Raises
    ------
    UnreadableLens
        A semi-diameter is unknown, and so is the beam.
    """
    unknown = [i for i, surface in enumerate(lens.surfaces, 1) if surface.semi_diameter_mm is None]
    if not unknown:
        return lens
    shown = ", ".join(map(str, unknown))
    if (beam.pupil is None and beam.f_number is None) or beam.field_deg is None:
        reason = f"surfaces {shown} have no semi-diameter, and the file has no pupil and field to compute them from"
        raise UnreadableLens(path, reason, hint="write clear apertures, or pupil diameter and field angles")
    try:
        pupil_mm = beam.pupil * unit_mm if beam.pupil is not None else _efl_mm(lens) / (beam.f_number or 1)
        found = with_clear_apertures(lens, pupil_mm, beam.field_deg)
    except PrescriptionError as error:
        raise UnreadableLens(path, error.what, hint=error.hint) from None
    what = (
        f"surfaces {shown} have no semi-diameter; written is what the unvignetted beam needs, to first order"
        f" (entrance pupil {pupil_mm:g} mm, half field {beam.field_deg:g} degrees)"
    )
    return replace(found, lost=(*found.lost, Lost(what=what)))


def _efl_mm(lens: PrintedLens) -> float:
    open_wide = tuple(replace(surface, semi_diameter_mm=1e-9) for surface in lens.surfaces)
    return abs(first_order(prescription_of(replace(lens, surfaces=open_wide))).efl_mm)
