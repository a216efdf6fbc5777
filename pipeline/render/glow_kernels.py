"""Light along rays without Embree: the first of several flat sheets, boxes around everything that only Embree knows, so
that rays that miss all of them need not be asked, and sums over the rays of pixels. Kernels only; vision frame, mm.
"""

import math

from pipeline.jit.decorators import kernel
from pipeline.targets.drawing_kernels import check_colour, only_checks, whiteness
from pipeline.targets.surface_kernels import on_plane
from pipeline.targets.vectors import row


@kernel
def may_meet(boxes, origin, direction, near):
    """Whether rays meet any box with edges along the axes, in front of their start.

    `boxes`, (k, 2, 3) float64: lowest and highest corner.
    `near`, (n,) bool: written; true also where a ray holds NaN.
    """
    for i in range(near.size):
        near[i] = False
        for k in range(boxes.shape[0]):
            enters, leaves = 0.0, math.inf
            for axis in range(3):
                per = 1.0 / direction[i, axis]
                a, b = (boxes[k, 0, axis] - origin[i, axis]) * per, (boxes[k, 1, axis] - origin[i, axis]) * per
                enters, leaves = max(enters, min(a, b)), min(leaves, max(a, b))
            if not leaves < enters:
                near[i] = True


@kernel
def first_sheet(poses, half_sizes, origin, direction, first):
    """Nearest sheet in front of the start of each ray, in double precision.

    `poses`, (k, 4, 4) float64: vision_from_sheet; a sheet lies in z = 0 about the origin.
    `half_sizes`, (k, 2) float64: along x and y.
    `first`, (n,) int64: written; -1 where the ray meets none or holds NaN.
    """
    for i in range(first.size):
        nearest, first[i] = 0.0, -1
        for k in range(half_sizes.shape[0]):
            t, x, y, _ = on_plane(poses[k], row(origin, i), row(direction, i))
            is_nearer = t > 0.0 and (first[i] < 0 or t < nearest)
            if is_nearer and abs(x) <= half_sizes[k, 0] and abs(y) <= half_sizes[k, 1]:
                nearest, first[i] = t, k


@kernel
def add_light(artwork, background, rays, pixels, wanted, image):
    """Add the light of rays to an image, ray by ray, if all that they may meet is a flat patch before a background.

    `rays`, `pixels`, camera.records.Leaving, (n,) int64: rays, and the pixel of each.
    `wanted`, `image`, (m,) bool, (m,) float64: pixels that are added to, and their sums.
    """
    # Plain numbers stay in registers; the arrays of a drawing would be passed on for every ray.
    drawing, colours, pose = artwork
    origin, direction, share, _ = rays
    half_x, half_y, black, white = drawing.half_x, drawing.half_y, colours[0], colours[1]
    is_checks, columns, rows, square = only_checks(drawing)
    for i in range(pixels.size):
        if not wanted[pixels[i]]:
            continue
        t, x, y, towards = on_plane(pose, row(origin, i), row(direction, i))
        if not (t > 0.0 and abs(x) <= half_x and abs(y) <= half_y):
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
