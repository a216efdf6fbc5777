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

OPEN = 1e-6
"""Singular value of columns over their sizes, of numbers by what rows tell of them where poses are known, below which a
direction is open [1]: derivatives are right to that."""
NOTHING = 1e-300
"""Size of a column that stands for 0."""


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
    """Singular value decomposition of columns over their sizes.

    `open`, `told`: directions that are open and those that are not, (unknowns - k, unknowns) and (k, unknowns), in
    unknowns times the sizes of their columns. `values`, `basis`: of those that are not, (k,) and (rows, k).
    """

    def __init__(self, columns: np.ndarray, size: np.ndarray) -> None:
        self.size = size
        left, values, right = np.linalg.svd(columns / size, full_matrices=False)
        is_told = values > OPEN
        self.open, self.told = right[~is_told], right[is_told]
        self.values, self.basis = values[is_told], left[:, is_told]

    @property
    def covariance(self) -> np.ndarray:
        """Covariance of the unknowns, with what is open left out."""
        half = self.told.T / self.values / self.size[:, None]
        return half @ half.T

    @property
    def largest(self) -> float:
        """Largest singular value; 0 where all directions are open."""
        return float(np.max(self.values, initial=0.0))

    def step(self, off: np.ndarray, damping: float, curvature: np.ndarray) -> np.ndarray:
        """Step of the unknowns that makes the sum of squares of `off` smaller, and is 0 along what is open.

        `curvature`: of half that sum beyond that of the columns, (unknowns, unknowns).
        """
        along = self.told / self.size
        matrix = np.diag(self.values**2 + damping * self.largest**2) + along @ curvature @ along.T
        return np.asarray(-along.T @ np.linalg.solve(matrix, self.values * (self.basis.T @ off)))


@dataclass(frozen=True)
class _View:
    """Rows of a board in a frame: their coordinates (c,), and what its pose does to them, in units of sigma.

    `by_pose`: (c, 6), as in `Slopes`; `arm_mm`: from the origin of the board to the point, (c, 3).
    """

    coordinates: np.ndarray
    by_pose: np.ndarray
    arm_mm: np.ndarray

    @cached_property
    def columns(self) -> _Columns:
        """The columns of its pose."""
        return _Columns(self.by_pose, np.maximum(np.linalg.norm(self.by_pose, axis=0), NOTHING))

    def change(self, step: np.ndarray) -> np.ndarray:
        """Change of the coordinates by a step of the pose, (c,): straight in where points go, not in the turn."""
        turn = step[:3]
        bend_mm = Rotation.from_rotvec(turn).apply(self.arm_mm) - self.arm_mm - np.cross(turn, self.arm_mm)
        return np.asarray(self.by_pose @ step + np.einsum("ci,ci->c", self.by_pose[:, 3:], bend_mm))

    def step(self, off: np.ndarray, damping: float) -> np.ndarray:
        """Step of the pose that makes the sum of squares of `off`, (c,), smallest; 0 along what is open."""
        told = self.columns.told / self.columns.size
        if not len(told):
            return np.zeros(6)
        weight = np.sqrt(damping) * self.columns.largest * self.columns.size

        def fit(start: np.ndarray) -> tuple[float, np.ndarray]:
            def left(along: np.ndarray) -> np.ndarray:
                step = start + told.T @ along
                return np.concatenate([off + self.change(step), weight * step])

            best = least_squares(left, np.zeros(len(told)), method="lm", ftol=1e-15, xtol=1e-12, gtol=1e-15)
            return best.cost, start + told.T @ best.x

        return min((fit(start) for start in (np.zeros(6), self._mirrored)), key=lambda each: each[0])[1]

    @property
    def _mirrored(self) -> np.ndarray:
        """Step to the pose with the opposite tilt, from which a narrow field sees a flat board nearly alike, (6,)."""
        middle_mm = self.arm_mm.mean(axis=0)
        normal = np.linalg.svd(self.arm_mm - middle_mm, full_matrices=False)[2][-1]
        x_by_mm, y_by_mm = self.by_pose[::2, 3:], self.by_pose[1::2, 3:]
        sight = np.cross(x_by_mm, y_by_mm).sum(axis=0)
        sight = sight * np.sign(normal @ sight)
        axis = np.cross(normal, sight)
        angle = 2 * np.arctan2(np.linalg.norm(axis), normal @ sight)
        turn = angle * axis / max(np.linalg.norm(axis), NOTHING)
        return np.concatenate([turn, middle_mm - Rotation.from_rotvec(turn).apply(middle_mm)])


class Linear:
    """Rows near numbers and poses, in units of sigma, as they count: `weight` by Cauchy's loss, 0 of what is not there.

    `by_number`, `off`: derivatives (2 n, m) and residuals (2 n,); a row without derivatives, of a bundle in pieces, is
    0. `views`: none if poses are known.
    """

    def __init__(self, slopes: Slopes, residual: np.ndarray, asked: Asked) -> None:
        self.slopes, self.asked, self.weight = slopes, asked, _weights(residual, asked)
        self.is_told = (self.weight > 0) & _tells(slopes)
        self._root = np.where(self.is_told, np.sqrt(self.weight) / asked.sigma_px, 0.0)
        self.off, self.by_number = self.scaled(residual[:, :, None])[:, 0], self.scaled(slopes.by_number)
        by_pose, arm_mm = self.scaled(slopes.by_pose), np.repeat(slopes.arm_mm, 2, axis=0)
        self.views = list[_View]()
        for view in range(asked.view.max() + 1) if asked.has_free_poses else ():
            coordinates = np.flatnonzero(np.repeat(asked.view == view, 2))
            self.views.append(_View(coordinates, by_pose[coordinates], arm_mm[coordinates]))
        self._reduced = self.without_poses(np.column_stack([self.by_number, self.off]))

    def scaled(self, columns: np.ndarray) -> np.ndarray:
        """Columns of rows, (n, 2, k) [px], in units of sigma and as they count, (2 n, k)."""
        counted = self._root[:, None, None] * np.where(self._root[:, None, None] > 0, columns, 0.0)
        return counted.reshape(2 * len(columns), columns.shape[2])

    def without_poses(self, columns: np.ndarray) -> np.ndarray:
        """Columns (2 n, k) without the parts that poses take up."""
        left = columns.copy()
        for view in self.views:
            basis = view.columns.basis
            left[view.coordinates] -= basis @ (basis.T @ columns[view.coordinates])
        return left

    def numbers(self, held: np.ndarray, of: np.ndarray | slice = slice(None)) -> _Columns:
        """Numbers, or some of them, by rows if poses follow, and below these by what holds each, (m,)."""
        held, size = held[of], np.linalg.norm(self.by_number[:, of], axis=0)
        size = np.where(size > 0, size, np.where(held > 0, held, 1.0))
        return _Columns(np.concatenate([self._reduced[:, :-1][:, of], np.diag(held)]), size)

    def off_with(self, by: np.ndarray, of: np.ndarray | slice = slice(None)) -> np.ndarray:
        """Residuals if poses follow, and below them those of priors at numbers `by`, or some of these."""
        return np.concatenate([self._reduced[:, -1], (by / self.asked.deviation)[of]])

    def gradient(self, by: np.ndarray) -> np.ndarray:
        """Gradient of half of chi squared by numbers if poses follow, at numbers `by`, (m,)."""
        return np.asarray(self._reduced[:, :-1].T @ self._reduced[:, -1] + by / self.asked.deviation**2)

    def decrement(self, by: np.ndarray) -> float:
        """Decrease of chi squared that a step of the numbers would bring if rows were straight."""
        return float(((self.numbers(1 / self.asked.deviation).basis.T @ self.off_with(by)) ** 2).sum())

    def gradient_change(self, by_step: np.ndarray) -> np.ndarray:
        """Change of that gradient by a step, if rows are straight, (m,)."""
        columns = self._reduced[:, :-1]
        return np.asarray(columns.T @ (columns @ by_step) + by_step / self.asked.deviation**2)

    def step(self, by: np.ndarray, damping: float, curvature: np.ndarray) -> np.ndarray:
        """Step of the numbers; those at a bound that would leave it stay there. `curvature`: that of rows, (m, m)."""
        asked, step, is_free = self.asked, by, np.ones(len(by), bool)
        for _ in range(len(by)):
            step = np.zeros(len(by))
            columns, off = self.numbers(1 / asked.deviation, is_free), self.off_with(by, is_free)
            step[is_free] = columns.step(off, damping, curvature[np.ix_(is_free, is_free)])
            at_bound = is_free & (np.abs(by + step) > asked.reach) & (np.abs(by) >= asked.reach)
            if not at_bound.any():
                break
            is_free &= ~at_bound
        return np.asarray(np.clip(by + step, -asked.reach, asked.reach) - by)

    def pose_steps(self, by_step: np.ndarray, damping: float) -> np.ndarray:
        """Steps of poses that fit best to numbers that move by so much, (v, 6)."""
        off, steps = self.off + self.by_number @ by_step, np.zeros((self.asked.view.max() + 1, 6))
        for number, view in enumerate(self.views):
            steps[number] = view.step(off[view.coordinates], damping)
        return steps

    def change(self, by_step: np.ndarray, pose_steps: np.ndarray) -> np.ndarray:
        """Change of the rows by steps of numbers and poses, (2 n,)."""
        change = self.by_number @ by_step
        for view, step in zip(self.views, pose_steps, strict=False):
            change[view.coordinates] += view.change(step)
        return np.asarray(change)


def scale(residual: np.ndarray, asked: Asked) -> np.ndarray:
    """Length of each residual in sigma, (n,); NaN of rows that are not there."""
    return np.asarray(np.hypot(*residual.T) / asked.sigma_px)


def _weights(residual: np.ndarray, asked: Asked) -> np.ndarray:
    """Weights of rows by Cauchy's loss, (n,); 0 of what is not there."""
    size = scale(residual, asked)
    weight = np.ones(len(size)) if asked.loss_scale is None else 1 / (1 + (size / asked.loss_scale) ** 2)
    return np.where(np.isfinite(size), weight, 0.0)


def _tells(slopes: Slopes) -> np.ndarray:
    """Rows with derivatives, (n,): others, of a bundle in pieces, take no part in a step."""
    return np.asarray(np.isfinite(slopes.by_pose).all(axis=(1, 2)) & np.isfinite(slopes.by_number).all(axis=(1, 2)))
