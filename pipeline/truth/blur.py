"""First-order blur of a target point in the image, from the second moments of its bundle."""

import numpy as np

from pipeline.camera.tracing.moments import COVARIANCE
from pipeline.records.shapes import Float64

_SPREAD = COVARIANCE + np.array([[0, 1], [1, 4]])
"""Columns of a bundle's moments with the covariance of its hits on the first plane, from an upper triangle."""


def spread(moments: Float64[np.ndarray, "n COLUMNS ..."]) -> np.ndarray:
    """Covariance of the hits of bundles on their first plane, (n, 2, 2, ...) [mm^2], or its derivative."""
    return moments[:, _SPREAD]


def deviations(
    covariance: Float64[np.ndarray, "n 4 4"], parameter: Float64[np.ndarray, "n"]
) -> tuple[np.ndarray, np.ndarray]:
    """Cov(u, u) and Cov(u, v), (n, 2, 2) [mm^2], of bundles at the distance of a target plane, ignoring its tilt.

    With delta_n and delta_f the deviations at the near and far plane and t the parameter from
    `position_image.parameter_on_target`, u = (1 - t) delta_n + t delta_f is the deviation at the target and v = delta_f
    - delta_n that of the direction.
    """
    t = parameter[:, None, None]
    nn, nf, ff = covariance[:, :2, :2], covariance[:, :2, 2:], covariance[:, 2:, 2:]
    fn = nf.transpose(0, 2, 1)
    uu = (1 - t) ** 2 * nn + t * (1 - t) * (nf + fn) + t**2 * ff
    uv = (1 - t) * (nf - nn) + t * (ff - fn)
    return uu, uv


def on_plane(
    uu: Float64[np.ndarray, "n 2 2"],
    direction: Float64[np.ndarray, "n 3"],
    vision_from_target: Float64[np.ndarray, "4 4"],
) -> np.ndarray:
    """Covariance of the hits in the target's x and y: u projected along the mean ray onto the plane, (n, 2, 2) [mm^2].

    `direction` is that of the mean ray, of any length.
    """
    axes, normal = vision_from_target[:3, :2], vision_from_target[:3, 2]
    normal_length = np.einsum("ni,i->n", direction, normal)  # not by BLAS, as in `parameter_on_target`
    # Rows e_i of P = I - w n^T / (n . w), restricted to the x and y components of u.
    project = (
        axes.T[None, :, :2] - (direction @ axes)[:, :, None] * normal[None, None, :2] / normal_length[:, None, None]
    )
    # Contiguous, so that a row is rounded alike alone and in an array.
    project = np.ascontiguousarray(project)
    uu = np.ascontiguousarray(uu)
    return project @ uu @ project.transpose(0, 2, 1)


def in_image(covariance: Float64[np.ndarray, "n 2 2"], target_from_image: Float64[np.ndarray, "n 2 2"]) -> np.ndarray:
    """Covariance on the target mapped to the image by the inverse Jacobian of J, (n, 2, 2) [px^2]."""
    image_from_target = np.linalg.inv(target_from_image)
    return image_from_target @ covariance @ image_from_target.transpose(0, 2, 1)


def radius_px(blur_px2: Float64[np.ndarray, "n 2 2"]) -> np.ndarray:
    """Radius of the uniform disc with the trace of the blur, sqrt(2 (blur_xx + blur_yy)), (n,)."""
    return np.sqrt(2 * np.maximum(np.trace(blur_px2, axis1=1, axis2=2), 0))


def signed_radius_px(blur_px2: Float64[np.ndarray, "n 2 2"], uv: Float64[np.ndarray, "n 2 2"]) -> np.ndarray:
    """rho = sign(tr Cov(u, v)) times that radius: positive if the target lies beyond best focus."""
    return np.sign(np.trace(uv, axis1=1, axis2=2)) * radius_px(blur_px2)
