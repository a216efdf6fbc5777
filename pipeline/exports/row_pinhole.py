"""The pinhole of rows: what stands for a camera over the area and the depths that its targets cover.

A calibration sees no more of a camera than that. The pinhole of camera.json is that of the whole image with its
corners; as the pupil of a lens moves with the angle, it has another centre, and a principal distance to go with it.
This one is found as calibrations find theirs, by targets that may move. It stands where these see the true centre.
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

    Principal distance and the radial coefficients of the pinhole of camera.json are fitted again; they are kept where
    others leave no tenth less. Without displaced surfaces the centre lies on the axis.

    `image`: the pinhole with distortion of camera.json.
    `targets`: rows of each target in each frame that shows some, where it truly is.
    """
    start = np.zeros(fit.PARAMETERS)
    start[list(fit.TILT)] = image.tilt_rad
    start[[F, *fit.CENTRE, *fit.POINT]] = image.principal_distance_px, *image.centre_mm, *image.principal_point_px
    start[list(fit.BROWN)] = image.distortion[:5]
    free = (F, *(number for number in fit.RADIAL if start[number]))
    if sum(sightings.x_px.size for sightings in targets) <= 6 * len(targets) + len(free):
        return "too few points"
    try:
        adjusted = _Adjusted(start, tuple(targets), (np.eye(4),) * len(targets)).settled(())
        nearer = adjusted
        if adjusted.together.rms_px(start) > fit.NOTHING_LEFT_PX:
            nearer = adjusted.settled(free)
    except np.linalg.LinAlgError:  # it ran away
        return "boards as they stand leave the principal distance open"
    left_px = nearer.together.rms_px(nearer.parameters)
    if not nearer.error < _UNCERTAIN:
        off = f"the principal distance is uncertain by {100 * nearer.error:.2g} %"
        return f"{off}: too few points, boards all alike, or {left_px:.2g} px rms that no pinhole explains"
    if left_px < fit.WORTH_IT * adjusted.together.rms_px(start):
        adjusted = nearer
    centres = np.array([apply(inverse(move), image.centre_mm) for move in adjusted.moves])
    centre_mm = np.average(centres, axis=0, weights=[len(sightings.x_px) for sightings in targets])
    projection = adjusted.together.projection(adjusted.parameters)
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
    """A pinhole before targets that have moved, each by a rigid `moves` (4, 4), and the `error` of `_UNCERTAIN`."""

    parameters: np.ndarray
    targets: tuple[Sightings, ...]
    moves: tuple[np.ndarray, ...]
    error: float = 0.0

    @property
    def together(self) -> Sightings:
        names = ("x_px", "points_mm")
        return Sightings(*(np.concatenate([getattr(target, name) for target in self.targets]) for name in names))

    def settled(self, free: tuple[int, ...]) -> Self:
        """Targets and the parameters in `free` at least squares."""
        adjusted, size_px = self, float(np.linalg.norm(self.together.x_px))
        for _ in range(fit.STEPS):
            adjusted, change_px = adjusted._nearer(free)
            if not change_px > fit.SETTLED * size_px:
                break
        return adjusted

    def _nearer(self, free: tuple[int, ...]) -> tuple[Self, float]:
        """A step of Gauss and Newton, and its change of the rows by moves [px]; these are eliminated one by one."""
        p, eliminated, parts = self.parameters.copy(), [], []
        for target in self.targets:
            by_move = _by_move(target, p)
            shared = np.column_stack([target.slopes(p, free), target.residuals(p).ravel()])
            eliminated.append(_without(by_move, shared))
            parts.append((by_move, shared))
        left, scale = np.concatenate(eliminated), np.linalg.norm(np.concatenate([part[1] for part in parts]), axis=0)
        slopes = left[:, :-1] / scale[:-1]
        step = np.linalg.lstsq(slopes, -left[:, -1], rcond=None)[0] / scale[:-1] if free else np.zeros(0)
        p[list(free)] += step
        targets, moves, change_px = [], [], 0.0
        for target, before, (by_move, shared) in zip(self.targets, self.moves, parts, strict=True):
            turn_and_shift = np.linalg.lstsq(by_move, -shared @ [*step, 1.0], rcond=None)[0]
            move = _move(target, turn_and_shift)
            targets.append(replace(target, points_mm=apply(move, target.points_mm)))
            moves.append(move @ before)
            change_px = max(change_px, float(np.linalg.norm(by_move @ turn_and_shift)))
        error = 0.0
        if free:
            steepness = np.linalg.norm(_without(slopes[:, 1:], slopes[:, :1])) * scale[0]
            spare = len(left) - 6 * len(self.targets) - len(free)
            off = np.linalg.norm(left[:, -1] + left[:, :-1] @ step) / math.sqrt(spare)
            error = float(off / steepness / abs(p[F]))
        return replace(self, parameters=p, targets=tuple(targets), moves=tuple(moves), error=error), change_px


def _without(basis: np.ndarray, columns: np.ndarray) -> np.ndarray:
    """Columns less their projection on the span of a basis."""
    span = np.linalg.qr(basis)[0]
    return np.asarray(columns - span @ (span.T @ columns))


def _by_move(sightings: Sightings, p: np.ndarray) -> np.ndarray:
    """Derivatives of residuals by a turn of a target about the middle of its points and by a shift, (2 n, 6)."""
    steps = fit.IMAGINARY * 1j * np.eye(3)
    off = [replace(sightings, points_mm=sightings.points_mm + step).residuals(p).imag / fit.IMAGINARY for step in steps]
    by_place = np.stack(off, axis=-1)
    arms = (sightings.points_mm - sightings.points_mm.mean(axis=0))[:, None]
    return np.concatenate([np.cross(arms, by_place), by_place], axis=2).reshape(-1, 6)


def _move(sightings: Sightings, turn_and_shift: np.ndarray) -> np.ndarray:
    """The rigid transform of a small turn about the middle of the points, by Cayley, and of a shift, (4, 4)."""
    half, middle = np.cross(turn_and_shift[:3] / 2, np.eye(3)).T, sightings.points_mm.mean(axis=0)
    rotation = np.linalg.solve(np.eye(3) - half, np.eye(3) + half)
    return rigid(rotation, middle + turn_and_shift[3:] - rotation @ middle)
