"""Rows of targets, which may move while a frame is exposed. CONVENTIONS.md, Time, has the law.

J(x) is the mean over the rays of x and over the exposure of the line at x, so that J(x) = p is solved as for a still
target: planes are those of the time at x. The derivative of J then has the motion in it.
"""

from dataclasses import dataclass

import numpy as np

from pipeline.camera.integrals import Bundles, integrals
from pipeline.camera.rig import Rig
from pipeline.records.shapes import Float64, Int64
from pipeline.truth.direct.candidates import inverse
from pipeline.truth.direct.direct_rows import guesses, solve
from pipeline.truth.direct.newton import mean_hit
from pipeline.truth.planes import PlanePair, Planes, faces_camera
from pipeline.truth.rows import Correspondences, Solutions

_TURNS = 4
"""Times that a point is looked for where it is then [1]: each leaves of the error of its time the part that the image
moves during the scan, which is small."""
_NEAR_LINES = 2.0
"""Lines within which the time of a first guess is good enough [1]: guesses are right to a pixel or two."""
_APART_S = 1e-6
"""Least time between two planes by which a velocity is measured [s]: without exposure and lines there is none else."""


@dataclass(frozen=True, slots=True)
class TimeOfRows:
    """Time of rows: the middle of their exposure after the time code of the frame, the covariance of their positions by
    motion during the exposure, and how many lines have the point in them in the middle of their own exposure.
    """

    middle_s: Float64[np.ndarray, "n"]
    motion_px2: Float64[np.ndarray, "n 2 2"]
    lines: Int64[np.ndarray, "n"]


def solve_points(
    rig: Rig, planes: Planes, some: slice, accuracy_px: float, min_hit_fraction: float
) -> Correspondences | None:
    """All rows of some points; None if none of the target's faces the camera when it is exposed."""
    own, rays = planes_at_own_times(rig, planes, some)
    if not faces_camera(own).any():
        return None
    asked = np.zeros_like(own)
    # The others face neither to the camera nor away: they get no rows
    asked[:, 0], asked[some] = own[:, 0], own[some]
    guess, more = guesses(rig, asked)
    rows = solve(rig, guess, planes, accuracy_px, min_hit_fraction)
    rows.counts["rays"] += rays + more
    return rows


def planes_at_own_times(rig: Rig, planes: Planes, some: slice) -> tuple[np.ndarray, int]:
    """Planes of points (p, 4, 3) about when their lines are exposed, and traced rays; of points that are not seen those
    in the middle.
    """
    first, end = planes.shutter.window_s(planes.size_px)
    points = np.arange(len(planes.of_points))
    times, rays = np.full(len(points), (first + end) / 2), 0
    looked = points[some]
    for turn in range(_TURNS if planes.moves and planes.shutter.line_by_px_s else 0):
        asked = np.zeros((len(points), 4, 3))
        asked[looked] = planes.at(looked, times[looked])
        guess, more = guesses(rig, asked)
        rays += more
        count = np.bincount(guess.point, minlength=len(points))
        sums = [np.bincount(guess.point, axis, minlength=len(points)) for axis in guess.x_px.T]
        x_px = np.stack(sums, axis=1) / np.maximum(count, 1)[:, None]
        is_seen = count > 0
        before, unseen = times.copy(), looked[~is_seen[looked]]
        times[is_seen] = np.clip(planes.middle_s(x_px[is_seen]), first, end)
        times[unseen] = (first, end, (first + end) / 2, (first + end) / 2)[turn]
        if np.abs(times - before)[is_seen].max(initial=0.0) < _NEAR_LINES * planes.shutter.line_s and not len(unseen):
            break
    return planes.at(points, times), rays


def time_of_rows(rig: Rig, planes: Planes, solutions: Solutions) -> TimeOfRows:
    """The time of rows; velocities are those of the mean hits of their bundles."""
    x_px, shutter = solutions.xy_px, planes.shutter
    middle = planes.middle_s(x_px)
    if not planes.moves:
        return TimeOfRows(middle, np.zeros((len(x_px), 2, 2)), np.ones(len(x_px), np.int64))
    half = max(shutter.exposure_s, shutter.line_s, _APART_S) / 2
    times, microlens = (middle - half, middle + half), rig.microlens(solutions.cell)

    first, end = (
        mean_hit(integrals(rig.tracer, Bundles(x_px, microlens, on.both, rig.square_px), 0).moments)
        for on in (PlanePair.twice(planes.at(solutions.point, at)) for at in times)
    )
    hits_mm_per_s = (end - first) / (2 * half)
    # The derivative of J has the scan in it: where the point moves v in the image of an instant, it moves v / (1 - v D)
    # in the image that is scanned, D the time from line to line.
    way_px_per_s = -np.einsum("nij,nj->ni", inverse(solutions.jacobian), hits_mm_per_s)
    motion = way_px_per_s * shutter.exposure_s
    # Line r is exposed while the point is (1 - v D) (y - r) from its middle, y along the axis of the scan.
    y, reach = x_px[:, shutter.axis], np.abs(1 + way_px_per_s[:, shutter.axis] * shutter.line_by_px_s) / 2
    lines = np.floor(y + reach) - np.floor(y - reach)
    return TimeOfRows(middle, motion[:, :, None] * motion[:, None, :] / 12, lines.astype(np.int64))
