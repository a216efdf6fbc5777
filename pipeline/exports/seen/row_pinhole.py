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

from pipeline.camera.figures.pinhole_fit import (
    CENTRE,
    IMAGINARY,
    NOTHING_LEFT_PX,
    POINT,
    RADIAL,
    SETTLED,
    STEPS,
    TANGENTIAL,
    WORTH_IT,
    F,
    Sightings,
)
from pipeline.frames import apply, inverse, rigid
from pipeline.results.records import BuiltPinhole

_UNCERTAIN = 1e-4
"""Standard error of the principal distance from which rows do not determine it, relative: a fifth of what pinholes of
the image and of the rows of a wide lens differ by."""


def row_pinhole(image: BuiltPinhole, seen: Sequence[Sightings]) -> BuiltPinhole | None:
    """The pinhole that a calibration finds in exact rows, with the residual that it prints; None: rows determine none.

    Principal distance and the radial coefficients of the pinhole of camera.json are fitted again; they are kept where
    others leave no tenth less. Without displaced surfaces the centre lies on the axis.

    Parameters
    ----------
    image : BuiltPinhole
        The pinhole with distortion of camera.json.
    seen : sequence of Sightings
        Rows of each target in each frame that shows some, where it truly is.
    """
    start = np.zeros(11)
    start[[F, *CENTRE, *POINT]] = image.principal_distance_px, *image.centre_mm, *image.principal_point_px
    start[[*RADIAL, *TANGENTIAL]] = image.distortion[[0, 1, 4, 2, 3]]
    free = (F, *(number for number in RADIAL if start[number]))
    if sum(one.x_px.size for one in seen) <= 6 * len(seen) + len(free):
        return None
    found = _Adjusted(start, tuple(seen), (np.eye(4),) * len(seen)).settled(())
    if found.together.rms_px(start) > NOTHING_LEFT_PX:
        try:
            nearer = found.settled(free)
        except np.linalg.LinAlgError:  # it ran away
            return None
        if not nearer.error < _UNCERTAIN:
            return None
        if nearer.together.rms_px(nearer.parameters) < WORTH_IT * found.together.rms_px(start):
            found = nearer
    centres = np.array([apply(inverse(move), image.centre_mm) for move in found.moves])
    centre_mm = np.average(centres, axis=0, weights=[len(one.x_px) for one in seen])
    projection = found.together.projection(found.parameters)
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
    seen: tuple[Sightings, ...]
    moves: tuple[np.ndarray, ...]
    error: float = 0.0

    @property
    def together(self) -> Sightings:
        """All rows."""
        return Sightings(*(np.concatenate([getattr(one, name) for one in self.seen]) for name in ("x_px", "places_mm")))

    def settled(self, free: tuple[int, ...]) -> Self:
        """Targets and the parameters in `free` at least squares."""
        found, size_px = self, float(np.linalg.norm(self.together.x_px))
        for _ in range(STEPS):
            found, change_px = found._nearer(free)
            if not change_px > SETTLED * size_px:
                break
        return found

    def _nearer(self, free: tuple[int, ...]) -> tuple[Self, float]:
        """A step of Gauss and Newton, and its change of the rows by moves [px]; these are eliminated one by one."""
        p, eliminated, parts = self.parameters.copy(), [], []
        for one in self.seen:
            by_move, own = _by_move(one, p), np.column_stack([one.slopes(p, free), one.residuals(p).ravel()])
            eliminated.append(_without(by_move, own))
            parts.append((by_move, own))
        left, scale = np.concatenate(eliminated), np.linalg.norm(np.concatenate([own for _, own in parts]), axis=0)
        slopes = left[:, :-1] / scale[:-1]
        step = np.linalg.lstsq(slopes, -left[:, -1], rcond=None)[0] / scale[:-1] if free else np.zeros(0)
        p[list(free)] += step
        seen, moves, change_px = [], [], 0.0
        for one, before, (by_move, own) in zip(self.seen, self.moves, parts, strict=True):
            turn_and_shift = np.linalg.lstsq(by_move, -own @ [*step, 1.0], rcond=None)[0]
            move = _move(one, turn_and_shift)
            seen.append(replace(one, places_mm=apply(move, one.places_mm)))
            moves.append(move @ before)
            change_px = max(change_px, float(np.linalg.norm(by_move @ turn_and_shift)))
        error = 0.0
        if free:
            own = np.linalg.norm(_without(slopes[:, 1:], slopes[:, :1])) * scale[0]
            spare = len(left) - 6 * len(self.seen) - len(free)
            off = np.linalg.norm(left[:, -1] + left[:, :-1] @ step) / math.sqrt(spare)
            error = float(off / own / p[F])
        return replace(self, parameters=p, seen=tuple(seen), moves=tuple(moves), error=error), change_px


def _without(columns: np.ndarray, others: np.ndarray) -> np.ndarray:
    """Other columns less their projection on the span of these."""
    span = np.linalg.qr(columns)[0]
    return np.asarray(others - span @ (span.T @ others))


def _by_move(one: Sightings, p: np.ndarray) -> np.ndarray:
    """Derivatives of residuals by a turn of a target about the middle of its points and by a shift, (2 n, 6)."""
    steps = IMAGINARY * 1j * np.eye(3)
    off = [replace(one, places_mm=one.places_mm + step).residuals(p).imag / IMAGINARY for step in steps]
    by_place = np.stack(off, axis=-1)
    arms = (one.places_mm - one.places_mm.mean(axis=0))[:, None]
    return np.concatenate([np.cross(arms, by_place), by_place], axis=2).reshape(-1, 6)


def _move(one: Sightings, turn_and_shift: np.ndarray) -> np.ndarray:
    """The rigid transform of a small turn about the middle of the points, by Cayley, and of a shift, (4, 4)."""
    half, middle = np.cross(turn_and_shift[:3] / 2, np.eye(3)).T, one.places_mm.mean(axis=0)
    rotation = np.linalg.solve(np.eye(3) - half, np.eye(3) + half)
    return rigid(rotation, middle + turn_and_shift[3:] - rotation @ middle)
