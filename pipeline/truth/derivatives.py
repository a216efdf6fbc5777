"""Derivatives of rows of the ground truth by numbers of which camera, lens, array and targets are made.

A row is the solution x of J(x, theta) = 0 on the tangent plane of its point, from where J is counted, so that

    dx / dtheta = - (dJ / dx)^-1 dJ / dtheta.

A pose, or a board, moves the plane, and so does a shutter before which that moves; all else moves the rays. Nothing is
solved again: J of the camera a little before and a little behind theta is integrated at the row's own x, with what
passes held and its edges found to rounding, and the central difference is the derivative to about 1e-9 of it.

The covariance of a bundle on the plane has a derivative along the row, too: by theta, and by x as the row moves. The
blur is that covariance mapped to the image by dJ / dx, whose own change is of second order: where two edges cut what
passes, it depends on how their corner wanders, which what is held does not tell. It is a difference of dJ / dx beside
the row, at the position of a step less and more, with what passes found again: eight integrals more for each number.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from pipeline.camera.held import Held, by_x
from pipeline.camera.integrals import Bundles, Integral
from pipeline.camera.integrating.quadrature import SMOOTH
from pipeline.camera.parts.lattice import Lattice
from pipeline.camera.rig import Rig
from pipeline.camera.tracer import Tracer
from pipeline.camera.tracing.sampling_bounds import SKIP
from pipeline.records.shapes import Float64, Int64
from pipeline.truth.blur import spread
from pipeline.truth.direct.candidates import inverse
from pipeline.truth.direct.newton import mean_hit, over_exposure
from pipeline.truth.planes import Planes

_LEVEL = 2
"""Level of quadrature: of most rows the derivatives of the next level are the same to 1e-10, of level 1 to 1e-6."""

_BEND_PX = 1e-3
"""Half the step of differences by image position of which differences are taken [px]: they round to 1e-9. Over a longer
one J bends, over 1/256 px by 1e-4 of the derivative where a rim begins to cut."""


@dataclass(frozen=True, slots=True)
class SolvedRows:
    """Rows at their solutions: number of the point and cell of each, and the planes of all points."""

    point: Int64[np.ndarray, "n"]
    cell: Int64[np.ndarray, "n"]
    x_px: Float64[np.ndarray, "n 2"]
    planes: Planes


@dataclass(frozen=True, slots=True)
class Neighbour:
    """A camera and the tangent planes of the points before it, of which one number is a little different."""

    tracer: Tracer
    planes: Planes


@dataclass(frozen=True, slots=True)
class Variation:
    """The neighbours at a number less a step, and plus that step."""

    step: float
    less: Neighbour
    more: Neighbour


@dataclass(frozen=True, slots=True)
class Derivatives:
    """Derivatives of n rows by v numbers, per unit of each; NaN where what passes is in pieces or has a hole."""

    x_px: Float64[np.ndarray, "n v 2"]
    spread_mm2: Float64[np.ndarray, "n v 2 2"]  # of the covariance of the hits, in the axes of the tangent plane
    jacobian_mm_per_px: Float64[np.ndarray, "n 2 2"]  # of J by image position; columns are x and y
    # Of the blur; None where it was not asked for
    blur_px2: Float64[np.ndarray, "n v 2 2"] | None = None


class _Rows:
    """Integrals of rows at their solutions and beside them, as moments (n, COLUMNS)."""

    def __init__(self, here: Neighbour, point: np.ndarray, bundles: Bundles) -> None:
        self._here, self._point, self._bundles = here, point, bundles
        self.held = Held(here.tracer, bundles, _LEVEL, SMOOTH)

    def of(self, there: Neighbour) -> np.ndarray:
        """Those of a neighbour."""
        microlens = _same(self._bundles.microlens, self._here.tracer.lattice, there.tracer.lattice)
        return self._exposed(there, replace(self._bundles, microlens=microlens))

    def at(self, x_px: np.ndarray) -> np.ndarray:
        """Those of other image positions."""
        return self._exposed(self._here, replace(self._bundles, x_px=x_px))

    def _exposed(self, there: Neighbour, bundles: Bundles) -> np.ndarray:
        def integrate(planes: np.ndarray) -> Integral:
            return self.held.next_to(there.tracer, replace(bundles, planes=planes))

        return over_exposure(there.planes.exposed(self._point, bundles.x_px), integrate).moments


def _same(microlens: np.ndarray, here: Lattice | None, there: Lattice | None) -> np.ndarray:
    """Rows in another lattice of microlenses of one; SKIP: it has none. A pitch decides how many lie on an array."""
    if here is None or there is None or (np.array_equal(here.k, there.k) and np.array_equal(here.l, there.l)):
        return microlens
    return there.rows(here.k[microlens], here.l[microlens], SKIP)


def _jacobian(there: Neighbour, point: np.ndarray, bundles: Bundles) -> np.ndarray:
    """Derivative of J by image position, (n, 2, 2), with what passes found again at every end: corners wander."""

    def moments(x_px: np.ndarray) -> np.ndarray:
        return _Rows(there, point, replace(bundles, x_px=x_px)).at(x_px)

    return mean_hit(by_x(moments, bundles.x_px, _BEND_PX))


def derivatives(
    rig: Rig, solved: SolvedRows, variations: Sequence[Variation], *, with_blur: bool = False
) -> Derivatives:
    """Derivatives of solved rows on the tangent planes of their points, which may move with the lines of rows."""
    here, nowhere = Neighbour(rig.tracer, solved.planes), np.zeros((len(solved.x_px), 2, 4, 3))
    bundles = Bundles(solved.x_px, rig.microlens(solved.cell), nowhere, rig.square_px)
    rows = _Rows(here, solved.point, bundles)
    rates_by_x = by_x(rows.at, solved.x_px)
    jacobian, spread_by_x = mean_hit(rates_by_x), spread(rates_by_x)
    px_per_mm = inverse(jacobian)
    x_rates = np.full((len(px_per_mm), len(variations), 2), np.nan)
    spread_rates = np.full((len(px_per_mm), len(variations), 2, 2), np.nan)
    for number, variation in enumerate(variations):
        rates = (rows.of(variation.more) - rows.of(variation.less)) / (2 * variation.step)
        x_rates[:, number] = rate = -np.einsum("nij,nj->ni", px_per_mm, mean_hit(rates))
        spread_rates[:, number] = spread(rates) + np.einsum("nijk,nk->nij", spread_by_x, rate)
    of_rows = Derivatives(x_rates, spread_rates, jacobian)
    if not with_blur:
        return of_rows
    return replace(of_rows, blur_px2=_of_blur(here, solved.point, bundles, variations, of_rows))


def _of_blur(
    here: Neighbour, point: np.ndarray, bundles: Bundles, variations: Sequence[Variation], of_rows: Derivatives
) -> np.ndarray:
    """Derivatives of the blur, (n, v, 2, 2), from those of the covariance and of dJ / dx along the row."""
    rows = _Rows(here, point, replace(bundles, square_px=0.0))  # a footprint is part of J, and not of the blur
    spread_mm2, spread_by_x = spread(rows.at(bundles.x_px)), spread(by_x(rows.at, bundles.x_px))
    px_per_mm = inverse(of_rows.jacobian_mm_per_px)
    back = px_per_mm.transpose(0, 2, 1)
    blur_rates = np.empty_like(of_rows.spread_mm2)
    for number, variation in enumerate(variations):
        rate, ends = of_rows.x_px[:, number], []
        for side, step in ((variation.more, variation.step), (variation.less, -variation.step)):
            microlens = _same(bundles.microlens, here.tracer.lattice, side.tracer.lattice)
            ends.append(_jacobian(side, point, replace(bundles, x_px=bundles.x_px + step * rate, microlens=microlens)))
        of_inverse = px_per_mm @ (ends[1] - ends[0]) @ px_per_mm / (2 * variation.step)
        rates = spread(rows.of(variation.more) - rows.of(variation.less)) / (2 * variation.step)
        rates += np.einsum("nijk,nk->nij", spread_by_x, rate)
        half = of_inverse @ spread_mm2 @ back
        blur_rates[:, number] = px_per_mm @ rates @ back + half + half.transpose(0, 2, 1)
    return blur_rates
