"""Boxes around everything that only Embree knows: rays that miss all of them need not be asked of Embree. Kernels
only; mm.
"""

import math

from pipeline.jit.decorators import kernel


@kernel
def may_meet(boxes, origin, direction, near):
    """Whether rays meet any box with edges along the axes, in front of their start.

    Parameters
    ----------
    boxes : (k, 2, 3) float64
        Lowest and highest corner.
    origin, direction : (n, 3) float64
    near : (n,) bool
        Written; true also where a ray holds NaN.
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
