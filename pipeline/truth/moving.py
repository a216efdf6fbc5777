"""Rows of targets that may move while a frame is exposed. CONVENTIONS.md, Time, states the law.

J(x) is the mean over the rays of x and over the exposure of the line at x, so that J(x) = p is solved as for a still
target, with the planes at the time of x. The derivative of J then includes the motion.
"""

from dataclasses import dataclass

import numpy as np

from pipeline.camera.integrals import Bundles, integrals
from pipeline.camera.rig import Rig
from pipeline.records.shapes import Float64, Int64
from pipeline.truth.direct.candidates import inverse
from pipeline.truth.direct.direct_rows import guesses, solve
from pipeline.truth.direct.residuals import mean_hit
from pipeline.truth.planes import PlanePair, Planes, faces_camera
from pipeline.truth.rows import Correspondences, Solutions

_ITERATIONS = 4
"""Most iterations for the time of a point [1]: each reduces the error of the time by the image's motion during the
scan, a small factor."""
_NEAR_LINES = 2.0
"""Error in lines below which the time of a first guess suffices [1]: guesses are right to a pixel or two."""
_APART_S = 1e-6
"""Least time between two planes that measure a velocity [s], without exposure and line times."""


@dataclass(frozen=True, slots=True)
class TimeOfRows:
    """Times of rows.

    `middle_s`: middle of their exposure after the time code of the frame. `motion_px2`: covariance of their positions
    by motion during the exposure. `lines`: number of lines that contain the point in the middle of their own exposure.
    """

    middle_s: Float64[np.ndarray, "n"]
    motion_px2: Float64[np.ndarray, "n 2 2"]
    lines: Int64[np.ndarray, "n"]


def solve_points(
    rig: Rig, planes: Planes, searched: slice, accuracy_px: float, min_hit_fraction: float
) -> Correspondences | None:
    """All rows of a slice of points; None if no point of the target faces the camera when it is exposed."""
    planes_at_times, rays_for_times = planes_at_own_times(rig, planes, searched)
    if not faces_camera(planes_at_times).any():
        return None
    # All other normals are 0: points that face neither to the camera nor away have no rows.
    searched_planes = np.zeros_like(planes_at_times)
    searched_planes[:, 0] = planes_at_times[:, 0]
    searched_planes[searched] = planes_at_times[searched]
    guess, rays_for_guesses = guesses(rig, searched_planes)
    rows = solve(rig, guess, planes, accuracy_px, min_hit_fraction)
    rows.counts["rays"] += rays_for_times + rays_for_guesses
    return rows


def planes_at_own_times(rig: Rig, planes: Planes, searched: slice) -> tuple[np.ndarray, int]:
    """Planes of points (p, 4, 3) at approximately the exposure times of their lines, and the number of traced rays.

    The time of a point is a fixed point: its plane at a time has an image, whose line is exposed at the next time.
    Points without a guess have the planes of the middle of the exposure.
    """
    first, end = planes.shutter.window_s(planes.size_px)
    middle = (first + end) / 2
    points = np.arange(len(planes.of_points))
    times = np.full(len(points), middle)
    rays = 0
    sought = points[searched]
    # Where no guess finds a point, it may enter the view later: try the first and the last time, then the middle.
    times_without_guess = (first, end, middle, middle)
    for iteration in range(_ITERATIONS if planes.moves and planes.shutter.line_by_px_s else 0):
        # Guess the image positions of the points at their times; behind microlenses take their mean.
        sought_planes = np.zeros((len(points), 4, 3))
        sought_planes[sought] = planes.at(sought, times[sought])
        guess, traced_rays = guesses(rig, sought_planes)
        rays += traced_rays
        count = np.bincount(guess.point, minlength=len(points))
        sums = [np.bincount(guess.point, axis, minlength=len(points)) for axis in guess.x_px.T]
        x_px = np.stack(sums, axis=1) / np.maximum(count, 1)[:, None]
        # Take the times at which the lines at these positions are exposed.
        has_guess = count > 0
        without_guess = sought[~has_guess[sought]]
        before = times.copy()
        times[has_guess] = np.clip(planes.middle_s(x_px[has_guess]), first, end)
        times[without_guess] = times_without_guess[iteration]
        change = np.abs(times - before)[has_guess].max(initial=0.0)
        if change < _NEAR_LINES * planes.shutter.line_s and not len(without_guess):
            break
    return planes.at(points, times), rays


def time_of_rows(rig: Rig, planes: Planes, solutions: Solutions) -> TimeOfRows:
    """The times of rows; velocities are those of the mean hits of their bundles."""
    x_px = solutions.xy_px
    shutter = planes.shutter
    middle = planes.middle_s(x_px)
    if not planes.moves:
        return TimeOfRows(middle, np.zeros((len(x_px), 2, 2)), np.ones(len(x_px), np.int64))
    half = max(shutter.exposure_s, shutter.line_s, _APART_S) / 2
    microlens = rig.microlens(solutions.cell)

    def hits_mm(times_s: np.ndarray) -> np.ndarray:
        """Mean hits of the rows' bundles on the planes that their points have at these times, (n, 2)."""
        pair = PlanePair.twice(planes.at(solutions.point, times_s))
        return mean_hit(integrals(rig.tracer, Bundles(x_px, microlens, pair.both, rig.square_px), 0).moments)

    hits_mm_per_s = (hits_mm(middle + half) - hits_mm(middle - half)) / (2 * half)
    # The derivative of J includes the scan: a point that moves at v in the image of an instant moves at v / (1 - v D)
    # in the scanned image, D the time from line to line.
    velocity_px_per_s = -np.einsum("nij,nj->ni", inverse(solutions.jacobian), hits_mm_per_s)
    motion = velocity_px_per_s * shutter.exposure_s
    # Line r is exposed while the point is (1 - v D) (y - r) from its middle, y along the axis of the scan.
    y = x_px[:, shutter.axis]
    reach = np.abs(1 + velocity_px_per_s[:, shutter.axis] * shutter.line_by_px_s) / 2
    lines = np.floor(y + reach) - np.floor(y - reach)
    return TimeOfRows(middle, motion[:, :, None] * motion[:, None, :] / 12, lines.astype(np.int64))
