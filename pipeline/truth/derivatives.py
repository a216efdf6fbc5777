"""Derivatives of rows of the ground truth by parameters of camera, lens, array and targets.

A row is the solution x of J(x, theta) = 0 on the tangent plane of its point, the origin of J, so that

    dx / dtheta = - (dJ / dx)^-1 dJ / dtheta.

A pose or a board moves the plane, and so does the shutter for a moving target; every other parameter moves the rays.
Nothing is solved again: J of the camera at theta - h and theta + h is integrated at the row's own x, with the pupil
geometry frozen and boundaries found to rounding, and the central difference is the derivative to about 1e-9 of it.

The covariance of a bundle on the plane also has a total derivative: by theta, and by x as the row moves. The blur is
that covariance mapped to the image by dJ / dx, whose own change is of second order. Where two rims cut the pupil it
depends on the motion of their corner, which a frozen pupil lacks. So it is a difference of dJ / dx at both ends of the
step, with the pupil traced anew: eight more integrals for each parameter.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from pipeline.camera.frozen_pupils import FrozenPupils, by_x
from pipeline.camera.integrals import Bundles, Integral
from pipeline.camera.integrating.quadrature import SMOOTH
from pipeline.camera.parts.lattice import Lattice
from pipeline.camera.rig import Rig
from pipeline.camera.tracer import Tracer
from pipeline.camera.tracing.sampling_bounds import SKIP
from pipeline.records.shapes import Float64, Int64
from pipeline.truth.blur import spread
from pipeline.truth.direct.candidates import inverse
from pipeline.truth.direct.residuals import mean_hit, over_exposure
from pipeline.truth.planes import Planes

_LEVEL = 2
"""Level of quadrature: for most rows the next level changes derivatives by 1e-10, and level 1 by 1e-6."""

_BEND_PX = 1e-3
"""Half the step of differences by image position whose differences are taken [px]: they round to 1e-9. Over longer
steps J bends, over 1/256 px by 1e-4 of the derivative where a rim begins to cut."""


@dataclass(frozen=True, slots=True)
class SolvedRows:
    """Rows at their solutions: number of the point and cell of each, and the planes of all points."""

    point: Int64[np.ndarray, "n"]
    cell: Int64[np.ndarray, "n"]
    x_px: Float64[np.ndarray, "n 2"]
    planes: Planes


@dataclass(frozen=True, slots=True)
class Neighbour:
    """A camera and the tangent planes of the points before it, with one parameter shifted."""

    tracer: Tracer
    planes: Planes


@dataclass(frozen=True, slots=True)
class Variation:
    """The neighbours at a parameter less and plus a step."""

    step: float
    less: Neighbour
    more: Neighbour


@dataclass(frozen=True, slots=True)
class Derivatives:
    """Derivatives of n rows by v parameters, per unit of each; NaN where a bundle is not star-shaped."""

    x_px: Float64[np.ndarray, "n v 2"]
    spread_mm2: Float64[np.ndarray, "n v 2 2"]  # of the covariance of the hits, in the axes of the tangent plane
    jacobian_mm_per_px: Float64[np.ndarray, "n 2 2"]  # of J by image position; columns are x and y
    # Of the blur; None unless requested
    blur_px2: Float64[np.ndarray, "n v 2 2"] | None = None


class _RowIntegrals:
    """Integrals of rows at their solutions and beside them, as moments (n, COLUMNS)."""

    def __init__(self, base: Neighbour, point: np.ndarray, bundles: Bundles) -> None:
        self._base = base
        self._point = point
        self._bundles = bundles
        self.pupils = FrozenPupils(base.tracer, bundles, _LEVEL, SMOOTH)

    def by_neighbour(self, neighbour: Neighbour) -> np.ndarray:
        """Moments of a neighbour's bundles."""
        microlens = _same_microlenses(self._bundles.microlens, self._base.tracer.lattice, neighbour.tracer.lattice)
        return self._exposed(neighbour, replace(self._bundles, microlens=microlens))

    def at(self, x_px: np.ndarray) -> np.ndarray:
        """Moments at other image positions."""
        return self._exposed(self._base, replace(self._bundles, x_px=x_px))

    def _exposed(self, neighbour: Neighbour, bundles: Bundles) -> np.ndarray:
        """Moments over the exposure of the rows, on the planes and with the tracer of a neighbour."""

        def integrate(planes: np.ndarray) -> Integral:
            return self.pupils.next_to(neighbour.tracer, replace(bundles, planes=planes))

        return over_exposure(neighbour.planes.exposed(self._point, bundles.x_px), integrate).moments


def _same_microlenses(microlens: np.ndarray, base: Lattice | None, neighbour: Lattice | None) -> np.ndarray:
    """Rows of the microlenses in another lattice; SKIP: it has none. A pitch decides how many lie on an array."""
    if (
        base is None
        or neighbour is None
        or (np.array_equal(base.k, neighbour.k) and np.array_equal(base.l, neighbour.l))
    ):
        return microlens
    return neighbour.rows(base.k[microlens], base.l[microlens], SKIP)


def _jacobian(neighbour: Neighbour, point: np.ndarray, bundles: Bundles) -> np.ndarray:
    """Derivative of J by image position, (n, 2, 2), with the pupil traced anew at both ends: corners move."""

    def moments(x_px: np.ndarray) -> np.ndarray:
        return _RowIntegrals(neighbour, point, replace(bundles, x_px=x_px)).at(x_px)

    return mean_hit(by_x(moments, bundles.x_px, _BEND_PX))


def derivatives(
    rig: Rig, solved: SolvedRows, variations: Sequence[Variation], *, with_blur: bool = False
) -> Derivatives:
    """Derivatives of solved rows on the tangent planes of their points, which may move with the shutter."""
    base = Neighbour(rig.tracer, solved.planes)
    no_planes = np.zeros((len(solved.x_px), 2, 4, 3))  # each integral puts in its own
    bundles = Bundles(solved.x_px, rig.microlens(solved.cell), no_planes, rig.square_px)
    rows = _RowIntegrals(base, solved.point, bundles)
    moments_by_x = by_x(rows.at, solved.x_px)
    jacobian = mean_hit(moments_by_x)
    spread_by_x = spread(moments_by_x)
    px_per_mm = inverse(jacobian)
    x_rates = np.full((len(px_per_mm), len(variations), 2), np.nan)
    spread_rates = np.full((len(px_per_mm), len(variations), 2, 2), np.nan)
    for number, variation in enumerate(variations):
        # dx / dtheta, and the total derivative of the covariance: by theta, and by x as the row moves.
        change = rows.by_neighbour(variation.more) - rows.by_neighbour(variation.less)
        moments_rate = change / (2 * variation.step)
        x_rate = -np.einsum("nij,nj->ni", px_per_mm, mean_hit(moments_rate))
        x_rates[:, number] = x_rate
        spread_rates[:, number] = spread(moments_rate) + np.einsum("nijk,nk->nij", spread_by_x, x_rate)
    without_blur = Derivatives(x_rates, spread_rates, jacobian)
    if not with_blur:
        return without_blur
    return replace(without_blur, blur_px2=_blur_rates(base, solved.point, bundles, variations, without_blur))


def _blur_rates(
    base: Neighbour, point: np.ndarray, bundles: Bundles, variations: Sequence[Variation], of_rows: Derivatives
) -> np.ndarray:
    """Derivatives of the blur, (n, v, 2, 2), from those of the covariance and of dJ / dx along the row.

    With C the covariance and B the inverse of dJ / dx the blur is B C B^T. Its derivative is B' C B^T + B C' B^T +
    B C B'^T, with B' = - B (dJ / dx)' B.
    """
    rows = _RowIntegrals(base, point, replace(bundles, square_px=0.0))  # a footprint is part of J, and not of the blur
    spread_mm2 = spread(rows.at(bundles.x_px))
    spread_by_x = spread(by_x(rows.at, bundles.x_px))
    px_per_mm = inverse(of_rows.jacobian_mm_per_px)
    transposed = px_per_mm.transpose(0, 2, 1)
    blur_rates = np.empty_like(of_rows.spread_mm2)
    for number, variation in enumerate(variations):
        # Take dJ / dx at both ends of the step, each at the x to which the row moves.
        x_rate = of_rows.x_px[:, number]
        ends = []
        for neighbour, step in ((variation.more, variation.step), (variation.less, -variation.step)):
            microlens = _same_microlenses(bundles.microlens, base.tracer.lattice, neighbour.tracer.lattice)
            moved = replace(bundles, x_px=bundles.x_px + step * x_rate, microlens=microlens)
            ends.append(_jacobian(neighbour, point, moved))
        inverse_rate = px_per_mm @ (ends[1] - ends[0]) @ px_per_mm / (2 * variation.step)
        # Take the total derivative of the covariance, and apply the product rule.
        change = rows.by_neighbour(variation.more) - rows.by_neighbour(variation.less)
        spread_rate = spread(change) / (2 * variation.step)
        spread_rate += np.einsum("nijk,nk->nij", spread_by_x, x_rate)
        by_inverse = inverse_rate @ spread_mm2 @ transposed
        blur_rates[:, number] = px_per_mm @ spread_rate @ transposed + by_inverse + by_inverse.transpose(0, 2, 1)
    return blur_rates
