"""Comparison of a lens with what its file states of it: focal length, back focal distance, F-number, sharpness on axis.

A file that lost rows or terms on its way still reads well. These four figures show it, and each difference is a remark.
"""

import math
from dataclasses import dataclass, replace

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


@dataclass(frozen=True, slots=True, kw_only=True)
class Stated:
    """Figures that a file states of its lens; None where it does not. `line` is where the last surface stands."""

    efl_mm: float | None = None
    bfd_mm: float | None = None
    f_number: float | None = None
    line: int | None = None


def figures(lens: PrintedLens) -> FirstOrder | None:
    """First-order figures, whatever the semi-diameters of all surfaces but the stop; None for an afocal lens."""
    small = tuple(s if s.is_stop else replace(s, semi_diameter_mm=1e-9) for s in lens.surfaces)
    forward = tuple(replace(s, thickness_mm=max(s.thickness_mm, 0.0)) for s in small[-1:])
    try:
        return first_order(prescription_of(replace(lens, surfaces=(*small[:-1], *forward))))
    except (PrescriptionError, ArithmeticError):
        return None


def remarks(lens: PrintedLens, stated: Stated, without_aspheres: bool) -> tuple[Lost, ...]:
    """Differences between a lens and the figures that its file states of it.

    `without_aspheres`: whether the format has no place for aspheric terms: a blurred image on the axis is then a
        remark.
    """
    computed = figures(lens)
    if computed is None:
        return ()
    losses = []
    if stated.efl_mm and abs(computed.efl_mm / stated.efl_mm - 1) > _NEAR_FOCUS:
        off = 100 * (computed.efl_mm / stated.efl_mm - 1)
        losses.append(
            f"the rows have the focal length {computed.efl_mm:.6g} mm, the file states {stated.efl_mm:g} ({off:+.3g} %)"
        )
    if stated.bfd_mm and abs(computed.bfd_mm - stated.bfd_mm) > _NEAR_FOCUS * abs(computed.efl_mm):
        losses.append(
            f"the focus lies {computed.bfd_mm:.6g} mm behind the last row, whose thickness is {stated.bfd_mm:g} mm:"
            " a cover glass or another row may be missing, or the lens is not focused at infinity"
        )
    near = _NEAR_F_NUMBER * (stated.f_number or 0.0) + _PRINTED_F_NUMBER
    if stated.f_number and abs(abs(computed.f_number) - stated.f_number) > near:
        losses.append(
            f"with its stop the lens is f/{abs(computed.f_number):.3g}, the file states f/{stated.f_number:g}"
        )
    if without_aspheres and (blur := axial_blur_mm(lens, computed)) > _SHARP * abs(computed.efl_mm):
        losses.append(_blurred(blur, computed))
    return tuple(Lost(what=what, line=stated.line) for what in losses)


def _blurred(blur_mm: float, computed: FirstOrder) -> str:
    seen = "some rays of the axial beam fail" if math.isinf(blur_mm) else f"its rms radius is {blur_mm:.3g} mm"
    return (
        f"the sharpest image of a point on the axis at f/{abs(computed.f_number):.3g} is blurred ({seen}):"
        " it may have lost aspheric terms, which this format cannot hold"
    )


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
    """Heights and slopes at the last vertex of rays parallel to the axis; None if one misses or is totally reflected.

    Snell's law in the plane: Spencer and Murty, J. Opt. Soc. Am. 52 (1962) 672.
    """
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
