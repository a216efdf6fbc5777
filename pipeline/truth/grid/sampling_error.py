"""Sampling error of position images, in pixels."""

import numpy as np

from pipeline.records.shapes import Num


def jacobian(image: Num[np.ndarray, "h w 2"], cell: Num[np.ndarray, "h w"]) -> np.ndarray:
    """Derivative of a position image per step of its grid, from neighbours in the same cell.

    Parameters
    ----------
    image : (h, w, 2) float
    cell : (h, w) int

    Returns
    -------
    (h, w, 2, 2) float
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
    """Standard errors of a mean crossing mapped to the image by the inverse Jacobian, (..., 2) [px].

    Parameters
    ----------
    variance : (..., 2) float
        Squared standard errors along x and y, taken as independent [mm^2].
    derivative : (..., 2, 2) float
        Derivative from `jacobian` [mm per step].
    """
    a, b, c, d = derivative[..., 0, 0], derivative[..., 0, 1], derivative[..., 1, 0], derivative[..., 1, 1]
    with np.errstate(divide="ignore", invalid="ignore"):
        scale = 1 / (a * d - b * c) ** 2
        x = (d**2 * variance[..., 0] + b**2 * variance[..., 1]) * scale
        y = (c**2 * variance[..., 0] + a**2 * variance[..., 1]) * scale
    error = np.sqrt(np.stack([x, y], axis=-1)) / supersampling
    return np.where(np.isfinite(error), error, np.nan)
