"""Quadrature by Gauss and Legendre on the unit interval."""

import functools

import numpy as np


@functools.cache
def unit_nodes(count: int) -> tuple[np.ndarray, np.ndarray]:
    """Nodes on [0, 1] and their weights, (count,) each: exact up to the degree 2 count - 1."""
    nodes, weights = np.polynomial.legendre.leggauss(count)
    return (nodes + 1) / 2, weights / 2
