"""Which points are nearest, against all distances."""

import numpy as np
import pytest

from pipeline.camera.micro_images.centres import NOBODY, Nearby

_TURN = np.array([[0.96, -0.28], [0.28, 0.96]])


def lattice(rows, columns, noise=0.0):
    """A hexagonal lattice, turned, some of it moved."""
    l, k = np.mgrid[:rows, :columns]
    points = 0.12 * np.stack([k + 0.5 * l, np.sqrt(0.75) * l], axis=-1).reshape(-1, 2) @ _TURN.T
    return points + np.random.default_rng(3).normal(0.0, noise, points.shape)


def around(points, count, reach):
    """Positions over and about the points, some in the wide."""
    random = np.random.default_rng(5)
    return np.concatenate(
        [
            random.uniform(points.min(axis=0) - reach, points.max(axis=0) + reach, (count, 2)),
            points[random.integers(0, len(points), count)] + random.normal(0.0, 0.01 * reach, (count, 2)),
        ]
    )


CLOUDS = {
    "lattice": lattice(40, 50, 0.01),
    "line": np.stack([np.arange(30.0), np.full(30, 2.0)], axis=1),
    "heap": np.concatenate([np.random.default_rng(7).normal(0.0, s, (300, 2)) for s in (1e-3, 5.0)]),
    "three": np.array([[0.0, 0.0], [3.0, 1.0], [-1.0, 2.0]]),
    "one": np.array([[2.0, -1.0]]),
    "twice": np.array([[1.0, 1.0], [1.0, 1.0]]),
}


@pytest.mark.parametrize("count", [1, 2, 5])
@pytest.mark.parametrize("name", CLOUDS)
def test_the_nearest_are_those_of_all_distances(name, count):
    points = CLOUDS[name]
    positions = around(points, 200, 2.0)
    distance, rows = Nearby(points).nearest(positions, count)
    apart = np.sqrt(((points - positions[:, None]) ** 2).sum(axis=2))
    order = np.argsort(apart, axis=1, kind="stable")[:, :count]  # stable: the lower row first
    some = order.shape[1]
    assert np.array_equal(rows[:, :some], order)
    assert np.array_equal(distance[:, :some], np.take_along_axis(apart, order, axis=1))
    assert (rows[:, some:] == NOBODY).all() and np.isinf(distance[:, some:]).all()


@pytest.mark.parametrize("radius", [0.0, 0.05, 0.2, 1.0])
@pytest.mark.parametrize("name", CLOUDS)
def test_all_within_a_radius_are_found_nearest_first(name, radius):
    points = CLOUDS[name]
    positions = np.concatenate([around(points, 100, 0.5), points[:20]])
    distance, rows = Nearby(points).within(positions, radius)
    apart = np.sqrt(((points - positions[:, None]) ** 2).sum(axis=2))
    assert rows.shape[1] == (apart <= radius).sum(axis=1).max()
    for near, found, away in zip(apart, rows, distance, strict=True):
        some = np.argsort(near, kind="stable")[: (near <= radius).sum()]
        assert np.array_equal(found[: len(some)], some) and np.array_equal(away[: len(some)], near[some])
        assert (found[len(some) :] == NOBODY).all()


def test_no_position_and_an_unknown_one_have_nobody():
    near = Nearby(CLOUDS["lattice"])
    assert near.nearest(np.zeros((0, 2)))[1].shape == (0, 1)
    assert near.within(np.zeros((0, 2)), 1.0)[1].shape == (0, 0)
    assert near.nearest(np.array([[np.nan, 0.0]]))[1].tolist() == [[NOBODY]]
