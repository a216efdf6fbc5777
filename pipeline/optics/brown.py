"""Brown's distortion of the image behind an ideal thin lens, for model cameras, as OpenCV defines it.

A direction through the centre of the lens with slopes u = (x, y) and r = |u| has its image at D(u) times the image
distance: D(u) = u (1 + k1 r^2 + k2 r^4 + k3 r^6) + (2 p1 x y + p2 (r^2 + 2 x^2), p1 (r^2 + 2 y^2) + 2 p2 x y).

A ray is bent in the lens so that it meets the image plane at D of the point where the undistorted lens would send it.
All rays from a point in focus still meet, and rays through the centre are those of a pinhole with distortion. Light
towards the scene needs the inverse of D, by Newton's method; a ray for which that does not converge, far outside of any
image, is blocked.
"""

import math
from typing import NamedTuple

import numpy as np

from pipeline.jit.decorators import inline
from pipeline.optics.crossing import Ray
from pipeline.optics.table import COEFFICIENTS, SEMI_DIAMETER_SQUARED, TERMS, TOWARDS_SCENE, VERTEX

_STEPS = 12
"""Newton steps: each doubles the digits, and distortions of a half need six steps to come near."""
SETTLED_SQUARED = 1e-26
"""Squared difference of directions at which Newton's method has converged [1]: some hundred roundings."""
_RADII = 2000
"""Number of radii at which the slope of the distortion is tested, up to `_FAR` times that of the image's corner."""
_FAR = 4.0
"""Largest undistorted over distorted radius that is searched [1]: barrel distortion of three quarters."""


class Brown(NamedTuple):
    """A distorting lens: vertex [mm], squared semi-diameter [mm^2], power and 1 / image distance [1/mm], k1 to k3."""

    vertex: float
    limit: float
    power: float
    vergence: float
    k1: float
    k2: float
    p1: float
    p2: float
    k3: float


@inline
def brown_of(row):
    """The distorting lens in a row of a table."""
    i = COEFFICIENTS
    return Brown(
        row[VERTEX],
        row[SEMI_DIAMETER_SQUARED],
        row[i],
        row[i + 1],
        row[i + 2],
        row[i + 3],
        row[i + 4],
        row[i + 5],
        row[i + 6],
    )


@inline
def distorted(b, x, y):
    """The image D of a direction."""
    r = x * x + y * y
    radial = 1.0 + r * (b.k1 + r * (b.k2 + r * b.k3))
    return (
        x * radial + 2.0 * b.p1 * x * y + b.p2 * (r + 2.0 * x * x),
        y * radial + b.p1 * (r + 2.0 * y * y) + 2.0 * b.p2 * x * y,
    )


@inline
def undistorted(b, x_image, y_image):
    """The direction with this image by Newton's method, and 1, or 0 if it did not converge."""
    x = x_image
    y = y_image
    determinant = 1.0
    for _ in range(_STEPS):
        # The Jacobian of D is symmetric; `slope` is 2 d(radial) / d(r^2).
        r = x * x + y * y
        radial = 1.0 + r * (b.k1 + r * (b.k2 + r * b.k3))
        slope = 2.0 * (b.k1 + r * (2.0 * b.k2 + 3.0 * b.k3 * r))
        xx = radial + slope * x * x + 2.0 * b.p1 * y + 6.0 * b.p2 * x
        xy = slope * x * y + 2.0 * b.p1 * x + 2.0 * b.p2 * y
        yy = radial + slope * y * y + 6.0 * b.p1 * y + 2.0 * b.p2 * x
        x_off, y_off = distorted(b, x, y)
        x_off, y_off = x_off - x_image, y_off - y_image
        determinant = xx * yy - xy * xy
        x, y = x - (yy * x_off - xy * y_off) / determinant, y - (xx * y_off - xy * x_off) / determinant
    x_off, y_off = distorted(b, x, y)
    miss_squared = (x_off - x_image) ** 2 + (y_off - y_image) ** 2
    return x, y, 1.0 if miss_squared <= SETTLED_SQUARED * (1.0 + x * x + y * y) and determinant > 0.0 else 0.0


@inline
def turned_with_distortion(row, ray):
    """The ray on the plane of an ideal thin lens, deflected by its power and its distortion."""
    b = brown_of(row)
    across = ray.dx / ray.dz
    up = ray.dy / ray.dz
    undone = 1.0
    if row[TERMS] == TOWARDS_SCENE:
        across, up, undone = undistorted(b, across - b.vergence * ray.x, up - b.vergence * ray.y)
        across, up = across + (b.vergence - b.power) * ray.x, up + (b.vergence - b.power) * ray.y
    else:
        to_image = b.vergence - b.power
        across, up = distorted(b, across + to_image * ray.x, up + to_image * ray.y)
        across, up = across - b.vergence * ray.x, up - b.vergence * ray.y
    dz = 1.0 / math.sqrt(1.0 + across * across + up * up)
    alive = ray.alive if ray.x * ray.x + ray.y * ray.y <= b.limit else 0.0
    return Ray(ray.x, ray.y, b.vertex, across * dz, up * dz, dz, min(alive, undone))


def largest_radius(coefficients: tuple[float, ...], limit: float) -> float:
    """Radius of the image up to which the radial part of a distortion grows, at most `limit`.

    Radii are over the image distance. Beyond, several directions would share an image.
    """
    k1, k2, _, _, k3 = coefficients
    r = np.linspace(0.0, _FAR * limit, _RADII)
    image = r * (1 + k1 * r**2 + k2 * r**4 + k3 * r**6)
    falls = np.flatnonzero(np.diff(image) <= 0)
    highest = image[falls[0]] if len(falls) else image[-1]
    return float(min(highest, limit))
