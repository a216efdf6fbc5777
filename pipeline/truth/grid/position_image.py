"""Position images: the points where the bundles of all pixels meet a target's plane, in the target frame."""

import numpy as np

from pipeline.records.shapes import Float64


def on_target(
    near: Float64[np.ndarray, "... 2"],
    far: Float64[np.ndarray, "... 2"],
    near_mm: float,
    far_mm: float,
    vision_from_target: Float64[np.ndarray, "4 4"],
) -> np.ndarray:
    """J by the paper's second method: the intersection of the mean ray of every pixel with the target's plane.

    J = J_near + t (J_far - J_near), t = <q - J_near, n> / <J_far - J_near, n>.

    Parameters
    ----------
    near, far : (..., 2) float64
        Mean crossings with the planes z = near_mm and z = far_mm, vision frame [mm].
    vision_from_target : (4, 4) float64
        Pose of the target.

    Returns
    -------
    (..., 2) float64
        x and y in the target frame [mm]; NaN where the bundle is empty.
    """
    share, start, way = crossing_share(near, far, near_mm, far_mm, vision_from_target)
    hit = start + share[..., None] * way - vision_from_target[:3, 3]
    return hit @ vision_from_target[:3, :2]


def crossing_share(
    near: Float64[np.ndarray, "... 2"],
    far: Float64[np.ndarray, "... 2"],
    near_mm: float,
    far_mm: float,
    vision_from_target: Float64[np.ndarray, "4 4"],
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Share t (...) of the way between the planes at which mean rays meet the target; J_near; the way (..., 3)."""
    start = np.concatenate([near, np.full((*near.shape[:-1], 1), near_mm)], axis=-1)
    way = np.concatenate([far - near, np.full((*near.shape[:-1], 1), far_mm - near_mm)], axis=-1)
    origin, normal = vision_from_target[:3, 3], vision_from_target[:3, 2]
    return ((origin - start) @ normal) / (way @ normal), start, way
