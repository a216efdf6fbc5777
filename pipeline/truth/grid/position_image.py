"""Position images: the points where the bundles of all pixels meet a target's plane, in the target frame; their
derivatives and errors.
"""

import numpy as np

from pipeline.records.shapes import Float64, Num


def on_target(
    near: Float64[np.ndarray, "... 2"],
    far: Float64[np.ndarray, "... 2"],
    near_mm: float,
    far_mm: float,
    vision_from_target: Float64[np.ndarray, "4 4"],
) -> np.ndarray:
    """J by the paper's second method: the intersection of every pixel's mean ray with the target's plane; target frame
    [mm].

    J = J_near + t (J_far - J_near), t = <q - J_near, n> / <J_far - J_near, n>; NaN where the bundle is empty. `near`
    and `far` are mean crossings with the planes z = near_mm and z = far_mm, vision frame [mm].
    """
    t, start, direction = parameter_on_target(near, far, near_mm, far_mm, vision_from_target)
    hit = start + t[..., None] * direction - vision_from_target[:3, 3]
    return hit @ vision_from_target[:3, :2]


def parameter_on_target(
    near: Float64[np.ndarray, "... 2"],
    far: Float64[np.ndarray, "... 2"],
    near_mm: float,
    far_mm: float,
    vision_from_target: Float64[np.ndarray, "4 4"],
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Parameter t (...) at which mean rays J_near + t (J_far - J_near) meet the target's plane.

    Also J_near and J_far - J_near, (..., 3) each; vision frame [mm], as the arguments.
    """
    start = np.concatenate([near, np.full((*near.shape[:-1], 1), near_mm)], axis=-1)
    direction = np.concatenate([far - near, np.full((*near.shape[:-1], 1), far_mm - near_mm)], axis=-1)
    target_origin = vision_from_target[:3, 3]
    normal = vision_from_target[:3, 2]
    # einsum, not @: BLAS rounds a row differently depending on how many rows there are, and results must not depend on
    # that.
    normal_distance_to_target = np.einsum("...i,i->...", target_origin - start, normal)
    normal_length_of_direction = np.einsum("...i,i->...", direction, normal)
    return normal_distance_to_target / normal_length_of_direction, start, direction


def jacobian(image: Num[np.ndarray, "h w 2"], cell: Num[np.ndarray, "h w"]) -> np.ndarray:
    """Derivative of a position image per step of its grid, from neighbours in the same cell, (h, w, 2, 2).

    [..., i, 0] along columns, [..., i, 1] along rows; NaN where a position has no neighbour of its cell.
    """
    along_columns = _difference(image, cell)
    along_rows = _difference(image.swapaxes(0, 1), cell.swapaxes(0, 1)).swapaxes(0, 1)
    return np.stack([along_columns, along_rows], axis=-1)


def _difference(image: np.ndarray, cell: np.ndarray) -> np.ndarray:
    """Mean of the forward and backward difference along axis 1, from neighbours in the same cell with values."""
    step = np.diff(image, axis=1)
    step[cell[:, 1:] != cell[:, :-1]] = np.nan
    finite = ~np.isnan(step)
    step = np.where(finite, step, 0)
    # Each step is the forward difference of the position before it, and the backward one of the position behind it.
    total = np.zeros(image.shape, image.dtype)
    count = np.zeros(image.shape, image.dtype)
    for side in (slice(None, -1), slice(1, None)):
        total[:, side] += step
        count[:, side] += finite
    return np.divide(total, count, out=np.full_like(total, np.nan), where=count > 0)


def in_pixels(
    variance: Num[np.ndarray, "... 2"], derivative: Num[np.ndarray, "... 2 2"], supersampling: int
) -> np.ndarray:
    """Standard errors in the image, (..., 2) [px], of a mean crossing, from its variances along x and y [mm^2]."""
    # Variances in the image are sums over both axes of the squared elements of the inverse derivative.
    a, b, c, d = derivative[..., 0, 0], derivative[..., 0, 1], derivative[..., 1, 0], derivative[..., 1, 1]
    with np.errstate(divide="ignore", invalid="ignore"):
        scale = 1 / (a * d - b * c) ** 2
        x = (d**2 * variance[..., 0] + b**2 * variance[..., 1]) * scale
        y = (c**2 * variance[..., 0] + a**2 * variance[..., 1]) * scale
    error = np.sqrt(np.stack([x, y], axis=-1)) / supersampling
    return np.where(np.isfinite(error), error, np.nan)
