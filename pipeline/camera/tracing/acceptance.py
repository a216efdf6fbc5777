"""Angular response of pixels, and the weight of an aperture with it. Kernels only.

`acceptance` is a `camera.tracing.records.Acceptance`. With theta the angle to the axis and A its acceptance, the weight
of a region is the integral of A cos(theta) d omega, or of A over its area. By Stokes's theorem it is the sum over the
region's edges of the integral of G d phi, phi the azimuth as seen from the sensor position and G(theta) the integral of
A cos sin from 0 to theta, or of A tan / cos^2 times the squared distance of the region's plane.
"""

import math

import numpy as np

from pipeline.camera.parts.polygon import area, projected_solid_angle
from pipeline.jit.decorators import inline

_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(16)
"""Gauss-Legendre nodes along a piece of an edge on [-1, 1], and their weights: exact to the 31st degree."""


@inline
def is_limited(acceptance):
    """Whether pixels accept less than all of the light."""
    return acceptance.power > 0.0 or acceptance.half_angle > 0.0


@inline
def accepted_share(acceptance, cosine):
    """Acceptance of a ray whose angle with the axis has this cosine."""
    if acceptance.power > 0.0:
        return cosine**acceptance.power
    beyond = math.acos(min(cosine, 1.0)) - acceptance.half_angle
    if beyond <= 0.0:
        return 1.0
    return 1.0 - beyond / acceptance.roll_off if beyond < acceptance.roll_off else 0.0


@inline
def region_weight(polygon, count, x, y, distance, acceptance):
    """Weight of a polygon in the plane z = distance, as seen from (x, y, 0) [sr, by area mm^2]."""
    if not is_limited(acceptance):
        if acceptance.by_area:
            return area(polygon, count)
        return projected_solid_angle(polygon, count, x, y, distance)
    total = 0.0
    for i in range(count):
        j = i + 1 if i + 1 < count else 0
        ax, ay = (polygon[i, 0] - x) / distance, (polygon[i, 1] - y) / distance
        bx, by = (polygon[j, 0] - x) / distance, (polygon[j, 1] - y) / distance
        total += _edge_weight(ax, ay, bx, by, acceptance)
    return distance * distance * total if acceptance.by_area else total


@inline
def _edge_weight(ax, ay, bx, by, acceptance):
    """Contribution of an edge in the plane at distance 1, split where it crosses the circles of the cone."""
    ex, ey = bx - ax, by - ay
    length = math.sqrt(ex * ex + ey * ey)
    if length == 0.0:
        return 0.0
    offset = (ax * ey - ay * ex) / length
    start, end = (ax * ex + ay * ey) / length, (bx * ex + by * ey) / length
    inner, outer = _circle(acceptance, 0.0, offset), _circle(acceptance, acceptance.roll_off, offset)
    total = 0.0
    piece_start = start
    for mark in (-outer, -inner, inner, outer, math.inf):
        piece_end = min(max(mark, piece_start), end)
        if piece_end > piece_start:
            total += _piece_weight(offset, piece_start, piece_end, acceptance)
        piece_start = piece_end
    return total


@inline
def _circle(acceptance, roll_off, offset):
    """Half the length of the chord that a circle of the cone cuts from a line; inf without a cone."""
    angle = acceptance.half_angle + roll_off
    if not acceptance.half_angle > 0.0 or angle >= 0.5 * math.pi:
        return math.inf
    return math.sqrt(max(math.tan(angle) ** 2 - offset * offset, 0.0))


@inline
def _piece_weight(offset, start, end, acceptance):
    """Integral of G d phi along a piece of a line in the plane at distance 1.

    `offset`: signed distance of the line from the axis; `start`, `end`: positions along it, from the foot of the axis.
    """
    middle = 0.5 * (start + end)
    if (
        acceptance.half_angle > 0.0
        and math.atan(math.sqrt(offset * offset + middle * middle)) > acceptance.half_angle + acceptance.roll_off
    ):
        # G is constant beyond the cone; the azimuth turns by the angle of the piece.
        turn = math.atan2(offset * (end - start), offset * offset + start * end)
        return turn * _inner_weight(math.inf, acceptance)
    total = 0.0
    for k in range(_NODES.shape[0]):
        s = middle + 0.5 * (end - start) * _NODES[k]
        squared = offset * offset + s * s
        # G / squared is smooth, also where the edge passes right above the position.
        ratio = 0.5 if squared == 0.0 else _inner_weight(squared, acceptance) / squared
        total += _WEIGHTS[k] * ratio
    return 0.5 * (end - start) * offset * total


@inline
def _inner_weight(squared, acceptance):
    """G for the squared tangent of theta; by area that in a plane at distance 1."""
    if acceptance.by_area:
        return _inner_area(squared, acceptance)
    power = acceptance.power + 2.0
    if acceptance.power > 0.0:
        return -math.expm1(-0.5 * power * math.log1p(squared)) / power
    theta = math.atan(math.sqrt(squared))
    half_angle, roll_off = acceptance.half_angle, acceptance.roll_off
    if theta <= half_angle:
        return 0.5 * squared / (1.0 + squared)
    inside = 0.5 * math.sin(half_angle) ** 2
    if roll_off == 0.0:
        return inside
    end = min(theta, half_angle + roll_off)
    # From half_angle to end, the integral of (1 - (t - half_angle) / roll_off) sin(2 t) / 2 by parts.
    accepted_at_end = 1.0 - (end - half_angle) / roll_off
    wave = (math.sin(2.0 * end) - math.sin(2.0 * half_angle)) / (8.0 * roll_off)
    return inside + 0.25 * (math.cos(2.0 * half_angle) - accepted_at_end * math.cos(2.0 * end)) - wave


@inline
def _inner_area(squared, acceptance):
    """G by area, the integral of A tan / cos^2 from 0 to theta, in a plane at distance 1."""
    power = acceptance.power
    if power == 2.0:
        return 0.5 * math.log1p(squared)
    if power > 0.0:
        return math.expm1((1.0 - 0.5 * power) * math.log1p(squared)) / (2.0 - power)
    half_angle, roll_off = acceptance.half_angle, acceptance.roll_off
    theta = math.atan(math.sqrt(squared))
    if theta <= half_angle:
        return 0.5 * squared
    if roll_off == 0.0:
        return 0.5 * math.tan(half_angle) ** 2
    end = min(theta, half_angle + roll_off)
    # From half_angle to end, the integral of (1 - (t - half_angle) / roll_off) tan(t) / cos(t)^2 by parts.
    accepted_at_end = 1.0 - (end - half_angle) / roll_off
    wave = (math.tan(end) - math.tan(half_angle) - (end - half_angle)) / (2.0 * roll_off)
    return 0.5 * accepted_at_end * math.tan(end) ** 2 + wave


@inline
def disc_weight(radius, x, y, distance):
    """Integral of cos(theta) d omega over a disc about the origin of the plane z = distance, as seen from (x, y, 0)
    [sr].

    pi times the view factor of a parallel disc: Howell, A Catalog of Radiation Heat Transfer Configuration Factors.
    """
    a, h, r = x * x + y * y, distance * distance, radius * radius
    total = a + h + r
    root = math.sqrt(total * total - 4.0 * r * a)
    # 1 - (a + h - r) / root without its cancellation.
    return 0.5 * math.pi * 4.0 * r * h / (root * (root + a + h - r))
