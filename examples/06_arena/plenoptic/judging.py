"""The judge of plenoptic calibrations: it knows no contestant. Models come in, numbers go out.

A calibration's frame is free: a model is moved and turned (six numbers, no scale) until it explains the exact rows of
the boards' distances best, and then asked where it images points all over the field, through every microlens.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from judge import covered
from rows import Rows
from scipy.optimize import least_squares
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation
from truth import Model, Truth

Answer = dict[str, Any]
_LEAST = 3
"""Least microlenses that must see a point whose depth is asked [1]."""
_INNER = 0.35
"""Part of the pitch within which a corner's disparity is asked [1]."""
_WRONG_PX = 1.0
"""Error from which a disparity is wrong [px]: a match of something else."""


@dataclass(frozen=True, slots=True)
class Calibration:
    """A calibrated model, its parameters, poses (v, 4, 4) of our frame of the board in some views (v,), and the
    residual that it prints [px]."""

    model: Model
    parameters: dict[str, float]
    poses: np.ndarray
    views: np.ndarray
    rms_px: float


@dataclass(frozen=True, slots=True)
class ErrorField:
    """Error of a model at rows of the field: `error_px` (n, 2), and the model's frame from the vision frame (4, 4).

    `is_covered` (n,) are rows within the convex hull of all positions of boards: elsewhere a calibration guesses.
    """

    rows: Rows
    is_covered: np.ndarray
    error_px: np.ndarray
    model_from_vision: np.ndarray

    def rms_px(self, of: np.ndarray) -> float:
        """Root mean square length over some rows (n,) bool."""
        lengths = (self.error_px[of] ** 2).sum(axis=1)
        return float(np.sqrt(np.nanmean(lengths))) if np.isfinite(lengths).any() else float("nan")


def judged(truth: Truth, kinds: dict[str, Calibration], noisy: list[Calibration], true: dict[str, float]) -> Answer:
    """What calibrations from several kinds of rows are worth, and those from rows with noise in common: errors, and the
    spread of parameters; beside true parameters."""
    answer: Answer = {kind: calibrated(truth, calibration) for kind, calibration in kinds.items()}
    answer["true"] = true
    if noisy:
        parts = [calibrated(truth, calibration) for calibration in noisy]
        values = np.array([[*calibration.parameters.values()] for calibration in noisy])
        answer["spread"] = dict(zip(noisy[0].parameters, values.std(axis=0, ddof=1).tolist(), strict=True))
        errors = ("own_rms_px", "field_px", "outside_px", "chief_px", "marginal_px", "depth_mm", "pose")
        squares = {name: np.square([part[name] for part in parts]) for name in errors}
        answer["noise"] = {name: np.sqrt(np.mean(square, axis=0)).tolist() for name, square in squares.items()}
    return answer


def calibrated(truth: Truth, calibration: Calibration) -> Answer:
    """What a calibration is worth: the residual that it prints, and what is true of it."""
    field = error_field(truth, calibration.model)
    rows, is_covered = field.rows, field.is_covered
    inside = np.hypot(*(rows.image_px - truth.centre_px[rows.microlens]).T)
    boards = np.isin(rows.view, range(1, len(truth.distances_mm) - 1))
    radius = np.quantile(inside, 2 / 3)
    return {
        "own_rms_px": calibration.rms_px,
        "distances_mm": truth.distances_mm.tolist(),
        "field_px": [field.rms_px(is_covered & (rows.view == number)) for number in range(len(truth.distances_mm))],
        "outside_px": field.rms_px(boards & ~is_covered),
        "chief_px": field.rms_px(boards & is_covered & (inside < radius)),
        "marginal_px": field.rms_px(boards & is_covered & (inside >= radius)),
        "depth_mm": depth_errors_mm(truth, calibration.model, field)[:, 0].tolist(),
        "pose": pose_errors(truth, calibration.poses, calibration.views),
        "parameters": calibration.parameters,
    }


def error_field(truth: Truth, model: Model) -> ErrorField:
    """Project the field by a model that is laid over the camera at the distances of the boards."""
    rows, is_covered = truth.field, covered(truth.field.image_px, truth.boards.image_px)
    inner = is_covered & np.isin(rows.view, range(1, len(truth.distances_mm) - 1))

    def errors(motion: np.ndarray, part: Rows) -> np.ndarray:
        moved = part.points_mm @ Rotation.from_rotvec(motion[:3]).as_matrix().T + motion[3:]
        return model.project(moved, part.microlens) - part.image_px

    part = rows.only(inner)
    part = part.only(np.isfinite(errors(np.zeros(6), part)).all(axis=1))
    best = least_squares(
        lambda motion: errors(motion, part).ravel(), np.zeros(6), x_scale=[1e-4] * 3 + [0.1] * 3, xtol=1e-12, ftol=1e-12
    ).x
    frame = np.eye(4)
    frame[:3, :3], frame[:3, 3] = Rotation.from_rotvec(best[:3]).as_matrix(), best[3:]
    return ErrorField(rows, is_covered, errors(best, rows), frame)


def depth_errors_mm(truth: Truth, model: Model, field: ErrorField) -> np.ndarray:
    """Median and largest error of depths by the model at each distance, (distances, 2) [mm]; NaN if few see it.

    A depth is that of the point whose images by the model are nearest to the exact positions of a point.
    """
    turn, shift = field.model_from_vision[:3, :3], field.model_from_vision[:3, 3]
    result = np.full((len(truth.distances_mm), 2), np.nan)
    for number in range(len(truth.distances_mm)):
        off = []
        at = field.rows.only(field.is_covered & (field.rows.view == number))
        for point in np.unique(at.point):
            seen = at.only(at.point == point)
            true = seen.points_mm[0]
            places = seen.points_mm @ turn.T + shift
            seen, start = seen.only(np.isfinite(model.project(places, seen.microlens)).all(axis=1)), places[0]
            if len(seen.point) >= _LEAST:
                place = least_squares(
                    lambda p, s=seen: (model.project(np.tile(p, (len(s.point), 1)), s.microlens) - s.image_px).ravel(),
                    start, x_scale=[0.1, 0.1, 1.0],
                ).x  # fmt: skip
                off.append(((place - shift) @ turn)[2] - true[2])
        if off:
            result[number] = np.median(off), np.abs(off).max()
    return result


def pose_errors(truth: Truth, poses: np.ndarray, views: np.ndarray) -> tuple[float, float]:
    """Root mean square errors of found poses (v, 4, 4) of some views, in rotation [deg] and place [mm].

    Each is taken relative to the first, so that the frame of the model does not count; NaN if there is no other.
    """
    if len(views) < 2:
        return float("nan"), float("nan")
    true = np.linalg.inv(truth.poses[views[0]]) @ truth.poses[views]
    away = (np.linalg.inv(true) @ np.linalg.inv(poses[0]) @ poses)[1:]
    turns = np.degrees(Rotation.from_matrix(away[:, :3, :3]).magnitude())
    shifts = np.linalg.norm(away[:, :3, 3], axis=1)
    return float(np.sqrt(np.mean(turns**2))), float(np.sqrt(np.mean(shifts**2)))


def centre_errors(
    centres_px: np.ndarray, truths_px: dict[str, np.ndarray], reach_px: float
) -> dict[str, dict[str, float]]:
    """Errors of found centres (n, 2) against each kind of true centre (m, 2): share found, bias and rms [px]."""
    result = {}
    for name, true in truths_px.items():
        is_lit = np.isfinite(true).all(axis=1)
        distance, row = cKDTree(centres_px).query(true[is_lit], distance_upper_bound=reach_px)
        near = np.isfinite(distance)
        error = centres_px[row[near]] - true[is_lit][near]
        bias = error.mean(axis=0) if len(error) else np.full(2, np.nan)
        result[name] = {
            "found": float(near.mean()),
            "bias_x_px": float(bias[0]),
            "bias_y_px": float(bias[1]),
            "rms_px": float(np.sqrt((error**2).sum(axis=1).mean())) if len(error) else float("nan"),
        }
    return result


def types_right(focals_mm: np.ndarray, true_mm: np.ndarray) -> float:
    """Share of microlenses (n,) whose focal length stands among those of a program where the true one stands among the
    true ones: who mixes two types, or calls the longer one the shorter, is wrong about both. NaN, of microlenses that
    the program does not know, does not count.
    """
    has_type = np.isfinite(focals_mm)
    theirs, true = (np.unique(values[has_type], return_inverse=True)[1] for values in (focals_mm, true_mm))
    return float(np.mean(theirs == true))


def disparity_errors(
    rows: Rows, true_centre_px: np.ndarray, pitch_px: float, centre_px: np.ndarray, disparity_px: np.ndarray
) -> dict[str, float]:
    """Errors of disparities (c, n, n) of squares of a pitch around centres (c, 2) at the exact corners of a board.

    Disparity is how far the image of a point moves against the micro-image, from one to one that is a pitch away [px].
    Corners near the rim are left out: the square around them is not all light.
    """
    off = []
    for point in np.unique(rows.point):
        seen = rows.only(rows.point == point)
        if len(seen.point) < _LEAST:
            continue
        centre = true_centre_px[seen.microlens]
        lattice, moved = centre - centre.mean(axis=0), seen.image_px - centre
        true = abs((lattice * moved).sum() / (lattice**2).sum()) * pitch_px
        count = disparity_px.shape[1]
        column, row = np.rint(moved * (count - 1) / pitch_px + (count - 1) / 2).astype(int).T
        is_inner = np.hypot(*moved.T) < _INNER * pitch_px
        _, lens = cKDTree(centre_px).query(centre[is_inner])
        off.extend(disparity_px[lens, row[is_inner], column[is_inner]] - true)
    error = np.array(off)
    return {
        "corners": len(error),
        "bias_px": float(np.median(error)),
        "median_px": float(np.median(np.abs(error))),
        "wrong": float(np.mean(np.abs(error) > _WRONG_PX)),
    }
