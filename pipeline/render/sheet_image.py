"""Sums of light over the rays of pixels, also straight from one flat sheet that nothing hides. Kernels only; mm."""

import math
from typing import NamedTuple

import numpy as np

from pipeline.jit.decorators import kernel
from pipeline.targets.kernels import CHECKS, check_colour, on_plane, whiteness


class Sheet(NamedTuple):
    """A flat patch before a background.

    Attributes
    ----------
    drawing : tuple
        `Drawing.arrays`.
    colours : (2,) float64
        Radiance of black and of white.
    pose : (4, 4) float64
        vision_from_patch.
    background : float
        Radiance beside the sheet.
    """

    drawing: tuple[np.ndarray, ...]
    colours: np.ndarray
    pose: np.ndarray
    background: float


@kernel
def add_light(sheet, rays, pixels, wanted, image):
    """Add what rays bring to an image, ray by ray.

    Parameters
    ----------
    rays : camera.records.Leaving
    pixels : (n,) int64
        Pixel of each ray.
    wanted, image : (m,) bool, (m,) float64
        Pixels that are added to, and their sums.
    """
    # Plain numbers stay in registers; the arrays of a drawing would be handed on at every ray.
    extent, kinds, numbers, first, corners, bins, starts, items = sheet.drawing
    origin, direction, share, _ = rays
    pose, background, black, white = sheet.pose, sheet.background, sheet.colours[0], sheet.colours[1]
    is_checks = kinds.size == 1 and kinds[0] == CHECKS
    columns, rows, square = (numbers[0, 0], numbers[0, 1], numbers[0, 2]) if is_checks else (0.0, 0.0, 1.0)
    for i in range(pixels.size):
        if not wanted[pixels[i]]:
            continue
        x, y, towards = on_plane(pose, origin, direction, i)
        if math.isnan(x) or abs(x) > extent[0] or abs(y) > extent[1]:
            light = background
        elif towards >= 0.0:
            light = 0.0
        elif is_checks:
            light = black if check_colour(columns, rows, square, x, y) == 0.0 else white
        else:
            value = whiteness(extent, kinds, numbers, first, corners, bins, starts, items, x, y)
            light = black if value == 0.0 else white
        image[pixels[i]] += share[i] * light


@kernel
def add_values(share, light, pixels, image):
    """Add light (n,) of rays by their shares (n,) to their pixels (n,), ray by ray."""
    for i in range(pixels.size):
        image[pixels[i]] += share[i] * light[i]
