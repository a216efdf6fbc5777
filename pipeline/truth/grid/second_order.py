"""Method `moments`: the mean of the hits instead of the hit of the mean ray, to second order in the bundle's width.

With p_n, p_f the mean crossings, w = p_f - p_n, t the share of the mean ray's hit, u = (1 - t) delta_n + t delta_f and
v = delta_f - delta_n the deviations of the bundle's rays at the target and of their direction,

    E[h] = h(mean) - P Cov(v, u) n / (n . w) + third moments,        P = I - w n^T / (n . w).

It follows from the second derivative h'' = -2 (n . u) P v / (n . w) of the hit h by the crossings, averaged. The
correction vanishes on planes parallel to J_near and J_far, and where the bundle is sharp.
"""

import numpy as np

from pipeline.records.shapes import Float64
from pipeline.truth.grid.position_image import crossing_share
from pipeline.truth.grid.ray_grid import RayGrid
from pipeline.truth.grid.sampling_error import jacobian


def correction(
    covariance: Float64[np.ndarray, "... 10"],
    share: Float64[np.ndarray, "..."],
    way: Float64[np.ndarray, "... 3"],
    vision_from_target: Float64[np.ndarray, "4 4"],
) -> np.ndarray:
    """Correction to add to the hit of the mean ray, (..., 2) in the target frame [mm].

    Parameters
    ----------
    covariance : (..., 10) float64
        Upper triangle of the covariance of (x_near, y_near, x_far, y_far) [mm^2].
    share, way : (...), (..., 3) float64
        t and w of `position_image.crossing_share`.
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
