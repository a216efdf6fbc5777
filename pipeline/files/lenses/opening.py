"""The system aperture of a file (ENPD and FNUM of Zemax, EPD and FNO of CODE V), which determines the semi-diameter
of the stop.
"""

import math
from dataclasses import replace
from pathlib import Path

from pipeline.files.lenses.sizing import Beam, efl_mm, pupil_mm
from pipeline.files.lenses.text import UnreadableLens
from pipeline.optics.clear_apertures import with_clear_apertures
from pipeline.optics.prescription import PrescriptionError
from pipeline.optics.printed import Lost, PrintedLens

_SAME = 1e-6
"""Relative difference between two semi-diameters of the stop that is due to rounding in a file."""


def opened(path: str | Path, lens: PrintedLens, beam: Beam, unit_mm: float, has_ring: bool) -> PrintedLens:
    """The lens with the stop that the system aperture requires, to first order; a difference from the file is
    reported.

    Lens design programs launch rays into the entrance pupil of the system aperture and print at the stop the size
    that they draw. A hard ring there blocks rays outside it: if it is smaller, it remains.

    Parameters
    ----------
    lens : PrintedLens
        The lens, with all semi-diameters known.
    has_ring : bool
        Whether the semi-diameter of the stop is a hard ring.

    Raises
    ------
    UnreadableLens
        No stop fulfils the system aperture.
    """
    stops = [i for i, surface in enumerate(lens.surfaces) if surface.is_stop]
    if len(stops) != 1 or not beam.is_known:
        return lens  # several stops are refused later
    stop, place = lens.surfaces[stops[0]], stops[0]
    printed_mm = stop.semi_diameter_mm or 0.0
    unsized = _with_stop(lens, place, None)
    try:
        wide_mm = pupil_mm(lens, beam, unit_mm)
        rim_mm = with_clear_apertures(unsized, wide_mm, ()).surfaces[place].semi_diameter_mm or 0.0
    except PrescriptionError as error:
        raise UnreadableLens(path, f"{beam.said}: {error.what}", line=beam.line, hint=error.hint) from None
    if math.isclose(rim_mm, printed_mm, rel_tol=_SAME):
        return lens
    asked, there = _f_number(lens, wide_mm), _f_number(lens, wide_mm * printed_mm / rim_mm)
    what = f"{beam.said} is {asked}: the stop, surface {place + 1}, "
    if stop.half_widths_mm or (has_ring and printed_mm < rim_mm):
        shape = "a rectangle" if stop.half_widths_mm else f"a ring of semi-diameter {printed_mm:.6g} mm, {there},"
        return replace(lens, lost=(*lens.lost, Lost(what=f"{what}is {shape} and stays", line=beam.line)))
    what += f"gets semi-diameter {rim_mm:.6g} mm in place of {printed_mm:.6g} mm, {there}"
    return replace(_with_stop(lens, place, rim_mm), lost=(*lens.lost, Lost(what=what, line=beam.line)))


def _with_stop(lens: PrintedLens, place: int, semi_diameter_mm: float | None) -> PrintedLens:
    stop = replace(lens.surfaces[place], semi_diameter_mm=semi_diameter_mm)
    return replace(lens, surfaces=(*lens.surfaces[:place], stop, *lens.surfaces[place + 1 :]))


def _f_number(lens: PrintedLens, wide_mm: float) -> str:
    try:
        return f"f/{efl_mm(lens) / wide_mm:.3g}"
    except PrescriptionError:  # without a focal length; other problems are reported when the lens is built
        return f"an entrance pupil of {wide_mm:.6g} mm"
