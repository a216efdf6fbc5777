"""Faces of glass: the exact reflectance of a dielectric (Fresnel), refraction (Snell), and rough faces as a layer of
microfacets (Walter, Marschner, Li and Torrance, "Microfacet Models for Refraction through Rough Surfaces", EGSR 2007)
with the distribution of Trowbridge and Reitz and a masking term for each direction. Light that goes from facet to facet
is lost.

A `ratio` is the index beyond a face over that before it, as a path that comes from the camera sees it: above 1 into
glass, below 1 out of it, and 0 where there is no glass. Radiance in glass is that in air times the square of its index.
"""

import math

from pipeline.jit.decorators import inline, unit
from pipeline.plugins.scenes.lighting.reflection import masking, visible_facet
from pipeline.targets.vectors import along, dot, times
from pipeline.targets.vectors import unit as of_length_one


@inline
def dielectric(cosine, ratio):
    """Reflectance of a face for unpolarised light, and the cosine of refracted light, 0 if all is reflected."""
    beyond_squared = 1.0 - (1.0 - cosine * cosine) / (ratio * ratio)
    if not beyond_squared > 0.0:
        return 1.0, 0.0
    beyond = math.sqrt(beyond_squared)
    perpendicular = (cosine - ratio * beyond) / (cosine + ratio * beyond)
    parallel = (ratio * cosine - beyond) / (ratio * cosine + beyond)
    return 0.5 * (perpendicular * perpendicular + parallel * parallel), beyond


@inline
def through_pane(cosine, index):
    """Transmittance (1 - r) / (1 + r) of a pane with all internal reflections, from outside; r of one face."""
    r, _ = dielectric(abs(cosine), index)
    return (1.0 - r) / (1.0 + r)


@inline
def through_face(cosine, index):
    """Transmittance of one of two parallel faces, and the path between them over that of light that does not bend."""
    _, inside = dielectric(abs(cosine), index)
    return math.sqrt(through_pane(cosine, index)), abs(cosine) / inside


@inline
def bent(direction, normal, cosine, beyond, ratio):
    """Direction of refracted light, for its cosines before and behind a face whose normal points to its start."""
    return along(times(1.0 / ratio, direction), cosine / ratio - beyond, normal)


@unit
def glass_reflected(paint, view, lit):
    """Reflectance or transmittance of rough glass times the cosine, and the density of `glass_scattered`.

    Frame of the surface, on whose side z > 0 it is seen; `lit` may be on either side.
    """
    ratio, alpha = paint.ratio, paint.alpha
    if lit[2] > 0.0:
        half = of_length_one((view[0] + lit[0], view[1] + lit[1], view[2] + lit[2]))
    else:
        half = view[0] + ratio * lit[0], view[1] + ratio * lit[1], view[2] + ratio * lit[2]
        half = of_length_one(times(math.copysign(1.0, half[2]), half))
    glance, other = dot(view, half), dot(lit, half)
    if not (view[2] > 0.0 and glance > 0.0 and other * lit[2] > 0.0):
        return 0.0, 0.0
    reflectance, _ = dielectric(glance, ratio)
    inner = half[2] * half[2] * (alpha * alpha - 1.0) + 1.0
    facets = alpha * alpha / (math.pi * inner * inner) * masking(alpha, view[2]) / view[2]
    if lit[2] > 0.0:
        density = reflectance * facets / 4.0
        return density * masking(alpha, lit[2]), density
    denominator = glance + ratio * other
    once = (1.0 - reflectance) * facets * glance * -other / (denominator * denominator)
    return once * masking(alpha, -lit[2]), once * ratio * ratio


@unit
def glass_scattered(paint, view, pair, dice):
    """A direction on either side of rough glass, drawn by its facets; zero if a facet sends light to another facet."""
    half = visible_facet(paint.alpha, view, pair[0], pair[1])
    glance = dot(view, half)
    reflectance, beyond = dielectric(glance, paint.ratio)
    side = 1.0 if dice < reflectance else -1.0
    if side > 0.0:
        lit = along(times(-1.0, view), 2.0 * glance, half)
    else:
        lit = bent(times(-1.0, view), half, glance, beyond, paint.ratio)
    return lit if side * lit[2] > 0.0 else (0.0, 0.0, 0.0)
