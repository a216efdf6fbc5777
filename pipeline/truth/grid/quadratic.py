"""Quadratic surface through the 4 x 4 values around a quad, instead of a plane through three of them.

A least squares fit to 16 values is less noisy than three values and follows the curvature of J; its residuals give
an error estimate. Positions are columns and rows of the fine grid; J is in the target frame.
"""

from dataclasses import dataclass

import numpy as np

from pipeline.records.shapes import Float64, Int64

_OFFSETS = np.arange(4) - 1.5
"""Columns and rows of the 16 values, relative to the middle of their quad [steps of the grid]."""
_STEPS = 6
"""Steps of Newton's method: the number of correct digits doubles with each, starting from a nearly plane quadratic."""
_FREEDOM = 16 - 6
"""Degrees of freedom of a fit: 16 values minus 6 coefficients."""


@dataclass(frozen=True, slots=True)
class QuadSolutions:
    """Solutions J(x) = p of the fitted surfaces.

    `x`: column and row from the middle of the quad; NaN unless all 16 values exist and lie in one micro-image.
    `jacobian`: derivative of J per step of the grid; columns are along columns and rows.
    `noise_gain`: standard error of the solution over that of a single value.
    `error`: expected error of the solution by the fit's residuals, in steps of the grid.
    """

    x: Float64[np.ndarray, "n 2"]
    jacobian: Float64[np.ndarray, "n 2 2"]
    noise_gain: Float64[np.ndarray, "n"]
    error: Float64[np.ndarray, "n"]


def solve(
    image: Float64[np.ndarray, "h w 2"],
    cell: Int64[np.ndarray, "h w"],
    quads: Int64[np.ndarray, "n 2"],
    points: Float64[np.ndarray, "n 2"],
) -> QuadSolutions:
    """Solve J(x) = p in the surfaces around quads, which have column and row of their top-left position."""
    values, complete = _windows(image, cell, quads)
    v, u = (grid.ravel() for grid in np.meshgrid(_OFFSETS, _OFFSETS, indexing="ij"))
    design = _terms(u, v)
    coefficients = np.linalg.pinv(design) @ values
    residual = values - design @ coefficients
    noise = np.sqrt((residual**2).sum(axis=(1, 2)) / (2 * _FREEDOM))
    x, jacobian = np.zeros((len(quads), 2)), np.full((len(quads), 2, 2), np.nan)
    for _ in range(_STEPS):
        here, jacobian = _surface(coefficients, x)
        with np.errstate(invalid="ignore"):
            regular = complete & (np.abs(np.linalg.det(jacobian)) > 0)
        jacobian = np.where(regular[:, None, None], jacobian, np.nan)
        x = x + np.linalg.solve(jacobian, (points - here)[..., None])[..., 0]
    # A solution outside the window is not valid.
    x = np.where(np.abs(x).max(axis=1, keepdims=True) <= 1.5, x, np.nan)
    terms = _terms(*x.T)
    gain = np.sqrt(np.einsum("na,ab,nb->n", terms, np.linalg.inv(design.T @ design), terms))
    steps_per_mm = np.sqrt((np.linalg.inv(jacobian) ** 2).sum(axis=(1, 2)))
    return QuadSolutions(x, jacobian, gain, gain * noise * steps_per_mm)


def _windows(image: np.ndarray, cell: np.ndarray, quads: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The 16 values around each quad, (n, 16, 2), and whether all exist and lie in the quad's own cell."""
    height, width = cell.shape
    column, row = (quads[:, i, None, None] + np.arange(-1, 3).reshape(shape) for i, shape in ((0, (1, 4)), (1, (4, 1))))
    inside = ((column >= 0) & (column < width) & (row >= 0) & (row < height)).all(axis=(1, 2))
    column, row = np.clip(column, 0, width - 1), np.clip(row, 0, height - 1)
    values = image[row, column].reshape(-1, 16, 2)
    label = cell[quads[:, 1], quads[:, 0]]
    complete = inside & (cell[row, column].reshape(-1, 16) == label[:, None]).all(axis=1)
    return values, complete & ~np.isnan(values).any(axis=(1, 2))


def _terms(u: np.ndarray, v: np.ndarray) -> np.ndarray:
    return np.stack([np.ones_like(u), u, v, u * u, u * v, v * v], axis=-1)


def _surface(coefficients: np.ndarray, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Value (n, 2) and derivative (n, 2, 2) of fitted surfaces (n, 6, 2)."""
    u, v = x.T
    zero, ones = np.zeros_like(u), np.ones_like(u)
    along_u = np.stack([zero, ones, zero, 2 * u, v, zero], axis=-1)
    along_v = np.stack([zero, zero, ones, zero, u, 2 * v], axis=-1)
    value, du, dv = (np.einsum("na,nai->ni", terms, coefficients) for terms in (_terms(u, v), along_u, along_v))
    return value, np.stack([du, dv], axis=-1)
