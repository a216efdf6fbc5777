"""Claim: bounds and inner points of regions are those of closed forms.

Their corners and the nodes of arcs are judged by laws/test_direct.py, by what quadrature yields.
"""

import math

import numpy as np

from pipeline.camera import boundary


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
