"""Fisher information of the views of a data set about a camera: of a model's parameters, with all poses unknown.

With J the derivatives of all image positions by all unknowns and sigma the noise of each coordinate, J^T J / sigma^2
is the information, and its inverse the least covariance of any unbiased estimate (Cramér and Rao), which least squares
reach where residuals are small. Poses are eliminated view by view: their blocks do not touch each other.

A projection is predicted as mrcal predicts it: a point is kept at its place before every target, the poses of all views
carry it back to the camera, and the mean of where they do is projected. So what the poses can take over, as a turn of
the camera, is no uncertainty of the projection (mrcal, "Projection uncertainty", the mean of points in the camera's
frame).
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from scipy.spatial.transform import Rotation

from pipeline.camera.figures.equivalent_pinhole import IMAGINARY
from pipeline.frames import apply
from pipeline.records.shapes import Float64

_NOTHING = 1e-13
"""Share of the largest eigenvalue below which a direction of scaled parameters is undetermined [1]: roundings of sums
of some thousand squares are 1e-15 of it."""
_APART = 1e-3
"""Part of a parameter in an undetermined direction above which it is undetermined itself [1]."""
_STEPS, _SETTLED = 30, 1e-10
"""Most steps of Gauss and Newton, and the relative change of the sum of squares that ends them [1]."""
_DAMPED, _NEAR = 1e-12, 1e-3
"""First damping where a step without goes astray [1], each further one is a hundred times that; and the relative change
that ends damped steps [1]: they creep along what the views hardly tell."""
_POSE = 6
"""Unknowns of a pose: a turn and a shift."""

Project = Callable[[np.ndarray, np.ndarray, np.ndarray], np.ndarray]
"""Image positions (n, 2) by parameters (m,), points in the frame of the model (n, 3), and the rows' own numbers (n, k),
of which plenoptic models have the vertices of microlenses; analytic in the first two."""


@dataclass(frozen=True, slots=True)
class View:
    """Points of a target that are seen in a frame."""

    model_from_target: np.ndarray  # (4, 4) [mm]
    points_mm: Float64[np.ndarray, "n 3"]  # target frame
    row_numbers: Float64[np.ndarray, "n k"]  # of each row, which the model asks for besides
    x_px: Float64[np.ndarray, "n 2"]


@dataclass(frozen=True, slots=True)
class Block:
    """A view's part of the normal equations at a noise of 1 px: blocks of J^T J, and the gradient J^T r.

    `parameters` (m, m), `mixed` (m, 6), `pose` (6, 6), `gradient` (m + 6,).
    """

    parameters: np.ndarray
    mixed: np.ndarray
    pose: np.ndarray
    gradient: np.ndarray


@dataclass(frozen=True, slots=True)
class Information:
    """Information about the parameters of a model, at values that fit the views."""

    names: tuple[str, ...]
    parameters: np.ndarray  # (m,)
    views: tuple[View, ...]  # with the poses that fit
    residual_px: np.ndarray  # (n, 2), of all rows
    noise_px: float
    matrix: np.ndarray  # (m, m), with all poses unknown
    project: Project
    blocks: tuple[Block, ...]  # of the views

    @classmethod
    def of(cls, names: Sequence[str], project: Project, p: np.ndarray, views: Sequence[View], noise_px: float) -> Self:
        """The information at given values and poses."""
        blocks, residuals = zip(*(_block(project, p, view) for view in views), strict=True)
        matrix, _ = _without_poses(blocks)
        residual_px = np.concatenate(residuals)
        return cls(tuple(names), p, tuple(views), residual_px, noise_px, matrix / noise_px**2, project, blocks)

    def only(self, numbers: Sequence[int]) -> "Information":
        """The information of the views of these numbers."""
        blocks = tuple(self.blocks[i] for i in numbers)
        matrix, _ = _without_poses(blocks)
        views = tuple(self.views[i] for i in numbers)
        return replace(self, views=views, matrix=matrix / self.noise_px**2, blocks=blocks)

    @property
    def rank(self) -> int:
        """Number of directions of the parameters that the views determine."""
        return int((self.scaled[1] > 0).sum())

    @property
    def gauge(self) -> np.ndarray:
        """Directions that they do not, (m - rank, m), each of length 1 in parameters over their own deviations."""
        _, values, vectors = self.scaled
        return vectors[:, values == 0].T

    @property
    def covariance(self) -> np.ndarray:
        """Least covariance of the parameters, (m, m); undetermined directions are left out."""
        size, values, vectors = self.scaled
        determined = vectors[:, values > 0]
        return (determined / values[values > 0]) @ determined.T / np.outer(size, size)

    @property
    def deviations(self) -> np.ndarray:
        """Standard deviations of the parameters, (m,); infinite of what is undetermined."""
        is_open = (np.abs(self.gauge) > _APART).any(axis=0)
        return np.where(is_open, np.inf, np.sqrt(np.diag(self.covariance)))

    @property
    def scaled(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Sizes of the parameters' own information, known poses given, and eigenvalues and vectors of the matrix over
        them; an eigenvalue of nothing is 0.
        """
        with_known_poses = sum(np.diag(block.parameters) for block in self.blocks) / self.noise_px**2
        size = np.sqrt(np.where(with_known_poses > 0, with_known_poses, 1.0))  # of what no view sees, nothing
        values, vectors = np.linalg.eigh(self.matrix / np.outer(size, size))
        return size, np.where(values > _NOTHING * values.max(), values, 0.0), vectors

    def of_projections(
        self, points_mm: Float64[np.ndarray, "n 3"], row_numbers: Float64[np.ndarray, "n k"]
    ) -> np.ndarray:
        """Covariance of the projections of points in the frame of the model, (n, 2, 2) [px^2]; infinite where the views
        do not determine them.
        """
        by_parameter, by_point = derivatives(self.project, self.parameters, points_mm, row_numbers)
        of_poses = np.zeros((len(points_mm), 2, 2))
        share = 1 / len(self.views)  # of each view in the mean of where they carry a point
        for view, block in zip(self.views, self.blocks, strict=True):
            by_pose = share * _by_pose(by_point, points_mm, view.model_from_target[:3, 3])
            inverse = np.linalg.pinv(block.pose)
            by_parameter = by_parameter - by_pose @ inverse @ block.mixed.T  # the pose follows the parameters
            of_poses += by_pose @ inverse @ by_pose.transpose(0, 2, 1)
        of_parameters = by_parameter @ self.covariance @ by_parameter.transpose(0, 2, 1)
        covariance = of_parameters + self.noise_px**2 * of_poses
        # An undetermined direction has at least the variance of the least eigenvalue that counts.
        size, values, _ = self.scaled
        least = ((by_parameter @ (self.gauge / size).T) ** 2).sum(axis=(1, 2)) / (_NOTHING * values.max())
        covariance[least > np.trace(covariance, axis1=1, axis2=2)] = np.inf
        return covariance


def information(
    names: Sequence[str], project: Project, start: np.ndarray, views: Sequence[View], noise_px: float
) -> Information:
    """Fit a model and all poses to the rows of views, by Gauss and Newton, and take the information there."""
    fit, damping = Information.of(names, project, start, views, noise_px), 0.0
    for _ in range(_STEPS):
        trial = _stepped(fit, damping)
        before, after = float((fit.residual_px**2).sum()), float((trial.residual_px**2).sum())
        if after < before:
            fit = trial
        elif damping < 1 and not after - before <= _SETTLED * before:  # astray, along what the views hardly tell
            damping = max(100 * damping, _DAMPED)
            continue
        if before - after <= (_NEAR if damping else _SETTLED) * after:
            break
    return fit


def _stepped(fit: Information, damping: float) -> Information:
    """The model and all poses a step of Gauss and Newton nearer to the rows; `damping`: added to the information about
    directions of scaled parameters, over the largest.
    """
    _, gradient = _without_poses(fit.blocks)
    size, values, vectors = fit.scaled
    is_determined = values > 0
    directions, curvature = vectors[:, is_determined], values[is_determined] + damping * values.max()
    step = -directions @ (directions.T @ (gradient / size) / curvature) / size / fit.noise_px**2
    views = [_with_pose_after(view, block, step) for view, block in zip(fit.views, fit.blocks, strict=True)]
    return Information.of(fit.names, fit.project, fit.parameters + step, views, fit.noise_px)


def _block(project: Project, p: np.ndarray, view: View) -> tuple[Block, np.ndarray]:
    """A view's part, and its residuals (n, 2)."""
    points_mm = apply(view.model_from_target, view.points_mm)
    by_parameter, by_point = derivatives(project, p, points_mm, view.row_numbers)
    residual = project(p, points_mm, view.row_numbers) - view.x_px
    by_parameter = by_parameter.reshape(-1, len(p))
    by_pose = _by_pose(by_point, points_mm, view.model_from_target[:3, 3]).reshape(-1, _POSE)
    gradient = np.concatenate([by_parameter, by_pose], axis=1).T @ residual.ravel()
    return Block(by_parameter.T @ by_parameter, by_parameter.T @ by_pose, by_pose.T @ by_pose, gradient), residual


def _without_poses(blocks: Sequence[Block]) -> tuple[np.ndarray, np.ndarray]:
    """Information about the parameters alone, (m, m), and their gradient, (m,), with all poses eliminated: the sum of
    the Schur complements of the blocks.
    """
    m = len(blocks[0].parameters)
    matrix, gradient = np.zeros((m, m)), np.zeros(m)
    for block in blocks:
        inverse = np.linalg.pinv(block.pose)
        matrix += block.parameters - block.mixed @ inverse @ block.mixed.T
        gradient += block.gradient[:m] - block.mixed @ inverse @ block.gradient[m:]
    return (matrix + matrix.T) / 2, gradient


def _with_pose_after(view: View, block: Block, step: np.ndarray) -> View:
    """The view at the pose that fits best after a step of the parameters."""
    turn, shift = np.split(-np.linalg.pinv(block.pose) @ (block.gradient[len(step) :] + block.mixed.T @ step), 2)
    pose = view.model_from_target.copy()
    pose[:3, :3] = Rotation.from_rotvec(turn).as_matrix() @ pose[:3, :3]
    pose[:3, 3] += shift
    return replace(view, model_from_target=pose)


def derivatives(
    project: Project, p: np.ndarray, points: np.ndarray, row_numbers: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Derivatives of projections by parameters (n, 2, m) and by points (n, 2, 3), by complex steps."""
    h = 1j * IMAGINARY
    by_parameter = [project(p + h * axis, points, row_numbers).imag for axis in np.eye(len(p))]
    by_point = [project(p.astype(complex), points + h * axis, row_numbers).imag for axis in np.eye(3)]
    return np.stack(by_parameter, axis=-1) / IMAGINARY, np.stack(by_point, axis=-1) / IMAGINARY


def _by_pose(by_point: np.ndarray, points: np.ndarray, pivot: np.ndarray) -> np.ndarray:
    """Derivatives by a small turn [rad] of the target about its origin and a shift [mm], (n, 2, 6)."""
    x, y, z = (points - pivot).T
    zero = np.zeros(len(points))
    point_by_turn = np.array([[zero, z, -y], [-z, zero, x], [y, -x, zero]]).transpose(2, 0, 1)
    return np.concatenate([by_point @ point_by_turn, by_point], axis=2)
