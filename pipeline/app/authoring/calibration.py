"""Uncertainty of a calibration, predicted from the poses of a target before anything is built.

The parameters of a pinhole are f, the principal point c and k1, those of each pose a turn and a shift. With J the
derivatives of all image positions, the inverse of J^T J / sigma^2 bounds their covariance (Cramér and Rao), and a
least-squares fit reaches that bound where its residuals are small. Poses are eliminated one by one.
"""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

NOISE_PX = 0.05
"""Error of a detected corner along x and along y, one sigma [px]: good detectors on sharp images of real boards."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Uncertainty:
    """Standard deviations of what a calibration finds, with `NOISE_PX` in each coordinate."""

    principal_distance_px: float
    principal_point_px: tuple[float, float]


def uncertainty(
    principal_distance_px: float, k1: float, views: Iterable[tuple[np.ndarray, np.ndarray]]
) -> Uncertainty | None:
    """Predict it for a pinhole with one focal length and k1; None where the points are too few to find them.

    Parameters
    ----------
    views : iterable of ((4, 4) float64, (n, 3) float64)
        Per pose pinhole_from_target, and the points that are seen, target frame [mm].
    """
    information = np.zeros((4, 4))
    for pinhole_from_target, points_mm in views:
        turned = points_mm @ pinhole_from_target[:3, :3].T
        place = turned + pinhole_from_target[:3, 3]
        u, (x, y, z), nil, unit = place[:, :2] / place[:, 2:], turned.T, np.zeros(len(place)), np.eye(2)
        r2 = np.sum(u**2, axis=1)[:, None, None]
        bent = principal_distance_px * ((1 + k1 * r2) * unit + 2 * k1 * u[:, :, None] * u[:, None, :])
        shift = bent @ np.dstack([np.tile(unit, (len(u), 1, 1)), -u[:, :, None]]) / place[:, 2, None, None]
        turn = shift @ np.array([[nil, z, -y], [-z, nil, x], [y, -x, nil]]).transpose(2, 0, 1)
        of_pose = np.dstack([turn, shift]).reshape(-1, 6)
        of_f, of_k1 = u * (1 + k1 * r2[:, 0]), principal_distance_px * u * r2[:, 0]
        shared = np.column_stack([of_f.ravel(), np.tile(unit, (len(u), 1)), of_k1.ravel()])
        left = shared - of_pose @ np.linalg.lstsq(of_pose, shared, rcond=None)[0]
        information += left.T @ left
    size = np.sqrt(np.diag(information))  # the columns differ by many powers of ten
    if not (size > 0).all() or np.linalg.matrix_rank(scaled := information / np.outer(size, size)) < 4:
        return None
    f_px, x_px, y_px, _ = (NOISE_PX * np.sqrt(np.diag(np.linalg.inv(scaled))) / size).tolist()
    return Uncertainty(principal_distance_px=f_px, principal_point_px=(x_px, y_px))
