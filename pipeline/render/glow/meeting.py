"""What rays meet without Embree: boxes around everything that only Embree knows, so that rays that miss all of them
need not be asked, and the first of several flat sheets. Kernels only; vision frame, mm.
"""

import math

from pipeline.jit.decorators import kernel


@kernel
def may_meet(boxes, origin, direction, near):
    """Whether rays meet any box with edges along the axes, in front of their start.

    `boxes`, (k, 2, 3) float64: lowest and highest corner.
    `origin`, `direction`, (n, 3) float64.
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
    `origin`, `direction`, (n, 3) float64.
    `first`, (n,) int64: written; -1 where the ray meets none or holds NaN.
    """
    for i in range(first.size):
        nearest, first[i] = 0.0, -1
        for k in range(half_sizes.shape[0]):
            pose = poses[k]
            ox, oy, oz = origin[i, 0] - pose[0, 3], origin[i, 1] - pose[1, 3], origin[i, 2] - pose[2, 3]
            dx, dy, dz = direction[i, 0], direction[i, 1], direction[i, 2]
            away = pose[0, 2] * ox + pose[1, 2] * oy + pose[2, 2] * oz
            t = -away / (pose[0, 2] * dx + pose[1, 2] * dy + pose[2, 2] * dz)
            if not (t > 0.0 and (first[i] < 0 or t < nearest)):
                continue
            hx, hy, hz = ox + t * dx, oy + t * dy, oz + t * dz
            x = pose[0, 0] * hx + pose[1, 0] * hy + pose[2, 0] * hz
            y = pose[0, 1] * hx + pose[1, 1] * hy + pose[2, 1] * hz
            if abs(x) <= half_sizes[k, 0] and abs(y) <= half_sizes[k, 1]:
                nearest, first[i] = t, k
