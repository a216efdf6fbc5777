"""Image positions as formats count them: the only place where pixels get other numbers."""

import numpy as np

from pipeline.exports.conventions import Convention, ImageAxes, Origin

_FIRST_PIXEL = {Origin.ZERO: 0.0, Origin.HALF: 0.5, Origin.ONE: 1.0}
"""Number of the centre of the top-left pixel [px]; of other origins it depends on the image."""


def positions(places_px: np.ndarray, convention: Convention, size_px: tuple[int, int]) -> np.ndarray:
    """Image positions of ours as a format counts them, (..., 2) [px, or 1]."""
    upwards = convention.axes is ImageAxes.X_UP
    if convention.origin is Origin.SHARE:
        shares = (places_px + _FIRST_PIXEL[Origin.HALF]) / np.array(size_px)
        shifted = np.stack([shares[..., 0], 1 - shares[..., 1]], axis=-1) if upwards else shares
    elif convention.origin is Origin.IMAGE_CENTRE:
        shifted = (places_px - (np.array(size_px) - 1) / 2) * (1, -1 if upwards else 1)
    else:
        shifted = (places_px + _FIRST_PIXEL[convention.origin]) * (1, -1 if upwards else 1)
    return shifted[..., ::-1] if convention.axes is ImageAxes.Y_X else shifted


def ours(stated: np.ndarray, convention: Convention, size_px: tuple[int, int]) -> np.ndarray:
    """Image positions of a format as ours, (..., 2) [px]: the inverse of `positions`."""
    first, last = np.zeros(2), np.array(size_px) - 1.0
    start, end = (positions(place, convention, size_px) for place in (first, last))
    steps = (stated - start) / (end - start)
    return np.asarray((steps[..., ::-1] if convention.axes is ImageAxes.Y_X else steps) * last)
