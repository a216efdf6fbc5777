"""Rigid transforms named a_from_b, the frames they join, and the unit of a stage. The list of frames: CONVENTIONS.md.

A transform is a (4, 4) float64 array that acts on column vectors, lengths in mm.
"""

import math

import numpy as np

from pipeline.records.shapes import Float64, Num

VISION_FROM_CAMERA = np.diag([1.0, -1.0, -1.0, 1.0])
"""Vision frame (x right, y down, z forward) from USD's camera frame (x right, y up, looking along -z)."""


def rigid(rotation: Float64[np.ndarray, "3 3"], translation_mm: Float64[np.ndarray, "3"]) -> np.ndarray:
    """The transform p -> rotation p + translation."""
    a_from_b = np.eye(4)
    a_from_b[:3, :3] = rotation
    a_from_b[:3, 3] = translation_mm
    return a_from_b


def inverse(a_from_b: Float64[np.ndarray, "4 4"]) -> np.ndarray:
    """b_from_a of a rigid transform."""
    rotation = a_from_b[:3, :3].T
    return rigid(rotation, -rotation @ a_from_b[:3, 3])


def apply(a_from_b: Float64[np.ndarray, "4 4"], points_mm: Float64[np.ndarray, "... 3"]) -> np.ndarray:
    """Points of frame b in frame a, (n, 3)."""
    return points_mm @ a_from_b[:3, :3].T + a_from_b[:3, 3]


def on_tilted(
    tau_rad: Num[np.ndarray, "2"], x: Num[np.ndarray, "n"], y: Num[np.ndarray, "n"]
) -> tuple[np.ndarray, np.ndarray]:
    """Points of the plane z = 1, seen from the origin on that plane turned about (0, 0, 1), in its own x and y.

    computeTiltProjectionMatrix of OpenCV, by tauX and tauY; analytic.
    """
    (cos_x, cos_y), (sin_x, sin_y) = np.cos(tau_rad), np.sin(tau_rad)
    about_x = np.array([[1, 0, 0], [0, cos_x, sin_x], [0, -sin_x, cos_x]])
    about_y = np.array([[cos_y, 0, -sin_y], [0, 1, 0], [sin_y, 0, cos_y]])
    turn = about_y @ about_x
    upright = np.array([[turn[2, 2], 0, -turn[0, 2]], [0, turn[2, 2], -turn[1, 2]], [0, 0, 1]])
    seen = upright @ turn @ np.stack([x, y, np.ones_like(x)])
    return seen[0] / seen[2], seen[1] / seen[2]


def rotation_vector(a_from_b: Float64[np.ndarray, "4 4"]) -> np.ndarray:
    """Axis times angle of the rotation, what OpenCV calls rvec, (3,) [rad].

    Computed from the quaternion, by the largest of its four squares: Shepperd, J. Guidance and Control 1 (1978) 223.
    """
    (xx, xy, xz), (yx, yy, yz), (zx, zy, zz) = a_from_b[:3, :3].tolist()
    trace = xx + yy + zz
    x, y, z, w = {
        xx: (1 - trace + 2 * xx, yx + xy, zx + xz, zy - yz),
        yy: (yx + xy, 1 - trace + 2 * yy, zy + yz, xz - zx),
        zz: (zx + xz, zy + yz, 1 - trace + 2 * zz, yx - xy),
        trace: (zy - yz, xz - zx, yx - xy, 1 + trace),
    }[max(xx, yy, zz, trace)]
    norm = math.copysign(math.sqrt(x * x + y * y + z * z + w * w), w)
    x, y, z, w = x / norm, y / norm, z / norm, w / norm
    angle = 2 * math.atan2(math.sqrt(x * x + y * y + z * z), w)
    scale = angle / math.sin(angle / 2) if angle > 1e-3 else 2 + angle * angle / 12 + 7 * angle**4 / 2880
    return np.array([x * scale, y * scale, z * scale])


def mm_per_unit(meters_per_unit: float) -> float:
    """Millimetres in one unit of a stage whose `metersPerUnit` is given."""
    return meters_per_unit * 1000.0
