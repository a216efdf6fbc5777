"""The picture of labels to look at, of the size of the image: things in colours of their own, darker the farther."""

import numpy as np

from pipeline.records.shapes import Float32
from pipeline.render.spectral.preview import srgb_encoded

_FARTHEST = 0.1
"""Brightness of the farthest thing [1]; the nearest one has its full colour, and what sees nothing is black."""
_LEAST = 0.15
"""Least of red, green and blue in the colour of a thing [1]: none vanishes."""


def preview(channels: dict[str, Float32[np.ndarray, "h w"]]) -> np.ndarray:
    """An sRGB picture, (h, w, 3) uint8, of the channels of labels.exr that are there."""
    shown = np.repeat(np.nan_to_num(channels["A"].astype(float))[..., None], 3, axis=2)
    for matte in [name.removesuffix("00.R") for name in channels if name.endswith("00.R")][:1]:
        bits = np.ascontiguousarray(channels[f"{matte}00.R"]).view(np.uint32)[..., None]
        colour = _LEAST + (1 - _LEAST) * (bits >> np.array([0, 7, 14], np.uint32) & 127) / 127
        shown = channels[f"{matte}00.G"][..., None] * colour
    if "Z" in channels and np.isfinite(channels["Z"]).any():
        z_mm = channels["Z"].astype(float)
        near_mm, far_mm = np.nanmin(z_mm), np.nanmax(z_mm)
        nearness = np.nan_to_num((far_mm - z_mm) / max(far_mm - near_mm, 1.0))
        shown = shown * (_FARTHEST + (1 - _FARTHEST) * nearness)[..., None]
    return np.rint(255 * srgb_encoded(np.clip(shown, 0.0, 1.0))).astype(np.uint8)
