"""Tables of the light that a layer of microfacets returns, by integration over its visible facets."""

import functools
import math

import numpy as np

from pipeline.jit.decorators import kernel
from pipeline.render.lighting.reflection import ENTRIES, LEAST_ALPHA, NODES, Layers, _masking, _visible_facet

_DRAWS = 128, 24
"""Points along both axes of the square that facets are drawn from: the tables are then accurate to 0.0002."""


@functools.cache
def layers() -> Layers:
    """The tables, the same for all surfaces."""
    sums = np.empty((NODES, NODES, ENTRIES))
    fill_sums(sums, *_DRAWS)
    root = np.linspace(0.0, 1.0, NODES)  # of the cosine
    # The mean of f is the integral of 2 c f dc, with c = root^2: 4 root^3 f droot; linear between nodes, so exactly.
    means = np.stack([_mean(root, sums[:, :, k]) for k in range(ENTRIES)], axis=1)
    return Layers(sums, means)


def _mean(root: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Integrals of 4 x^3 f(x) for rows of f that are linear between nodes, by Gauss and Legendre with 3 points."""
    nodes, weights = np.polynomial.legendre.leggauss(3)
    total = np.zeros(len(values))
    for first, end, low, high in zip(root, root[1:], values.T, values.T[1:], strict=False):
        for node, weight in zip(nodes, weights, strict=True):
            part = 0.5 * (1.0 + node)
            x = first + part * (end - first)
            total += 0.5 * weight * (end - first) * 4.0 * x**3 * ((1.0 - part) * low + part * high)
    return total


@kernel
def fill_sums(sums, steps, turns):
    """Write `reflection.Layers.sums`: nodes are equally spaced in the root of alpha and in the root of the cosine.

    Most facets of a smooth surface lie flat. The few steep ones, whose light goes below the horizon, are the last
    hundredth of the first number that facets are drawn from, u = 1 - s^4; steps are even in s. Each counts by its
    length in u: their sum is 1, so that a mirror loses nothing. Both halves of a turn are alike.
    """
    nodes = sums.shape[0]
    for i in range(nodes):
        alpha = max(LEAST_ALPHA, (i / (nodes - 1)) ** 2)
        for j in range(nodes):
            cosine = max(1e-4, (j / (nodes - 1)) ** 2)
            seen = math.sqrt(1.0 - cosine * cosine), 0.0, cosine
            whole, grazing = 0.0, 0.0
            for a in range(steps):
                s, step = (a + 0.5) / steps, ((a + 1) ** 4 - a**4) / steps**4
                for b in range(turns):
                    half = _visible_facet(alpha, seen, 1.0 - s**4, 0.5 * (b + 0.5) / turns)
                    glance = seen[0] * half[0] + seen[2] * half[2]
                    lit = 2.0 * glance * half[2] - seen[2]
                    part = step * _masking(alpha, lit)
                    off = 1.0 - min(max(glance, 0.0), 1.0)
                    whole += part
                    grazing += part * off**5
            sums[i, j, 0], sums[i, j, 1] = whole / turns, grazing / turns
