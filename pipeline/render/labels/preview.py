"""The picture of labels to look at, of the size of the image: things in colours of their own, darker the farther."""

import numpy as np

from pipeline.records.shapes import Float32
from pipeline.render.spectral.preview import srgb_encoded

SHOWN = "A", "Z", "CryptoObject00.R", "CryptoObject00.G"
"""Channels that it shows, those that are there."""
_DARKEST = 0.15
"""Brightness of the farthest thing, and of red, green and blue in the colour of any [1]: nothing vanishes."""


def preview(channels: dict[str, Float32[np.ndarray, "h w"]]) -> np.ndarray:
    """An sRGB picture, (h, w, 3) uint8."""
    shown = np.repeat(np.nan_to_num(channels["A"].astype(float))[..., None], 3, axis=2)
    if SHOWN[-1] in channels:
        bits = np.ascontiguousarray(channels[SHOWN[-2]]).view(np.uint32)[..., None]
        hue = (bits >> np.array([0, 7, 14], np.uint32) & 127) / 127
        shown = channels[SHOWN[-1]][..., None] * (_DARKEST + (1 - _DARKEST) * hue)
    if "Z" in channels and np.isfinite(channels["Z"]).any():
        z_mm = channels["Z"].astype(float)
        nearness = (np.nanmax(z_mm) - z_mm) / max(float(np.ptp(z_mm[np.isfinite(z_mm)])), 1.0)
        shown = shown * (_DARKEST + (1 - _DARKEST) * np.nan_to_num(nearness))[..., None]
    return np.rint(255 * srgb_encoded(np.clip(shown, 0.0, 1.0))).astype(np.uint8)
