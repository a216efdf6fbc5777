"""Damped Gauss-Newton with poses eliminated, robust weights and priors."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from pipeline.errors import PipelineError
from pipeline.plugins.fits.linear_rows import RANK_TOLERANCE, Assumptions, Linearisation, standardised
from pipeline.plugins.fits.predicted_rows import Slopes, moved

_STEPS, _TRIALS = 40, 24
"""Most steps, and most trials of one: damping of the numbers alone, of poses, too, then more of it."""
_FIRST_DAMPING, _LESS, _MORE = 1e-4, 0.1, 10.0
"""Damping of a step after one that went astray, over the largest singular value squared [1], and its changes."""
SETTLED = 1e-3
"""Change of all rows together by the last step, in sigma, or in what the misfit says that sigma is [1]: no number then
moves by more than that part of its deviation, and the next step would move it by far less."""
_CREEP = 0.1
"""Decrease of chi squared by a damped step, over that which rows promise if they are straight, below which they are too
bent to tell [1]."""
_SLACK = 1e-7
"""Increase of chi squared that counts as none, over itself and the number of rows [1]: what rows are solved to."""
_LEAST_ROWS = 0.5
"""Part of the rows that a step has to keep [1]: a camera that loses its image fits what is left of it."""
_LEAST_FRACTION = 1 / 16
"""Fraction of a step down to which it is halved where there is no camera at its end [1]: then it is damped."""
_OPEN_SHARE = 1e-3
"""Component of a number in a direction that is open, above which the number is open itself [1]."""
CREPT = "rows hardly tell which way"
"""Ending of a fit whose steps creep: a direction of numbers or poses is told by next to nothing."""


class Problem(Protocol):
    """Rows at corrected numbers and at poses; PipelineError where there is no such camera.

    `residual`: (n, 2) [px], NaN of a row that is not there; `near`: that of numbers and poses near by. `slopes`: where
    the residuals are known.
    """

    def residual(self, correction: np.ndarray, poses: np.ndarray, near: np.ndarray | None = None) -> np.ndarray: ...

    def slopes(self, correction: np.ndarray, poses: np.ndarray, residual: np.ndarray) -> Slopes: ...


@dataclass(frozen=True, slots=True, kw_only=True)
class Solution:
    """Corrections of numbers (m,), poses (v, 4, 4), and what is known of both there.

    `residual_px`: (n, 2), NaN of rows that the stage does not have. `expected`: of chi squared, of each row (n,).
    `covariance`: (m, m), of the directions that are not open. `open_directions`: steps of the numbers that change no
    row, (k, m), priors aside, and their components over what each number alone would change, (k, m), of unit length;
    `are_held`: by priors, all of them. `weakest`: components of the direction that rows and priors tell least, (m,).
    `information_share`: part of what is known of each number that the rows said, (m,). `ending`: why it ended;
    `refusal`: of a fit that did not converge, why there is no camera where the last step led at first; `converged`:
    whether it ended well. `linearisation`: of the rows near by.
    """

    correction: np.ndarray
    poses: np.ndarray
    residual_px: np.ndarray
    expected: np.ndarray
    covariance: np.ndarray
    deviation: np.ndarray
    open_directions: np.ndarray
    open_components: np.ndarray
    are_held: bool
    weakest: np.ndarray
    at_bound: np.ndarray
    information_share: np.ndarray
    steps: int
    ending: str
    refusal: str | None
    converged: bool
    linearisation: Linearisation


@dataclass(frozen=True, slots=True)
class _Iterate:
    """Numbers and poses, and the residuals of rows there."""

    correction: np.ndarray
    poses: np.ndarray
    residual: np.ndarray


@dataclass(frozen=True, slots=True, kw_only=True)
class _Step:
    """A step of numbers and poses to the next iterate, and the loss at both ends of the `rows` that both have.

    `fraction`: of the numbers' whole step.
    """

    end: _Iterate
    number_step: np.ndarray
    pose_steps: np.ndarray
    fraction: float
    rows: int
    loss_before: float
    loss_after: float


class _StepSearch:
    """Steps of a problem, with the damping that one leaves to the next.

    `refusal`: why a trial point of the last step has no camera, if one has none.
    """

    def __init__(self, problem: Problem, assumptions: Assumptions) -> None:
        self.damping = 0.0
        self.refusal: str | None = None
        self._problem, self._assumptions = problem, assumptions

    def step(self, linearisation: Linearisation, iterate: _Iterate) -> _Step | None:
        """The first step that makes the loss no larger, of ever more damped ones; None: none of them does."""
        damps_poses, fraction, self.refusal = False, 1.0, None
        for _ in range(_TRIALS):
            number_step = fraction * linearisation.number_step(self.damping)
            pose_steps = linearisation.pose_steps(number_step, self.damping if damps_poses else 0.0)
            correction, poses = iterate.correction + number_step, moved(iterate.poses, pose_steps)
            try:
                end = _Iterate(correction, poses, self._problem.residual(correction, poses, iterate.residual))
            except PipelineError as error:  # there is no such camera
                self.refusal = error.message
                if fraction > _LEAST_FRACTION:
                    fraction /= 2  # the direction is as good as rows are straight, and only its end is out of reach
                    continue
            else:
                # Rows come and go: only those of both ends are compared, or a step that loses rows would look good.
                is_common = linearisation.is_used & np.isfinite(end.residual[:, 0])
                before, after = (_loss(at, is_common, self._assumptions) for at in (iterate, end))
                keeps_rows = is_common.sum() >= _LEAST_ROWS * linearisation.is_used.sum()
                if keeps_rows and after <= before + _SLACK * (before + len(is_common)):
                    return _Step(
                        end=end,
                        number_step=number_step,
                        pose_steps=pose_steps,
                        fraction=fraction,
                        rows=int(is_common.sum()),
                        loss_before=before,
                        loss_after=after,
                    )
            if self.damping and not damps_poses:
                damps_poses = True
                continue
            self.damping = max(_MORE * self.damping, _FIRST_DAMPING)  # of the numbers first
            damps_poses = False
        return None

    def relax(self) -> None:
        """Damp the next step less, and not at all after one that was hardly damped."""
        self.damping = _LESS * self.damping if self.damping > _FIRST_DAMPING else 0.0


def solve(
    problem: Problem,
    assumptions: Assumptions,
    correction: np.ndarray,
    poses: np.ndarray,
    tell: Callable[[str], None] = lambda _: None,
) -> Solution:
    """Fit numbers and poses to rows, from first corrections of the numbers and first poses."""
    iterate = _Iterate(correction, poses, problem.residual(correction, poses))
    search, count = _StepSearch(problem, assumptions), 0
    ending, converged = f"{_STEPS} steps were not enough", False
    for count in range(1, _STEPS + 1):
        slopes = problem.slopes(iterate.correction, iterate.poses, iterate.residual)
        linearisation = Linearisation(slopes, iterate.residual, iterate.correction, assumptions)
        if not linearisation.is_used.any():
            ending = "the stage has none of these rows"
            break
        chi2 = _loss(iterate, linearisation.is_used, assumptions)
        tell(f"step {count}: chi squared {chi2:.6g} of {2 * linearisation.is_used.sum()} coordinates")
        step = search.step(linearisation, iterate)
        if step is None:
            ending = "no step made the misfit smaller"
            break
        is_settled = search.damping == 0 and step.fraction == 1 and _is_settled(linearisation, step)
        gain = step.loss_before - step.loss_after
        creeps = search.damping > 0 and gain < _CREEP * linearisation.decrement
        iterate = step.end
        if is_settled:
            ending, converged = f"the last step moved no number by more than {SETTLED:g} of its deviation", True
            break
        if creeps:
            ending = CREPT
            break
        search.relax()
    if not converged:
        slopes = problem.slopes(iterate.correction, iterate.poses, iterate.residual)
    last = Linearisation(slopes, iterate.residual, iterate.correction, assumptions)
    return _solution(last, iterate, count, ending, None if converged else search.refusal, converged)


def _is_settled(linearisation: Linearisation, step: _Step) -> bool:
    """Whether a step changed rows by next to nothing, in sigma, or in the sigma that their misfit says."""
    change = np.linalg.norm(linearisation.change(step.number_step, step.pose_steps))
    return bool(change < SETTLED * np.sqrt(max(1.0, step.loss_before / (2 * step.rows))))


def _loss(iterate: _Iterate, rows: np.ndarray, assumptions: Assumptions) -> float:
    """Loss of rows, and of priors: chi squared, or Cauchy's loss of it."""
    size2 = standardised(iterate.residual, assumptions)[rows] ** 2
    if assumptions.loss_scale is not None:
        size2 = assumptions.loss_scale**2 * np.log1p(size2 / assumptions.loss_scale**2)
    return float(size2.sum() + ((iterate.correction / assumptions.prior_deviation) ** 2).sum())


def _solution(
    linearisation: Linearisation, iterate: _Iterate, steps: int, ending: str, refusal: str | None, converged: bool
) -> Solution:
    """Facts about numbers at the solution."""
    assumptions, coordinates = linearisation.assumptions, 2 * len(iterate.residual)
    by_all, by_rows = linearisation.numbers(), linearisation.numbers(has_priors=False)
    # Of chi squared a row keeps what it does not spend on the fit: its leverage, on the diagonal of the hat matrix.
    leverage = (by_all.range_basis[:coordinates] ** 2).sum(axis=1)
    for view in linearisation.views:
        leverage[view.coordinates] += (view.columns.range_basis**2).sum(axis=1)
    is_open = (np.abs(by_all.null_space) > _OPEN_SHARE).any(axis=0)
    deviation = np.where(is_open, np.inf, np.sqrt(np.diag(by_all.covariance)))
    with np.errstate(invalid="ignore"):
        share = 1 - (deviation / assumptions.prior_deviation) ** 2
    return Solution(
        correction=iterate.correction,
        poses=iterate.poses,
        residual_px=iterate.residual,
        expected=np.where(linearisation.weight > 0, (1 - leverage).reshape(-1, 2).sum(axis=1), 0.0),
        covariance=by_all.covariance,
        deviation=deviation,
        open_directions=by_rows.null_space / by_rows.norm,
        open_components=by_rows.null_space,
        are_held=not len(by_all.null_space),
        weakest=by_all.row_space[-1] if len(by_all.row_space) else np.zeros(len(deviation)),
        at_bound=(np.abs(iterate.correction) >= assumptions.reach) & (assumptions.reach > 0),
        information_share=np.where(np.isfinite(assumptions.prior_deviation), share, np.where(is_open, 0.0, 1.0)),
        steps=steps,
        ending=ending,
        refusal=refusal,
        converged=converged,
        linearisation=linearisation,
    )


def omitted_parameters(solution: Solution, derivatives: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Estimates and deviations of parameters that the fit omits, (k,), one at a time beside all that is free, of which
    rows have `derivatives` (n, 2, k): what a mistake would look like, by a last step that is not taken.
    """
    linearisation = solution.linearisation
    columns = linearisation.scaled(derivatives)
    norm = np.linalg.norm(columns, axis=0)
    basis = linearisation.numbers().range_basis
    # What neither poses nor numbers take up of each column (Frisch, Waugh and Lovell).
    left = np.zeros((len(linearisation.residual), columns.shape[1]))
    left[: len(columns)] = linearisation.without_poses(columns)
    left -= basis @ (basis.T @ left)
    information = (left**2).sum(axis=0)
    is_told = information > (RANK_TOLERANCE * norm) ** 2
    information = np.where(is_told, information, 1.0)
    estimate = -(left.T @ linearisation.residual) / information
    return np.where(is_told, estimate, 0.0), np.where(is_told, 1 / np.sqrt(information), np.inf)
