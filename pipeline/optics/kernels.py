"""Sequential trace of rays through a table of surfaces, in packets.

A packet keeps its rays in small arrays that stay in the cache. The outer loop runs over the surfaces, the inner one
over the rays; the inner loop has no branch, so the compiler turns it into SIMD code. A blocked ray only loses its
`alive` flag and is carried along. Lengths in mm, directions are unit vectors with a positive z component.

The intersection is the cancellation-free root of the quadratic next to the vertex (it is exact for planes, too):
t = F / (G + sqrt(G^2 - c F)) with F = c (x^2 + y^2), G = N - c (x L + y M), after moving the ray to the vertex plane.
"""

import math

import numpy as np

from pipeline.jit import inline, kernel
from pipeline.optics.table import CURVATURE, INDEX_RATIO, SEMI_DIAMETER_SQUARED, VERTEX

PACKET = 256
"""Rays per packet: eight arrays of 256 doubles fill 16 kB, half of a first-level cache."""


@inline
def trace_packet(table, x, y, z, dx, dy, dz, alive, cosine, count):
    """Trace the first `count` rays of a packet through all surfaces, in place.

    Parameters
    ----------
    table : (n, 4) float64
        From `optics.table`.
    x, y, z : (PACKET,) float64
        Points on the rays; afterwards the intersections with the last surface [mm].
    dx, dy, dz : (PACKET,) float64
        Unit directions.
    alive : (PACKET,) float64
        1 for a ray that passes, 0 for one that a semi-diameter, a miss or total reflection has blocked.
    cosine : (PACKET,) float64
        Scratch.
    """
    for k in range(table.shape[0]):
        vertex, c = table[k, VERTEX], table[k, CURVATURE]
        mu, limit = table[k, INDEX_RATIO], table[k, SEMI_DIAMETER_SQUARED]
        for i in range(count):
            to_plane = (vertex - z[i]) / dz[i]
            px = x[i] + to_plane * dx[i]
            py = y[i] + to_plane * dy[i]
            f = c * (px * px + py * py)
            g = dz[i] - c * (px * dx[i] + py * dy[i])
            discriminant = g * g - c * f
            root = math.sqrt(max(discriminant, 0.0))
            t = f / (g + root)
            px += t * dx[i]
            py += t * dy[i]
            hit = (discriminant >= 0.0) & (px * px + py * py <= limit)
            alive[i] = alive[i] if hit else 0.0
            x[i] = px
            y[i] = py
            z[i] = vertex + t * dz[i]
            cosine[i] = root
        if mu != 1.0:
            # Snell: D' = mu D + (cos' - mu cos) n, n the unit normal with a positive z component.
            for i in range(count):
                squared = 1.0 - mu * mu * (1.0 - cosine[i] * cosine[i])
                alive[i] = alive[i] if squared >= 0.0 else 0.0
                step = math.sqrt(max(squared, 0.0)) - mu * cosine[i]
                dx[i] = mu * dx[i] - step * c * x[i]
                dy[i] = mu * dy[i] - step * c * y[i]
                dz[i] = mu * dz[i] + step * (1.0 - c * (z[i] - vertex))


@kernel
def trace_rays(table, position, direction, alive):
    """Trace any number of rays in place: (n, 3) points and unit directions, (n,) float64 flags."""
    x, y, z = np.empty(PACKET), np.empty(PACKET), np.empty(PACKET)
    dx, dy, dz = np.empty(PACKET), np.empty(PACKET), np.empty(PACKET)
    flag, cosine = np.empty(PACKET), np.empty(PACKET)
    for start in range(0, position.shape[0], PACKET):
        count = min(PACKET, position.shape[0] - start)
        for i in range(count):
            x[i], y[i], z[i] = position[start + i]
            dx[i], dy[i], dz[i] = direction[start + i]
            flag[i] = alive[start + i]
        trace_packet(table, x, y, z, dx, dy, dz, flag, cosine, count)
        for i in range(count):
            position[start + i] = x[i], y[i], z[i]
            direction[start + i] = dx[i], dy[i], dz[i]
            alive[start + i] = flag[i]
