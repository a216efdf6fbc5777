"""Rays of pixels of cameras that no lens is traced for."""

import numpy as np

from pipeline.results.answers import PixelRays


def lit_rays(x_px: np.ndarray, y_px: np.ndarray, origin_mm: np.ndarray, ahead: np.ndarray) -> PixelRays:
    """Rays from points along vectors (n, 3), without errors and in full light."""
    direction = ahead / np.linalg.norm(ahead, axis=1, keepdims=True)
    more = {"error_px": np.zeros((len(ahead), 2)), "hit_fraction": np.ones(len(ahead)), "microlens": None}
    return PixelRays(x_px=x_px, y_px=y_px, origin_mm=origin_mm, direction=direction, **more)
