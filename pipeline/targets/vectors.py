"""Vectors of three numbers in kernels, as triples."""

import math

from pipeline.jit.decorators import inline


@inline
def row(array, i):
    """The triple in a row of an (n, 3) array."""
    return array[i, 0], array[i, 1], array[i, 2]


@inline
def column(pose, k):
    """The triple in a column of a pose."""
    return pose[0, k], pose[1, k], pose[2, k]


@inline
def dot(a, b):
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@inline
def cross(a, b):
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@inline
def minus(a, b):
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


@inline
def along(point, t, direction):
    """The point at a path t from another one."""
    return point[0] + t * direction[0], point[1] + t * direction[1], point[2] + t * direction[2]


@inline
def times(factor, a):
    return factor * a[0], factor * a[1], factor * a[2]


@inline
def unit(a):
    """The unit vector of a direction; NaN for the zero vector."""
    return times(1.0 / math.sqrt(dot(a, a)), a)


@inline
def across(normal):
    """Two unit vectors that complete a unit normal to a right-handed frame.

    Source: Duff et al., "Building an Orthonormal Basis, Revisited", JCGT 6(1), 2017.
    """
    sign = math.copysign(1.0, normal[2])
    a = -1.0 / (sign + normal[2])
    b = normal[0] * normal[1] * a
    right = 1.0 + sign * normal[0] * normal[0] * a, sign * b, -sign * normal[0]
    return right, (b, sign + normal[1] * normal[1] * a, -normal[1])


@inline
def local(a, x, y, z):
    """Components of a vector along three axes."""
    return dot(a, x), dot(a, y), dot(a, z)


@inline
def world(a, x, y, z):
    """The vector with given components along three axes."""
    return (
        a[0] * x[0] + a[1] * y[0] + a[2] * z[0],
        a[0] * x[1] + a[1] * y[1] + a[2] * z[1],
        a[0] * x[2] + a[1] * y[2] + a[2] * z[2],
    )
