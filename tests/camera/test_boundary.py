"""Claim: bounds, inner points and corners of regions are those of closed forms; an arc has the nodes that it needs.

What quadrature over arcs yields is judged by laws/test_direct.py and laws/test_regions.py.
"""

import math

import numpy as np
import pytest
from tolerances import BISECTED

from pipeline.camera import boundary

STEPS = 40
"""Bisections: to 1e-12 of a way."""
NONE = boundary.Corners(np.zeros(0, np.int64), np.zeros(0))


def test_bounds_move_outwards_until_they_are_dark_and_no_farther() -> None:
    """Doubled from 1: past 5 with 8 and inner bound 4; a way that is dark at once stays; and at most so often."""
    edge = np.array([0.5, 5.0, 1000.0])
    bounds = boundary.widened(lambda far: far < edge, np.zeros(3), np.ones(3), lambda far: 2 * far, 4)
    assert [b.tolist() for b in bounds] == [[0.0, 4.0, 8.0], [1.0, 8.0, 16.0]]


def test_an_inner_point_is_lit_also_where_the_mean_is_dark() -> None:
    """A half moon whose mean lies in the bite; the nearest of its points; and nothing where nothing is lit."""
    u = np.linspace(-1, 1, 41)
    points = np.stack(np.meshgrid(u, u), axis=-1).reshape(-1, 2)
    x, y = points.T
    moon = (np.hypot(x, y) <= 1) & (np.hypot(x - 0.3, y) > 0.95)
    mean = points[moon].mean(axis=0)
    assert math.hypot(mean[0] - 0.3, mean[1]) < 0.95
    found = boundary.inner_points(np.stack([points, points]), np.stack([moon, np.zeros_like(moon)]))
    assert np.isnan(found[1]).all() and moon[np.flatnonzero((points == found[0]).all(axis=1))].all()
    assert math.dist(found[0], mean) == min(math.dist(point, mean) for point in points[moon])


CORNERS = {0: [0.5, 2.0, 3.0, 6.0], 2: [1.0, 1.02, 4.0]}
"""Directions of the corners of two regions; in the second, two lie between neighbouring directions of 24."""


def label_at(owner: np.ndarray, angle: np.ndarray) -> np.ndarray:
    """Numbers of the arcs: the last goes on at 0, as the first begins at a corner."""
    turned = angle % (2 * np.pi)
    pairs = zip(owner.tolist(), turned.tolist(), strict=True)
    return np.array([np.searchsorted(CORNERS[row], turn, side="right") % len(CORNERS[row]) for row, turn in pairs])


@pytest.mark.parametrize("first", [24, 7])
def test_corners_are_found_also_between_two_first_directions(first: int) -> None:
    """The third label between two of them makes two corners."""
    rows = np.array(list(CORNERS))
    angle = np.tile(boundary.even_angles(first), 2)
    label = label_at(np.repeat(rows, first), angle).reshape(2, first)
    # With 24 first directions the short arc of 0.02 rad hides between 0.785 and 1.047.
    found = boundary.corners(label_at, rows, label, STEPS)
    for row, exact in CORNERS.items():
        of_it = found.angle[found.owner == row]
        assert np.all(np.diff(of_it) > 0) and np.abs(of_it - exact).max() < BISECTED
    assert found.owner.tolist() == sorted(found.owner.tolist())


def test_a_smooth_edge_has_even_directions_and_every_arc_its_least_number() -> None:
    """A trapezoid rule, whose error falls faster than any power; an arc of a thousandth still has eight nodes."""
    owner, angle, share = boundary.directions(np.array([0]), NONE, 48, 8, 24)
    assert np.array_equal(angle, boundary.even_angles(24)) and np.all(share == 2 * np.pi / 24) and not owner.any()
    found = boundary.Corners(np.zeros(2, np.int64), np.array([1.0, 1.001]))
    _, angle, share = boundary.directions(np.array([0]), found, 48, 8)
    inside = (angle > 1.0) & (angle < 1.001)
    assert np.count_nonzero(inside) == 8 and abs(share[inside].sum() - 0.001) < BISECTED
