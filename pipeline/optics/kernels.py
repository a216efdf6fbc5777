"""Sequential trace of rays through a table of surfaces, in packets.

A packet keeps its rays in small arrays that stay in the cache. The outer loop runs over the surfaces, the inner ones
over the rays; no inner loop has a branch, so the compiler turns them into SIMD code. What a surface is gets decided
once per packet. A blocked ray only loses its `alive` flag and is carried along. Lengths in mm, directions are unit
vectors with a positive z component.

The intersection with a conic is the cancellation-free root of the quadratic next to the vertex (exact for planes, too):
t = F / (G + sqrt(G^2 - A F)) with F = c (x^2 + y^2), G = N - c (x L + y M), A = c (1 + k N^2), after moving the ray to
the vertex plane; k = 0 for a sphere. An asphere starts from there.

A surface off its place is met in the frame in which it stands in its place: rays move there and back.
"""

import math

import numpy as np

from pipeline.jit import fma, inline, kernel
from pipeline.optics.table import (
    COEFFICIENTS,
    CONIC,
    CURVATURE,
    EDGES,
    FIRST_EDGE,
    INDEX_RATIO,
    INNER_SQUARED,
    LOW_TERMS,
    ODD,
    POSE,
    SEMI_DIAMETER_SQUARED,
    TERMS,
    VERTEX,
)

PACKET = 256
"""Rays per packet: eight arrays of 256 doubles fill 16 kB, half of a first-level cache."""
SCRATCH = 6
"""Arrays that a packet needs besides its rays; spheres use one of them."""
NEWTON_STEPS = 5
"""From the conic to the asphere: three suffice for camera lenses, five for strong ones filled to the edge."""
RESIDUAL_MM = 1e-9
"""A ray that ends farther from an asphere than this has missed it."""


@inline
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
    cosine = scratch[0]
    for k in range(table.shape[0]):
        vertex, c = table[k, VERTEX], table[k, CURVATURE]
        mu, limit = table[k, INDEX_RATIO], table[k, SEMI_DIAMETER_SQUARED]
        if table[k, POSE] > 0.0:
            _enter(table[k], x, y, z, dx, dy, dz, alive, count)
        if table[k, CONIC] != 0.0 or table[k, TERMS] > 0.0:
            _cross_asphere(table[k], x, y, z, dx, dy, dz, alive, scratch, count)
            _clip(table[k], x, y, alive, count)
            if table[k, POSE] > 0.0:
                _leave(table[k], x, y, z, dx, dy, dz, alive, count)
            continue
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
        if table[k, INNER_SQUARED] > 0.0 or table[k, EDGES] > 0.0:
            _clip(table[k], x, y, alive, count)
        if table[k, POSE] > 0.0:
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
def _cross_asphere(row, x, y, z, dx, dy, dz, alive, scratch, count):
    """Intersect one conic or asphere and refract; z counts from the vertex in between.

    The normal is (-q x, -q y, n_z), not of unit length; q, n_z and its product with the direction are kept in scratch.
    """
    along_normal, slope, upright = scratch[0], scratch[1], scratch[2]
    vertex, mu, limit = row[VERTEX], row[INDEX_RATIO], row[SEMI_DIAMETER_SQUARED]
    if row[TERMS] > 0.0:
        _newton(row, x, y, z, dx, dy, dz, scratch, count)
    else:
        _meet_conic(row, x, y, z, dx, dy, dz, along_normal, slope, upright, count)
    for i in range(count):
        # The other sheet of a hyperboloid and the far side of an ellipsoid have a normal that points backwards.
        hit = (along_normal[i] >= 0.0) & (upright[i] > 0.0) & (x[i] * x[i] + y[i] * y[i] <= limit)
        alive[i] = alive[i] if hit else 0.0
        z[i] += vertex
    if mu != 1.0:
        for i in range(count):
            squared = slope[i] * slope[i] * (x[i] * x[i] + y[i] * y[i]) + upright[i] * upright[i]
            shorten = 1.0 / math.sqrt(squared)
            cosine = along_normal[i] * shorten
            squared = 1.0 - mu * mu * (1.0 - cosine * cosine)
            alive[i] = alive[i] if squared >= 0.0 else 0.0
            step = (math.sqrt(max(squared, 0.0)) - mu * cosine) * shorten
            dx[i] = mu * dx[i] - step * slope[i] * x[i]
            dy[i] = mu * dy[i] - step * slope[i] * y[i]
            dz[i] = mu * dz[i] + step * upright[i]


@inline
def _meet_conic(row, x, y, z, dx, dy, dz, along_normal, slope, upright, count):
    """Move rays to a conic; `along_normal` is -1 for a miss."""
    vertex, c, conic = row[VERTEX], row[CURVATURE], row[CONIC]
    for i in range(count):
        px, py, t, root, discriminant = _conic_root(vertex, c, conic, x[i], y[i], z[i], dx[i], dy[i], dz[i])
        x[i] = px + t * dx[i]
        y[i] = py + t * dy[i]
        z[i] = t * dz[i]
        along_normal[i] = root if discriminant >= 0.0 else -1.0
        slope[i] = c
        upright[i] = 1.0 - (1.0 + conic) * c * z[i]


@inline
def _conic_root(vertex, c, conic, x, y, z, dx, dy, dz):
    """Where a ray meets the vertex plane, how far behind it the conic, and the normal's product with the direction."""
    to_plane = (vertex - z) / dz
    px = x + to_plane * dx
    py = y + to_plane * dy
    f = c * (px * px + py * py)
    g = dz - c * (px * dx + py * dy)
    discriminant = g * g - c * (1.0 + conic * dz * dz) * f
    root = math.sqrt(max(discriminant, 0.0))
    return px, py, f / (g + root), root, discriminant


@inline
def _newton(row, x, y, z, dx, dy, dz, scratch, count):
    """Move rays from the conic to the asphere by a fixed number of Newton steps.

    With S the polynomial and w = z - S, a point lies on the asphere where w lies on the conic:
    w - c (r^2 + (1 + k) w^2) / 2 = 0. Unlike z - sag(r) this needs no square root, and it has no edge beyond which the
    sag does not exist. Only the path t behind the vertex plane changes: r^2 = r0^2 + 2 (r0 . d) t + (1 - N^2) t^2.
    A ray that is not there in the end has missed.
    """
    t, squared, across, v, p, dp = scratch[0], scratch[1], scratch[2], scratch[3], scratch[4], scratch[5]
    half, bulge = 0.5 * row[CURVATURE], 1.0 + row[CONIC]
    is_short = row[ODD] == 0.0 and row[TERMS] == LOW_TERMS
    share = 0.5 if row[ODD] > 0.0 else 1.0
    first = COEFFICIENTS
    a, b, c, d, e = row[first], row[first + 1], row[first + 2], row[first + 3], row[first + 4]
    vertex, curvature, conic = row[VERTEX], row[CURVATURE], row[CONIC]
    for i in range(count):
        px, py, step, _, _ = _conic_root(vertex, curvature, conic, x[i], y[i], z[i], dx[i], dy[i], dz[i])
        x[i], y[i], t[i] = px, py, step
        squared[i] = px * px + py * py
        across[i] = px * dx[i] + py * dy[i]
    for _ in range(NEWTON_STEPS):
        if is_short:
            for i in range(count):
                outward = fma(fma(-dz[i], dz[i], 1.0), t[i], across[i])
                r2 = fma(across[i] + outward, t[i], squared[i])
                s, ds = _horner(r2, e, 0.0, a, b, c, d)
                f, n, q = _implicit(half, bulge, r2, t[i] * dz[i], s, fma(r2, ds, s))
                t[i] += f / fma(q, outward, -n * dz[i])
        else:
            _high_powers(row, squared, across, dz, t, v, p, dp, count)
            for i in range(count):
                outward = fma(fma(-dz[i], dz[i], 1.0), t[i], across[i])
                r2 = fma(across[i] + outward, t[i], squared[i])
                s, ds = _horner(v[i], p[i], dp[i], a, b, c, d)
                f, n, q = _implicit(half, bulge, r2, t[i] * dz[i], s, fma(share * v[i], ds, s))
                t[i] += f / fma(q, outward, -n * dz[i])
    if not is_short:
        _high_powers(row, squared, across, dz, t, v, p, dp, count)
    along_normal, slope, upright = scratch[0], scratch[1], scratch[2]
    for i in range(count):
        x[i] += t[i] * dx[i]
        y[i] += t[i] * dy[i]
        z[i] = t[i] * dz[i]
        r2 = x[i] * x[i] + y[i] * y[i]
        u = r2 if is_short else v[i]
        s, ds = _horner(u, e if is_short else p[i], 0.0 if is_short else dp[i], a, b, c, d)
        f, n, q = _implicit(half, bulge, r2, z[i], s, fma(share * u, ds, s))
        cosine = n * dz[i] - q * (x[i] * dx[i] + y[i] * dy[i])
        along_normal[i] = cosine if abs(f) <= RESIDUAL_MM * n else -1.0
        slope[i] = q
        upright[i] = n


@inline
def _implicit(half, bulge, squared, z, p, rise):
    """The asphere's equation at a point, and its derivatives there along z and, over -r, along r.

    `half` is half the curvature, `squared` r^2, `p` is S / r^2 and `rise` dS / d(r^2).
    """
    w = fma(-squared, p, z)
    n = fma(-2.0 * half * bulge, w, 1.0)
    return fma(-half, fma(bulge * w, w, squared), w), n, 2.0 * fma(n, rise, half)


@inline
def _horner(v, p, dp, a, b, c, d):
    """Four steps of Horner's rule for a polynomial in v and its derivative, behind those that gave p and dp."""
    dp = fma(dp, v, p)
    p = fma(p, v, d)
    dp = fma(dp, v, p)
    p = fma(p, v, c)
    dp = fma(dp, v, p)
    p = fma(p, v, b)
    return fma(p, v, a), fma(dp, v, p)


@inline
def _high_powers(row, squared, across, dz, t, v, p, dp, count):
    """v, which is r^2, or r if there are odd powers; Horner's rule down to the fifth coefficient.

    S = r^2 p(v), and dS / d(r^2) is p + v p', or p + v p' / 2. The loop over coefficients is the outer one.
    """
    for i in range(count):
        v[i] = squared[i] + (2.0 * across[i] + (1.0 - dz[i] * dz[i]) * t[i]) * t[i]
    if row[ODD] > 0.0:
        for i in range(count):
            v[i] = math.sqrt(max(v[i], 0.0))
    last = int(row[TERMS]) - 1
    top = row[COEFFICIENTS + last]
    for i in range(count):
        p[i] = top
        dp[i] = 0.0
    for j in range(last - 1, LOW_TERMS - 2, -1):
        a = row[COEFFICIENTS + j]
        for i in range(count):
            dp[i] = fma(dp[i], v[i], p[i])
            p[i] = fma(p[i], v[i], a)


@kernel
def trace_rays(table, position, direction, alive):
    """Trace any number of rays in place: (n, 3) points and unit directions, (n,) float64 flags."""
    x, y, z = np.empty(PACKET), np.empty(PACKET), np.empty(PACKET)
    dx, dy, dz = np.empty(PACKET), np.empty(PACKET), np.empty(PACKET)
    flag, scratch = np.empty(PACKET), np.empty((SCRATCH, PACKET))
    for start in range(0, position.shape[0], PACKET):
        count = min(PACKET, position.shape[0] - start)
        for i in range(count):
            x[i], y[i], z[i] = position[start + i]
            dx[i], dy[i], dz[i] = direction[start + i]
            flag[i] = alive[start + i]
        trace_packet(table, x, y, z, dx, dy, dz, flag, scratch, count)
        for i in range(count):
            position[start + i] = x[i], y[i], z[i]
            direction[start + i] = dx[i], dy[i], dz[i]
            alive[start + i] = flag[i]
