"""Damped Gauss-Newton with poses eliminated, robust weights and priors.

Of each view, the columns of its pose are projected away by their orthogonal complement, so that what is left of all
rows tells about the free numbers alone. Directions of these follow from a singular value decomposition: one that
neither rows nor priors tell is left where it is. Robust loss is a weight of each row, found again at every step.

Where such a step does not make the misfit smaller, poses for the moved numbers are sought anew from the rays of the
camera (variable projection): the tilt of a board that faces the camera may change its sign then, which no straight
step lets it.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from pipeline.errors import PipelineError
from pipeline.plugins.fits.predicted_rows import Slopes, moved

OPEN = 1e-6
"""Singular value of columns over their sizes, of numbers by what rows tell of them where poses are known, below which a
direction is open [1]: derivatives are right to that."""
_STEPS, _TRIES = 40, 12
"""Most steps, and most amounts of damping of one, each with poses that step and with poses that are sought anew."""
_FIRST_DAMPING, _LESS, _MORE = 1e-4, 0.1, 10.0
"""Damping of a step after one that went astray, over the largest singular value squared [1], and its changes."""
SETTLED = 1e-3
"""Change of all rows together by the last step, in sigma, or in what the misfit says that sigma is [1]: no number then
moves by more than that part of its deviation, and the next step would move it by far less."""
_CREEP = 0.1
"""Decrease of chi squared that is none, by a step that was damped more [1]: a tenth of what a row of noise adds."""
_SLACK = 1e-7
"""Increase of chi squared that counts as none, over itself and the number of rows [1]: what rows are solved to."""
_LEAST_ROWS = 0.5
"""Part of the rows that a step has to keep [1]: a camera that loses its image fits what is left of it."""
_NOTHING = 1e-300
"""Size of a column that stands for 0."""
_APART = 1e-3
"""Part of a number in a direction that nothing tells, above which the number is open itself [1]."""


class Problem(Protocol):
    """Rows at numbers moved `by` and at poses; PipelineError where there is no such camera.

    `residual`: (n, 2), NaN of a row that is not there; `near`: those of numbers and poses nearby. `slopes`: where the
    residuals are known. `posed`: poses for numbers, sought from rays; those that are given where no pose fits.
    """

    def residual(self, by: np.ndarray, poses: np.ndarray, near: np.ndarray | None = None) -> np.ndarray: ...

    def slopes(self, by: np.ndarray, poses: np.ndarray, residual: np.ndarray) -> Slopes: ...

    def posed(self, by: np.ndarray, poses: np.ndarray) -> np.ndarray: ...


@dataclass(frozen=True, slots=True, kw_only=True)
class Asked:
    """Facts beside the rows.

    `sigma_px`: (n,). `view`: of each row, (n,), -1 of one before no board. `deviation`, `reach`: of the errors of
    numbers, (m,), infinite of what nothing holds. `loss_scale`: residual over sigma at which a row begins to count
    less; None: never.
    """

    sigma_px: np.ndarray
    view: np.ndarray
    deviation: np.ndarray
    reach: np.ndarray
    has_free_poses: bool
    loss_scale: float | None


class _Columns:
    """Singular value decomposition of columns over their sizes, with 0 in place of values that are open.

    `open`: directions that are open, (unknowns - k, unknowns), in unknowns times the sizes of their columns.
    """

    def __init__(self, columns: np.ndarray, size: np.ndarray) -> None:
        self.size = size
        self._left, values, self._right = np.linalg.svd(columns / size, full_matrices=False)
        self._values = np.where(values > OPEN, values, 0.0)
        self._is_told = self._values > 0
        self.open = self._right[~self._is_told]

    @property
    def basis(self) -> np.ndarray:
        """Orthonormal basis of what the columns span, (rows, k)."""
        return self._left[:, self._is_told]

    @property
    def covariance(self) -> np.ndarray:
        """Covariance of the unknowns, with what is open left out."""
        half = self._right[self._is_told].T / self._values[self._is_told] / self.size[:, None]
        return half @ half.T

    def step(self, off: np.ndarray, damping: float) -> np.ndarray:
        """Step of the unknowns that makes the sum of squares of `off` smaller, and is 0 along what is open."""
        squared = self._values**2 + damping * np.max(self._values, initial=0.0) ** 2
        gain = np.divide(self._values, squared, out=np.zeros_like(squared), where=self._is_told)
        return np.asarray(-(self._right.T @ (gain * (self._left.T @ off))) / self.size)


class Linear:
    """Rows near numbers and poses, in units of sigma, as they count: `weight` by Cauchy's loss, 0 of what is not there.

    `by_number`, `off`: derivatives (2 n, m) and residuals (2 n,); a row without derivatives, of a bundle in pieces, is
    0. `poses`: of each view its coordinates, and the columns of its pose.
    """

    def __init__(self, slopes: Slopes, residual: np.ndarray, asked: Asked) -> None:
        self.slopes, self.asked, self.weight = slopes, asked, _weights(residual, asked)
        is_told = (self.weight > 0) & tells(slopes)
        self._root = np.where(is_told, np.sqrt(self.weight) / asked.sigma_px, 0.0)
        self.off, self.by_number = self.scaled(residual[:, :, None])[:, 0], self.scaled(slopes.by_number)
        by_pose, self.poses = self.scaled(slopes.by_pose), list[tuple[np.ndarray, _Columns]]()
        for view in range(asked.view.max() + 1) if asked.has_free_poses else ():
            rows = np.flatnonzero(np.repeat(asked.view == view, 2))
            size = np.maximum(np.linalg.norm(by_pose[rows], axis=0), _NOTHING)
            self.poses.append((rows, _Columns(by_pose[rows], size)))
        self._reduced = self.without_poses(np.column_stack([self.by_number, self.off]))

    def scaled(self, columns: np.ndarray) -> np.ndarray:
        """Columns of rows, (n, 2, k) [px], in units of sigma and as they count, (2 n, k)."""
        counted = self._root[:, None, None] * np.where(self._root[:, None, None] > 0, columns, 0.0)
        return counted.reshape(2 * len(columns), columns.shape[2])

    def without_poses(self, columns: np.ndarray) -> np.ndarray:
        """Columns (2 n, k) without the parts that poses take up."""
        left = columns.copy()
        for rows, pose in self.poses:
            left[rows] -= pose.basis @ (pose.basis.T @ columns[rows])
        return left

    def numbers(self, held: np.ndarray, of: np.ndarray | slice = slice(None)) -> _Columns:
        """Numbers, or some of them, by rows if poses follow, and below these by what holds each, (m,)."""
        held, size = held[of], np.linalg.norm(self.by_number[:, of], axis=0)
        size = np.where(size > 0, size, np.where(held > 0, held, 1.0))
        return _Columns(np.concatenate([self._reduced[:, :-1][:, of], np.diag(held)]), size)

    def off_with(self, by: np.ndarray, of: np.ndarray | slice = slice(None)) -> np.ndarray:
        """Residuals if poses follow, and below them those of priors at numbers `by`, or some of these."""
        return np.concatenate([self._reduced[:, -1], (by / self.asked.deviation)[of]])

    def step(self, by: np.ndarray, damping: float) -> np.ndarray:
        """Step of the numbers; those at a bound that would leave it stay there."""
        asked, step, is_free = self.asked, by, np.ones(len(by), bool)
        for _ in range(len(by)):
            step = np.zeros(len(by))
            step[is_free] = self.numbers(1 / asked.deviation, is_free).step(self.off_with(by, is_free), damping)
            at_bound = is_free & (np.abs(by + step) > asked.reach) & (np.abs(by) >= asked.reach)
            if not at_bound.any():
                break
            is_free &= ~at_bound
        return np.asarray(np.clip(by + step, -asked.reach, asked.reach) - by)

    def pose_steps(self, by_step: np.ndarray, damping: float) -> np.ndarray:
        """Steps of poses that fit best to numbers that move by so much, (v + 1, 6), the last one 0: of no board."""
        off, steps = self.off + self.by_number @ by_step, np.zeros((self.asked.view.max() + 2, 6))
        for view, (rows, pose) in enumerate(self.poses):
            steps[view] = pose.step(off[rows], damping)
        return steps


@dataclass(frozen=True, slots=True, kw_only=True)
class Solution:
    """Numbers moved `by` (m,), poses (v, 4, 4), and what is known of both there.

    `residual_px`: (n, 2), NaN of rows that the stage does not have. `expected`: of chi squared, of each row (n,).
    `covariance`: (m, m), of the directions that are not open. `open_directions`: of the rows alone, (k, m), in numbers;
    `are_held`: by priors, all of them. `told`: part of what is known of each number that the rows said, (m,).
    `ending`: why it ended; `converged`: well. `linear`: rows near by.
    """

    by: np.ndarray
    poses: np.ndarray
    residual_px: np.ndarray
    expected: np.ndarray
    covariance: np.ndarray
    deviation: np.ndarray
    open_directions: np.ndarray
    are_held: bool
    at_bound: np.ndarray
    told: np.ndarray
    steps: int
    ending: str
    converged: bool
    linear: Linear


def solve(
    problem: Problem, asked: Asked, by: np.ndarray, poses: np.ndarray, tell: Callable[[str], None] = lambda _: None
) -> Solution:
    """Fit numbers and poses to rows, from numbers that are moved `by` and from first poses."""
    damping, step = 0.0, 0
    residual = problem.residual(by, poses)
    ending, converged = f"{_STEPS} steps were not enough", False
    for step in range(1, _STEPS + 1):
        linear = Linear(problem.slopes(by, poses, residual), residual, asked)
        was = tells(linear.slopes) & np.isfinite(residual[:, 0])
        tell(f"step {step}: chi squared {_cost(residual, was, by, asked):.6g} of {2 * was.sum()} coordinates")
        first_damping = damping
        for trial in range(2 * _TRIES):
            by_step = linear.step(by, damping)
            pose_steps = linear.pose_steps(by_step, damping)
            is_straight = trial % 2 == 0 or not asked.has_free_poses
            posed = moved(poses, pose_steps[:-1]) if is_straight else problem.posed(by + by_step, poses)
            there = _tried(problem, by + by_step, posed, residual)
            both = was & np.isfinite(there[:, 0])
            before, after = _cost(residual, both, by, asked), _cost(there, both, by + by_step, asked)
            allowed = before + (_SLACK * (before + len(both)) if is_straight else -_CREEP)
            if both.sum() >= _LEAST_ROWS * was.sum() and after <= allowed:
                break
            if not (is_straight and asked.has_free_poses):
                damping = max(_MORE * damping, _FIRST_DAMPING)
        else:
            ending = "no step made the misfit smaller"
            break
        change = linear.slopes.by_number @ by_step
        change += np.einsum("nij,nj->ni", linear.slopes.by_pose, pose_steps[asked.view])
        way = np.linalg.norm((change / asked.sigma_px[:, None])[both])
        by, poses, residual = by + by_step, posed, there
        if damping == 0 and is_straight and way < SETTLED * np.sqrt(max(1.0, before / (2 * both.sum()))):
            ending, converged = f"the last step moved no number by more than {SETTLED:g} of its deviation", True
            break
        if damping > first_damping and before - after < _CREEP:  # less did not do, and this leads nowhere
            ending = "rows hardly tell which way: free less, give tolerances, or leave out boards that face the camera"
            break
        damping = _LESS * damping if damping > _FIRST_DAMPING else 0.0
    slopes = linear.slopes if converged else problem.slopes(by, poses, residual)
    return _solution(Linear(slopes, residual, asked), (by, poses, residual), (step, ending, converged))


def _tried(problem: Problem, by: np.ndarray, poses: np.ndarray, near: np.ndarray) -> np.ndarray:
    """Residuals elsewhere; NaN where there is no such camera."""
    try:
        return problem.residual(by, poses, near)
    except PipelineError:
        return np.full_like(near, np.nan)


def _scale(residual: np.ndarray, asked: Asked) -> np.ndarray:
    """Length of each residual in sigma, (n,); NaN of rows that are not there."""
    return np.asarray(np.hypot(*residual.T) / asked.sigma_px)


def _weights(residual: np.ndarray, asked: Asked) -> np.ndarray:
    """Weights of rows by Cauchy's loss, (n,); 0 of what is not there."""
    size = _scale(residual, asked)
    weight = np.ones(len(size)) if asked.loss_scale is None else 1 / (1 + (size / asked.loss_scale) ** 2)
    return np.where(np.isfinite(size), weight, 0.0)


def _cost(residual: np.ndarray, rows: np.ndarray, by: np.ndarray, asked: Asked) -> float:
    """Loss of rows, and of priors."""
    size2 = np.nan_to_num(_scale(residual, asked)[rows]) ** 2
    if asked.loss_scale is not None:
        size2 = asked.loss_scale**2 * np.log1p(size2 / asked.loss_scale**2)
    return float(size2.sum() + ((by / asked.deviation) ** 2).sum())


def tells(slopes: Slopes) -> np.ndarray:
    """Rows with derivatives, (n,): others, of a bundle in pieces, take no part in a step."""
    return np.asarray(np.isfinite(slopes.by_pose).all(axis=(1, 2)) & np.isfinite(slopes.by_number).all(axis=(1, 2)))


def _solution(linear: Linear, at: tuple[np.ndarray, np.ndarray, np.ndarray], end: tuple[int, str, bool]) -> Solution:
    """Facts about numbers at the solution."""
    (by, poses, residual), (steps, ending, converged), asked = at, end, linear.asked
    numbers, rows = linear.numbers(1 / asked.deviation), 2 * len(residual)
    leverage = (numbers.basis[:rows] ** 2).sum(axis=1)
    for view, pose in linear.poses:
        leverage[view] += (pose.basis**2).sum(axis=1)
    of_rows = linear.numbers(np.zeros(len(by)))
    directions = of_rows.open / of_rows.size
    directions = directions / np.max(np.abs(directions), axis=1, keepdims=True, initial=_NOTHING)
    is_open = (np.abs(numbers.open) > _APART).any(axis=0)
    deviation = np.where(is_open, np.inf, np.sqrt(np.diag(numbers.covariance)))
    with np.errstate(invalid="ignore"):
        told = np.where(
            np.isfinite(asked.deviation), 1 - (deviation / asked.deviation) ** 2, np.where(is_open, 0.0, 1.0)
        )
    return Solution(
        by=by,
        poses=poses,
        residual_px=residual,
        expected=np.where(linear.weight > 0, (1 - leverage).reshape(-1, 2).sum(axis=1), 0.0),
        covariance=numbers.covariance,
        deviation=deviation,
        open_directions=directions,
        are_held=not len(numbers.open),
        at_bound=(np.abs(by) >= asked.reach) & (asked.reach > 0),
        told=told,
        steps=steps,
        ending=ending,
        converged=converged,
        linear=linear,
    )


def unnoticed(solution: Solution, extra: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Estimates and deviations of further numbers (k,), of which rows have derivatives `extra` (n, 2, k), one at a
    time beside all that is free: what a mistake would look like, by a last step that is not taken.
    """
    linear = solution.linear
    columns = linear.scaled(extra)
    alone = np.linalg.norm(columns, axis=0)
    basis, off = linear.numbers(1 / linear.asked.deviation).basis, linear.off_with(solution.by)
    left = np.concatenate([linear.without_poses(columns), np.zeros((len(solution.by), columns.shape[1]))])
    left -= basis @ (basis.T @ left)
    told = (left**2).sum(axis=0)
    is_told = told > (OPEN * alone) ** 2
    told = np.where(is_told, told, 1.0)
    return np.where(is_told, -(left.T @ off) / told, 0.0), np.where(is_told, 1 / np.sqrt(told), np.inf)
