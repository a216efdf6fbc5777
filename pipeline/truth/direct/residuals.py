"""J(x) and its errors from integrals over a bundle: the mean over an exposure, and over both planes of a pair."""

from collections.abc import Callable

import numpy as np

from pipeline.camera.integrals import Integral
from pipeline.records.shapes import Float64
from pipeline.truth.planes import Exposed

Integrate = Callable[[np.ndarray], Integral]
"""Function of planes (n, 2, 4, 3) of rows that returns their integrals."""


def over_exposure(exposed: Exposed, integrate: Integrate) -> Integral:
    """The weighted mean of the integrals over the stretches of an exposure."""
    first, *later = (integrate(pair.both) for pair in exposed.stretches)
    if not later:
        return first
    share = exposed.weights[:, :, None]
    moments, error_mm = share[:, 0] * first.moments, share[:, 0] * first.error_mm
    is_random = first.is_random
    rays = first.rays
    for stretch, part in enumerate(later, 1):
        moments = moments + share[:, stretch] * part.moments
        error_mm = error_mm + share[:, stretch] * part.error_mm
        is_random = is_random | part.is_random
        rays += part.rays
    return Integral(moments, error_mm, is_random, rays)


def mean_hit(moments: Float64[np.ndarray, "n COLUMNS ..."]) -> np.ndarray:
    """Mean of the hits of bundles on both planes, (n, 2, ...) [mm]; on equal planes that on one, to the bit."""
    return (moments[:, :2] + moments[:, 2:4]) / 2


def errors_px(inverse: Float64[np.ndarray, "n 2 2"], integral: Integral) -> np.ndarray:
    """Error of J in the image [px]: random errors add in squares, differences of two levels linearly."""
    in_squares = np.sqrt(np.einsum("nij,nj->ni", inverse**2, integral.error_mm**2))
    linearly = np.einsum("nij,nj->ni", np.abs(inverse), integral.error_mm)
    return np.where(integral.is_random[:, None], in_squares, linearly)
