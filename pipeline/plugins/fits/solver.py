"""Damped Gauss-Newton with poses eliminated, robust weights and priors.

Rows near the rim of a micro-image bend, and what noise leaves of them then bends chi squared: straight steps converge
slowly, or overshoot for ever. The curvature of this part, r H of residuals r with second derivatives H, is learnt from
the change of the gradient at each step (J. E. Dennis, D. M. Gay, R. E. Welsch, ACM TOMS 7, 1981, 348), of the numbers.
While the misfit still falls fast, what was learnt is of residuals that are gone, and straight steps are the best: a
step that makes chi squared much smaller forgets it (R. Fletcher, C. Xu, IMA J. Numer. Anal. 7, 1987, 371).
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from pipeline.errors import PipelineError
from pipeline.plugins.fits.linear_rows import NOTHING, OPEN, Asked, Linear, scale
from pipeline.plugins.fits.predicted_rows import Slopes, moved

_STEPS, _TRIES = 40, 24
"""Most steps, and most trials of one: damping of the numbers alone, of poses, too, then more of it."""
_FIRST_DAMPING, _LESS, _MORE = 1e-4, 0.1, 10.0
"""Damping of a step after one that went astray, over the largest singular value squared [1], and its changes."""
SETTLED = 1e-3
"""Change of all rows together by the last step, in sigma, or in what the misfit says that sigma is [1]: no number then
moves by more than that part of its deviation, and the next step would move it by far less."""
_CREEP = 0.1
"""Decrease of chi squared by a damped step, over that which rows promise if they are straight, below which they are too
bent to tell [1]."""
_FALLS = 0.2
"""Decrease of chi squared by a step, over itself, from which on the next one takes rows as straight [1]: of Fletcher
and Xu."""
_SLACK = 1e-7
"""Increase of chi squared that counts as none, over itself and the number of rows [1]: what rows are solved to."""
_LEAST_ROWS = 0.5
"""Part of the rows that a step has to keep [1]: a camera that loses its image fits what is left of it."""
_SKIPPED = 1e-8
"""Cosine of a step and of what an update adds to its gradient below which there is none [1], as is usual."""
_APART = 1e-3
"""Part of a number in a direction that nothing tells, above which the number is open itself [1]."""


class Problem(Protocol):
    """Rows at numbers moved `by` and at poses; PipelineError where there is no such camera.

    `residual`: (n, 2), NaN of a row that is not there; `near`: those of numbers and poses nearby. `slopes`: where the
    residuals are known.
    """

    def residual(self, by: np.ndarray, poses: np.ndarray, near: np.ndarray | None = None) -> np.ndarray: ...

    def slopes(self, by: np.ndarray, poses: np.ndarray, residual: np.ndarray) -> Slopes: ...


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
    damping, step, by_step = 0.0, 0, np.zeros(len(by))
    curvature, gradient = np.zeros((len(by), len(by))), np.zeros(len(by))
    residual = problem.residual(by, poses)
    before, after = np.inf, 0.0
    ending, converged = f"{_STEPS} steps were not enough", False
    for step in range(1, _STEPS + 1):
        linear = Linear(problem.slopes(by, poses, residual), residual, asked)
        chi2, count = _cost(residual, linear.is_told, by, asked), 2 * linear.is_told.sum()
        tell(f"step {step}: chi squared {chi2:.6g} of {count} coordinates")
        if after < (1 - _FALLS) * before:
            curvature = np.zeros_like(curvature)
        else:
            curvature = _updated(curvature, by_step, linear.gradient(by) - gradient - linear.gradient_change(by_step))
        gradient = linear.gradient(by)
        with_poses = False
        for _ in range(_TRIES):
            by_step = linear.step(by, damping, curvature)
            pose_steps = linear.pose_steps(by_step, damping if with_poses else 0.0)
            posed = moved(poses, pose_steps)
            there = _tried(problem, by + by_step, posed, residual)
            both = linear.is_told & np.isfinite(there[:, 0])
            before, after = _cost(residual, both, by, asked), _cost(there, both, by + by_step, asked)
            if both.sum() >= _LEAST_ROWS * linear.is_told.sum() and after <= before + _SLACK * (before + len(both)):
                break
            if with_poses or not damping:
                damping = max(_MORE * damping, _FIRST_DAMPING)
                curvature = np.zeros_like(curvature)
                with_poses = False
            else:
                with_poses = True
        else:
            ending = "no step made the misfit smaller"
            break
        way = np.linalg.norm(linear.change(by_step, pose_steps))
        by, poses, residual = by + by_step, posed, there
        if damping == 0 and way < SETTLED * np.sqrt(max(1.0, before / (2 * both.sum()))):
            ending, converged = f"the last step moved no number by more than {SETTLED:g} of its deviation", True
            break
        if damping and before - after < _CREEP * linear.decrement(by - by_step):
            ending = "rows hardly tell which way: free less, give tolerances, or leave out boards that face the camera"
            break
        damping = _LESS * damping if damping > _FIRST_DAMPING else 0.0
    slopes = linear.slopes if converged else problem.slopes(by, poses, residual)
    return _solution(Linear(slopes, residual, asked), (by, poses, residual), (step, ending, converged))


def _updated(curvature: np.ndarray, step: np.ndarray, change: np.ndarray) -> np.ndarray:
    """Curvature of rows after a step, along which the gradient changed by `change` beyond that of straight rows: the
    symmetric update of rank one (Nocedal and Wright, Numerical Optimization, 6.24).
    """
    off = change - curvature @ step
    along = off @ step
    if abs(along) <= _SKIPPED * np.linalg.norm(off) * np.linalg.norm(step):
        return curvature
    return np.asarray(curvature + np.outer(off, off) / along)


def _tried(problem: Problem, by: np.ndarray, poses: np.ndarray, near: np.ndarray) -> np.ndarray:
    """Residuals elsewhere; NaN where there is no such camera."""
    try:
        return problem.residual(by, poses, near)
    except PipelineError:
        return np.full_like(near, np.nan)


def _cost(residual: np.ndarray, rows: np.ndarray, by: np.ndarray, asked: Asked) -> float:
    """Loss of rows, and of priors."""
    size2 = np.nan_to_num(scale(residual, asked)[rows]) ** 2
    if asked.loss_scale is not None:
        size2 = asked.loss_scale**2 * np.log1p(size2 / asked.loss_scale**2)
    return float(size2.sum() + ((by / asked.deviation) ** 2).sum())


def _solution(linear: Linear, at: tuple[np.ndarray, np.ndarray, np.ndarray], end: tuple[int, str, bool]) -> Solution:
    """Facts about numbers at the solution."""
    (by, poses, residual), (steps, ending, converged), asked = at, end, linear.asked
    numbers, rows = linear.numbers(1 / asked.deviation), 2 * len(residual)
    leverage = (numbers.basis[:rows] ** 2).sum(axis=1)
    for view in linear.views:
        leverage[view.coordinates] += (view.columns.basis**2).sum(axis=1)
    of_rows = linear.numbers(np.zeros(len(by)))
    directions = of_rows.open / of_rows.size
    directions = directions / np.max(np.abs(directions), axis=1, keepdims=True, initial=NOTHING)
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
