"""The judge of plenoptic calibrations: it knows no contestant. Models come in, numbers go out.

A calibration's frame is free: a model is moved and turned (six numbers, no scale) until it explains the exact rows of
the boards' distances best, and then asked where it images points all over the field, through every microlens.
"""

from dataclasses import dataclass

import numpy as np
from judge import covered
from scipy.optimize import least_squares
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation
from truth import Model, Rows, Truth

_ONE_TO_ONE = 3
"""Least microlenses that must see a point whose depth is asked [1]."""


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


def error_field(truth: Truth, model: Model) -> ErrorField:
    """Project the field by a model that is laid over the camera at the distances of the boards."""
    rows, known = truth.field, covered(truth.field.image_px, truth.boards.image_px)
    inner = known & np.isin(rows.view, range(1, len(truth.distances_mm) - 1))

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
    return ErrorField(rows, known, errors(best, rows), frame)


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
            if len(seen.point) >= _ONE_TO_ONE:
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

    Each is taken relative to the first, so that the frame of the model does not count.
    """
    true = np.linalg.inv(truth.poses[views[0]]) @ truth.poses[views]
    away = (np.linalg.inv(true) @ np.linalg.inv(poses[0]) @ poses)[1:]
    turns = [np.degrees(Rotation.from_matrix(a[:3, :3]).magnitude()) for a in away]
    shifts = [np.linalg.norm(a[:3, 3]) for a in away]
    return float(np.sqrt(np.mean(np.square(turns)))), float(np.sqrt(np.mean(np.square(shifts))))


def centre_errors(
    centres_px: np.ndarray, truths_px: dict[str, np.ndarray], reach_px: float
) -> dict[str, dict[str, float]]:
    """Errors of found centres (n, 2) against each kind of true centre (m, 2): share found, bias and rms [px]."""
    result = {}
    for name, true in truths_px.items():
        known = np.isfinite(true).all(axis=1)
        distance, row = cKDTree(centres_px).query(true[known], distance_upper_bound=reach_px)
        near = np.isfinite(distance)
        error = centres_px[row[near]] - true[known][near]
        bias = error.mean(axis=0) if len(error) else np.full(2, np.nan)
        result[name] = {
            "found": float(near.mean()),
            "bias_x_px": float(bias[0]),
            "bias_y_px": float(bias[1]),
            "rms_px": float(np.sqrt((error**2).sum(axis=1).mean())) if len(error) else float("nan"),
        }
    return result
