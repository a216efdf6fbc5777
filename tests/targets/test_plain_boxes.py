"""Boxes of a chart: one that is said to have a colour has it at every point, and most that have one are said so."""

import numpy as np
import pytest
from targets.examples import EXAMPLES, name_of

from pipeline.targets.drawing_kernels import BESIDE, MIXED, colour_of_box
from pipeline.targets.patterns.stars import SiemensStar, Stars

POINTS = 24
"""Along each side of a box."""


@pytest.mark.parametrize("pattern", EXAMPLES, ids=name_of)
def test_a_box_of_one_colour_has_no_other(pattern) -> None:
    rng, drawing = np.random.default_rng(4), pattern.drawing
    half = np.array([drawing.half_x_mm, drawing.half_y_mm])
    told, plain = 0, 0
    for middle, size in zip(rng.uniform(-1.1, 1.1, (400, 2)) * half, rng.uniform(0.005, 0.4, (400, 2)), strict=True):
        low, high = middle - size, middle + size
        found = colour_of_box(drawing.arrays, low[0], high[0], low[1], high[1])
        x, y = (axis.ravel() for axis in np.meshgrid(*np.linspace(low, high, POINTS).T))
        values = np.nan_to_num(drawing.whiteness(x, y), nan=BESIDE)
        if found != MIXED:
            assert np.all(values == found)
        told, plain = told + (found != MIXED), plain + (np.ptp(values) == 0)
    assert told > 0
    if not isinstance(pattern, (Stars, SiemensStar)):  # between spokes no box is plain
        assert told > 0.95 * plain


def test_a_box_that_holds_nan_is_doubted() -> None:
    arrays = EXAMPLES[0].drawing.arrays
    for place in range(4):
        box = [-0.1, 0.1, -0.1, 0.1]
        box[place] = np.nan
        assert colour_of_box(arrays, *box) == MIXED
