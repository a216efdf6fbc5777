"""Normal and Poisson random numbers of a pixel, from its counter."""

import math

from pipeline.jit.decorators import inline
from pipeline.render.sensor.counter import DRAWS, uniforms

_FEW = 10.0
"""Mean up to which a count is found by inversion [e-]: rejection needs a mean of 10, and inversion takes as many steps
as the count."""
_NEVER = 1e-20
"""Probability below which no further count is tried [1]: random numbers have steps of 2e-16."""
_MOST = 1e9
"""Means beyond this are taken as this [e-]: ten times the largest full well, so that none of them is seen."""


@inline
def normals(keys, row, column, stage):
    """Two independent numbers of mean 0 and variance 1 (Box and Muller 1958)."""
    first, second = uniforms(keys, row, column, stage, 0)
    radius, angle = math.sqrt(-2.0 * math.log(first)), 2.0 * math.pi * second
    return radius * math.cos(angle), radius * math.sin(angle)


@inline
def poisson(keys, row, column, stage, mean):
    """Poisson-distributed count of a mean, as a float.

    Small means by inversion of the distribution function, others by transformed rejection with squeeze (PTRS): both
    are exact but for rounding.

    Source: W. Hormann, The transformed rejection method for generating Poisson random variables, Insurance: Mathematics
    and Economics 12 (1993) 39-45.
    """
    if mean <= 0.0:
        return 0.0
    if mean < _FEW:
        return _by_inversion(mean, uniforms(keys, row, column, stage, 0)[0])
    return _by_rejection(keys, row, column, stage, min(mean, _MOST))


@inline
def _by_inversion(mean, level):
    count, probability = 0.0, math.exp(-mean)
    total = probability
    while level > total and probability > _NEVER:
        count += 1.0
        probability *= mean / count
        total += probability
    return count


@inline
def _by_rejection(keys, row, column, stage, mean):
    b = 0.931 + 2.53 * math.sqrt(mean)
    a = -0.059 + 0.02483 * b
    inverse_alpha, squeeze = 1.1239 + 1.1328 / (b - 3.4), 0.9277 - 3.6224 / (b - 2.0)
    count = mean
    for draw in range(DRAWS):
        first, second = uniforms(keys, row, column, stage, draw)
        first -= 0.5
        edge = 0.5 - abs(first)
        count = math.floor((2.0 * a / edge + b) * first + mean + 0.43)
        if edge >= 0.07 and second <= squeeze:
            break
        if count < 0.0 or (edge < 0.013 and second > edge):
            continue
        bound = count * math.log(mean) - mean - math.lgamma(count + 1.0)
        if math.log(second * inverse_alpha / (a / (edge * edge) + b)) <= bound:
            break
    return count
