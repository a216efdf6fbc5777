"""Quadrature by Gauss and Legendre on the unit interval and on the unit square."""

import functools

import numpy as np


@functools.cache
def unit_nodes(count: int) -> tuple[np.ndarray, np.ndarray]:
    """Nodes on [0, 1] and their weights, (count,) each: exact up to the degree 2 count - 1."""
    nodes, weights = np.polynomial.legendre.leggauss(count)
    return (nodes + 1) / 2, weights / 2


@functools.cache
def square_nodes(count: int) -> tuple[np.ndarray, np.ndarray]:
    """Nodes (count^2, 2) on the square of edge 1 about the origin, and their shares of it (count^2,)."""
    node, weight = np.polynomial.legendre.leggauss(count)
    x, y = (axis.ravel() for axis in np.meshgrid(node / 2, node / 2))
    return np.stack([x, y], axis=1), np.outer(weight / 2, weight / 2).ravel()
