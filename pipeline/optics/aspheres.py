"""Conics and aspheres of a packet of rays: intersection and refraction. Units and shapes are those of `optics.kernels`.

The intersection with a conic is the cancellation-free root of the quadratic next to the vertex: t = F / (G + sqrt(G^2 -
A F)) with F = c (x^2 + y^2), G = N - c (x L + y M), A = c (1 + k N^2), after moving the ray to the vertex plane. An
asphere starts from there.
"""

import math

from pipeline.jit import fma, inline
from pipeline.optics.table import (
    COEFFICIENTS,
    CONIC,
    CURVATURE,
    INDEX_RATIO,
    LOW_TERMS,
    ODD,
    SEMI_DIAMETER_SQUARED,
    TERMS,
    VERTEX,
)

NEWTON_STEPS = 5
"""At most, from the conic to the asphere. Two or three are taken, on strong aspheres filled to the edge, too."""
STILL_MM = 1e-6
"""After a step this short the error is its square times about half the curvature [1/mm]: less than 1e-12 mm."""
RESIDUAL_MM = 1e-9
"""A ray that ends farther from an asphere than this has missed it."""


@inline
def cross_asphere(row, x, y, z, dx, dy, dz, alive, scratch, count):
    """Move rays from the vertex plane to one conic or asphere and refract; z counts from the vertex in between.

    The normal is m = (-q x, -q y, n), not of unit length. With M = m . m, Snell's law is
    D' = mu D + (sqrt(M - mu^2 (M - (m . D)^2)) - mu m . D) m / M.
    """
    along_normal, slope, upright = scratch[0], scratch[1], scratch[2]
    mu = row[INDEX_RATIO]
    if row[TERMS] > 0.0:
        _meet_asphere(row, x, y, z, dx, dy, dz, alive, scratch, count)
    else:
        _meet_conic(row, x, y, z, dx, dy, dz, alive, along_normal, slope, upright, count)
    if mu != 1.0:
        for i in range(count):
            length = slope[i] * slope[i] * (x[i] * x[i] + y[i] * y[i]) + upright[i] * upright[i]
            squared = length - mu * mu * (length - along_normal[i] * along_normal[i])
            alive[i] = alive[i] if squared >= 0.0 else 0.0
            step = (math.sqrt(max(squared, 0.0)) - mu * along_normal[i]) / length
            dx[i] = mu * dx[i] - step * slope[i] * x[i]
            dy[i] = mu * dy[i] - step * slope[i] * y[i]
            dz[i] = mu * dz[i] + step * upright[i]


@inline
def _meet_conic(row, x, y, z, dx, dy, dz, alive, along_normal, slope, upright, count):
    """Move rays to a conic; of the normal keep m . D, q and n."""
    vertex, c, conic, limit = row[VERTEX], row[CURVATURE], row[CONIC], row[SEMI_DIAMETER_SQUARED]
    for i in range(count):
        t, root, discriminant = _conic_root(c, conic, x[i] * x[i] + y[i] * y[i], x[i] * dx[i] + y[i] * dy[i], dz[i])
        x[i] += t * dx[i]
        y[i] += t * dy[i]
        r2 = x[i] * x[i] + y[i] * y[i]
        n = 1.0 - (1.0 + conic) * c * (t * dz[i])
        # The other sheet of a hyperboloid and the far side of an ellipsoid have a normal that points backwards.
        hit = (discriminant >= 0.0) & (n > 0.0) & (r2 <= limit)
        alive[i] = alive[i] if hit else 0.0
        z[i] = vertex + t * dz[i]
        along_normal[i], slope[i], upright[i] = root, c, n


@inline
def _conic_root(c, conic, squared, across, dz):
    """Path from the vertex plane to the conic, and the normal's product with the direction."""
    f = c * squared
    g = dz - c * across
    discriminant = g * g - c * (1.0 + conic * dz * dz) * f
    root = math.sqrt(max(discriminant, 0.0))
    return f / (g + root), root, discriminant


@inline
def _meet_asphere(row, x, y, z, dx, dy, dz, alive, scratch, count):
    """Move rays from the vertex plane to the asphere: to the conic, then on by Newton's steps.

    With S the polynomial and w = z - S, a point lies on the asphere where w lies on the conic:
    w - c (r^2 + (1 + k) w^2) / 2 = 0. Unlike z - sag(r) this needs no square root, and it has no edge beyond which the
    sag does not exist. Only the path t behind the vertex plane changes: r^2 = r0^2 + 2 (r0 . d) t + (1 - N^2) t^2.
    The packet stops when none of its rays moves any more. A ray takes no step after a short one, and none if it is
    blocked, so its bits do not depend on its packet. A ray that is not there in the end has missed.
    """
    t, moved, squared, twice_across = scratch[0], scratch[1], scratch[2], scratch[3]
    c, conic = row[CURVATURE], row[CONIC]
    for i in range(count):
        squared[i] = x[i] * x[i] + y[i] * y[i]
        across = x[i] * dx[i] + y[i] * dy[i]
        twice_across[i] = 2.0 * across
        t[i], _, _ = _conic_root(c, conic, squared[i], across, dz[i])
        moved[i] = math.inf if alive[i] > 0.0 else 0.0
    steps, moving = 0, 1
    while steps < NEWTON_STEPS and moving > 0:
        steps += 1
        moving = _newton(row, dz, scratch, count)
    _land(row, x, y, z, dx, dy, dz, alive, scratch, count)


@inline
def _newton(row, dz, scratch, count):
    """One step of all rays that still move; how many still do."""
    t, moved, squared, twice_across = scratch[0], scratch[1], scratch[2], scratch[3]
    v, p, dp = scratch[4], scratch[5], scratch[6]
    c, bulge = row[CURVATURE], 1.0 + row[CONIC]
    is_short, share, a0, a1, a2, a3, a4, b1, b2, b3, b4 = _coefficients(row)
    moving = 0
    if is_short:
        for i in range(count):
            across = fma(-dz[i], dz[i], 1.0)
            r2 = fma(fma(across, t[i], twice_across[i]), t[i], squared[i])
            v2 = r2 * r2
            s, rise = _quartic(r2, v2, a0, a1, a2, a3, a4), _quartic(r2, v2, a0, b1, b2, b3, b4 * a4)
            f, n, q = _implicit(c, bulge, r2, t[i] * dz[i], s, rise)
            step = f / fma(q, fma(2.0 * across, t[i], twice_across[i]), -n * dz[i])
            step = step if moved[i] > STILL_MM else 0.0
            t[i] += step
            moved[i] = abs(step)
            moving += 1 if abs(step) > STILL_MM else 0
    else:
        _high_powers(row, squared, twice_across, dz, t, v, p, dp, count)
        for i in range(count):
            across = fma(-dz[i], dz[i], 1.0)
            r2 = fma(fma(across, t[i], twice_across[i]), t[i], squared[i])
            v2 = v[i] * v[i]
            s = _quartic(v[i], v2, a0, a1, a2, a3, p[i])
            rise = _quartic(v[i], v2, a0, b1, b2, b3, fma(share * v[i], dp[i], b4 * p[i]))
            f, n, q = _implicit(c, bulge, r2, t[i] * dz[i], s, rise)
            step = f / fma(q, fma(2.0 * across, t[i], twice_across[i]), -n * dz[i])
            step = step if moved[i] > STILL_MM else 0.0
            t[i] += step
            moved[i] = abs(step)
            moving += 1 if abs(step) > STILL_MM else 0
    return moving


@inline
def _land(row, x, y, z, dx, dy, dz, alive, scratch, count):
    """Move rays along their paths to the asphere; of the normal keep m . D, q and n."""
    t, squared, twice_across = scratch[0], scratch[2], scratch[3]
    v, p, dp = scratch[4], scratch[5], scratch[6]
    vertex, c, bulge, limit = row[VERTEX], row[CURVATURE], 1.0 + row[CONIC], row[SEMI_DIAMETER_SQUARED]
    is_short, share, a0, a1, a2, a3, a4, b1, b2, b3, b4 = _coefficients(row)
    if not is_short:
        _high_powers(row, squared, twice_across, dz, t, v, p, dp, count)
    along_normal, slope, upright = scratch[0], scratch[1], scratch[2]
    for i in range(count):
        px, py, depth = x[i] + t[i] * dx[i], y[i] + t[i] * dy[i], t[i] * dz[i]
        r2 = px * px + py * py
        if is_short:
            v2 = r2 * r2
            s, rise = _quartic(r2, v2, a0, a1, a2, a3, a4), _quartic(r2, v2, a0, b1, b2, b3, b4 * a4)
        else:
            v2 = v[i] * v[i]
            s = _quartic(v[i], v2, a0, a1, a2, a3, p[i])
            rise = _quartic(v[i], v2, a0, b1, b2, b3, fma(share * v[i], dp[i], b4 * p[i]))
        f, n, q = _implicit(c, bulge, r2, depth, s, rise)
        q *= 2.0
        cosine = n * dz[i] - q * (px * dx[i] + py * dy[i])
        x[i], y[i], z[i] = px, py, vertex + depth
        along_normal[i] = cosine if abs(f) <= RESIDUAL_MM * n else -1.0
        slope[i] = q
        upright[i] = n
    for i in range(count):
        hit = (along_normal[i] >= 0.0) & (upright[i] > 0.0) & (x[i] * x[i] + y[i] * y[i] <= limit)
        alive[i] = alive[i] if hit else 0.0


@inline
def _coefficients(row):
    """Whether the row holds no more than the low even powers; of S / r^2 and, b, of dS / d(r^2)."""
    is_short = row[ODD] == 0.0 and row[TERMS] == LOW_TERMS
    share = 0.5 if row[ODD] > 0.0 else 1.0
    first = COEFFICIENTS
    a0, a1, a2, a3, a4 = row[first], row[first + 1], row[first + 2], row[first + 3], row[first + 4]
    b1, b2, b3, b4 = (1.0 + share) * a1, (1.0 + 2.0 * share) * a2, (1.0 + 3.0 * share) * a3, 1.0 + 4.0 * share
    return is_short, share, a0, a1, a2, a3, a4, b1, b2, b3, b4


@inline
def _implicit(c, bulge, squared, z, p, rise):
    """The asphere's equation at a point, and its derivatives there along z and, over -2 r, along r.

    `squared` is r^2, `p` S / r^2 and `rise` dS / d(r^2).
    """
    w = fma(-squared, p, z)
    n = fma(-c * bulge, w, 1.0)
    return fma(-0.5 * c, fma(bulge * w, w, squared), w), n, fma(n, rise, 0.5 * c)


@inline
def _quartic(v, v2, a0, a1, a2, a3, a4):
    """A polynomial by Estrin's scheme, half as long a chain of operations as Horner's."""
    return fma(v2, fma(v2, a4, fma(a3, v, a2)), fma(a1, v, a0))


@inline
def _high_powers(row, squared, twice_across, dz, t, v, p, dp, count):
    """v, which is r^2, or r if there are odd powers; Horner's rule down to the fifth coefficient.

    S = r^2 p(v), and dS / d(r^2) is p + v p', or p + v p' / 2. The loop over coefficients is the outer one.
    """
    for i in range(count):
        v[i] = squared[i] + (twice_across[i] + (1.0 - dz[i] * dz[i]) * t[i]) * t[i]
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
