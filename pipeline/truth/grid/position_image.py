"""Position images: the points where the bundles of all pixels meet a target's plane, in the target frame; their
derivatives and errors.

Method `moments` takes the mean of the hits instead of the hit of the mean ray, to second order in the bundle's width.
With p_n, p_f the mean crossings, w = p_f - p_n, t the share of the mean ray's hit, u = (1 - t) delta_n + t delta_f and
v = delta_f - delta_n the deviations of the bundle's rays at the target and of their direction,

    E[h] = h(mean) - P Cov(v, u) n / (n . w) + third moments,        P = I - w n^T / (n . w).

It follows from the second derivative h'' = -2 (n . u) P v / (n . w) of the hit h by the crossings, averaged. The
correction vanishes on planes parallel to J_near and J_far, and where the bundle is sharp.
"""

import numpy as np

from pipeline.records.shapes import Float64, Num
from pipeline.truth.grid.ray_grid import RayGrid


def on_target(
    near: Float64[np.ndarray, "... 2"],
    far: Float64[np.ndarray, "... 2"],
    near_mm: float,
    far_mm: float,
    vision_from_target: Float64[np.ndarray, "4 4"],
) -> np.ndarray:
    """J by the paper's second method: the mean ray of every pixel meets the target's plane; target frame [mm].

    J = J_near + t (J_far - J_near), t = <q - J_near, n> / <J_far - J_near, n>; NaN where the bundle is empty. `near`
    and `far` are mean crossings with the planes z = near_mm and z = far_mm, vision frame [mm].
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


def jacobian(image: Num[np.ndarray, "h w 2"], cell: Num[np.ndarray, "h w"]) -> np.ndarray:
    """Derivative of a position image per step of its grid, from neighbours in the same cell, (h, w, 2, 2).

    [..., i, 0] along columns, [..., i, 1] along rows; NaN where a position has no neighbour of its cell.
    """
    along_columns = _difference(image, cell)
    along_rows = _difference(image.swapaxes(0, 1), cell.swapaxes(0, 1)).swapaxes(0, 1)
    return np.stack([along_columns, along_rows], axis=-1)


def _difference(image: np.ndarray, cell: np.ndarray) -> np.ndarray:
    """Mean of the forward and backward difference along axis 1, using only neighbours in the same cell with values."""
    step = np.diff(image, axis=1)
    step[cell[:, 1:] != cell[:, :-1]] = np.nan
    known = ~np.isnan(step)
    step = np.where(known, step, 0)
    total, count = np.zeros(image.shape, image.dtype), np.zeros(image.shape, image.dtype)
    for side in (slice(None, -1), slice(1, None)):
        total[:, side] += step
        count[:, side] += known
    return np.divide(total, count, out=np.full_like(total, np.nan), where=count > 0)


def in_pixels(
    variance: Num[np.ndarray, "... 2"], derivative: Num[np.ndarray, "... 2 2"], supersampling: int
) -> np.ndarray:
    """Standard errors in the image, (..., 2) [px], of a mean crossing, from their squares along x and y [mm^2]."""
    a, b, c, d = derivative[..., 0, 0], derivative[..., 0, 1], derivative[..., 1, 0], derivative[..., 1, 1]
    with np.errstate(divide="ignore", invalid="ignore"):
        scale = 1 / (a * d - b * c) ** 2
        x = (d**2 * variance[..., 0] + b**2 * variance[..., 1]) * scale
        y = (c**2 * variance[..., 0] + a**2 * variance[..., 1]) * scale
    error = np.sqrt(np.stack([x, y], axis=-1)) / supersampling
    return np.where(np.isfinite(error), error, np.nan)


def correction(
    covariance: Float64[np.ndarray, "... 10"],
    share: Float64[np.ndarray, "..."],
    way: Float64[np.ndarray, "... 3"],
    vision_from_target: Float64[np.ndarray, "4 4"],
) -> np.ndarray:
    """Correction to add to the hit of the mean ray, (..., 2) in the target frame [mm].

    `covariance` as of `RayGrid`; `share` and `way` are t and w of `crossing_share`.
    """
    xn_xn, xn_yn, xn_xf, xn_yf, yn_yn, yn_xf, yn_yf, xf_xf, xf_yf, yf_yf = np.moveaxis(covariance, -1, 0)
    axes, normal = vision_from_target[:3, :2], vision_from_target[:3, 2]
    # Cov(v, u) = Cov(v, delta_n) + t Cov(v, v).
    cross = xf_yf - yn_xf - xn_yf + xn_yn
    vx_ux = xn_xf - xn_xn + share * (xf_xf - 2 * xn_xf + xn_xn)
    vx_uy = yn_xf - xn_yn + share * cross
    vy_ux = xn_yf - xn_yn + share * cross
    vy_uy = yn_yf - yn_yn + share * (yf_yf - 2 * yn_yf + yn_yn)
    bent_x, bent_y = vx_ux * normal[0] + vx_uy * normal[1], vy_ux * normal[0] + vy_uy * normal[1]
    along = way @ normal
    slide = (normal[0] * bent_x + normal[1] * bent_y) / along
    bent = np.stack([bent_x - slide * way[..., 0], bent_y - slide * way[..., 1], -slide * way[..., 2]], axis=-1)
    return -(bent @ axes) / along[..., None]


def corrected(
    image: Float64[np.ndarray, "h w 2"], grid: RayGrid, vision_from_target: Float64[np.ndarray, "4 4"]
) -> np.ndarray:
    """A position image by two planes with the correction added, (K h, K w, 2) in the target frame [mm].

    Second moments are stored once per pixel, for rays from one point; the contribution of the square of a position
    follows from the derivative of J. At the edge of a cell, positions of another micro-image than the one stored for
    their pixel stay uncorrected. Behind microlenses the correction is a few 1e-4 px.
    """
    k = grid.supersampling
    share, _, way = crossing_share(grid.near, grid.far, grid.near_mm, grid.far_mm, vision_from_target)
    covariance = grid.covariance.repeat(k, axis=0).repeat(k, axis=1)
    kept = grid.cell[k // 2 :: k, k // 2 :: k].repeat(k, axis=0).repeat(k, axis=1)
    if grid.square_steps > 0:
        covariance = covariance + _of_square(grid)
    shift = correction(covariance, share, way, vision_from_target)
    known = (kept == grid.cell)[..., None] & ~np.isnan(shift)
    return image + np.where(known, shift, 0.0)


def _of_square(grid: RayGrid) -> np.ndarray:
    """Covariance of the mean crossings over the square of each position, (K h, K w, 10) [mm^2]; 0 where unknown."""
    derivative = np.concatenate([jacobian(image, grid.cell) for image in (grid.near, grid.far)], axis=-2)
    rows, columns = np.triu_indices(4)
    products = (derivative[..., rows, :] * derivative[..., columns, :]).sum(axis=-1)
    return np.nan_to_num(grid.square_steps**2 / 12 * products)
