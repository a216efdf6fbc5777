"""Derivatives of rows of the ground truth by numbers of which camera, lens, array and targets are made.

A row is the solution x of J(x, theta) = 0 on the tangent plane of its point, from where J is counted, so that

    dx / dtheta = - (dJ / dx)^-1 dJ / dtheta.

A pose, or a board, moves the plane, and so does a shutter before which that moves; all else moves the rays. Nothing is
solved again: J of the camera a little before and a little behind theta is integrated at the row's own x, with regions
held: a search of what passes ends somewhere, and two cameras that differ by 1e-4 of a radius would differ by that, and
by the search. Here both share inner points and the directions of nodes, and edges are found to rounding. The rays of
both go through the same shares of the ways to their edges, so that the rim of what passes counts as it moves, and their
central difference is the derivative to about 1e-9 of it.

The covariance of a bundle on the plane has a derivative along the row, too: by theta, and by x as the row moves. The
blur is that covariance mapped to the image by dJ / dx, whose own change is of second order: where two edges cut what
passes, it depends on how their corner wanders, which held regions do not tell.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from pipeline.camera.integrals import NODES, Bundles, Integral
from pipeline.camera.integrating.quadrature import INTEGRATED, SMOOTH, regions
from pipeline.camera.parts.lattice import Lattice
from pipeline.camera.rig import Rig
from pipeline.camera.tracer import Tracer
from pipeline.camera.tracing.moments import COLUMNS, COVARIANCE, WEIGHT, mixed
from pipeline.camera.tracing.sampling_bounds import SKIP
from pipeline.records.shapes import Float64, Int64
from pipeline.truth.direct.candidates import inverse
from pipeline.truth.direct.newton import mean_hit, over_exposure
from pipeline.truth.grid.ray_grid import matrix_4
from pipeline.truth.planes import Planes

_LEVEL = 2
"""Level of quadrature: of most rows the derivatives of the next level are the same to 1e-10, of level 1 to 1e-6."""
_HALF_PX = 1e-3
"""Half the step of differences by image position [px]: J bends by 1e-8 of them within a micro-image, and rounds to
1e-9."""


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
    rays: int


class _Rows:
    """Integrals of rows at their solutions and beside them; mean hits (n, 2) [mm] and covariances (n, 2, 2) [mm^2]."""

    def __init__(self, here: Neighbour, point: np.ndarray, bundles: Bundles) -> None:
        self._here, self._point, self._bundles, self.rays = here, point, bundles, 0
        nodes, _ = bundles.at_nodes(_LEVEL)
        self._held = [
            regions(light.tracer.arrays, light.tracer.positions_mm(*nodes.x_px.T), nodes.microlens, SMOOTH)
            for light in here.tracer.lights
        ]

    def of(self, there: Neighbour) -> tuple[np.ndarray, np.ndarray]:
        """Those of a neighbour."""
        microlens = _same(self._bundles.microlens, self._here.tracer.lattice, there.tracer.lattice)
        return self._exposed(there, replace(self._bundles, microlens=microlens))

    def by_x(self) -> tuple[np.ndarray, np.ndarray]:
        """Derivatives by image position, (n, 2, 2) and (n, 2, 2, 2), by x and y along the last axis."""
        rates = []
        for step in _HALF_PX * np.eye(2):
            more, less = (
                self._exposed(self._here, replace(self._bundles, x_px=self._bundles.x_px + sign * step))
                for sign in (1, -1)
            )
            rates.append(_rates(more, less, _HALF_PX))
        of_j, of_covariance = (np.stack(parts, axis=-1) for parts in zip(*rates, strict=True))
        return of_j, of_covariance

    def _exposed(self, there: Neighbour, bundles: Bundles) -> tuple[np.ndarray, np.ndarray]:
        def integrate(planes: np.ndarray) -> Integral:
            moments, rays = self._integrated(there.tracer, replace(bundles, planes=planes))
            return Integral(moments, np.zeros((len(moments), 2)), np.zeros(len(moments), bool), rays)

        integral = over_exposure(there.planes.pairs(self._point, bundles.x_px), integrate)
        self.rays += integral.rays
        return mean_hit(integral.moments), matrix_4(integral.moments[:, COVARIANCE:WEIGHT])[:, :2, :2]

    def _integrated(self, tracer: Tracer, bundles: Bundles) -> tuple[np.ndarray, int]:
        nodes, share = bundles.at_nodes(_LEVEL)
        parts, count = [], 0
        for light, held in zip(tracer.lights, self._held, strict=True):
            positions = light.tracer.positions_mm(*nodes.x_px.T)
            there = held.next_to(light.tracer.arrays, positions, nodes.microlens)
            moments, status, rays = there.moments(nodes.planes, NODES[_LEVEL], is_last=False)
            moments[status != INTEGRATED] = np.nan  # not star-shaped
            parts.append(mixed(moments.reshape(-1, len(share), COLUMNS), share) if len(share) > 1 else moments)
            count += rays
        if len(parts) > 1:
            moments = mixed(np.stack(parts, axis=1), np.array([light.share for light in tracer.lights]))
        else:
            moments = parts[0]
        return moments, count


def _same(microlens: np.ndarray, here: Lattice | None, there: Lattice | None) -> np.ndarray:
    """Rows in another lattice of microlenses of one; SKIP: it has none. A pitch decides how many lie on an array."""
    if here is None or there is None or (np.array_equal(here.k, there.k) and np.array_equal(here.l, there.l)):
        return microlens
    return there.rows(here.k[microlens], here.l[microlens], SKIP)


def _rates(
    more: tuple[np.ndarray, np.ndarray], less: tuple[np.ndarray, np.ndarray], step: float
) -> tuple[np.ndarray, np.ndarray]:
    """Central differences of mean hits and covariances."""
    return (more[0] - less[0]) / (2 * step), (more[1] - less[1]) / (2 * step)


def derivatives(
    rig: Rig,
    point: Int64[np.ndarray, "n"],
    cell: Int64[np.ndarray, "n"],
    x_px: Float64[np.ndarray, "n 2"],
    planes: Planes,
    variations: Sequence[Variation],
) -> Derivatives:
    """Derivatives of solved rows on the tangent planes of their points, which may move with the lines of rows."""
    nowhere = np.zeros((len(x_px), 2, 4, 3))
    rows = _Rows(Neighbour(rig.tracer, planes), point, Bundles(x_px, rig.microlens(cell), nowhere, rig.square_px))
    jacobian, covariance_by_x = rows.by_x()
    px_per_mm = inverse(jacobian)
    x_rates = np.full((len(x_px), len(variations), 2), np.nan)
    spread_rates = np.full((len(x_px), len(variations), 2, 2), np.nan)
    for number, variation in enumerate(variations):
        of_j, of_covariance = _rates(rows.of(variation.more), rows.of(variation.less), variation.step)
        x_rates[:, number] = rate = -np.einsum("nij,nj->ni", px_per_mm, of_j)
        spread_rates[:, number] = of_covariance + np.einsum("nijk,nk->nij", covariance_by_x, rate)
    return Derivatives(x_rates, spread_rates, jacobian, rows.rays)
