"""Semi-diameters for a lens whose source prints none: what an unvignetted beam needs, to first order."""

import math
from dataclasses import replace

from pipeline.optics.prescription import PrescriptionError
from pipeline.optics.printed import PrintedLens, PrintedSurface


def with_clear_apertures(lens: PrintedLens, entrance_pupil_mm: float, field_deg: float) -> PrintedLens:
    """The lens with each unknown semi-diameter filled in: |marginal ray| + |chief ray|, at the stop the marginal ray.

    Parameters
    ----------
    lens : PrintedLens
        With an object at infinity.
    entrance_pupil_mm : float
        Diameter of the entrance pupil.
    field_deg : float
        Largest half field, from the axis.

    Notes
    -----
    Paraxial: a real ray at the edge of a fast lens passes somewhat further out.
    """
    stops = [i for i, surface in enumerate(lens.surfaces) if surface.is_stop]
    if len(stops) != 1:
        raise PrescriptionError(f"a prescription needs exactly one aperture stop, this one has {len(stops)}")
    parallel = _heights(lens.surfaces, 1.0, 0.0)
    oblique = _heights(lens.surfaces, 0.0, 1.0)
    slope = math.tan(math.radians(field_deg))
    # The chief ray starts where it will pass the centre of the stop.
    start = -slope * oblique[stops[0]] / parallel[stops[0]]
    surfaces = []
    for surface, a, b in zip(lens.surfaces, parallel, oblique, strict=True):
        height = abs(a) * entrance_pupil_mm / 2 + abs(a * start + b * slope)
        known = surface.semi_diameter_mm is not None
        surfaces.append(surface if known else replace(surface, semi_diameter_mm=height))
    return replace(lens, surfaces=tuple(surfaces))


def _heights(surfaces: tuple[PrintedSurface, ...], height: float, slope: float) -> list[float]:
    """Heights of a paraxial ray at all surfaces; it starts at the first vertex, in air."""
    heights, index, reduced = [], 1.0, slope
    for i, surface in enumerate(surfaces):
        if i:
            height += surfaces[i - 1].thickness_mm * reduced / index
        heights.append(height)
        curvature = 0.0 if math.isinf(surface.radius_mm) else 1 / surface.radius_mm
        reduced -= (surface.index - index) * curvature * height
        index = surface.index
    return heights
