"""The solver alone, before cameras in closed form: it ends where it should, and says how far to believe it."""

from dataclasses import dataclass

import numpy as np
import pytest
from scipy.optimize import lsq_linear
from scipy.spatial.transform import Rotation
from scipy.stats import chi2

from pipeline.errors import PipelineError
from pipeline.frames import rigid
from pipeline.plugins.fits.linear_rows import Assumptions
from pipeline.plugins.fits.predicted_rows import Slopes, moved
from pipeline.plugins.fits.solver import CREPT, solve

BOARD_MM = np.array([[10.0 * i, 10.0 * j, 0.0] for j in range(-2, 3) for i in range(-3, 4)])
FOCAL_PX, SIGMA_PX = 4000.0, 0.1
TILTS = ((0.0, 0.0), (0.3, 0.0), (0.3, -0.4))
"""Turns of boards about x and y [rad]: the first faces the camera."""


@dataclass(frozen=True)
class Pinhole:
    """A pinhole with a free focal length and centre [px], and k1, and boards before it; derivatives are differences.

    `free`: which of the four numbers are corrected.
    """

    observed_px: np.ndarray
    free: tuple[int, ...] = (0, 1, 2)

    def residual(self, correction: np.ndarray, poses: np.ndarray, near: np.ndarray | None = None) -> np.ndarray:
        off = np.zeros(4)
        off[list(self.free)] = correction
        points = np.concatenate([BOARD_MM @ pose[:3, :3].T + pose[:3, 3] for pose in poses])
        slope = points[:, :2] / points[:, 2:]
        bent = slope * (1 + off[3] * (slope**2).sum(axis=1, keepdims=True))
        return (FOCAL_PX + off[0]) * bent + off[1:3] - self.observed_px

    def slopes(self, correction: np.ndarray, poses: np.ndarray, residual: np.ndarray) -> Slopes:
        step = 1e-4

        def difference(number_step: np.ndarray, pose_step: np.ndarray) -> np.ndarray:
            ends = (self.residual(correction + sign * number_step, moved(poses, sign * pose_step)) for sign in (1, -1))
            return np.subtract(*ends) / (2 * step)

        by_number = np.stack([difference(axis, np.zeros(6)) for axis in step * np.eye(len(correction))], axis=2)
        by_pose = np.stack([difference(np.zeros(len(correction)), axis) for axis in step * np.eye(6)], axis=2)
        arm_mm = np.concatenate([BOARD_MM @ pose[:3, :3].T for pose in poses])
        return Slopes(by_number=by_number, by_pose=by_pose, arm_mm=arm_mm)


def posed(tilts: tuple, distance_mm: float = 300.0) -> np.ndarray:
    """Boards in several places, (v, 4, 4), with these turns."""
    places = [(0.0, 0.0, distance_mm), (20.0, -20.0, distance_mm + 10), (-25.0, 5.0, distance_mm + 20)]
    turns = [Rotation.from_euler("xy", tilt).as_matrix() for tilt in tilts]
    return np.array([rigid(turn, np.array(place)) for turn, place in zip(turns, places, strict=True)])


def test_noisy_fits_converge_from_a_mirrored_tilt_and_scatter_by_the_stated_covariance():
    """Four fits with three numbers each; the second board's first pose is tilted to the other side, which a field as
    narrow as this sees nearly alike.
    """
    poses, first = posed(TILTS, 600.0), posed((TILTS[0], (-0.3, 0.0), TILTS[2]), 600.0)
    true, exact = np.array([60.0, 5.0, -3.0]), Pinhole(np.zeros((len(BOARD_MM) * len(TILTS), 2)))
    rows_px, random = exact.residual(true, poses), np.random.default_rng(5)
    assumptions = Assumptions(
        sigma_px=np.full(len(rows_px), SIGMA_PX),
        view=np.repeat(np.arange(len(TILTS)), len(BOARD_MM)),
        prior_deviation=np.full(3, np.inf),
        reach=np.full(3, np.inf),
        has_free_poses=True,
        loss_scale=None,
    )
    errors, misfits, expected = [], 0.0, 0.0
    for _ in range(4):
        noisy = Pinhole(rows_px + random.normal(scale=SIGMA_PX, size=rows_px.shape))
        solution = solve(noisy, assumptions, np.zeros(3), first)
        assert solution.converged and solution.steps < 20
        errors.append(np.linalg.solve(np.linalg.cholesky(solution.covariance), solution.correction - true))
        misfits += (solution.residual_px**2).sum() / SIGMA_PX**2
        expected += solution.expected.sum()
    for total, count in ((np.square(errors).sum(), np.size(errors)), (misfits, expected)):
        assert chi2.ppf(1e-4, count) < total < chi2.ppf(1 - 1e-4, count)


def test_the_number_that_keeps_a_fit_from_converging_is_the_weakest():
    """Boards that hardly turn from the camera, with noise, tell k1, but not a focal length from their distances."""
    tilts = ((0.005, 0.0), (0.0, 0.005), (-0.005, 0.005))
    poses, noise_px = posed(tilts), np.random.default_rng(2).normal(scale=SIGMA_PX, size=(len(BOARD_MM) * 3, 2))
    rows_px = Pinhole(-noise_px, (0, 3)).residual(np.array([40.0, 0.05]), poses)
    ends = {}
    for free in ((0, 1, 2, 3), (1, 2, 3)):
        unbounded = np.full(len(free), np.inf)
        assumptions = Assumptions(
            sigma_px=np.full(len(rows_px), SIGMA_PX),
            view=np.repeat(np.arange(len(tilts)), len(BOARD_MM)),
            prior_deviation=unbounded,
            reach=unbounded,
            has_free_poses=True,
            loss_scale=None,
        )
        ends[free] = solve(Pinhole(rows_px, free), assumptions, np.zeros(len(free)), poses)
    crept, converged = ends.values()
    assert crept.ending == CREPT and abs(crept.weakest[0]) > 0.9 and abs(crept.weakest[3]) < 0.1
    assert converged.converged


class Bent:
    """Four rows that are the arctangent of a shift of their board: from 3 on, straight steps go further and further."""

    def residual(self, correction: np.ndarray, poses: np.ndarray, near: np.ndarray | None = None) -> np.ndarray:
        return np.tile([np.arctan(poses[0, 0, 3]), 0.0], (4, 1))

    def slopes(self, correction: np.ndarray, poses: np.ndarray, residual: np.ndarray) -> Slopes:
        by_pose = np.zeros((4, 2, 6))
        by_pose[:, 0, 3] = 1 / (1 + poses[0, 0, 3] ** 2)
        return Slopes(by_number=np.zeros((4, 2, 0)), by_pose=by_pose, arm_mm=np.zeros((4, 3)))


def test_a_step_that_goes_astray_is_shortened():
    none, view = np.zeros(0), np.zeros(4, int)
    assumptions = Assumptions(
        sigma_px=np.ones(4), view=view, prior_deviation=none, reach=none, has_free_poses=True, loss_scale=None
    )
    solution = solve(Bent(), assumptions, none, rigid(np.eye(3), np.array([3.0, 0.0, 0.0]))[None])
    assert solution.converged and abs(solution.poses[0, 0, 3]) < 1e-3 and solution.steps <= 8


class Unseen(Bent):
    """The same board behind the camera."""

    def residual(self, correction: np.ndarray, poses: np.ndarray, near: np.ndarray | None = None) -> np.ndarray:
        return np.full((4, 2), np.nan)


def test_a_stage_that_has_none_of_the_rows_is_no_fit():
    none, view = np.zeros(0), np.zeros(4, int)
    assumptions = Assumptions(
        sigma_px=np.ones(4), view=view, prior_deviation=none, reach=none, has_free_poses=True, loss_scale=None
    )
    solution = solve(Unseen(), assumptions, none, rigid(np.eye(3), np.array([3.0, 0.0, 0.0]))[None])
    assert not solution.converged and solution.ending == "the stage has none of these rows"


@dataclass(frozen=True)
class Walled:
    """Four rows exp(x) - e, of which the first step from -1 leads to 5.4; there is no camera beyond a wall."""

    wall: float

    def residual(self, correction: np.ndarray, poses: np.ndarray, near: np.ndarray | None = None) -> np.ndarray:
        if correction[0] > self.wall:
            raise PipelineError(f"x is above {self.wall}")
        return np.tile([np.exp(correction[0]) - np.e, 0.0], (4, 1))

    def slopes(self, correction: np.ndarray, poses: np.ndarray, residual: np.ndarray) -> Slopes:
        by_number = np.zeros((4, 2, 1))
        by_number[:, 0, 0] = np.exp(correction[0])
        return Slopes(by_number=by_number, by_pose=np.zeros((4, 2, 6)), arm_mm=np.zeros((4, 3)))


@pytest.mark.parametrize(("wall", "converged"), [(1.5, True), (0.5, False)])
def test_a_step_to_a_camera_that_cannot_be_is_halved_and_a_fit_that_ends_there_says_why(wall, converged):
    infinite, view = np.full(1, np.inf), np.zeros(4, int)
    assumptions = Assumptions(
        sigma_px=np.ones(4), view=view, prior_deviation=infinite, reach=infinite, has_free_poses=False, loss_scale=None
    )
    solution = solve(Walled(wall), assumptions, np.array([-1.0]), np.eye(4)[None])
    assert solution.converged == converged
    if converged:
        assert abs(solution.correction[0] - 1.0) < 1e-3 and solution.steps <= 7 and solution.refusal is None
    else:
        assert solution.refusal == "x is above 0.5"


@dataclass(frozen=True)
class Straight:
    """Rows that are straight in three numbers, which are not at right angles."""

    by_number: np.ndarray
    observed_px: np.ndarray

    def residual(self, correction: np.ndarray, poses: np.ndarray, near: np.ndarray | None = None) -> np.ndarray:
        return self.by_number @ correction - self.observed_px

    def slopes(self, correction: np.ndarray, poses: np.ndarray, residual: np.ndarray) -> Slopes:
        none = np.zeros((len(residual), 2, 6))
        return Slopes(by_number=self.by_number, by_pose=none, arm_mm=none[:, 0, :3])


def test_numbers_stay_within_their_bounds_and_the_others_make_the_best_of_it():
    """As SciPy's bounded least squares. A whole step takes two of them to their bounds, and one comes back."""
    random = np.random.default_rng(0)
    by_number = 1.0 + random.normal(scale=0.5, size=(9, 2, 3))
    straight, reach = Straight(by_number, by_number @ (3.0, -2.0, 0.5)), np.array([1.0, 1.0, np.inf])
    assumptions = Assumptions(
        sigma_px=np.ones(9),
        view=np.zeros(9, int),
        prior_deviation=np.full(3, np.inf),
        reach=reach,
        has_free_poses=False,
        loss_scale=None,
    )
    solution = solve(straight, assumptions, np.zeros(3), np.eye(4)[None])
    expected = lsq_linear(by_number.reshape(-1, 3), straight.observed_px.ravel(), (-reach, reach), tol=1e-15)
    assert solution.converged and solution.at_bound.tolist() == [True, False, False]
    np.testing.assert_allclose(solution.correction, expected.x, atol=1e-9)
