"""Rows near numbers and poses: straight in the numbers, bent in the turns of boards.

Of each view, the columns of its pose are projected away by their orthogonal complement, so that what is left of all
rows tells about the free numbers alone (variable projection). Directions of these follow from a singular value
decomposition: one that neither rows nor priors tell is left where it is. Robust loss is a weight of each row, found
again at every step.

The poses that follow are those that fit best if rows are straight in the points of a board, but not in its turns: a
board that faces the camera is foreshortened by the square of its tilt, which the derivative there hardly shows. Either
sign of the tilt is tried.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from pipeline.plugins.fits.predicted_rows import Slopes

RANK_TOLERANCE = 1e-6
"""Singular value of columns over their norms, of numbers by what rows tell of them where poses are known, below which a
direction is open [1]: derivatives are right to that."""
LEAST_NORM = 1e-300
"""Norm of a column that stands for 0."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Assumptions:
    """Errors of rows and of numbers before the fit, and which poses are free.

    `sigma_px`: of rows, (n,). `view`: of each row, (n,), -1 of a centre. `prior_deviation`, `reach`: standard deviation
    and bound of the correction of each number, (m,), infinite of what nothing holds. `loss_scale`: residual over sigma
    at which a row begins to count less; None: never.
    """

    sigma_px: np.ndarray
    view: np.ndarray
    prior_deviation: np.ndarray
    reach: np.ndarray
    has_free_poses: bool
    loss_scale: float | None


class _Decomposition:
    """Singular value decomposition of columns over their norms.

    `null_space`, `row_space`: directions that are open and those that are told, (unknowns - k, unknowns) and (k,
    unknowns), in unknowns times the norms of their columns. `singular_values`, `range_basis`: of those that are told,
    the largest first, (k,) and (rows, k).
    """

    def __init__(self, columns: np.ndarray, norm: np.ndarray) -> None:
        self.norm = norm
        left, values, right = np.linalg.svd(columns / norm, full_matrices=False)
        is_told = values > RANK_TOLERANCE
        self.null_space, self.row_space = right[~is_told], right[is_told]
        self.singular_values, self.range_basis = values[is_told], left[:, is_told]

    @property
    def covariance(self) -> np.ndarray:
        """Covariance of the unknowns, with what is open left out."""
        root = self.row_space.T / self.singular_values / self.norm[:, None]
        return root @ root.T

    @property
    def largest(self) -> float:
        """Largest singular value; 0 where all directions are open."""
        return float(np.max(self.singular_values, initial=0.0))

    def step(self, residual: np.ndarray, damping: float) -> np.ndarray:
        """Step of the unknowns that makes the sum of squares smaller, and is 0 along what is open."""
        along = self.singular_values * (self.range_basis.T @ residual)
        along /= self.singular_values**2 + damping * self.largest**2
        return np.asarray(-along @ self.row_space / self.norm)


@dataclass(frozen=True)
class _ViewRows:
    """Rows of a board in a frame: their coordinates (c,), and what its pose does to them, in units of sigma.

    `by_pose`: (c, 6), as in `Slopes`; `arm_mm`: from the origin of the board to the point, (c, 3).
    """

    coordinates: np.ndarray
    by_pose: np.ndarray
    arm_mm: np.ndarray

    @cached_property
    def columns(self) -> _Decomposition:
        """The columns of its pose."""
        return _Decomposition(self.by_pose, np.maximum(np.linalg.norm(self.by_pose, axis=0), LEAST_NORM))

    @cached_property
    def _by_matrix(self) -> np.ndarray:
        """Derivatives by the elements of a matrix that moves each point by its product with the arm, (c, 9)."""
        return np.einsum("ci,cj->cij", self.by_pose[:, 3:], self.arm_mm).reshape(-1, 9)

    def change(self, step: np.ndarray) -> np.ndarray:
        """Change of the coordinates by a step of the pose, (c,): straight in where points go, not in the turn."""
        x, y, z = step[:3]
        straight = np.array([[1, -z, y], [z, 1, -x], [-y, x, 1]])
        bend = Rotation.from_rotvec(step[:3]).as_matrix() - straight
        return np.asarray(self.by_pose @ step + self._by_matrix @ bend.ravel())

    def step(self, residual: np.ndarray, damping: float) -> np.ndarray:
        """Step of the pose that makes the sum of squares of residuals, (c,), smallest; 0 along what is open.

        The misfit has a minimum at either sign of a small tilt: searches begin at both, and the better one counts.
        """
        directions = self.columns.row_space / self.columns.norm
        if not len(directions):
            return np.zeros(6)
        damping_weight = np.sqrt(damping) * self.columns.largest * self.columns.norm

        def nearest(start: np.ndarray) -> tuple[float, np.ndarray]:
            def damped_residual(along: np.ndarray) -> np.ndarray:
                step = start + directions.T @ along
                return np.concatenate([residual + self.change(step), damping_weight * step])

            start_along = np.zeros(len(directions))
            fit = least_squares(damped_residual, start_along, method="lm", ftol=1e-15, xtol=1e-12, gtol=1e-15)
            return fit.cost, start + directions.T @ fit.x

        minima = (nearest(start) for start in (np.zeros(6), self._step_to_opposite_tilt))
        return min(minima, key=lambda minimum: minimum[0])[1]

    @property
    def _step_to_opposite_tilt(self) -> np.ndarray:
        """Step to the pose with the opposite tilt, from which a narrow field sees a flat board nearly alike, (6,)."""
        middle_mm = self.arm_mm.mean(axis=0)
        normal = np.linalg.svd(self.arm_mm - middle_mm, full_matrices=False)[2][-1]
        # Along the line of sight a shift moves no image: it is across the derivatives of x and of y.
        x_by_mm, y_by_mm = self.by_pose[::2, 3:], self.by_pose[1::2, 3:]
        sight = np.cross(x_by_mm, y_by_mm).sum(axis=0)
        sight /= max(np.linalg.norm(sight), LEAST_NORM)
        # Half a turn about each takes the normal to the other side of the line of sight; here about the middle.
        about_sight, about_normal = Rotation.from_rotvec(np.pi * np.array([sight, normal]))
        turn = about_sight * about_normal
        return np.concatenate([turn.as_rotvec(), middle_mm - turn.apply(middle_mm)])


class Linearisation:
    """Rows near numbers and poses, in units of sigma, as they count: `weight` by Cauchy's loss, 0 of what is not there.

    `is_used`, (n,): rows with derivatives; others, of a bundle in pieces, are 0. `views`: none if poses are known.
    `columns`, `residual`: derivatives by numbers and residuals of what poses leave of rows, and below them of priors,
    (2 n + m, m) and (2 n + m,).
    """

    def __init__(
        self, slopes: Slopes, residual_px: np.ndarray, correction: np.ndarray, assumptions: Assumptions
    ) -> None:
        self.slopes, self.assumptions, self._correction = slopes, assumptions, correction
        self.weight = _weights(residual_px, assumptions)
        has_derivatives = (np.isfinite(by).all(axis=(1, 2)) for by in (slopes.by_pose, slopes.by_number))
        self.is_used = np.all([self.weight > 0, *has_derivatives], axis=0)
        self._root_weight = np.where(self.is_used, np.sqrt(self.weight) / assumptions.sigma_px, 0.0)
        self._by_number, self._residual = self.scaled(slopes.by_number), self.scaled(residual_px[:, :, None])[:, 0]
        by_pose, arm_mm = self.scaled(slopes.by_pose), np.repeat(slopes.arm_mm, 2, axis=0)
        self.views = list[_ViewRows]()
        for view in range(assumptions.view.max() + 1) if assumptions.has_free_poses else ():
            coordinates = np.flatnonzero(np.repeat(assumptions.view == view, 2))
            self.views.append(_ViewRows(coordinates, by_pose[coordinates], arm_mm[coordinates]))
        of_rows = self.without_poses(np.column_stack([self._by_number, self._residual]))
        of_priors = np.column_stack([np.eye(len(correction)), correction]) / assumptions.prior_deviation[:, None]
        all_rows = np.concatenate([of_rows, of_priors])
        self.columns, self.residual = all_rows[:, :-1], all_rows[:, -1]

    def scaled(self, columns: np.ndarray) -> np.ndarray:
        """Columns of rows, (n, 2, k) [px], in units of sigma and as they count, (2 n, k)."""
        root = self._root_weight[:, None, None]
        return (root * np.where(root > 0, columns, 0.0)).reshape(2 * len(columns), columns.shape[2])

    def without_poses(self, columns: np.ndarray) -> np.ndarray:
        """Columns (2 n, k) without the parts that poses take up."""
        left = columns.copy()
        for view in self.views:
            basis = view.columns.range_basis
            left[view.coordinates] -= basis @ (basis.T @ columns[view.coordinates])
        return left

    def numbers(self, is_free: np.ndarray | slice = slice(None), *, has_priors: bool = True) -> _Decomposition:
        """Numbers, or those that are free, if poses follow.

        Columns are over their norms where poses are known, so that one that poses take up is small beside 1.
        """
        columns = self.columns if has_priors else self.columns[: len(self._by_number)]
        norm, of_priors = np.linalg.norm(self._by_number, axis=0), np.linalg.norm(columns, axis=0)
        norm = np.where(norm > 0, norm, np.where(of_priors > 0, of_priors, 1.0))
        return _Decomposition(columns[:, is_free], norm[is_free])

    @property
    def decrement(self) -> float:
        """Decrease of chi squared that a step of the numbers would bring if rows were straight."""
        return float(((self.numbers().range_basis.T @ self.residual) ** 2).sum())

    def number_step(self, damping: float) -> np.ndarray:
        """Step of the numbers; those at a bound that chi squared pulls outwards stay there."""
        reach, correction = self.assumptions.reach, self._correction
        is_free = (np.abs(correction) < reach) | (correction * (self.columns.T @ self.residual) > 0)
        step = np.zeros(len(correction))
        step[is_free] = self.numbers(is_free).step(self.residual, damping)
        return np.asarray(np.clip(correction + step, -reach, reach) - correction)

    def pose_steps(self, number_step: np.ndarray, damping: float) -> np.ndarray:
        """Steps of poses that fit best to numbers that move by so much, (v, 6)."""
        residual = self._residual + self._by_number @ number_step
        steps = np.zeros((self.assumptions.view.max() + 1, 6))
        for number, view in enumerate(self.views):
            steps[number] = view.step(residual[view.coordinates], damping)
        return steps

    def change(self, number_step: np.ndarray, pose_steps: np.ndarray) -> np.ndarray:
        """Change of the rows by steps of numbers and poses, (2 n,)."""
        change = self._by_number @ number_step
        for view, step in zip(self.views, pose_steps, strict=False):
            change[view.coordinates] += view.change(step)
        return np.asarray(change)


def standardised(residual_px: np.ndarray, assumptions: Assumptions) -> np.ndarray:
    """Length of each residual in sigma, (n,); NaN of rows that are not there."""
    return np.asarray(np.hypot(*residual_px.T) / assumptions.sigma_px)


def _weights(residual_px: np.ndarray, assumptions: Assumptions) -> np.ndarray:
    """Weights of rows by Cauchy's loss, (n,); 0 of what is not there."""
    size = standardised(residual_px, assumptions)
    weight = np.ones(len(size))
    if assumptions.loss_scale is not None:
        weight = 1 / (1 + (size / assumptions.loss_scale) ** 2)
    return np.where(np.isfinite(size), weight, 0.0)
