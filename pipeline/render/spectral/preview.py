"""Previews: pictures of 8 bits beside linear images."""

import numpy as np

from pipeline.records.shapes import Float64, Num


def srgb_encoded(linear: Float64[np.ndarray, "..."]) -> np.ndarray:
    """Values in [0, 1] encoded with the transfer function of sRGB, (...) float64.

    colour-science has this function, with the same bits. Importing it takes a second and a half of processor time in
    each worker process, and most images need nothing else of it.

    Source: IEC 61966-2-1:1999, sRGB.
    """
    return np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)


def srgb_preview(irradiance: Num[np.ndarray, "h w"], white: float) -> np.ndarray:
    """A neutral picture of a monochromatic image, encoded with the transfer function of sRGB.

    `irradiance`: linear and relative, finite.
    `white`: the irradiance that is shown as white; values above it and below 0 are clipped.
    Returns (h, w, 3) uint8: the three components are equal.
    Raises ValueError: a pixel is not finite or `white` is not a positive number.
    """
    if not (np.isfinite(white) and white > 0):
        raise ValueError(f"white must be a positive irradiance, not {white}")
    unusable = int(np.count_nonzero(~np.isfinite(irradiance)))
    if unusable:
        raise ValueError(f"{unusable} of {irradiance.size} pixels hold no finite irradiance")
    encoded = srgb_encoded(np.clip(np.asarray(irradiance, dtype=np.float64) / white, 0.0, 1.0))
    grey = np.rint(255.0 * encoded).astype(np.uint8)
    return np.repeat(grey[..., None], 3, axis=2)
