"""Reflection by a surface: matt paint below a specular layer of microfacets, and a clear coat above both.

Of the specular layer, single facets reflect as in UsdPreviewSurface, with the distribution D of Trowbridge and Reitz
(GGX), Smith's masking and shadowing G and Schlick's Fresnel term F. Directions v of view and l of light point away from
the surface, h halves them:

    f_1(v, l) = D(h) G(v, l) F(v . h) / (4 cos(v) cos(l))

Light that leaves a facet towards another one is not lost (Heitz, Hanika, d'Eon and Dachsbacher 2016). The share M(v)
that returns after two and more reflections leaves in all directions alike (Kulla and Conty 2017). The share 1 - R(v)
that the layer does not return meets the paint, of reflectance a (Kelemen and Szirmay-Kalos 2001). With means <> over
the hemisphere, weighted by the cosine, the reflectance is

    f(v, l) = f_1(v, l) + [M(v) M(l) / <M> + a (1 - R(v)) (1 - R(l)) / (1 - <R>)] / pi

It is reciprocal, and a surface that absorbs nothing reflects all light, in each direction. M and R are tabled, by
integration over visible facets.

A clear coat is one more layer of facets. It weakens the terms in brackets on the way in and out, by 1 - R of the coat
in both directions, and f_1 by the smaller of the two. Means of both layers together are tabled.

Frame of a surface: z along its shading normal.
"""

import functools
import math
from typing import NamedTuple

import numpy as np

from pipeline.jit.decorators import inline, kernel, unit
from pipeline.targets.vectors import dot
from pipeline.targets.vectors import unit as of_length_one

NODES = 64
"""Nodes of the tables along each axis [1]: with them a white furnace is white to 0.0003."""
COARSE = 22
"""Nodes of the table of two layers along each axis [1], of which every third node of the others is one."""
_COAT = 0.04
"""Reflectance of a clear coat face on [1]: that of the index 1.5."""
LEAST_ALPHA = 1e-3
"""Least width of facets [1]: a roughness of 0.03. A mirror would be a case of its own, and looks the same."""
_STAYING = 0.77
"""Coefficient in `_many` [1]: the more light first facets send to others, the longer it stays among facets."""
_DRAWS = 128, 24
"""Points along both axes of the square that facets are drawn from: the tables are then accurate to 0.0002."""
_ROOT = 0.72, -1.045, 0.29, -0.026
"""Coefficients of the root in `Layers.pairs` [1]: of the mean Schlick term g of light that first facets send to others,
of the same times roughness, of the root of g, and of the cosine. Fitted to walks over all roughnesses and angles, as in
tests/plugins/scenes/microfacet_walk.py: light of all reflections together is right to 0.7 %.
"""


class Layers(NamedTuple):
    """Tables of the specular layer, from `tabled_layers`."""

    # (NODES, NODES, 5), one array, because kernels count the users of each that they hand on. By the roots of alpha and
    # of the cosine: light that single reflections return where the Fresnel term is 1, and where it is (1 - cos)^5; and
    # the root of the share of other light that returns if facets reflect (1 - cos)^5. By the root of alpha and by
    # `Paint.facing`: means over a hemisphere, weighted by the cosine, of both parts of `Layer`
    pairs: np.ndarray
    # (COARSE, COARSE, COARSE, 2), means of the light that a coat returns times both parts of `Layer`, by the roots of
    # the coat's alpha and of alpha, and by `Paint.facing`
    coated: np.ndarray


class Paint(NamedTuple):
    """A surface at a point and one wavelength."""

    diffuse: float  # reflectance of the paint; 0 below a metal
    facing: float  # reflectance of a facet seen face on
    alpha: float  # width of the distribution of facets; 0: there is no specular layer
    coat: float = 0.0  # share of the surface that has a clear coat, of the index 1.5
    coat_alpha: float = LEAST_ALPHA
    ratio: float = 0.0  # of glass, see `refraction`, which is smooth with the alpha 0; 0: the surface is opaque


class Layer(NamedTuple):
    """M and R of a layer in one direction: light that returns after two and more reflections, and in all."""

    many: float
    returned: float


class ViewedSurface(NamedTuple):
    """A surface viewed along a direction: all terms without the direction of light."""

    direction: tuple[float, float, float]
    layer: Layer  # in this direction
    # means over a hemisphere of `Layer.many`, and of the light that the layer lets through to the paint
    many: float
    kept: float
    chance: float  # probability with which `scattered` follows the layer
    coat: Layer  # what a clear coat returns, its share counted
    coat_many: float  # mean over a hemisphere of `Layer.many` of the coat, its share counted
    coat_chance: float  # probability with which `scattered` follows the coat


@inline
def _node(x):
    """Node of a table below a number in [0, 1], and the fraction of the step behind it."""
    position = min(max(x, 0.0), 1.0) * (NODES - 1)
    i = min(int(position), NODES - 2)
    return i, position - i


@inline
def _bilinear(table, i, a, j, b, k):
    """Entry of a table, bilinear between four nodes."""
    low = (1.0 - b) * table[i, j, k] + b * table[i, j + 1, k]
    return (1.0 - a) * low + a * ((1.0 - b) * table[i + 1, j, k] + b * table[i + 1, j + 1, k])


@inline
def _layer(layers, paint, cosine):
    """M and R of the specular layer in a direction."""
    i, a = _node(math.sqrt(paint.alpha))
    j, b = _node(math.sqrt(max(cosine, 0.0)))
    full, grazing = _bilinear(layers.pairs, i, a, j, b, 0), _bilinear(layers.pairs, i, a, j, b, 1)
    many = _many(paint.facing, 1.0 - full, _bilinear(layers.pairs, i, a, j, b, 2))
    return Layer(many, paint.facing * (full - grazing) + grazing + many)


@inline
def _many(facing, onward, root):
    """M, from the light `onward` that first facets send to others if they absorb nothing.

    The root of M / onward is a ratio of linear functions of the reflectance: right to 0.7 % of all light.
    """
    share = (facing + (1.0 - facing) * root) / (1.0 + (1.0 - facing) * _STAYING * onward * onward)
    return onward * share * share


@inline
def masking(alpha, cosine):
    """Smith's masking term G_1: the share of facets that is visible in a direction."""
    if not cosine > 0.0:
        return 0.0
    slope = alpha * alpha * (1.0 - cosine * cosine) / (cosine * cosine)
    return 2.0 / (1.0 + math.sqrt(1.0 + max(0.0, slope)))


@inline
def _lit_share(visible, other):
    """G(v, l) / G_1(v), with correlated heights: the share of visible facets that light reaches, too."""
    return other / (visible + other - visible * other) if other > 0.0 else 0.0


@inline
def fresnel(facing, cosine):
    """Schlick's approximation F_0 + (1 - F_0) (1 - cosine)^5."""
    off = 1.0 - min(max(cosine, 0.0), 1.0)
    return facing + (1.0 - facing) * off * off * off * off * off


@inline
def viewed_along(layers, paint, view):
    """The surface viewed along a direction."""
    bare = Layer(0.0, 0.0)
    if paint.coat > 0.0:
        return _coated_along(layers, paint, view)
    if paint.alpha == 0.0:
        return ViewedSurface(view, bare, 1.0, 1.0, 0.0, bare, 1.0, 0.0)
    layer = _layer(layers, paint, view[2])
    i, a = _node(math.sqrt(paint.alpha))
    j, b = _node(paint.facing)
    many = max(_bilinear(layers.pairs, i, a, j, b, 3), 1e-12)
    kept = max(1.0 - _bilinear(layers.pairs, i, a, j, b, 4), 1e-9)
    return ViewedSurface(view, layer, many, kept, specular_chance(paint, layer), bare, 1.0, 0.0)


@unit
def _coated_along(layers, paint, view):
    """A surface below a clear coat, viewed along a direction."""
    layer, many, kept, chance = Layer(0.0, 0.0), 1.0, 1.0, 0.0
    if paint.alpha > 0.0:
        layer = _layer(layers, paint, view[2])
        i, a = _node(math.sqrt(paint.alpha))
        j, b = _node(paint.facing)
        many = _bilinear(layers.pairs, i, a, j, b, 3) - paint.coat * _coated_mean(layers, paint, 0)
        kept = 1.0 - _bilinear(layers.pairs, i, a, j, b, 4) + paint.coat * _coated_mean(layers, paint, 1)
        chance = specular_chance(paint, layer)
    i, a = _node(math.sqrt(paint.coat_alpha))
    j, b = _node(_COAT)
    coat, coat_many = _coat(layers, paint, view[2]), paint.coat * _bilinear(layers.pairs, i, a, j, b, 3)
    kept -= paint.coat * _bilinear(layers.pairs, i, a, j, b, 4)
    under = (1.0 - coat.returned) * (layer.returned + paint.diffuse * (1.0 - layer.returned))
    follow = min(0.95, max(0.05, coat.returned / (coat.returned + under + 1e-12)))
    return ViewedSurface(view, layer, max(many, 1e-12), max(kept, 1e-9), chance, coat, max(coat_many, 1e-12), follow)


@inline
def _coat(layers, paint, cosine):
    """M and R of the clear coat in a direction, times its share."""
    layer = _layer(layers, Paint(0.0, _COAT, paint.coat_alpha, 0.0, LEAST_ALPHA, 0.0), cosine)
    return Layer(paint.coat * layer.many, paint.coat * layer.returned)


@inline
def _coated_mean(layers, paint, part):
    """Entry of `Layers.coated`, trilinear between eight nodes."""
    last, total = COARSE - 1, 0.0
    x, y, z = math.sqrt(paint.coat_alpha) * last, math.sqrt(paint.alpha) * last, paint.facing * last
    i, j, k = min(int(x), last - 1), min(int(y), last - 1), min(int(z), last - 1)
    for corner in range(8):
        p, q, r = corner & 1, corner >> 1 & 1, corner >> 2
        weight = (1.0 - abs(x - i - p)) * (1.0 - abs(y - j - q)) * (1.0 - abs(z - k - r))
        total += weight * layers.coated[i + p, j + q, k + r, part]
    return total


@unit
def let_through(layers, paint, cosine):
    """Share of light that neither layer nor coat of a surface returns, in a direction."""
    through = 1.0
    if paint.alpha > 0.0:
        through -= _layer(layers, paint, cosine).returned
    return max(through * (1.0 - _coat(layers, paint, cosine).returned), 0.0) if paint.coat > 0.0 else max(through, 0.0)


@inline
def reflected(layers, paint, viewed, lit):
    """The reflectance f times the cosine of the light, and the density with which `scattered` draws its direction."""
    if not (viewed.direction[2] > 0.0 and lit[2] > 0.0):
        return 0.0, 0.0
    if paint.coat > 0.0:
        return _reflected_by_coat(layers, paint, viewed, lit)
    if paint.alpha == 0.0:
        return paint.diffuse * lit[2] / math.pi, lit[2] / math.pi
    once, around, density = _of_layers(layers, paint, viewed, lit)
    return once + around * lit[2] / math.pi, density


@inline
def _of_layers(layers, paint, viewed, lit):
    """f_1 times the cosine, the terms of f in brackets, and the density."""
    layer, other = viewed.layer, _layer(layers, paint, lit[2])
    many = layer.many * other.many / viewed.many
    below = paint.diffuse * (1.0 - layer.returned) * (1.0 - other.returned) / viewed.kept
    once, single = _once(paint.facing, paint.alpha, viewed.direction, lit)
    return once, many + below, viewed.chance * single + (1.0 - viewed.chance) * lit[2] / math.pi


@unit
def _reflected_by_coat(layers, paint, viewed, lit):
    """Values of `reflected` with a clear coat."""
    coat = _coat(layers, paint, lit[2])
    coat_viewed = viewed.coat
    # f_1 times the cosine, the terms of f in brackets, and the density, without a specular layer
    once, around, density = 0.0, paint.diffuse / viewed.kept, lit[2] / math.pi
    if paint.alpha > 0.0:
        once, around, density = _of_layers(layers, paint, viewed, lit)
    mirrored, facets = _once(_COAT, paint.coat_alpha, viewed.direction, lit)
    around = around * (1.0 - coat_viewed.returned) * (1.0 - coat.returned)
    around += coat_viewed.many * coat.many / viewed.coat_many
    value = once * (1.0 - max(coat_viewed.returned, coat.returned)) + paint.coat * mirrored + around * lit[2] / math.pi
    return value, viewed.coat_chance * facets + (1.0 - viewed.coat_chance) * density


@inline
def _once(facing, alpha, view, lit):
    """f_1 times the cosine of the light, and the density of directions that visible facets mirror."""
    half = of_length_one((view[0] + lit[0], view[1] + lit[1], view[2] + lit[2]))
    glance = max(dot(view, half), 1e-12)
    # Density of facets with this normal, times their visible part.
    inner = half[2] * half[2] * (alpha * alpha - 1.0) + 1.0
    facets = alpha * alpha / (math.pi * inner * inner)
    visible = masking(alpha, view[2])
    single = facets * visible / (4.0 * view[2])
    return fresnel(facing, glance) * single * _lit_share(visible, masking(alpha, lit[2])), single


@inline
def specular_chance(paint, layer):
    """Probability with which `scattered` follows the specular layer."""
    under = paint.diffuse * (1.0 - layer.returned)
    return min(0.95, max(0.05, layer.returned / (layer.returned + under + 1e-12)))


@inline
def scattered(paint, viewed, pair):
    """A direction of light, drawn by the coat, the specular layer or the paint."""
    u, view = pair[0], viewed.direction
    if paint.coat > 0.0:
        if u < viewed.coat_chance:
            return _mirrored(paint.coat_alpha, view, u / viewed.coat_chance, pair[1])
        u = (u - viewed.coat_chance) / (1.0 - viewed.coat_chance)
    if paint.alpha > 0.0:
        if u < viewed.chance:
            return _mirrored(paint.alpha, view, u / viewed.chance, pair[1])
        u = (u - viewed.chance) / (1.0 - viewed.chance)
    radius, turn = math.sqrt(u), 2.0 * math.pi * pair[1]
    return radius * math.cos(turn), radius * math.sin(turn), math.sqrt(max(0.0, 1.0 - u))


@inline
def _mirrored(alpha, view, u, v):
    """The direction that a facet mirrors, drawn by the visible area of facets."""
    half = visible_facet(alpha, view, u, v)
    twice = 2.0 * dot(view, half)
    return twice * half[0] - view[0], twice * half[1] - view[1], twice * half[2] - view[2]


@inline
def visible_facet(alpha, view, u, v):
    """Normal of a facet, drawn by the visible area of facets."""
    # Source: Dupuy and Benyoub, "Sampling Visible GGX Normals with Spherical Caps", CGF 42(8), 2023.
    x, y, z = of_length_one((alpha * view[0], alpha * view[1], view[2]))
    height, turn = (1.0 - u) * (1.0 + z) - z, 2.0 * math.pi * v
    radius = math.sqrt(max(0.0, 1.0 - height * height))
    cap = radius * math.cos(turn) + x, radius * math.sin(turn) + y, height + z
    return of_length_one((alpha * cap[0], alpha * cap[1], max(1e-12, cap[2])))


@functools.cache
def tabled_layers() -> Layers:
    """The tables, the same for all surfaces."""
    sums = np.empty((NODES, NODES, 3))
    fill_sums(sums, *_DRAWS)
    root = np.linspace(0.0, 1.0, NODES)  # of alpha, which is roughness; of the cosine; and the reflectance
    full, grazing = sums[:, :, 0], sums[:, :, 1]
    g = sums[:, :, 2] / np.maximum(1.0 - full, 1e-9)
    features = g, g * root[:, None], np.sqrt(g), np.broadcast_to(root**2, g.shape)
    sums[:, :, 2] = np.tensordot(_ROOT, features, 1)
    many = _many.function(root[:, None, None], 1.0 - full, sums[:, :, 2])  # by reflectance first
    returned = root[:, None, None] * (full - grazing) + grazing + many
    both = np.stack([many, returned], axis=-1).transpose(1, 0, 2, 3)
    weights = _weights(root)
    coat = _COAT * (full - grazing) + grazing + _many.function(_COAT, 1.0 - full, sums[:, :, 2])
    step = (NODES - 1) // (COARSE - 1)
    coated = np.einsum("ac,bfck,c->abfk", coat[::step], both[::step, ::step], weights)
    pairs = np.concatenate([sums, np.einsum("aick,c->aik", both, weights)], axis=2)
    return Layers(np.ascontiguousarray(pairs), np.ascontiguousarray(coated))


def _weights(root: np.ndarray) -> np.ndarray:
    """Weights of nodes in means over a hemisphere, of functions linear between the nodes (Gauss and Legendre)."""
    # The mean of f is the integral of 2 c f dc, with c = root^2: 4 root^3 f droot.
    nodes, weights = np.polynomial.legendre.leggauss(3)
    part = 0.5 * (1.0 + nodes)
    low = root[:-1, None]
    step = np.diff(root)[:, None]
    piece = 0.5 * weights * step * 4.0 * (low + part * step) ** 3
    return np.append(piece @ (1.0 - part), 0.0) + np.append(0.0, piece @ part)


@kernel
def fill_sums(sums, steps, turns):
    """Integrate over visible facets the first two entries of `Layers.pairs`, and the Schlick term of light that first
    facets send to others.

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
            view = math.sqrt(1.0 - cosine * cosine), 0.0, cosine
            visible = masking(alpha, cosine)
            full, grazing, onward = 0.0, 0.0, 0.0
            for a in range(steps):
                s = (a + 0.5) / steps
                step = ((a + 1) ** 4 - a**4) / steps**4
                for b in range(turns):
                    half = visible_facet(alpha, view, 1.0 - s**4, 0.5 * (b + 0.5) / turns)
                    glance = view[0] * half[0] + view[2] * half[2]
                    lit = 2.0 * glance * half[2] - view[2]
                    part = step * _lit_share(visible, masking(alpha, lit))
                    schlick = (1.0 - min(max(glance, 0.0), 1.0)) ** 5
                    full += part
                    grazing += part * schlick
                    onward += (step - part) * schlick
            sums[i, j, 0], sums[i, j, 1], sums[i, j, 2] = full / turns, grazing / turns, onward / turns
