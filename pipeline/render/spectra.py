"""From irradiance to a picture for people.

Light here has one wavelength. Its true colour would hide what the picture is for, sharpness and brightness, so that it
is shown as neutral grey.
"""

import warnings

import numpy as np

from pipeline.records.shapes import Num

with warnings.catch_warnings():
    # On import, colour warns that Matplotlib and other optional packages are missing. None of them is needed here.
    warnings.simplefilter("ignore")
    from colour.models import eotf_inverse_sRGB


def srgb_preview(irradiance: Num[np.ndarray, "h w"], white: float) -> np.ndarray:
    """A neutral picture of a monochromatic image, encoded with the transfer function of sRGB.

    Parameters
    ----------
    irradiance : (h, w) float
        Linear and relative, finite.
    white : float
        The irradiance that is shown as white; more is clipped, and so is less than 0.

    Returns
    -------
    (h, w, 3) uint8
        The three components are equal.

    Raises
    ------
    ValueError
        If a pixel is not finite or `white` is not a positive number.

    References
    ----------
    IEC 61966-2-1:1999, sRGB.
    """
    if not (np.isfinite(white) and white > 0):
        raise ValueError(f"white must be a positive irradiance, not {white}")
    unusable = int(np.count_nonzero(~np.isfinite(irradiance)))
    if unusable:
        raise ValueError(f"{unusable} of {irradiance.size} pixels hold no finite irradiance")
    encoded = eotf_inverse_sRGB(np.clip(np.asarray(irradiance, dtype=np.float64) / white, 0.0, 1.0))
    grey = np.rint(255.0 * encoded).astype(np.uint8)
    return np.repeat(grey[..., None], 3, axis=2)
