"""Claim: the image of an ideal corner changes from pixel to pixel as a plain sum over a disc of light says, and its
second derivatives are those of its first.
"""

import numpy as np
import pytest

from pipeline.truth.positions.bundle_map import BundleMap
from pipeline.truth.positions.corner_image import CornerImage, hessian_of

SHEARED = np.array([[0.9, 0.5], [-0.3, 1.1]])
"""Coordinates along the corner's edges per px of the image: edges that are neither upright nor at right angles."""
RADIUS = 1.3
PLACES = np.array([[0.0, 0.0], [0.2, -0.1], [-0.15, 0.2]])


@pytest.fixture(scope="module")
def image() -> CornerImage:
    """A uniform disc of light, carried along affinely, in 32 rings of 128 directions; white and black are 1 and 0."""
    offsets, angle = np.array([-1.0, 0.0, 1.0]), 2 * np.pi * np.arange(128) / 128
    grid = 0.75 * np.stack(np.meshgrid(offsets, offsets, indexing="ij"), axis=-1).reshape(-1, 2)
    disc = RADIUS * np.arange(33)[:, None] / 32 * np.stack([np.cos(angle), np.sin(angle)], axis=-1)[:, None]
    hits = (grid @ SHEARED.T)[:, None, None] + disc
    fields = np.concatenate([hits, np.ones((*hits.shape[:-1], 1))], axis=-1)
    return CornerImage(BundleMap(np.zeros(2), np.full(2, 0.75), offsets, fields), 1.0)


def light(x_px: np.ndarray) -> float:
    """White share of the disc about a position, by a sum over 60,000 of its points: a chequer of two quadrants."""
    x, y = RADIUS * ((np.mgrid[:280, :280] + 0.5) / 140 - 1)
    u, v = SHEARED @ x_px
    return float(np.mean(((x + u) * (y + v) > 0)[np.hypot(x, y) < RADIUS]))


def test_the_gradient_is_the_light_of_one_side_of_the_pixel_minus_that_of_the_other(image: CornerImage) -> None:
    """Of any size and either sign, but the same for all positions and both axes."""
    nodes, weights = np.polynomial.legendre.leggauss(5)

    def along(x: np.ndarray, across: np.ndarray) -> float:
        return sum(w / 2 * light(x + node / 2 * across) for node, w in zip(nodes, weights, strict=True))

    first, second = np.eye(2)
    expected = [
        [
            along(x + first / 2, second) - along(x - first / 2, second),
            along(x + second / 2, first) - along(x - second / 2, first),
        ]
        for x in PLACES
    ]
    found = np.array([image.gradient(x) for x in PLACES])
    scale = np.sum(found * expected) / np.sum(np.square(expected))
    assert abs(scale) > 1
    assert np.abs(found[0]).max() < 1e-6 * np.abs(found).max()
    np.testing.assert_allclose(found / scale, expected, rtol=0, atol=0.01 * np.abs(expected).max())


def test_second_derivatives_are_those_of_the_gradient(image: CornerImage) -> None:
    """By central differences over another step; a saddle in the middle."""
    for x in PLACES[:2]:
        expected = [(image.gradient(x + step) - image.gradient(x - step)) / 0.04 for step in 0.02 * np.eye(2)]
        np.testing.assert_allclose(hessian_of(image.gradient, x), expected, rtol=0, atol=0.02 * np.abs(expected).max())
    assert np.linalg.det(hessian_of(image.gradient, PLACES[0])) < 0
