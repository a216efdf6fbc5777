"""Mean rays of image positions: straight lines through J of a position on every plane perpendicular to the axis.

Each ray of a bundle crosses such planes at places that are linear in their distance, so the weighted mean is, too.
CONVENTIONS.md, "The ray of a position", says why this line and no other stands for a position.
"""

from dataclasses import dataclass

import numpy as np

from pipeline.camera.integrals import LEVELS, Bundles, integrals
from pipeline.camera.rig import Rig
from pipeline.camera.tracer import parallel_planes
from pipeline.camera.tracing.moments import COLUMNS
from pipeline.records.shapes import Float64, Int64
from pipeline.truth.direct.candidates import chief_jacobian, inverse
from pipeline.truth.direct.newton import errors_px

_AT_ONCE = 1 << 14
"""Positions that are integrated together: bounds memory, and no result depends on it."""
_DIFFERENCE_PX = 0.25
"""Half the step of difference quotients where there is no chief ray [px], as in the search of points."""


@dataclass(frozen=True, slots=True)
class MeanRays:
    """Mean rays of image positions, vision frame; NaN where no light leaves."""

    microlens: Int64[np.ndarray, "n"]  # row of the microlens whose bundle it is, or NO_MICROLENS
    crossings_mm: Float64[np.ndarray, "n 2 2"]  # x and y on the near plane, then on the far one
    error_px: Float64[np.ndarray, "n 2"]  # error of the integral on the near plane, mapped to the image
    hit_fraction: Float64[np.ndarray, "n"]


def mean_rays(
    rig: Rig, x_px: Float64[np.ndarray, "n 2"], planes_mm: tuple[float, float], accuracy_px: float
) -> MeanRays:
    """Integrate the bundles of positions, each behind the microlens of its own cell, as finely as the accuracy asks."""
    microlens = rig.microlens_at(rig.tracer.positions_mm(*x_px.T))
    moments, error = np.full((len(x_px), COLUMNS), np.nan), np.full((len(x_px), 2), np.nan)
    for first in range(0, len(x_px), _AT_ONCE):
        some = np.arange(first, min(first + _AT_ONCE, len(x_px)))
        moments[some], error[some] = _integrated(rig, x_px[some], microlens[some], planes_mm, accuracy_px)
    return MeanRays(microlens, moments[:, :4].reshape(-1, 2, 2).copy(), error, rig.hit_fraction(moments))


def _integrated(
    rig: Rig, x_px: np.ndarray, microlens: np.ndarray, planes_mm: tuple[float, float], accuracy_px: float
) -> tuple[np.ndarray, np.ndarray]:
    """Moments (n, COLUMNS) and errors (n, 2) [px]; levels of quadrature follow until the errors are small enough."""
    planes = np.repeat(parallel_planes(*planes_mm)[None], len(x_px), axis=0)
    bundles = Bundles(x_px, microlens, planes, rig.square_px)
    px_per_mm = _inverse_jacobian(rig, bundles)
    moments, error = np.full((len(x_px), COLUMNS), np.nan), np.full((len(x_px), 2), np.nan)
    rows = np.arange(len(x_px))
    for level in range(1, LEVELS):
        integral = integrals(rig.tracer, _some(bundles, rows), level)
        moments[rows], error[rows] = integral.moments, errors_px(px_per_mm[rows], integral)
        is_done = np.isnan(integral.moments[:, 0]) | (np.hypot(*error[rows].T) < accuracy_px)
        rows = rows[~is_done]
        if not len(rows):
            break
    return moments, error


def _inverse_jacobian(rig: Rig, bundles: Bundles) -> np.ndarray:
    """Image positions by crossings with the near plane, (n, 2, 2) [px per mm], by chief rays or, without, by J."""
    jacobian = chief_jacobian(rig.tracer, bundles.microlens, bundles.x_px, bundles.planes[:, 0])
    lacking = np.flatnonzero(np.isnan(jacobian).any(axis=(1, 2)))
    for axis in range(2 if len(lacking) else 0):
        step = _DIFFERENCE_PX * np.eye(2)[axis]
        some = _some(bundles, lacking)
        ends = (
            integrals(rig.tracer, Bundles(some.x_px + sign * step, some.microlens, some.planes, rig.square_px), 0)
            for sign in (1, -1)
        )
        plus, minus = (integral.moments[:, :2] for integral in ends)
        jacobian[lacking, :, axis] = (plus - minus) / (2 * _DIFFERENCE_PX)
    return inverse(jacobian)


def _some(bundles: Bundles, rows: np.ndarray) -> Bundles:
    return Bundles(bundles.x_px[rows], bundles.microlens[rows], bundles.planes[rows], bundles.square_px)
