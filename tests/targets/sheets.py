"""Prints of drawings as images: a pinhole camera straight before the sheet."""

import numpy as np

from pipeline.targets.drawing import Drawing

SUBSAMPLES = 8


def scanned(drawing: Drawing, px_per_mm: float, turn_deg: float = 0.0) -> np.ndarray:
    """The sheet as 8-bit grey, each pixel the mean of 64 points; the sheet's centre is the centre of the image."""
    angle = np.radians(turn_deg)
    half = np.array([drawing.half_x_mm, drawing.half_y_mm])
    reach = np.abs([[np.cos(angle), np.sin(angle)], [np.sin(angle), np.cos(angle)]]) @ half
    width, height = (np.ceil(2 * reach * px_per_mm)).astype(int)
    steps = (np.arange(SUBSAMPLES) + 0.5) / SUBSAMPLES - 0.5
    x = ((np.arange(width)[:, None] + steps).ravel() - (width - 1) / 2) / px_per_mm
    y = -((np.arange(height)[:, None] + steps).ravel() - (height - 1) / 2) / px_per_mm
    grid_x, grid_y = np.meshgrid(x, y)
    c, s = np.cos(angle), np.sin(angle)
    value = drawing.whiteness((c * grid_x + s * grid_y).ravel(), (c * grid_y - s * grid_x).ravel())
    value = np.nan_to_num(value, nan=1.0).reshape(height, SUBSAMPLES, width, SUBSAMPLES).mean(axis=(1, 3))
    return np.rint(255 * value).astype(np.uint8)


def on_scan(drawing: Drawing, xy_mm: np.ndarray, px_per_mm: float) -> np.ndarray:
    """Where points of the chart lie in `scanned` without a turn, (n, 2); (0, 0) is the centre of the first pixel."""
    width, height = np.ceil(2 * px_per_mm * np.array([drawing.half_x_mm, drawing.half_y_mm]))
    return np.array([(width - 1) / 2, (height - 1) / 2]) + px_per_mm * np.asarray(xy_mm) * [1, -1]
