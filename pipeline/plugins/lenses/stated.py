"""Comparison of a lens with figures that its file states: focal length, back focal distance, F-number, sharpness.

A file that lost rows or terms may still parse. These four figures reveal it, and each difference is a remark.
"""

import math
from dataclasses import replace

import numpy as np

from pipeline.optics.first_order import FirstOrder, first_order
from pipeline.optics.prescription import Prescription, PrescriptionError
from pipeline.optics.printed import Lost, PrintedLens, prescription_of
from pipeline.optics.rays import traced
from pipeline.optics.table import VERTEX, towards_sensor, unbounded

_NEAR_FOCUS = 0.01
"""Share of the focal length by which focal length and back focal distance may differ: names are rounded, and the film
is not quite at the paraxial focus.
"""
_NEAR_F_NUMBER = 0.1
"""Relative difference of F-numbers that is tolerated: the diameter of a stop is often taken from a drawing."""
_PRINTED_F_NUMBER = 0.05
"""Half a unit of the one decimal of a printed F-number."""
_SHARP = 1 / 2000
"""Rms radius over focal length of the best image of a point on the axis: a disc of a thousandth of the focal length,
the classical circle of confusion, has two thirds of it.
"""
_RAYS = 24
"""Meridional rays over the entrance pupil, of equal shares of its area; the rms radius is a smooth integral of them."""


def figures(lens: PrintedLens) -> FirstOrder | None:
    """First-order figures, whatever the semi-diameters of all surfaces but the stop; None for an afocal lens."""
    try:
        return first_order(_of_any_width(lens))
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
    """Differences between a lens and the figures that its file states, None where it states none.

    `without_aspheres`: whether the format cannot hold aspheric terms: a blurred on-axis image is then a remark.
    `line`: that of the last surface.
    """
    computed = figures(lens)
    efl_mm = lens.nominal_efl_mm
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
        flaw = "some rays of the axial beam fail" if math.isinf(blur_mm) else f"its rms radius is {blur_mm:.3g} mm"
        losses.append(
            f"the sharpest image of a point on the axis at {opening} is blurred ({flaw}):"
            " it may have lost aspheric terms, which this format cannot hold"
        )
    return tuple(Lost(statement, line) for statement in losses)


def axial_blur_mm(lens: PrintedLens, computed: FirstOrder) -> float:
    """Least rms radius of the image of an infinitely distant point on the axis; inf if rays fail. [mm]"""
    table = unbounded(towards_sensor(_of_any_width(lens)))
    start = np.zeros((_RAYS, 3))
    start[:, 1] = computed.entrance_pupil.diameter_mm / 2 * np.sqrt((np.arange(_RAYS) + 0.5) / _RAYS)
    start[:, 2] = table[0, VERTEX]
    rays = traced(table, start, np.tile([0.0, 0.0, 1.0], (_RAYS, 1)))
    if not rays.passes.all():
        return math.inf
    slope = rays.direction[:, 1] / rays.direction[:, 2]
    height = rays.position[:, 1] - rays.position[:, 2] * slope
    depth = -float(height @ slope) / float(slope @ slope)
    return float(np.sqrt(np.mean((height + slope * depth) ** 2)))


def _of_any_width(lens: PrintedLens) -> Prescription:
    """The lens for first-order figures and unbounded rays, whatever the semi-diameters of all surfaces but the stop."""
    small = tuple(s if s.is_stop else replace(s, semi_diameter_mm=1e-9) for s in lens.surfaces)
    forward = tuple(replace(s, thickness_mm=max(s.thickness_mm, 0.0)) for s in small[-1:])
    return prescription_of(replace(lens, surfaces=(*small[:-1], *forward)))
