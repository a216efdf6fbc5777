"""Calibration of a stage by what a real camera sees: `pipeline calibrate`."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from pipeline.errors import UsageError
from pipeline.plugins.fits.association import associated
from pipeline.plugins.fits.first_poses import first_poses
from pipeline.plugins.fits.free_numbers import FreeStage
from pipeline.plugins.fits.linear_rows import Assumptions
from pipeline.plugins.fits.observations import Stated, concatenated, read_observations
from pipeline.plugins.fits.predicted_rows import Predictor, Slopes, Views
from pipeline.plugins.fits.solver import Solution, solve
from pipeline.plugins.fits.twin import Twin

_ROUNDS, _SETTLED_OFFSET = 6, 0.01
"""Most rounds in which other positions than those of J are found where the camera is then, and the change of these over
sigma that ends them [1]."""
_WHOLE, _LEADING = 0.999, 0.8
"""Hit fraction from which on a row has all of its light, and the least part of rows that lead a fit [1]."""


class _StageRows:
    """The problem of the solver: rows of a stage at corrected numbers and at poses.

    `offset_px`: from the position of J to that which the detector looks for, (n, 2); it hardly changes with a camera.
    `is_taken`: of each row, (n,).
    """

    def __init__(self, stage: FreeStage, predictor: Predictor, offset_px: np.ndarray, is_taken: np.ndarray) -> None:
        self._stage, self._predictor, self._is_taken = stage, predictor, is_taken
        self._detected_px = predictor.observations.x_px
        self._observed_px = self._detected_px - offset_px  # the position of J, as it were

    def residual(self, correction: np.ndarray, poses: np.ndarray, near: np.ndarray | None = None) -> np.ndarray:
        """Predicted minus observed positions, (n, 2) [px]; NaN of rows that the stage does not have or that are not
        taken.
        """
        start_px = self._observed_px if near is None else self._observed_px + near
        start_px = np.where(np.isfinite(start_px), start_px, self._detected_px)
        residual_px = self._predictor.positions(self._stage.at(correction), poses, start_px) - self._observed_px
        return np.where(self._is_taken[:, None], residual_px, np.nan)

    def slopes(self, correction: np.ndarray, poses: np.ndarray, residual: np.ndarray) -> Slopes:
        """Derivatives where rows have these residuals."""
        dataset, neighbours = self._stage.at(correction), self._stage.neighbours(correction)
        steps = [number.step for number in self._stage.numbers]
        return self._predictor.slopes(dataset, neighbours, steps, poses, self._observed_px + residual)


def calibrate(
    stage: FreeStage,
    files: Sequence[Path],
    stated: Stated,
    *,
    loss_scale: float | None = None,
    known_poses: bool = False,
    tell: Callable[[str], None] = lambda _: None,
) -> Twin:
    """Fit the free numbers of a dataset, and the poses of its boards unless they are known, to observed positions.

    Raises UsageError: a file cannot be read, does not belong to the dataset, or no pose of a board fits.
    """
    observations = concatenated([associated(read_observations(file, stated), stage.nominal) for file in files])
    views = Views.of(observations)
    if known_poses:
        poses = views.poses(stage.nominal)
    else:
        _require_poses_once(stage)
        poses = first_poses(observations, views, stage.nominal)
    coordinates = 2 * len(observations)
    unknowns = len(stage.numbers) + (0 if known_poses else 6 * len(views.keys))
    if coordinates < unknowns:
        hint = "free less, or give more images"
        raise UsageError(f"{coordinates} coordinates do not tell {unknowns} unknowns", hint=hint)
    assumptions = Assumptions(
        sigma_px=observations.sigma_px,
        view=views.of_rows,
        prior_deviation=np.array([number.deviation for number in stage.numbers]),
        reach=np.array([number.reach for number in stage.numbers]),
        has_free_poses=not known_poses,
        loss_scale=loss_scale,
    )
    solution = _solved(stage, Predictor(observations, views), assumptions, poses, tell)
    return Twin(stage=stage, observations=observations, views=views, solution=solution)


def _solved(
    stage: FreeStage, predictor: Predictor, assumptions: Assumptions, poses: np.ndarray, tell: Callable[[str], None]
) -> Solution:
    """The solution by the positions that the detector looks for, which are found again where the camera is then."""
    observations, correction = predictor.observations, np.zeros(len(stage.numbers))

    def offsets_px() -> np.ndarray:
        tell(f"looking for positions: {observations.kinds}")
        return predictor.offsets(stage.at(correction), poses, observations.x_px)

    def rows(is_taken: np.ndarray) -> _StageRows:
        return _StageRows(stage, predictor, offset_px, is_taken)

    offset_px = offsets_px()
    if np.isnan(offset_px).all():
        hint = "corners of squares have a saddle, discs a centroid, and all points exact"
        raise UsageError(f"no point of the boards has this position: {observations.kinds}", hint=hint)
    steps, everything = 0, np.ones(len(observations), bool)
    if any(entry.camera.microlenses for entry in stage.nominal.cameras):
        is_there, is_whole = (
            np.isfinite(predictor.positions(stage.nominal, poses, observations.x_px, least)[:, 0])
            for least in (0.0, _WHOLE)
        )
        if is_whole.mean() > _LEADING and not is_there.all():
            # Rims of micro-images that are not in their places cut the light of rows, and would hold the fit by these.
            leading = solve(rows(is_whole), assumptions, correction, poses, tell)
            steps = leading.steps
            if leading.converged:
                correction, poses = leading.correction, leading.poses
    for _ in range(_ROUNDS):
        solution = solve(rows(everything), assumptions, correction, poses, tell)
        correction, poses, steps = solution.correction, solution.poses, steps + solution.steps
        last_px, offset_px = offset_px, offsets_px()
        if not (np.abs(offset_px - last_px) >= _SETTLED_OFFSET * observations.sigma_px[:, None]).any():
            return replace(solution, steps=steps)
    ending = "the positions that the detector looks for did not settle"
    return replace(solution, steps=steps, converged=False, ending=ending)


def _require_poses_once(stage: FreeStage) -> None:
    """UsageError: a number is part of the pose of a board, which is free in each frame anyway."""
    boards = {entry.prim_path for entry in stage.nominal.targets}
    for number in stage.numbers:
        attribute, _ = number.entries[0]
        if str(attribute.GetPrim().GetPath()) in boards and attribute.GetName().startswith("xformOp:"):
            message = f"{number.name} is part of the pose of a board, and these are free in each frame"
            raise UsageError(message, hint="leave it out, or say --poses known")
