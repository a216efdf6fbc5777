"""The judge of the arena: what detectors and calibrations are off by, where the truth is known.

It knows no contestant: positions come in, numbers go out. Pixel (0, 0) is the centre of the top-left pixel.
"""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.interpolate import CloughTocher2DInterpolator
from scipy.optimize import least_squares
from scipy.spatial import Delaunay, cKDTree
from scipy.spatial.transform import Rotation

REACH_PX = 3.0
"""Distance within which a detection counts as that of a point [px]; but never half the way to the next point."""
LOST = 0.5
"""Share of repeats in which a point must be found to be judged at all [1]."""
ONE_SIGMA = 0.6827
"""Share of a Gaussian within one standard deviation [1]; within the ellipse of two dimensions, its law below."""
_ELLIPSE = -2 * np.log(1 - ONE_SIGMA)
"""Squared Mahalanobis distance within which that share of a Gaussian in two dimensions lies [1]."""


def matched(truth_px: np.ndarray, found_px: np.ndarray) -> np.ndarray:
    """Row of `found_px` (m, 2) for each of `truth_px` (n, 2); -1 where none is near. No detection serves two points."""
    result = np.full(len(truth_px), -1)
    if len(found_px) == 0:
        return result
    spacing = cKDTree(truth_px).query(truth_px, k=2)[0][:, 1].min() if len(truth_px) > 1 else np.inf
    distance, row = cKDTree(found_px).query(truth_px, distance_upper_bound=min(REACH_PX, 0.45 * spacing))
    for point in np.argsort(distance):
        if np.isfinite(distance[point]) and row[point] not in result:
            result[point] = row[point]
    return result


@dataclass(frozen=True, slots=True, kw_only=True)
class Detection:
    """What a detector is worth under one condition, against one of the truths.

    Spread is the covariance (2, 2), over points, of what stays of a point's error when noise is averaged out, which is
    the same in every image of a still scene; less the noise that the repeats leave in the means.
    """

    found: float  # share of the points, of all images
    bias_px: np.ndarray  # mean error of all points (2,)
    spread_px2: np.ndarray
    noise_px2: np.ndarray  # covariance (2, 2) of what changes from repeat to repeat

    @property
    def lasting_px(self) -> float:
        """Root mean square length of the errors that averaging does not remove: bias and spread."""
        return float(np.sqrt(self.bias_px @ self.bias_px + max(np.trace(self.spread_px2), 0.0)))


def detection(error_px: np.ndarray) -> Detection | None:
    """Judge errors (repeats, points, 2), NaN where a point was not found; None if too few were found to judge."""
    there = np.isfinite(error_px[..., 0])
    kept = there.mean(axis=0) > LOST
    if kept.sum() < 3:
        return None
    error, count = error_px[:, kept], there[:, kept].sum(axis=0)
    means = np.nanmean(error, axis=0)
    rest = np.where(np.isfinite(error), error - means, 0.0).reshape(-1, 2)
    noise = rest.T @ rest / max(int((count - 1).sum()), 1)
    spread = np.cov(means.T) - noise * float(np.mean(1 / count))
    return Detection(found=float(there.mean()), bias_px=means.mean(axis=0), spread_px2=spread, noise_px2=noise)


def inside_ellipse(error_px: np.ndarray, stated_px2: np.ndarray) -> float:
    """Share of errors (..., 2) within the stated ellipse (..., 2, 2) of one sigma: 0.6827 where it is true."""
    good = np.isfinite(error_px).all(axis=-1) & np.isfinite(stated_px2).all(axis=(-1, -2))
    error, stated = error_px[good], stated_px2[good]
    if not len(error):
        return float("nan")
    squared = np.einsum("ni,ni->n", error, np.linalg.solve(stated, error[..., None])[..., 0])
    return float(np.mean(squared < _ELLIPSE))


@dataclass(frozen=True, slots=True, kw_only=True)
class ExactRays:
    """True rays of image positions (rows, columns, 2) on a grid, vision frame; NaN where no light leaves."""

    query_px: np.ndarray
    origin_mm: np.ndarray  # (rows, columns, 3)
    direction: np.ndarray  # (rows, columns, 3)
    fitted_mm: tuple[float, ...]  # planes on which a calibration is laid over the camera: where its boards stood
    distances_mm: tuple[float, ...]  # planes on which it is judged

    def points(self, z_mm: float) -> np.ndarray:
        """Crossings with a plane, (rows, columns, 3) [mm]."""
        return self.origin_mm + self.direction * ((z_mm - self.origin_mm[..., 2:]) / self.direction[..., 2:])


@dataclass(frozen=True, slots=True, kw_only=True)
class ErrorField:
    """Where a calibrated model projects the points of exact rays, less where the camera sees them."""

    error_px: np.ndarray  # (distances, rows, columns, 2)
    centre_mm: np.ndarray  # (3,), of projection in the vision frame, as the model fits the true rays best

    @property
    def length_px(self) -> np.ndarray:
        """Lengths, (distances, rows, columns)."""
        return np.hypot(self.error_px[..., 0], self.error_px[..., 1])

    def rms_px(self, where: np.ndarray) -> np.ndarray:
        """Root mean square length at each distance, (distances,), over some of the positions (rows, columns)."""
        return np.sqrt(np.nanmean(self.length_px[:, where] ** 2, axis=1))


def covered(query_px: np.ndarray, seen_px: np.ndarray) -> np.ndarray:
    """Positions (rows, columns) within the convex hull of the points (n, 2) of a calibration: elsewhere it guesses."""
    return Delaunay(seen_px).find_simplex(query_px) >= 0


def error_field(
    exact: ExactRays, slopes: np.ndarray, where: np.ndarray, offsets_mm: np.ndarray | float = 0.0
) -> ErrorField:
    """Error field of a model with rays (x, y, 1), (rows * columns, 2), in a frame of its own; they cross its plane
    z = 0 at offsets, (rows * columns, 2), or, of a central model, at 0.

    The frame is free: the model is moved and turned so that it fits best at the positions `where` (rows, columns), on
    the planes where it was calibrated. Errors are small, so that the model's slopes are taken as linear over them.
    """
    slope, offset = (np.broadcast_to(each, slopes.shape).reshape(exact.query_px.shape) for each in (slopes, offsets_mm))
    step = exact.query_px[1, 1] - exact.query_px[0, 0]

    def errors(motion: np.ndarray, planes_mm: tuple[float, ...]) -> np.ndarray:
        points = np.stack([exact.points(z) for z in planes_mm])
        seen = (points - motion[3:]) @ Rotation.from_rotvec(motion[:3]).as_matrix().T
        at_plane = slope + offset / np.reshape(planes_mm, (-1, 1, 1, 1))  # how a point of a plane is seen from z = 0
        per_px = [np.gradient(at_plane, axis=axis) / step[2 - axis] for axis in (2, 1)]
        off = seen[..., :2] / seen[..., 2:] - slope - offset / seen[..., 2:]
        return np.einsum("dhwij,dhwj->dhwi", np.linalg.inv(np.stack(per_px, axis=-1)), off)

    lit = np.isfinite(exact.origin_mm[..., 0]) & np.isfinite(slope[..., 0]) & where
    found = least_squares(
        lambda motion: errors(motion, exact.fitted_mm)[:, lit].ravel(), np.zeros(6), x_scale=[1e-3] * 3 + [1.0] * 3
    )
    return ErrorField(error_px=errors(found.x, exact.distances_mm), centre_mm=found.x[3:])


def stated_covariance(exact: ExactRays, found: Any, where: np.ndarray) -> np.ndarray:
    """Covariances (distances, rows, columns, 2, 2) of projections by a model that says where its rays would be, moved
    along each axis of its uncertainty by one sigma: each is laid over the model as the model is over the camera.
    """
    slopes, offset_mm = (found[name].reshape(*exact.query_px.shape) for name in ("slopes", "offsets_mm"))
    ones, zeros = np.ones_like(slopes[..., :1]), np.zeros_like(slopes[..., :1])
    own = replace(
        exact,
        origin_mm=np.concatenate([offset_mm, zeros], axis=-1),
        direction=np.concatenate([slopes, ones], axis=-1),
    )
    moved = zip(found["moved_slopes"], found["moved_offsets_mm"], strict=True)
    errors = np.array([error_field(own, slope, where, offset).error_px for slope, offset in moved])
    return np.einsum("kdhwi,kdhwj->dhwij", errors, errors)


def depth_errors_mm(exact: ExactRays, field: ErrorField, where: np.ndarray, baseline_mm: float) -> np.ndarray:
    """Root mean square errors of the depths of points at each distance, (distances,), over some positions.

    The point of a position is triangulated by the model's rays, which the camera sends to it from there and from
    `baseline_mm` further right. Errors are small: depth is off by how far the rays pass each other, over the angle
    between them.
    """
    result = []
    for z_mm, error_px in zip(exact.distances_mm, field.error_px, strict=True):
        points_mm = exact.points(z_mm)
        along_x = np.gradient(points_mm[..., 0], axis=1) / (exact.query_px[0, 1, 0] - exact.query_px[0, 0, 0])
        lit = where & np.isfinite(along_x) & np.isfinite(error_px[..., 0])
        aside_mm = error_px[lit, 0] * along_x[lit]
        at_mm = points_mm[lit][:, :2]
        second_mm = CloughTocher2DInterpolator(at_mm, aside_mm)(at_mm - [baseline_mm, 0.0])
        off_mm = (aside_mm - second_mm) * (z_mm - field.centre_mm[2]) / baseline_mm
        result.append(np.sqrt(np.nanmean(off_mm**2)) if np.isfinite(off_mm).any() else np.nan)
    return np.array(result)


def pupil_errors(
    true_poses: np.ndarray, found_poses: np.ndarray, pupil_mm: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Mean and scatter over views of where found poses (v, 4, 4) put the centre of projection, less where it is [mm].

    Poses, or their upper rows, take the target's frame to the camera's: of the true ones it is the vision frame.
    """
    turned = -np.einsum("vji,vj->vi", found_poses[:, :3, :3], found_poses[:, :3, 3])
    centres = np.einsum("vij,vj->vi", true_poses[:, :3, :3], turned) + true_poses[:, :3, 3]
    return np.nanmean(centres, axis=0) - pupil_mm, np.nanstd(centres, axis=0)


def coverage(values: np.ndarray, sigmas: np.ndarray, without_noise: np.ndarray) -> tuple[float, float]:
    """Share of values (repeats, k) within their stated sigma of those without noise, and stated over real scatter."""
    share = float(np.mean(np.abs(values - without_noise) < sigmas))
    return share, float(np.median(np.sqrt((sigmas**2).mean(axis=0)) / values.std(axis=0, ddof=1)))


def numbers_kept(names: list[str], values: np.ndarray, sigmas: np.ndarray, true: np.ndarray) -> dict[str, Any]:
    """Honesty of numbers (repeats, k) whose truth is known: share within their stated sigmas, stated over real errors,
    and by name the stated sigma and the error, rms over repeats.
    """
    off = values - true
    rms = np.sqrt([(sigmas**2).mean(axis=0), (off**2).mean(axis=0)])
    return {
        "of": "its numbers",
        "inside_of_truth": float(np.mean(np.abs(off) < sigmas)),
        "stated_over_real": float(np.median(rms[0] / rms[1])),
        "numbers": dict(zip(names, rms.T.tolist(), strict=True)),
    }
