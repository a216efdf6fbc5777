"""Comparison of a lens with what its file states of it: focal length, back focal distance, F-number, sharpness on axis.

A file that lost rows or terms on its way still reads well. These four figures show it, and each difference is a remark.
"""

import math
from dataclasses import replace

import numpy as np

from pipeline.optics.first_order import FirstOrder, first_order
from pipeline.optics.prescription import PrescriptionError
from pipeline.optics.printed import Lost, PrintedLens, PrintedSurface, prescription_of
from pipeline.records.shapes import Float64

_NEAR_FOCUS = 0.01
"""Share of the focal length by which focal length and back focal distance may differ: names are round, and a film
stands a little off the paraxial focus."""
_NEAR_F_NUMBER = 0.1
"""Relative difference of F-numbers that is still silent: the diameter of a stop is often taken from a drawing."""
_PRINTED_F_NUMBER = 0.05
"""Half a unit of the one decimal of a printed F-number."""
_SHARP = 1 / 2000
"""Rms radius over focal length of the best image of a point on the axis: a disc of a thousandth of the focal length,
the classical circle of confusion, has two thirds of it."""
_RAYS = 24
"""Meridional rays over the entrance pupil, of equal shares of its area; the rms radius is a smooth integral of them."""


def figures(lens: PrintedLens) -> FirstOrder | None:
    """First-order figures, whatever the semi-diameters of all surfaces but the stop; None for an afocal lens."""
    small = tuple(s if s.is_stop else replace(s, semi_diameter_mm=1e-9) for s in lens.surfaces)
    forward = tuple(replace(s, thickness_mm=max(s.thickness_mm, 0.0)) for s in small[-1:])
    try:
        return first_order(prescription_of(replace(lens, surfaces=(*small[:-1], *forward))))
    except (PrescriptionError, ArithmeticError):
        return None


def remarks(
    lens: PrintedLens,
    *,
    bfd_mm: float | None,
    f_number: float | None,
    without_aspheres: bool = False,
    line: int | None = None,
) -> tuple[Lost, ...]:
    """Differences between a lens and the figures that its file states of it; None where it does not.

    `without_aspheres`: whether the format has no place for aspheric terms: a blurred image on the axis is then a
        remark.
    `line`: that of the last surface.
    """
    computed, efl_mm = figures(lens), lens.nominal_efl_mm
    if computed is None:
        return ()
    losses = []
    if efl_mm and abs(computed.efl_mm / efl_mm - 1) > _NEAR_FOCUS:
        off = 100 * (computed.efl_mm / efl_mm - 1)
        losses.append(
            f"the rows have the focal length {computed.efl_mm:.6g} mm, the file states {efl_mm:g} ({off:+.3g} %)"
        )
    if bfd_mm and abs(computed.bfd_mm - bfd_mm) > _NEAR_FOCUS * abs(computed.efl_mm):
        losses.append(
            f"the focus lies {computed.bfd_mm:.6g} mm behind the last row, whose thickness is {bfd_mm:g} mm:"
            " a cover glass or another row may be missing, or the lens is not focused at infinity"
        )
    opening = f"f/{abs(computed.f_number):.3g}"
    if f_number and abs(abs(computed.f_number) - f_number) > _NEAR_F_NUMBER * f_number + _PRINTED_F_NUMBER:
        losses.append(f"with its stop the lens is {opening}, the file states f/{f_number:g}")
    if without_aspheres and (blur_mm := axial_blur_mm(lens, computed)) > _SHARP * abs(computed.efl_mm):
        seen = "some rays of the axial beam fail" if math.isinf(blur_mm) else f"its rms radius is {blur_mm:.3g} mm"
        losses.append(
            f"the sharpest image of a point on the axis at {opening} is blurred ({seen}):"
            " it may have lost aspheric terms, which this format cannot hold"
        )
    return tuple(Lost(what=what, line=line) for what in losses)


def axial_blur_mm(lens: PrintedLens, computed: FirstOrder) -> float:
    """Rms radius of the image of an infinitely distant point on the axis, where it is smallest; inf if rays fail. [mm]

    Spheres and planes only, which a format without aspheres has.
    """
    rim = computed.entrance_pupil.diameter_mm / 2
    heights = rim * np.sqrt((np.arange(_RAYS) + 0.5) / _RAYS)
    crossed = _through_spheres(lens.surfaces, heights)
    if crossed is None:
        return math.inf
    height, slope = crossed
    depth = -float(height @ slope) / float(slope @ slope)
    return float(np.sqrt(np.mean((height + slope * depth) ** 2)))


def _through_spheres(
    surfaces: tuple[PrintedSurface, ...], heights_mm: Float64[np.ndarray, "rays"]
) -> tuple[Float64[np.ndarray, "rays"], Float64[np.ndarray, "rays"]] | None:
    """Heights and slopes at the last vertex of rays parallel to the axis; None if one misses or is reflected."""
    # Snell's law in the plane: Spencer and Murty, J. Opt. Soc. Am. 52 (1962) 672.
    y, z, dy, dz = heights_mm.copy(), np.zeros(len(heights_mm)), np.zeros(len(heights_mm)), np.ones(len(heights_mm))
    index, step_mm = 1.0, 0.0
    for surface in surfaces:
        c = 0.0 if math.isinf(surface.radius_mm) else 1 / surface.radius_mm
        y = y + (step_mm - z) / dz * dy
        cosine = (dz - c * y * dy) ** 2 - (c * y) ** 2
        if not np.all(cosine > 0):
            return None
        cosine = np.sqrt(cosine)
        path = c * y**2 / (dz - c * y * dy + cosine)
        y, z = y + path * dy, path * dz
        ratio = index / surface.index
        behind = 1 - ratio**2 * (1 - cosine**2)
        if not np.all(behind > 0):
            return None
        bend = np.sqrt(behind) - ratio * cosine
        dy, dz = ratio * dy - bend * c * y, ratio * dz + bend * (1 - c * z)
        index, step_mm = surface.index, surface.thickness_mm
    return y - z / dz * dy, dy / dz
