"""The picture of labels to look at: share, depth and things side by side, as far as there are any."""

import numpy as np

from pipeline.records.shapes import Float32
from pipeline.render.spectral.preview import srgb_encoded

Channels = dict[str, Float32[np.ndarray, "h w"]]
"""Pixels of each channel, by its name."""
_FARTHEST = 0.15
"""Brightness of the farthest thing [1]; the nearest one is white, and what sees nothing is black."""
_HUES = np.array([0, 9, 18])
"""Bits of an id by which red, green and blue are shifted: those of its fraction."""


def preview(channels: Channels) -> np.ndarray:
    """An sRGB picture, (h, n w, 3) uint8: depth in grey, then the things with most light in colours of their own."""
    share = np.nan_to_num(channels["A"].astype(float))[..., None]
    pictures = []
    if "Z" in channels:
        near_mm, far_mm = (np.nanmin(channels["Z"]), np.nanmax(channels["Z"])) if share.any() else (0.0, 0.0)
        depth = np.nan_to_num((far_mm - channels["Z"].astype(float)) / max(far_mm - near_mm, 1e-9))
        pictures.append(share * (_FARTHEST + (1 - _FARTHEST) * np.repeat(depth[..., None], 3, axis=2)))
    for matte in [name.removesuffix("00.R") for name in channels if name.endswith("00.R")]:
        ids, coverage = (np.ascontiguousarray(channels[f"{matte}00.{part}"]) for part in "RG")
        colour = (ids.view(np.uint32)[..., None] >> _HUES.astype(np.uint32) & 255) / 255
        pictures.append(coverage[..., None].astype(float) * colour)
    shown = np.concatenate(pictures or [np.repeat(share, 3, axis=2)], axis=1)
    return np.rint(255 * srgb_encoded(np.clip(shown, 0.0, 1.0))).astype(np.uint8)
