"""Bundles whose rays start anywhere on a square instead of at a point, by Gauss and Legendre over the square."""

import functools

import numpy as np


@functools.cache
def nodes(count: int) -> tuple[np.ndarray, np.ndarray]:
    """Nodes (count^2, 2) on the square of edge 1 about the origin, and their shares of it (count^2,)."""
    node, weight = np.polynomial.legendre.leggauss(count)
    x, y = (axis.ravel() for axis in np.meshgrid(node / 2, node / 2))
    return np.stack([x, y], axis=1), np.outer(weight / 2, weight / 2).ravel()
