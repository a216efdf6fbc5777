"""The real chief ray: from a point behind the lens backwards through the centre of the aperture stop."""

import numpy as np

from pipeline.camera.camera import CameraError
from pipeline.optics.kernels import trace_rays
from pipeline.optics.table import unbounded

_STEPS = 25
_TOLERANCE_MM = 1e-12


def chief_heights(table: np.ndarray, stop_row: int, plane_mm: float, heights: np.ndarray) -> np.ndarray:
    """Where the chief ray of each point (height, 0, plane) crosses the rear vertex plane.

    Parameters
    ----------
    table : (n, columns) float64
        From `optics.table.towards_scene`.
    stop_row : int
        Row of the aperture stop in the table.
    plane_mm : float
        Vision z of the points.
    heights : (m,) float64
        Heights of the points above the axis [mm].

    Returns
    -------
    (m,) float64
        Height of the crossing, on the side given by its sign; the secant method ends when the ray meets the stop
        within 1e-12 mm of its centre, or when it stops improving. [mm]

    Raises
    ------
    CameraError
        When the rear group lets no such ray through.
    """
    rear = unbounded(table[: stop_row + 1])  # The chief ray may lie outside of the clear apertures.
    if np.isclose(rear[-1, 0], rear[0, 0]):
        return np.zeros_like(heights)
    older, newer = np.zeros_like(heights), heights * 1e-3 + 1e-3
    miss_older, miss_newer = (_stop_height(rear, plane_mm, heights, r) for r in (older, newer))
    for _ in range(_STEPS):
        slope = (miss_newer - miss_older) / np.where(newer == older, 1.0, newer - older)
        done = (np.abs(miss_newer) < _TOLERANCE_MM) | (slope == 0)
        following = np.where(done, newer, newer - miss_newer / np.where(slope == 0, 1.0, slope))
        older, miss_older = newer, miss_newer
        newer, miss_newer = following, _stop_height(rear, plane_mm, heights, following)
    if not np.all(np.abs(miss_newer) < 1e-9):
        worst = float(heights[np.argmax(~(np.abs(miss_newer) < 1e-9))])
        raise CameraError(f"no ray from {worst} mm off the axis reaches the centre of the aperture stop")
    return newer


def _stop_height(rear: np.ndarray, plane_mm: float, heights: np.ndarray, crossings: np.ndarray) -> np.ndarray:
    """Height at which rays through (height, plane) and (crossing, rear vertex plane) meet the stop; NaN for a miss."""
    zero = np.zeros_like(heights)
    position = np.stack([heights, zero, np.full_like(heights, plane_mm)], axis=1)
    direction = np.stack([crossings - heights, zero, np.full_like(heights, rear[0, 0] - plane_mm)], axis=1)
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    alive = np.ones(heights.size)
    trace_rays(rear, position, direction, alive)
    return np.where(alive > 0, position[:, 0], np.nan)
