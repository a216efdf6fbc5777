"""Sequential trace of rays through a table of surfaces, in packets.

A packet keeps its rays in small arrays that stay in the cache. The outer loop runs over the surfaces, the inner ones
over the rays; no inner loop has a branch, so the compiler turns them into SIMD code. Loops are short on purpose: a
processor overlaps the divisions and roots of several rays only as far as it looks ahead. What a surface is gets decided
once per packet. A blocked ray only loses its `alive` flag and is carried along. Lengths in mm, directions are unit
vectors with a positive z component.

The intersection with a sphere is the cancellation-free root of the quadratic next to the vertex,
t = F / (N + sqrt(N^2 - c F)) with F = c p . p - 2 p_z, after moving the ray to p, its point nearest to the vertex
(Feder, J. Opt. Soc. Am. 41, 1951, 630); for conics and aspheres see `optics.aspheres`. An ideal thin lens bends rays at
its plane.

A surface off its place is met in the frame in which it stands in its place: rays move there and back.
"""

import math

import numpy as np

from pipeline.jit import buffers, inline, kernel, unit
from pipeline.optics.aspheres import cross_asphere
from pipeline.optics.table import (
    COEFFICIENTS,
    CONIC,
    CURVATURE,
    EDGES,
    FIRST_EDGE,
    INDEX_RATIO,
    INNER_SQUARED,
    POSE,
    SEMI_DIAMETER_SQUARED,
    TERMS,
    VERTEX,
)

PACKET = 256
"""Rays per packet: eight arrays of 256 doubles fill 16 kB, half of a first-level cache."""
SCRATCH = 7
"""Arrays that a packet needs besides its rays, for aspheres."""


@buffers
def new_packet():
    """Buffers of a packet: x, y, z, direction x, y, z, alive, scratch arrays and a weight for who traces."""
    return (
        np.empty(PACKET),
        np.empty(PACKET),
        np.empty(PACKET),
        np.empty(PACKET),
        np.empty(PACKET),
        np.empty(PACKET),
        np.empty(PACKET),
        np.empty((SCRATCH, PACKET)),
        np.empty(PACKET),
    )


@unit
def trace_packet(table, x, y, z, dx, dy, dz, alive, scratch, count):
    """Trace the first `count` rays of a packet through all surfaces, in place.

    Parameters
    ----------
    table : (n, columns) float64
        From `optics.table`.
    x, y, z : (PACKET,) float64
        Points on the rays; afterwards the intersections with the last surface [mm].
    dx, dy, dz : (PACKET,) float64
        Unit directions.
    alive : (PACKET,) float64
        1 for a ray that passes, 0 for one that an aperture, a miss or total reflection has blocked.
    scratch : (SCRATCH, PACKET) float64
    """
    for k in range(table.shape[0]):
        vertex, posed = table[k, VERTEX], table[k, POSE] > 0.0
        if posed:
            _enter(table[k], x, y, z, dx, dy, dz, alive, count)
        if table[k, TERMS] == 0.0 and table[k, CONIC] == 0.0:
            if table[k, CURVATURE] == 0.0:
                _through_plane(table[k], x, y, z, dx, dy, dz, alive, count)
            else:
                _through_sphere(table[k], x, y, z, dx, dy, dz, alive, count)
        else:
            for i in range(count):
                to_plane = (vertex - z[i]) / dz[i]
                x[i] += to_plane * dx[i]
                y[i] += to_plane * dy[i]
            if table[k, TERMS] < 0.0:
                _turn_ideal(table[k], x, y, z, dx, dy, dz, alive, count)
            else:
                cross_asphere(table[k], x, y, z, dx, dy, dz, alive, scratch, count)
        if table[k, INNER_SQUARED] > 0.0 or table[k, EDGES] > 0.0:
            _clip(table[k], x, y, alive, count)
        if posed:
            _leave(table[k], x, y, z, dx, dy, dz, alive, count)


@inline
def _enter(row, x, y, z, dx, dy, dz, alive, count):
    """Move rays as if the surface had come back to its place in the centred lens.

    A ray that then travels along -z meets the back of the surface: blocked, here as in `_leave`.
    """
    a, b, c, p, d, e, f, q, g, h, k, r = _motion(row)
    for i in range(count):
        px, py, pz, ox, oy, oz = x[i] - p, y[i] - q, z[i] - r, dx[i], dy[i], dz[i]
        x[i], y[i], z[i] = a * px + d * py + g * pz, b * px + e * py + h * pz, c * px + f * py + k * pz
        dx[i], dy[i], dz[i] = a * ox + d * oy + g * oz, b * ox + e * oy + h * oz, c * ox + f * oy + k * oz
        alive[i] = alive[i] if dz[i] > 0.0 else 0.0


@inline
def _leave(row, x, y, z, dx, dy, dz, alive, count):
    """Move rays along with the surface to where it stands."""
    a, b, c, p, d, e, f, q, g, h, k, r = _motion(row)
    for i in range(count):
        px, py, pz, ox, oy, oz = x[i], y[i], z[i], dx[i], dy[i], dz[i]
        x[i], y[i], z[i] = a * px + b * py + c * pz + p, d * px + e * py + f * pz + q, g * px + h * py + k * pz + r
        dx[i], dy[i], dz[i] = a * ox + b * oy + c * oz, d * ox + e * oy + f * oz, g * ox + h * oy + k * oz
        alive[i] = alive[i] if dz[i] > 0.0 else 0.0


@inline
def _motion(row):
    """The twelve numbers of a displaced surface's motion, row by row."""
    i = int(row[POSE])
    return (
        row[i],
        row[i + 1],
        row[i + 2],
        row[i + 3],
        row[i + 4],
        row[i + 5],
        row[i + 6],
        row[i + 7],
        row[i + 8],
        row[i + 9],
        row[i + 10],
        row[i + 11],
    )


@inline
def _through_sphere(row, x, y, z, dx, dy, dz, alive, count):
    """Move rays to a sphere and refract, in one pass: one division and two roots per ray.

    Snell: D' = mu D + (cos' - mu cos) n, n the unit normal with positive z; cos is the root of the quadratic.
    """
    vertex, c, mu, limit = row[VERTEX], row[CURVATURE], row[INDEX_RATIO], row[SEMI_DIAMETER_SQUARED]
    rest = 1.0 - mu * mu
    for i in range(count):
        px, py, pz = x[i], y[i], z[i] - vertex
        ox, oy, oz = dx[i], dy[i], dz[i]
        back = px * ox + py * oy + pz * oz
        px, py, pz = px - back * ox, py - back * oy, pz - back * oz
        f = c * (px * px + py * py + pz * pz) - 2.0 * pz
        discriminant = oz * oz - c * f
        root = math.sqrt(max(discriminant, 0.0))
        t = f / (oz + root)
        px, py, pz = px + t * ox, py + t * oy, pz + t * oz
        squared = rest + mu * mu * (root * root)
        step = math.sqrt(max(squared, 0.0)) - mu * root
        passes = (discriminant >= 0.0) & (px * px + py * py <= limit) & (squared >= 0.0)
        alive[i] = alive[i] if passes else 0.0
        x[i], y[i], z[i] = px, py, pz + vertex
        bend = step * c
        dx[i], dy[i], dz[i] = mu * ox - bend * px, mu * oy - bend * py, mu * oz + step - bend * pz


@inline
def _through_plane(row, x, y, z, dx, dy, dz, alive, count):
    """Move rays to a plane and refract."""
    vertex, mu, limit = row[VERTEX], row[INDEX_RATIO], row[SEMI_DIAMETER_SQUARED]
    for i in range(count):
        t = (vertex - z[i]) / dz[i]
        px, py = x[i] + t * dx[i], y[i] + t * dy[i]
        alive[i] = alive[i] if px * px + py * py <= limit else 0.0
        x[i], y[i], z[i] = px, py, vertex
    if mu != 1.0:
        rest = 1.0 - mu * mu
        for i in range(count):
            squared = rest + mu * mu * (dz[i] * dz[i])
            alive[i] = alive[i] if squared >= 0.0 else 0.0
            dx[i], dy[i], dz[i] = mu * dx[i], mu * dy[i], math.sqrt(max(squared, 0.0))


@inline
def _clip(row, x, y, alive, count):
    """Block what misses an aperture that is not just the circle, at the surface itself."""
    inner = row[INNER_SQUARED]
    if inner > 0.0:
        for i in range(count):
            alive[i] = alive[i] if x[i] * x[i] + y[i] * y[i] >= inner else 0.0
    for j in range(int(row[EDGES])):
        first = int(row[FIRST_EDGE]) + 3 * j
        nx, ny, distance = row[first], row[first + 1], row[first + 2]
        for i in range(count):
            alive[i] = alive[i] if nx * x[i] + ny * y[i] <= distance else 0.0


@inline
def _turn_ideal(row, x, y, z, dx, dy, dz, alive, count):
    """Turn rays on the plane of an ideal thin lens by its power; the same for light going either way."""
    vertex, power, limit = row[VERTEX], row[COEFFICIENTS], row[SEMI_DIAMETER_SQUARED]
    for i in range(count):
        alive[i] = alive[i] if x[i] * x[i] + y[i] * y[i] <= limit else 0.0
        across = dx[i] / dz[i] - power * x[i]
        up = dy[i] / dz[i] - power * y[i]
        dz[i] = 1.0 / math.sqrt(1.0 + across * across + up * up)
        dx[i] = across * dz[i]
        dy[i] = up * dz[i]
        z[i] = vertex


@kernel
def trace_rays(table, position, direction, alive):
    """Trace any number of rays in place: (n, 3) points and unit directions, (n,) float64 flags."""
    x, y, z = np.empty(PACKET), np.empty(PACKET), np.empty(PACKET)
    dx, dy, dz = np.empty(PACKET), np.empty(PACKET), np.empty(PACKET)
    flag, scratch = np.empty(PACKET), np.empty((SCRATCH, PACKET))
    for start in range(0, position.shape[0], PACKET):
        count = min(PACKET, position.shape[0] - start)
        for i in range(count):
            x[i], y[i], z[i] = position[start + i, 0], position[start + i, 1], position[start + i, 2]
            dx[i], dy[i], dz[i] = direction[start + i, 0], direction[start + i, 1], direction[start + i, 2]
            flag[i] = alive[start + i]
        trace_packet(table, x, y, z, dx, dy, dz, flag, scratch, count)
        for i in range(count):
            position[start + i, 0], position[start + i, 1], position[start + i, 2] = x[i], y[i], z[i]
            direction[start + i, 0], direction[start + i, 1], direction[start + i, 2] = dx[i], dy[i], dz[i]
            alive[start + i] = flag[i]
