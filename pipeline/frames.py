"""Rigid transforms named a_from_b, the frames they join, and the unit of a stage. CONVENTIONS.md lists the frames.

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


def distorted(
    coefficients: Num[np.ndarray, "k"], u: Num[np.ndarray, "n"], v: Num[np.ndarray, "n"]
) -> tuple[np.ndarray, np.ndarray]:
    """Points of the plane z = 1 under OpenCV's distortion with 0, 5, 8, 12 or 14 coefficients; analytic.

    Source: opencv/opencv, modules/calib3d, projectPoints.
    """
    k1, k2, p1, p2, k3, k4, k5, k6, s1, s2, s3, s4, *tau = np.concatenate(
        [coefficients, np.zeros(14 - len(coefficients))]
    )
    r2 = u * u + v * v
    radial = (1 + r2 * (k1 + r2 * (k2 + r2 * k3))) / (1 + r2 * (k4 + r2 * (k5 + r2 * k6)))
    x = u * radial + 2 * p1 * u * v + p2 * (r2 + 2 * u * u) + r2 * (s1 + r2 * s2)
    y = v * radial + p1 * (r2 + 2 * v * v) + 2 * p2 * u * v + r2 * (s3 + r2 * s4)
    return _on_tilted(np.array(tau), x, y) if any(tau) else (x, y)


def _on_tilted(
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
    projected = upright @ turn @ np.stack([x, y, np.ones_like(x)])
    return projected[0] / projected[2], projected[1] / projected[2]


def rotation_vector(a_from_b: Float64[np.ndarray, "4 4"]) -> np.ndarray:
    """Rotation vector, axis times angle, OpenCV's rvec, (3,) [rad].

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
