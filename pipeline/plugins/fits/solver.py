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
"""Singular value over the largest, of numbers in units of what one row tells of them, below which a direction is open
[1]: derivatives are right to that."""
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


class Problem(Protocol):
    """Rows at numbers and poses, and their slopes there; PipelineError where there is no such camera.

    `posed`: poses for numbers, sought from rays; those that are given where no pose fits.
    """

    def residual(self, by: np.ndarray, poses: np.ndarray) -> np.ndarray: ...

    def slopes(self, by: np.ndarray, poses: np.ndarray) -> Slopes: ...

    def posed(self, by: np.ndarray, poses: np.ndarray) -> np.ndarray: ...

    def __len__(self) -> int: ...


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


@dataclass(frozen=True, slots=True, kw_only=True)
class Solution:
    """Numbers moved `by` (m,), poses (v, 4, 4), and what is known of both there.

    `residual_px`: (n, 2), NaN of rows that the stage does not have. `expected`: of chi squared, of each row (n,).
    `covariance`: (m, m), of the directions that are not open. `open_directions`: of the rows alone, (k, m), in numbers.
    `told`: part of what is known of each number that the rows said, (m,). `ending`: why it ended; `converged`: well.
    """

    by: np.ndarray
    poses: np.ndarray
    residual_px: np.ndarray
    weight: np.ndarray
    expected: np.ndarray
    covariance: np.ndarray
    deviation: np.ndarray
    open_directions: np.ndarray
    unmoved: np.ndarray
    at_bound: np.ndarray
    told: np.ndarray
    steps: int
    ending: str
    converged: bool
    slopes: Slopes


@dataclass(frozen=True, slots=True)
class _Reduced:
    """Rows with poses projected away, in units of sigma, and what brings the poses along."""

    by_number: np.ndarray  # (2 n, m)
    residual: np.ndarray  # (2 n,)
    bases: list[tuple[np.ndarray, np.ndarray]]  # of each view: its coordinates, and an orthonormal basis of its poses
    full: np.ndarray  # (2 n, m), before


def solve(
    problem: Problem, asked: Asked, by: np.ndarray, poses: np.ndarray, tell: Callable[[str], None] = lambda _: None
) -> Solution:
    """Fit numbers and poses to rows, from numbers that are moved `by` and from first poses."""
    damping, step = 0.0, 0
    residual = problem.residual(by, poses)
    ending, converged = f"{_STEPS} steps were not enough", False
    for step in range(1, _STEPS + 1):
        slopes, weight = problem.slopes(by, poses), _weights(residual, asked)
        reduced, was = _reduced(slopes, residual, weight, asked), _tell(slopes) & np.isfinite(residual[:, 0])
        tell(f"step {step}: chi squared {_cost(residual, was, by, asked):.6g} of {2 * was.sum()} coordinates")
        first_damping = damping
        for trial in range(2 * _TRIES):
            by_step = _step(reduced, by, damping, asked)
            pose_steps = _pose_steps(slopes, residual, weight, by_step, damping, asked)
            is_straight = trial % 2 == 0 or not asked.has_free_poses
            posed = moved(poses, pose_steps[:-1]) if is_straight else problem.posed(by + by_step, poses)
            there = _tried(problem, by + by_step, posed)
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
        change = slopes.by_number @ by_step + np.einsum("nij,nj->ni", slopes.by_pose, pose_steps[asked.view])
        way = np.linalg.norm((change / asked.sigma_px[:, None])[both])
        by, poses, residual = by + by_step, posed, there
        if damping == 0 and is_straight and way < SETTLED * np.sqrt(max(1.0, before / (2 * both.sum()))):
            ending, converged = f"the last step moved no number by more than {SETTLED:g} of its deviation", True
            break
        if damping > first_damping and before - after < _CREEP:  # less did not do, and this leads nowhere
            ending = "rows hardly tell which way: free less, give tolerances, or leave out boards that face the camera"
            break
        damping = _LESS * damping if damping > _FIRST_DAMPING else 0.0
    if not converged:
        slopes = problem.slopes(by, poses)
    return _solution(slopes, asked, (by, poses, residual), (step, ending, converged))


def _tried(problem: Problem, by: np.ndarray, poses: np.ndarray) -> np.ndarray:
    """Residuals elsewhere; NaN where there is no such camera."""
    try:
        return problem.residual(by, poses)
    except PipelineError:
        return np.full((len(problem), 2), np.nan)


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


def _tell(slopes: Slopes) -> np.ndarray:
    """Rows with derivatives, (n,): others, of a bundle in pieces, take no part in a step."""
    return np.asarray(np.isfinite(slopes.by_pose).all(axis=(1, 2)) & np.isfinite(slopes.by_number).all(axis=(1, 2)))


def _reduced(slopes: Slopes, residual: np.ndarray, weight: np.ndarray, asked: Asked) -> _Reduced:
    there = (weight > 0) & _tell(slopes)
    root = np.where(there, np.sqrt(weight) / asked.sigma_px, 0.0)
    clean = np.where(there[:, None], residual, 0.0)
    full = (root[:, None, None] * np.where(there[:, None, None], slopes.by_number, 0.0)).reshape(2 * len(root), -1)
    by_pose = (root[:, None, None] * np.where(there[:, None, None], slopes.by_pose, 0.0)).reshape(-1, 6)
    off = (root[:, None] * clean).ravel()
    reduced, left, bases = full.copy(), off.copy(), []
    for view in range(asked.view.max() + 1) if asked.has_free_poses else ():
        some = np.flatnonzero(np.repeat(asked.view == view, 2))
        scaled = by_pose[some] / np.maximum(np.linalg.norm(by_pose[some], axis=0), 1e-300)
        basis, sizes, _ = np.linalg.svd(scaled, full_matrices=False)
        basis = basis[:, sizes > OPEN * sizes.max()]
        reduced[some] -= basis @ (basis.T @ full[some])
        left[some] -= basis @ (basis.T @ off[some])
        bases.append((some, basis))
    return _Reduced(reduced, left, bases, full)


def _decomposed(reduced: _Reduced, held: np.ndarray) -> tuple[np.ndarray, ...]:
    """Singular value decomposition of rows, and below them of what holds each number, over the size of its columns."""
    size = np.linalg.norm(reduced.full, axis=0)
    size = np.where(size > 0, size, np.where(held > 0, held, 1.0))
    left, values, right = np.linalg.svd(np.concatenate([reduced.by_number, np.diag(held)]) / size, full_matrices=False)
    return size, left, np.where(values > OPEN, values, 0.0), right


def _step(reduced: _Reduced, by: np.ndarray, damping: float, asked: Asked) -> np.ndarray:
    """Step of the numbers; those at a bound that would leave it stay there."""
    m, step = len(by), by
    is_free = np.ones(m, bool)
    for _ in range(m):
        part = _Reduced(reduced.by_number[:, is_free], reduced.residual, [], reduced.full[:, is_free])
        size, left, values, right = _decomposed(part, 1 / asked.deviation[is_free])
        off = np.concatenate([reduced.residual, (by / asked.deviation)[is_free]])
        step = np.zeros(m)
        step[is_free] = -(right.T @ (_gain(values, damping) * (left.T @ off))) / size
        beyond = is_free & (np.abs(by + step) > asked.reach)
        at_bound = beyond & (np.abs(by) >= asked.reach)
        if not at_bound.any():
            break
        is_free &= ~at_bound
    return np.asarray(np.clip(by + step, -asked.reach, asked.reach) - by)


def _pose_steps(
    slopes: Slopes, residual: np.ndarray, weight: np.ndarray, by_step: np.ndarray, damping: float, asked: Asked
) -> np.ndarray:
    """Steps of poses that fit best to numbers that move by so much, (v + 1, 6), the last one 0: of no board."""
    steps = np.zeros((asked.view.max() + 2, 6))
    if not asked.has_free_poses:
        return steps
    off = residual + slopes.by_number @ by_step
    is_there = (weight > 0) & _tell(slopes)
    for view in range(len(steps) - 1):
        some = np.flatnonzero((asked.view == view) & is_there)
        root = np.sqrt(weight[some]) / asked.sigma_px[some]
        rows = (root[:, None, None] * slopes.by_pose[some]).reshape(-1, 6)
        size = np.maximum(np.linalg.norm(rows, axis=0), 1e-300)
        left, values, right = np.linalg.svd(rows / size, full_matrices=False)
        values = np.where(values > OPEN * np.max(values, initial=0.0), values, 0.0)
        steps[view] = -(right.T @ (_gain(values, damping) * (left.T @ (root[:, None] * off[some]).ravel()))) / size
    return steps


def _gain(values: np.ndarray, damping: float) -> np.ndarray:
    """Damped inverses of singular values; 0 of what rows do not tell."""
    squared = values**2 + damping * np.max(values, initial=0.0) ** 2
    return np.divide(values, squared, out=np.zeros_like(values), where=values > 0)


def _solution(
    slopes: Slopes,
    asked: Asked,
    at: tuple[np.ndarray, np.ndarray, np.ndarray],
    end: tuple[int, str, bool],
) -> Solution:
    """Facts about numbers at the solution."""
    by, poses, residual = at
    weight, m = _weights(residual, asked), len(by)
    reduced = _reduced(slopes, residual, weight, asked)
    size, left, values, right = _decomposed(reduced, 1 / asked.deviation)
    is_told = values > 0
    half = right[is_told].T / values[is_told] / size[:, None]
    covariance, rows = half @ half.T, 2 * len(residual)
    leverage = (left[:rows, is_told] ** 2).sum(axis=1)
    for some, basis in reduced.bases:
        leverage[some] += (basis**2).sum(axis=1)
    expected = np.where(weight > 0, (1 - leverage).reshape(-1, 2).sum(axis=1), 0.0)
    _, _, of_rows, directions = _decomposed(reduced, np.zeros(m))
    scaled = directions[of_rows == 0] / size
    open_directions = scaled / np.maximum(np.abs(scaled).max(axis=1, keepdims=True), 1e-300) if m else np.zeros((0, 0))
    unmoved = right[~is_told]
    is_open = (np.abs(unmoved) > 1e-3).any(axis=0) if m else np.zeros(0, bool)
    deviation = np.where(is_open, np.inf, np.sqrt(np.diag(covariance)))
    with np.errstate(invalid="ignore"):
        told = np.where(
            np.isfinite(asked.deviation), 1 - (deviation / asked.deviation) ** 2, np.where(is_open, 0.0, 1.0)
        )
    steps, ending, converged = end
    return Solution(
        by=by,
        poses=poses,
        residual_px=residual,
        weight=weight,
        expected=expected,
        covariance=covariance,
        deviation=deviation,
        open_directions=open_directions,
        unmoved=unmoved / size if m else unmoved,
        at_bound=(np.abs(by) >= asked.reach) & (asked.reach > 0),
        told=told,
        steps=steps,
        ending=ending,
        converged=converged,
        slopes=slopes,
    )


def unnoticed(solution: Solution, asked: Asked, extra: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Estimates and deviations of further numbers (k,), of which rows have derivatives `extra` (n, 2, k), one at a
    time beside all that is free: what a mistake would look like, by a last step that is not taken.
    """
    reduced = _reduced(solution.slopes, solution.residual_px, solution.weight, asked)
    root = np.where(solution.weight > 0, np.sqrt(solution.weight) / asked.sigma_px, 0.0)
    columns = np.nan_to_num(root[:, None, None] * extra).reshape(2 * len(root), -1)
    alone = np.linalg.norm(columns, axis=0)
    for some, basis in reduced.bases:
        columns[some] -= basis @ (basis.T @ columns[some])
    size, left, values, _ = _decomposed(reduced, 1 / asked.deviation)
    basis = left[:, values > 0]
    columns = np.concatenate([columns, np.zeros((len(size), columns.shape[1]))])
    columns -= basis @ (basis.T @ columns)
    off = np.concatenate([reduced.residual, solution.by / asked.deviation])
    told = (columns**2).sum(axis=0)
    is_told = told > (OPEN * alone) ** 2
    told = np.where(is_told, told, 1.0)
    return np.where(is_told, -(columns.T @ off) / told, 0.0), np.where(is_told, 1 / np.sqrt(told), np.inf)
