"""Rigid transforms named a_from_b, and the frames they join. The list of frames: CONVENTIONS.md.

A transform is a (4, 4) float64 array that acts on column vectors, lengths in mm.
"""

import numpy as np

VISION_FROM_CAMERA = np.diag([1.0, -1.0, -1.0, 1.0])
"""Vision frame (x right, y down, z forward) from USD's camera frame (x right, y up, looking along -z)."""


def rigid(rotation: np.ndarray, translation_mm: np.ndarray) -> np.ndarray:
    """The transform p -> rotation p + translation."""
    a_from_b = np.eye(4)
    a_from_b[:3, :3] = rotation
    a_from_b[:3, 3] = translation_mm
    return a_from_b


def inverse(a_from_b: np.ndarray) -> np.ndarray:
    """b_from_a of a rigid transform."""
    rotation = a_from_b[:3, :3].T
    return rigid(rotation, -rotation @ a_from_b[:3, 3])


def apply(a_from_b: np.ndarray, points_mm: np.ndarray) -> np.ndarray:
    """Points of frame b in frame a, (n, 3)."""
    return points_mm @ a_from_b[:3, :3].T + a_from_b[:3, 3]


def rotation_vector(a_from_b: np.ndarray) -> np.ndarray:
    """Axis times angle of the rotation, what OpenCV calls rvec, (3,) [rad]."""
    from scipy.spatial.transform import Rotation

    return Rotation.from_matrix(a_from_b[:3, :3]).as_rotvec()
