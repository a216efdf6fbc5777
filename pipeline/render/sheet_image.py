"""Sums of light over the rays of pixels, also directly from one flat sheet that nothing hides. Kernels only; mm."""

import math
from typing import NamedTuple

from pipeline.jit.decorators import kernel
from pipeline.targets.kernels import Artwork, check_colour, on_plane, only_checks, whiteness


class FlatSheet(NamedTuple):
    """A flat patch before a background.

    `background`: radiance beside the sheet.
    """

    artwork: Artwork
    background: float


@kernel
def add_light(sheet, rays, pixels, wanted, image):
    """Add the light of rays to an image, ray by ray.

    `rays`, camera.records.Leaving.
    `pixels`, (n,) int64: pixel of each ray.
    `wanted`, `image`, (m,) bool, (m,) float64: pixels that are added to, and their sums.
    """
    # Plain numbers stay in registers; the arrays of a drawing would be passed on for every ray.
    drawing, colours, pose = sheet.artwork
    origin, direction, share, _ = rays
    half_x, half_y, background, black, white = drawing.half_x, drawing.half_y, sheet.background, colours[0], colours[1]
    is_checks, columns, rows, square = only_checks(drawing)
    for i in range(pixels.size):
        if not wanted[pixels[i]]:
            continue
        x, y, towards = on_plane(pose, origin, direction, i)
        if math.isnan(x) or abs(x) > half_x or abs(y) > half_y:
            light = background
        elif towards >= 0.0:
            light = 0.0
        elif is_checks:
            light = black if check_colour(columns, rows, square, x, y) == 0.0 else white
        else:
            value = whiteness(drawing, x, y)
            light = black if value == 0.0 else white
        image[pixels[i]] += share[i] * light


@kernel
def add_values(share, light, pixels, image):
    """Add light (n,) of rays by their shares (n,) to their pixels (n,), ray by ray."""
    for i in range(pixels.size):
        image[pixels[i]] += share[i] * light[i]
