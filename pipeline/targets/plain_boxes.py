"""Plain boxes: boxes of a chart in which a drawing has one colour. Kernels only; chart, mm.

An answer of one colour is always right; with many or round shapes, a box of one colour may be called mixed.
"""

import math

from pipeline.jit.decorators import inline
from pipeline.targets.kernels import (
    BOTTOM,
    CHECKS,
    COLUMNS,
    DISC,
    INNER,
    LEFT,
    MIDDLE_X,
    MIDDLE_Y,
    OUTER,
    POLYGON,
    RADIUS,
    RIGHT,
    ROWS,
    SQUARE,
    TOP,
    whiteness,
)

BESIDE, MIXED = -1.0, -2.0
"""Values for a box besides 0 (black) and 1 (white): off the sheet; of several colours, or possibly so."""
_MOST_BINS = 16
"""Most bins in which a box may lie before it is called mixed: examining more costs more than the rays that this may
save.
"""


@inline
def colour_of_box(drawing, left, right, bottom, top):
    """1 if a box is entirely white, 0 if entirely black, else `BESIDE` or `MIXED`; `drawing`:
    `kernels.DrawingArrays`.
    """
    half_x, half_y, n, starts = drawing.half_x, drawing.half_y, drawing.bins, drawing.starts
    if not (left <= right and bottom <= top):  # NaN
        return MIXED
    if right < -half_x or left > half_x or top < -half_y or bottom > half_y:
        return BESIDE
    if left < -half_x or right > half_x or bottom < -half_y or top > half_y:
        return MIXED
    i0, i1 = _bin(left, half_x, n), _bin(right, half_x, n)
    j0, j1 = _bin(bottom, half_y, n), _bin(top, half_y, n)
    if (i1 - i0 + 1) * (j1 - j0 + 1) > _MOST_BINS:
        return MIXED
    for j in range(j0, j1 + 1):
        for i in range(i0, i1 + 1):
            bin_ = j * n + i
            for place in range(starts[bin_], starts[bin_ + 1]):
                if _has_edge_in(drawing, drawing.items[place], left, right, bottom, top):
                    return MIXED
    x, y = 0.5 * (left + right), 0.5 * (bottom + top)
    return whiteness(drawing, x, y)


@inline
def _bin(x, half, n):
    return min(int((x + half) / (2.0 * half) * n), n - 1)


@inline
def _has_edge_in(drawing, s, left, right, bottom, top):
    """Whether the outline of shape number s may pass through a box."""
    kind, numbers, first, corners = drawing.kinds[s], drawing.numbers, drawing.first, drawing.corners
    if kind == CHECKS:
        return _checks_change(numbers[s, COLUMNS], numbers[s, ROWS], numbers[s, SQUARE], left, right, bottom, top)
    if kind == POLYGON:
        if right < numbers[s, LEFT] or left > numbers[s, RIGHT] or top < numbers[s, BOTTOM] or bottom > numbers[s, TOP]:
            return False
        j = first[s + 1] - 1
        for i in range(first[s], first[s + 1]):
            ax, ay, bx, by = corners[j, 0], corners[j, 1], corners[i, 0], corners[i, 1]
            if _may_cross(ax, ay, bx, by, left, right, bottom, top):
                return True
            j = i
        return False
    x, y = numbers[s, MIDDLE_X], numbers[s, MIDDLE_Y]
    near_x, near_y = max(left - x, x - right, 0.0), max(bottom - y, y - top, 0.0)
    far_x, far_y = max(right - x, x - left), max(top - y, y - bottom)
    near, far = near_x * near_x + near_y * near_y, far_x * far_x + far_y * far_y
    inner, outer = (numbers[s, RADIUS], numbers[s, RADIUS]) if kind == DISC else (numbers[s, INNER], numbers[s, OUTER])
    return near <= outer * outer and far >= inner * inner


@inline
def _checks_change(columns, rows, square, left, right, bottom, top):
    """Whether a box meets several squares of a checkerboard, or its rim."""
    i0, i1 = math.floor(left / square + 0.5 * (columns + 1)), math.floor(right / square + 0.5 * (columns + 1))
    j0, j1 = math.floor(0.5 * (rows + 1) - top / square), math.floor(0.5 * (rows + 1) - bottom / square)
    if i1 < 0 or i0 > columns or j1 < 0 or j0 > rows:
        return False
    return i0 != i1 or j0 != j1


@inline
def _may_cross(ax, ay, bx, by, left, right, bottom, top):
    """Whether a segment may meet a box: neither the box's sides nor the line through the segment separate them."""
    if max(ax, bx) < left or min(ax, bx) > right or max(ay, by) < bottom or min(ay, by) > top:
        return False
    ex, ey = bx - ax, by - ay
    middle = ex * (0.5 * (bottom + top) - ay) - ey * (0.5 * (left + right) - ax)
    return abs(middle) <= 0.5 * (abs(ex) * (top - bottom) + abs(ey) * (right - left)) * (1.0 + 1e-12)
