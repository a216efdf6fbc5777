"""Moments of bundles that are mixtures of others: of several points of a square, or of several wavelengths."""

import numpy as np

from pipeline.camera.tracing.moments import COLUMNS, COVARIANCE, FREE_WEIGHT, MEAN, VARIANCE, WEIGHT
from pipeline.records.shapes import Float64


def mixed(moments: Float64[np.ndarray, "n m COLUMNS"], share: Float64[np.ndarray, "m"]) -> np.ndarray:
    """Moments of mixtures, (n, COLUMNS).

    Parameters
    ----------
    moments : (n, m, COLUMNS) float64
        Moments of every part; NaN, with weight 0, where nothing passes. Errors of parts are independent.
    share : (m,) float64
        Share of each part in the mixture where all pass alike; negative: the part is taken away.
    """
    weight = moments[..., WEIGHT] * share
    result = np.zeros((len(moments), COLUMNS))
    result[:, WEIGHT], result[:, FREE_WEIGHT] = weight.sum(axis=1), moments[..., FREE_WEIGHT] @ share
    with np.errstate(invalid="ignore", divide="ignore"):  # dark mixtures
        part = weight / result[:, WEIGHT, None]
    known = np.where(weight[..., None] != 0, moments, 0.0)
    mean = np.einsum("nm,nma->na", part, known[..., MEAN:COVARIANCE])
    apart = known[..., MEAN:COVARIANCE] - mean[:, None]
    rows, columns = np.triu_indices(4)
    products = known[..., COVARIANCE:WEIGHT] + apart[..., rows] * apart[..., columns]
    result[:, MEAN:COVARIANCE] = mean
    result[:, COVARIANCE:WEIGHT] = np.einsum("nm,nma->na", part, products)
    result[:, VARIANCE:] = np.einsum("nm,nma->na", part**2, known[..., VARIANCE:])
    return result
