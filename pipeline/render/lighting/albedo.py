"""Tables of the light that a layer of microfacets returns, by integration over its visible facets."""

import functools
import math

import numpy as np

from pipeline.jit.decorators import kernel
from pipeline.render.lighting.reflection import LEAST_ALPHA, NODES, Layers, _both, _many, _masking, _visible_facet

_DRAWS = 128, 24
"""Points along both axes of the square that facets are drawn from: the tables are then accurate to 0.0002."""


_ROOT = 0.72, -1.045, 0.29, -0.026
"""Coefficients of the root in `Layers.sums` [1]: of the mean Schlick term g of light that first facets send to others,
of the same times roughness, of the root of g, and of the cosine. Fitted to walks over all roughnesses and angles, as in
tests/laws/microfacet_walk.py: light of all reflections together is right to 0.7 %.
"""


@functools.cache
def layers() -> Layers:
    """The tables, the same for all surfaces."""
    sums = np.empty((NODES, NODES, 3))
    fill_sums(sums, *_DRAWS)
    root = np.linspace(0.0, 1.0, NODES)  # of alpha, which is roughness; of the cosine; and the reflectance
    whole, grazing = sums[:, :, 0], sums[:, :, 1]
    g = sums[:, :, 2] / np.maximum(1.0 - whole, 1e-9)
    features = g, g * root[:, None], np.sqrt(g), np.broadcast_to(root**2, g.shape)
    sums[:, :, 2] = np.tensordot(_ROOT, features, 1)
    many = _many.function(root[:, None, None], 1.0 - whole, sums[:, :, 2])  # by reflectance first
    returned = root[:, None, None] * (whole - grazing) + grazing + many
    means = np.stack([many, returned], axis=-1).transpose(1, 0, 2, 3)
    return Layers(sums, np.ascontiguousarray(np.einsum("aick,c->aik", means, _weights(root))))


def _weights(root: np.ndarray) -> np.ndarray:
    """Weights of nodes in means over a hemisphere of what is linear between them.

    The mean of f is the integral of 2 c f dc, with c = root^2: 4 root^3 f droot.
    """
    nodes, weights = np.polynomial.legendre.leggauss(3)
    part, low, step = 0.5 * (1.0 + nodes), root[:-1, None], np.diff(root)[:, None]
    piece = 0.5 * weights * step * 4.0 * (low + part * step) ** 3
    return np.append(piece @ (1.0 - part), 0.0) + np.append(0.0, piece @ part)


@kernel
def fill_sums(sums, steps, turns):
    """Write two entries of `reflection.Layers.sums`, and the Schlick term of light that first facets send to others.

    Nodes are equally spaced in the root of alpha and in the root of the cosine. Most facets of a smooth surface lie
    flat. The few steep ones, whose light goes below the horizon, are the last hundredth of the first number that facets
    are drawn from, u = 1 - s^4; steps are even in s. Each counts by its length in u: their sum is 1, so that a mirror
    loses nothing. Both halves of a turn are alike.
    """
    nodes = sums.shape[0]
    for i in range(nodes):
        alpha = max(LEAST_ALPHA, (i / (nodes - 1)) ** 2)
        for j in range(nodes):
            cosine = max(1e-4, (j / (nodes - 1)) ** 2)
            seen = math.sqrt(1.0 - cosine * cosine), 0.0, cosine
            whole, grazing, others, visible = 0.0, 0.0, 0.0, _masking(alpha, cosine)
            for a in range(steps):
                s, step = (a + 0.5) / steps, ((a + 1) ** 4 - a**4) / steps**4
                for b in range(turns):
                    half = _visible_facet(alpha, seen, 1.0 - s**4, 0.5 * (b + 0.5) / turns)
                    glance = seen[0] * half[0] + seen[2] * half[2]
                    lit = 2.0 * glance * half[2] - seen[2]
                    part = step * _both(visible, _masking(alpha, lit))
                    schlick = (1.0 - min(max(glance, 0.0), 1.0)) ** 5
                    whole += part
                    grazing += part * schlick
                    others += (step - part) * schlick
            sums[i, j, 0], sums[i, j, 1], sums[i, j, 2] = whole / turns, grazing / turns, others / turns
