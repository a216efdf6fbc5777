"""The pinhole of rows: a model of a camera over the part of the image and the depths that its targets cover.

A calibration sees no more of a camera than that. The pinhole of camera.json is that of the whole image with its
corners; as the pupil of a lens moves with the angle, it has another centre, and a principal distance to go with it.
This one is fitted as calibrations fit theirs, with the poses of the targets: each target may make a small rigid move.
Its centre is the mean of the true centre as the moved targets see it.

The least squares over parameters q and moves m of the targets, min |A q + B m + r|, are solved by Gauss and Newton with
variable projection: r and A are projected onto the complement of B, target by target, which eliminates the moves.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from pipeline.camera.figures import equivalent_pinhole as fit
from pipeline.camera.figures.equivalent_pinhole import F, Sightings
from pipeline.frames import apply, inverse, rigid
from pipeline.results.records import BuiltPinhole

_UNCERTAIN = 1e-4
"""Standard error of the principal distance from which rows do not determine it, relative: a fifth of what pinholes of
the image and of the rows of a wide lens differ by."""


def row_pinhole(image: BuiltPinhole, targets: Sequence[Sightings]) -> BuiltPinhole | str:
    """The pinhole that a calibration finds in exact rows, with the residual that it prints; or why they determine none.

    Principal distance and radial coefficients are fitted again, but stay those of camera.json if that reduces the
    residual by less than a tenth. Without displaced surfaces the centre lies on the axis.

    `image`: the pinhole with distortion of camera.json.
    `targets`: rows and true points, vision frame, of each target in each frame that shows some of its points.
    """
    start = np.zeros(fit.PARAMETERS)
    start[list(fit.TILT)] = image.tilt_rad
    start[[F, *fit.CENTRE, *fit.POINT]] = image.principal_distance_px, *image.centre_mm, *image.principal_point_px
    start[list(fit.BROWN)] = image.distortion[:5]
    free = (F, *(number for number in fit.RADIAL if start[number]))
    if sum(sightings.x_px.size for sightings in targets) <= 6 * len(targets) + len(free):
        return "too few points"
    try:
        # First only the targets move, then the free parameters change, too.
        adjusted = _Adjusted(start, tuple(targets), (np.eye(4),) * len(targets)).at_least_squares(())
        fitted = adjusted
        if adjusted.all_rows.rms_px(start) > fit.NOTHING_LEFT_PX:
            fitted = adjusted.at_least_squares(free)
    except np.linalg.LinAlgError:  # a step diverged
        return "boards as they stand leave the principal distance open"
    residual_px = fitted.all_rows.rms_px(fitted.parameters)
    if not fitted.error < _UNCERTAIN:
        finding = f"the principal distance is uncertain by {100 * fitted.error:.2g} %"
        return f"{finding}: too few points, boards all alike, or {residual_px:.2g} px rms that no pinhole explains"
    if residual_px < fit.WORTH_IT * adjusted.all_rows.rms_px(start):
        adjusted = fitted
    centres = np.array([apply(inverse(move), image.centre_mm) for move in adjusted.moves])
    centre_mm = np.average(centres, axis=0, weights=[len(sightings.x_px) for sightings in targets])
    projection = adjusted.all_rows.projection(adjusted.parameters)
    return BuiltPinhole(
        centre_mm=np.where(image.centre_mm[:2].any(), centre_mm, [0.0, 0.0, centre_mm[2]]),
        principal_distance_px=projection.principal_distance_px,
        principal_point_px=np.array(projection.principal_point_px),
        distortion=np.array(projection.distortion),
        rms_px=projection.rms_px,
        max_px=projection.max_px,
    )


@dataclass(frozen=True, slots=True)
class _Adjusted:
    """A pinhole and targets that have made rigid moves, (4, 4) each; `error` is the relative standard error of the
    principal distance, see `_UNCERTAIN`.
    """

    parameters: np.ndarray
    targets: tuple[Sightings, ...]
    moves: tuple[np.ndarray, ...]
    error: float = 0.0

    @property
    def all_rows(self) -> Sightings:
        """The rows of all targets."""
        names = ("x_px", "points_mm")
        return Sightings(*(np.concatenate([getattr(target, name) for target in self.targets]) for name in names))

    def at_least_squares(self, free: tuple[int, ...]) -> Self:
        """The targets and the parameters in `free` that minimise the residuals."""
        adjusted = self
        size_px = float(np.linalg.norm(self.all_rows.x_px))
        for _ in range(fit.STEPS):
            adjusted, change_px = adjusted._after_step(free)
            if not change_px > fit.SETTLED * size_px:
                break
        return adjusted

    def _after_step(self, free: tuple[int, ...]) -> tuple[Self, float]:
        """The state after a step of Gauss and Newton, and the largest change of a target's rows by its move [px]."""
        parameters = self.parameters.copy()
        # Derivatives by the free parameters, with the residual as a last column, and without the span of the moves.
        by_moves = []
        columns = []
        projected = []
        for target in self.targets:
            by_moves.append(_by_move(target, parameters))
            slopes = target.slopes(parameters, free)
            columns.append(np.column_stack([slopes, target.residuals(parameters).ravel()]))
            projected.append(_without(by_moves[-1], columns[-1]))
        remaining = np.concatenate(projected)
        scale = np.linalg.norm(np.concatenate(columns), axis=0)
        # Step of the parameters; columns are scaled to similar size.
        slopes = remaining[:, :-1] / scale[:-1]
        step = np.linalg.lstsq(slopes, -remaining[:, -1], rcond=None)[0] / scale[:-1] if free else np.zeros(0)
        parameters[list(free)] += step
        # Move of each target that goes with it
        targets = []
        moves = []
        change_px = 0.0
        for target, move_before, by_move, its_columns in zip(self.targets, self.moves, by_moves, columns, strict=True):
            turn_and_shift = np.linalg.lstsq(by_move, -its_columns @ [*step, 1.0], rcond=None)[0]
            move = _move(target, turn_and_shift)
            targets.append(replace(target, points_mm=apply(move, target.points_mm)))
            moves.append(move @ move_before)
            change_px = max(change_px, float(np.linalg.norm(by_move @ turn_and_shift)))
        # Standard error of the principal distance, the first free parameter: the residual per degree of freedom over
        # the part of its derivative that no other parameter and no move explains.
        error = 0.0
        if free:
            own_slope = np.linalg.norm(_without(slopes[:, 1:], slopes[:, :1])) * scale[0]
            freedom = len(remaining) - 6 * len(self.targets) - len(free)
            residual = np.linalg.norm(remaining[:, -1] + remaining[:, :-1] @ step) / math.sqrt(freedom)
            error = float(residual / own_slope / abs(parameters[F]))
        return replace(self, parameters=parameters, targets=tuple(targets), moves=tuple(moves), error=error), change_px


def _without(basis: np.ndarray, columns: np.ndarray) -> np.ndarray:
    """Columns less their projection on the span of a basis."""
    span = np.linalg.qr(basis)[0]
    return np.asarray(columns - span @ (span.T @ columns))


def _by_move(sightings: Sightings, p: np.ndarray) -> np.ndarray:
    """Derivatives of residuals by a turn of a target about the middle of its points and by a shift, (2 n, 6).

    Those by the shift are complex-step derivatives; those by the turn follow by the cross product with the lever arms.
    """
    steps = fit.IMAGINARY * 1j * np.eye(3)
    columns = [
        replace(sightings, points_mm=sightings.points_mm + step).residuals(p).imag / fit.IMAGINARY for step in steps
    ]
    by_shift = np.stack(columns, axis=-1)
    arms = (sightings.points_mm - sightings.points_mm.mean(axis=0))[:, None]
    return np.concatenate([np.cross(arms, by_shift), by_shift], axis=2).reshape(-1, 6)


def _move(sightings: Sightings, turn_and_shift: np.ndarray) -> np.ndarray:
    """The rigid transform of a small turn about the middle of the points, and of a shift, (4, 4).

    Cayley: with K the cross product matrix of half the turn, (1 - K)^-1 (1 + K) is a rotation.
    """
    half = np.cross(turn_and_shift[:3] / 2, np.eye(3)).T
    middle = sightings.points_mm.mean(axis=0)
    rotation = np.linalg.solve(np.eye(3) - half, np.eye(3) + half)
    return rigid(rotation, middle + turn_and_shift[3:] - rotation @ middle)
