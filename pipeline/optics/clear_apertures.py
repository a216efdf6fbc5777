"""Semi-diameters for a lens whose source prints none: what an unvignetted beam needs, to first order."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

from pipeline.optics.prescription import PrescriptionError
from pipeline.optics.printed import PrintedLens, PrintedSurface


@dataclass(frozen=True, slots=True, kw_only=True)
class Field:
    """An object point at infinity: its angle, and which part of the pupil's semi-diameter it loses above and below."""

    angle_deg: float
    upper: float = 0.0
    lower: float = 0.0


def with_clear_apertures(lens: PrintedLens, entrance_pupil_mm: float, fields: Sequence[Field]) -> PrintedLens:
    """The lens with each unknown semi-diameter filled in: the largest height of a rim ray of any field.

    At the stop it is the height of the axial rim ray. Paraxial: a real ray at the edge of a fast lens passes somewhat
    further out. The object is at infinity; the beam through the entrance pupil along the axis counts besides `fields`.

    Raises PrescriptionError: there is not one stop, or it stands in a focus of what is before it.
    """
    stops = [i for i, surface in enumerate(lens.surfaces) if surface.is_stop]
    if len(stops) != 1:
        raise PrescriptionError(f"a prescription needs exactly one aperture stop, this one has {len(stops)}")
    parallel = _heights(lens.surfaces, 1.0, 0.0)
    oblique = _heights(lens.surfaces, 0.0, 1.0)
    if not parallel[stops[0]]:
        raise PrescriptionError(
            "the entrance pupil lies at infinity, and its diameter opens no stop", hint="state the stop's semi-diameter"
        )
    # A chief ray starts where it will pass the centre of the stop.
    start = -oblique[stops[0]] / parallel[stops[0]]
    surfaces = []
    for surface, a, b in zip(lens.surfaces, parallel, oblique, strict=True):
        rim, chief = a * entrance_pupil_mm / 2, a * start + b
        heights = [abs(rim)]
        for field in () if surface.is_stop else fields:
            centre = chief * math.tan(math.radians(field.angle_deg))
            heights += [abs(centre + rim * (1 - field.upper)), abs(centre - rim * (1 - field.lower))]
        known = surface.semi_diameter_mm is not None
        surfaces.append(surface if known else replace(surface, semi_diameter_mm=max(heights)))
    return replace(lens, surfaces=tuple(surfaces))


def _heights(surfaces: tuple[PrintedSurface, ...], height: float, slope: float) -> list[float]:
    """Heights of a paraxial ray at all surfaces; it starts at the first vertex, in air."""
    heights, index, reduced = [], 1.0, slope
    for i, surface in enumerate(surfaces):
        if i:
            height += surfaces[i - 1].thickness_mm * reduced / index
        heights.append(height)
        reduced -= surface.power_per_mm(index) * height
        index = surface.index
    return heights
