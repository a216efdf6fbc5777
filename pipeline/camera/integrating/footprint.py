"""Bundles whose rays start anywhere on a square instead of at a point, by Gauss and Legendre over the square."""

import functools

import numpy as np

from pipeline.camera.tracing.moments import COLUMNS, COVARIANCE, FREE_WEIGHT, MEAN, VARIANCE, WEIGHT
from pipeline.records.shapes import Float64


@functools.cache
def nodes(count: int) -> tuple[np.ndarray, np.ndarray]:
    """Nodes (count^2, 2) on the square of edge 1 about the origin, and their shares of it (count^2,)."""
    node, weight = np.polynomial.legendre.leggauss(count)
    x, y = (axis.ravel() for axis in np.meshgrid(node / 2, node / 2))
    return np.stack([x, y], axis=1), np.outer(weight / 2, weight / 2).ravel()


def joined(moments: Float64[np.ndarray, "n m COLUMNS"], share: Float64[np.ndarray, "m"]) -> np.ndarray:
    """Moments of whole squares from those of their nodes, (n, COLUMNS).

    Parameters
    ----------
    moments : (n, m, COLUMNS) float64
        Of the bundle of every node; NaN, with weight 0, where nothing passes. Standard errors are not looked at.
    share : (m,) float64
    """
    weight = moments[..., WEIGHT] * share
    result = np.zeros((len(moments), COLUMNS))
    result[:, WEIGHT], result[:, FREE_WEIGHT] = weight.sum(axis=1), moments[..., FREE_WEIGHT] @ share
    with np.errstate(invalid="ignore"):  # dark squares
        part = weight / result[:, WEIGHT, None]
    known = np.where(weight[..., None] > 0, moments, 0.0)
    mean = np.einsum("nm,nma->na", part, known[..., MEAN:COVARIANCE])
    apart = known[..., MEAN:COVARIANCE] - mean[:, None]
    rows, columns = np.triu_indices(4)
    products = known[..., COVARIANCE:WEIGHT] + apart[..., rows] * apart[..., columns]
    result[:, MEAN:COVARIANCE] = mean
    result[:, COVARIANCE:WEIGHT] = np.einsum("nm,nma->na", part, products)
    result[np.isnan(mean[:, 0]), VARIANCE:] = np.nan
    return result
