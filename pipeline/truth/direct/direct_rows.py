"""Rows of correspondences by method `direct`: candidates from forward tracing, solutions, and the rules for existing
rows. Also the inverse: mean rays of image positions.

Rows of position images take their light from here, too: the nearest position of the grid is not sufficient (in the
penumbra of a micro-image its hit fraction is off by 0.1, and its blur by a quarter of the trace).
"""

import dataclasses
from dataclasses import dataclass

import numpy as np

from pipeline.camera.frozen_pupils import FrozenPupils, by_x
from pipeline.camera.integrals import LEVELS, Bundles, integrals
from pipeline.camera.integrating.quadrature import STEADY
from pipeline.camera.pupil.chief_ray import chief_rays
from pipeline.camera.pupil.from_stop import is_steep, pupil_fan
from pipeline.camera.rig import Rig
from pipeline.camera.tracer import parallel_planes
from pipeline.camera.tracing.moments import COLUMNS, COVARIANCE, WEIGHT
from pipeline.records.shapes import Bool, Float64, Int64
from pipeline.truth import blur
from pipeline.truth.direct.candidates import candidates, chief_jacobian, inverse
from pipeline.truth.direct.newton import BLUR_LEVEL, NEARLY_PX, Search
from pipeline.truth.direct.residuals import errors_px, mean_hit
from pipeline.truth.grid.ray_grid import matrix_4
from pipeline.truth.planes import Exposed, PlanePair, Planes, axes_across, faces_camera
from pipeline.truth.rows import Correspondences, Solutions, existing_indices

_AT_ONCE = 1 << 14
"""Positions that are integrated together: bounds memory, and no result depends on it."""
_DIFFERENCE_PX = 0.25
"""Half the step of finite differences where there is no chief ray [px], as in the search of points."""


@dataclass(frozen=True, slots=True)
class MeanRays:
    """Mean rays of image positions, vision frame: straight lines through J on all planes parallel to two given ones,
    which are perpendicular to the axis except in wide cameras.

    Each ray of a bundle crosses such planes at positions that are linear in their distance, and so does the weighted
    mean. CONVENTIONS.md, "The ray of a position", gives the reason for this definition. NaN where no light leaves.
    """

    microlens: Int64[np.ndarray, "n"]  # row of the microlens whose bundle it is, or NO_MICROLENS
    crossings_mm: Float64[np.ndarray, "n 2 2"]  # in the axes of the near plane, then of the far one
    error_px: Float64[np.ndarray, "n 2"]  # error of the integral on the near plane, mapped to the image
    hit_fraction: Float64[np.ndarray, "n"]


def mean_rays(
    rig: Rig, x_px: Float64[np.ndarray, "n 2"], planes: Float64[np.ndarray, "n 2 4 3"], accuracy_px: float
) -> MeanRays:
    """Integrate the bundles of positions, each behind the microlens of its own cell, to the requested accuracy."""
    microlens = rig.microlens_at(rig.tracer.positions_mm(*x_px.T))
    moments = np.full((len(x_px), COLUMNS), np.nan)
    error = np.full((len(x_px), 2), np.nan)
    for first in range(0, len(x_px), _AT_ONCE):
        batch = np.arange(first, min(first + _AT_ONCE, len(x_px)))
        moments[batch], error[batch] = _integrated(rig, x_px[batch], microlens[batch], planes[batch], accuracy_px)
    return MeanRays(microlens, moments[:, :4].reshape(-1, 2, 2).copy(), error, rig.hit_fraction(moments))


def planes_of_rays(rig: Rig, x_px: Float64[np.ndarray, "n 2"], planes_mm: tuple[float, float]) -> np.ndarray:
    """Near and far planes that define the rays of positions, (n, 2, 4, 3).

    At two vision z or, for a wide camera, across the chief ray of each position, equally far along it from the first
    vertex; NaN where it has none.
    """
    tracer = rig.tracer
    prescription = tracer.camera.prescription
    if rig.images is not None or not pupil_fan(prescription).is_wide:
        return np.repeat(parallel_planes(*planes_mm)[None], len(x_px), axis=0)
    # A vision z becomes a distance from the first vertex, along the chief ray.
    start = tracer.on_film(tracer.positions_mm(*x_px.T))
    exit_point, direction, _ = chief_rays(tracer.table, tracer.stop_row, start)
    distances_mm = np.array(planes_mm) + prescription.vertices_from_stop_mm[0]
    origins = exit_point[:, None] + distances_mm[:, None] * direction[:, None]
    return np.concatenate([origins[:, :, None], np.repeat(axes_across(direction)[:, None], 2, axis=1)], axis=2)


def _integrated(
    rig: Rig, x_px: np.ndarray, microlens: np.ndarray, planes: np.ndarray, accuracy_px: float
) -> tuple[np.ndarray, np.ndarray]:
    """Moments (n, COLUMNS) and errors (n, 2) [px]; levels of quadrature follow until the errors are small enough."""
    bundles = Bundles(x_px, microlens, planes, rig.square_px)
    px_per_mm = _inverse_jacobian(rig, bundles)
    moments = np.full((len(x_px), COLUMNS), np.nan)
    error = np.full((len(x_px), 2), np.nan)
    rows = np.arange(len(x_px))
    for level in range(1, LEVELS):
        integral = integrals(rig.tracer, bundles.only(rows), level)
        moments[rows] = integral.moments
        error[rows] = errors_px(px_per_mm[rows], integral)
        is_done = np.isnan(integral.moments[:, 0]) | (np.hypot(*error[rows].T) < accuracy_px)
        rows = rows[~is_done]
        if not len(rows):
            break
    return moments, error


def _inverse_jacobian(rig: Rig, bundles: Bundles) -> np.ndarray:
    """Image positions by intersections with the near plane, (n, 2, 2) [px per mm], by chief rays or, without, by J."""
    jacobian = chief_jacobian(rig.tracer, bundles.microlens, bundles.x_px, bundles.planes[:, 0])
    without_chief_ray = np.flatnonzero(np.isnan(jacobian).any(axis=(1, 2)))
    if len(without_chief_ray):
        rest = bundles.only(without_chief_ray)

        def mean_at(x_px: np.ndarray) -> np.ndarray:
            """J on the near plane at other positions, (k, 2) [mm]."""
            return integrals(rig.tracer, dataclasses.replace(rest, x_px=x_px), 0).moments[:, :2]

        jacobian[without_chief_ray] = by_x(mean_at, rest.x_px, _DIFFERENCE_PX)
    return inverse(jacobian)


_APART_MM = 10.0
"""Distance of the second upright plane behind the point's own [mm]. Rays are straight, so any distance far above
rounding would do."""


@dataclass(frozen=True, slots=True)
class Guess:
    """Pairs of point and micro-image to solve, (n,) each, with first guesses (n, 2)."""

    point: Int64[np.ndarray, "n"]
    cell: Int64[np.ndarray, "n"]
    x_px: Float64[np.ndarray, "n 2"]

    def only(self, kept: Bool[np.ndarray, "n"]) -> "Guess":
        """The pairs where `kept` is true."""
        return Guess(self.point[kept], self.cell[kept], self.x_px[kept])


def guesses(rig: Rig, planes: Float64[np.ndarray, "n 4 3"]) -> tuple[Guess, int]:
    """Pairs of a point that faces the camera and a micro-image that may see it, and the number of traced rays."""
    facing = np.flatnonzero(faces_camera(planes))
    pairs = candidates(rig, planes[facing, 0])
    return Guess(facing[pairs.point], np.maximum(pairs.microlens, 0), pairs.x_px), pairs.rays


def solve(
    rig: Rig,
    guess: Guess,
    planes: Float64[np.ndarray, "p 4 3"] | Planes,
    accuracy_px: float,
    min_hit_fraction: float,
) -> Correspondences:
    """Solve J(x) = p for pairs and keep the rows that exist."""
    moving_planes = Planes(planes) if isinstance(planes, np.ndarray) else planes

    def exposed(rows: np.ndarray, x_px: np.ndarray) -> Exposed:
        """Planes of the pairs' points over the exposure at image positions."""
        return moving_planes.exposed(guess.point[rows], x_px)

    def may_exist(x_px: np.ndarray, rows: np.ndarray, grace_px: float) -> np.ndarray:
        """Whether positions lie in the image and in the cells of their pairs, or at most `grace_px` outside."""
        return rig.in_image(x_px, grace_px) & rig.in_cell(x_px, guess.cell[rows], grace_px)

    microlens = rig.microlens(guess.cell)
    search = Search(rig.tracer, microlens, exposed, guess.x_px, rig.home_px(guess.cell), rig.square_px)

    # Solve roughly, then to the accuracy wherever a row may exist.
    search.approach(may_exist)
    is_solved = np.isfinite(search.x_px).all(axis=1) & np.isfinite(search.inverse).all(axis=(1, 2))
    rough_px = np.where(is_solved[:, None], search.x_px, 0.0)
    near = is_solved & may_exist(rough_px, np.arange(len(is_solved)), NEARLY_PX)
    search.refine(np.flatnonzero(near), accuracy_px)
    # Take the solutions; name what is left unsolved in light enough for a row.
    ended = np.isfinite(search.x_px).all(axis=1) & np.isfinite(search.sigma_px).all(axis=1)
    strayed = ~search.reached & ~search.is_random & (search.contraction > 1)  # its last step led away from the point
    rows = np.flatnonzero(near & ended & ~strayed)
    missed = ~is_solved | near
    missed[rows] = False
    # Where a rim hides the point, steps lead from too little light into none: no row, however near the search came.
    is_dark = missed & ~(rig.hit_fraction(search.lit_moments) >= min_hit_fraction)
    unsolved = np.flatnonzero(missed & ~is_dark)
    counts = {"candidates": len(is_solved), "unsolved": len(unsolved)}
    # Keep the rows that exist, and count the rest by reason.
    x_px, moments = search.x_px[rows], search.moments[rows]
    kept, dropped = existing_indices(
        rig, x_px, guess.cell[rows], lambda inside: rig.hit_fraction(moments[inside]) >= min_hit_fraction
    )
    rows = rows[kept]
    counts |= dropped
    search.sharpen(rows, accuracy_px)
    counts["dropped_hit_fraction"] += int(is_dark.sum())
    beside = is_solved & ~near & ~rig.in_image(rough_px, NEARLY_PX)
    counts["dropped_outside_image"] += int(beside.sum())
    counts["dropped_outside_cell"] += int(np.sum(is_solved & ~near & ~beside))
    counts |= {"random": int(search.is_random[rows].sum()), "inaccurate": int(np.sum(~search.reached[rows]))}
    counts |= {"rows": len(rows), "rays": search.rays}
    solved = _with_blur(rig, search, guess, rows, moving_planes, counts)
    return dataclasses.replace(solved, unsolved=np.stack([guess.point[unsolved], guess.cell[unsolved]], axis=1))


def _with_blur(
    rig: Rig, search: Search, guess: Guess, rows: np.ndarray, planes: Planes, counts: dict[str, int]
) -> Correspondences:
    """Solved rows of a search, given by index, as rows of the table, with their light and the blur in mid-exposure."""
    point = guess.point[rows]
    cell = guess.cell[rows]
    x_px = search.x_px[rows]
    jacobian = search.jacobian[rows]
    moments = search.moments[rows]
    blurred, rho, rays = blur_of(rig, cell, x_px, planes.middle(point, x_px), jacobian, moments)
    x, y = x_px.T
    no_noise = np.zeros(len(rows))  # no position image takes part
    solved = Correspondences(
        Solutions(point, cell, x, y, jacobian, no_noise),
        search.sigma_px[rows],
        rig.hit_fraction(moments),
        blurred,
        rho,
        {**counts, "rays": search.rays + rays},
    )
    return solved.sorted_by(rig.axial)


def blur_of(
    rig: Rig,
    cell: Int64[np.ndarray, "n"],
    x_px: Float64[np.ndarray, "n 2"],
    planes: Float64[np.ndarray, "n 4 3"],
    jacobian: Float64[np.ndarray, "n 2 2"],
    moments: Float64[np.ndarray, "n COLUMNS"],
) -> tuple[np.ndarray, np.ndarray, int]:
    """Blur (n, 2, 2) [px^2] and signed radius (n,) [px] from the rows' own bundles, and the number of traced rays.

    `planes` are the tangent planes of each row's point at an instant, `jacobian` is that of J [mm per px], `moments`
    are those of the bundles; bundles that start on squares are traced again from the positions.
    """
    microlens = rig.microlens(cell)
    rays = 0
    if rig.square_px:
        from_positions = integrals(rig.tracer, Bundles(x_px, microlens, PlanePair.twice(planes).both), BLUR_LEVEL)
        moments, rays = from_positions.moments, from_positions.rays
    blurred = blur.in_image(blur.spread(moments), jacobian)
    # The sign needs the bundle on two planes, through and behind the point: across the axis, or across the view where
    # the point is beside the lens.
    z = planes[:, 0, 2]
    pairs = np.repeat(parallel_planes(0.0, 0.0)[None], len(z), axis=0)
    pairs[:, 0, 0, 2] = z
    pairs[:, 1, 0, 2] = z + _APART_MM
    steep = is_steep(rig.tracer.camera.prescription, planes[:, 0])
    pairs[steep] = _across(rig, planes[steep, 0])
    on_pairs = integrals(rig.tracer, Bundles(x_px, microlens, pairs), 0)
    _, uv = blur.deviations(matrix_4(on_pairs.moments[:, COVARIANCE:WEIGHT]), np.zeros(len(z)))
    return blurred, blur.signed_radius_px(blurred, uv), rays + on_pairs.rays


def _across(rig: Rig, points_mm: np.ndarray) -> np.ndarray:
    """Planes across the directions from the lens to points, through the points and behind them, (n, 2, 4, 3)."""
    front_mm = pupil_fan(rig.tracer.camera.prescription).z_mm[0]
    axes = axes_across(points_mm - (0.0, 0.0, front_mm))
    ends = points_mm[:, None] + np.array([0.0, _APART_MM])[:, None] * axes[:, None, 2]
    return np.concatenate([ends[:, :, None], np.repeat(axes[:, None], 2, axis=1)], axis=2)


def with_own_bundles(
    rig: Rig, rows: Correspondences, planes: Float64[np.ndarray, "p 4 3"], min_hit_fraction: float
) -> Correspondences:
    """Rows with light and blur of their own bundles, as `direct` has them; rows too dark are dropped and counted."""
    solutions = rows.solutions
    x_px = solutions.xy_px
    planes_of_rows = planes[solutions.point]
    bundles = Bundles(x_px, rig.microlens(solutions.cell), PlanePair.twice(planes_of_rows).both, rig.square_px)
    integral = integrals(rig.tracer, bundles, BLUR_LEVEL)
    # The Jacobian of the search is a difference over steps of the grid, where J may bend: take it anew.
    pupils = FrozenPupils(rig.tracer, bundles, BLUR_LEVEL, STEADY)

    def moments_at(x_px: np.ndarray) -> np.ndarray:
        """Moments of the bundles at other image positions."""
        return pupils.next_to(rig.tracer, dataclasses.replace(bundles, x_px=x_px)).moments

    derivative = mean_hit(by_x(moments_at, x_px))
    is_finite = np.isfinite(derivative).all(axis=(1, 2), keepdims=True)
    jacobian = np.where(is_finite, derivative, solutions.jacobian)
    blurred, rho, rays = blur_of(rig, solutions.cell, x_px, planes_of_rows, jacobian, integral.moments)
    hit_fraction = rig.hit_fraction(integral.moments)
    kept = (hit_fraction > 0) & (hit_fraction >= min_hit_fraction)
    with_jacobian = dataclasses.replace(solutions, jacobian=jacobian)
    traced = dataclasses.replace(rows, solutions=with_jacobian, hit_fraction=hit_fraction, blur_px2=blurred, rho_px=rho)
    return traced.only(kept).recounted(
        dropped_hit_fraction=rows.counts.get("dropped_hit_fraction", 0) + int(np.sum(~kept)),
        rays_of_bundles=integral.rays + pupils.rays + rays,
        rows=int(kept.sum()),
    )
