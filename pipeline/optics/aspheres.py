"""Conics, cylinders and aspheres: intersection and refraction of one ray, and of a packet of rays.

Units: `optics.crossing`. A conic with curvature c and conic constant k is c (x^2 + y^2 + (1 + k) z^2) - 2 z = 0. From
the vertex plane its intersection is the cancellation-free root next to the vertex, t = F / (G + sqrt(G^2 - A F)) with F
= c (x^2 + y^2), G = N - c (x L + y M), A = c (1 + k N^2) for the direction (L, M, N). A cylinder is met by the ray's
projection onto the plane of y and z.

An asphere adds a polynomial S(r) to the sag of its conic. With w = z - S a point lies on it where w lies on the conic:
f = w - c (r^2 + (1 + k) w^2) / 2 = 0. Unlike z - sag(r) this needs no square root, and it has no edge beyond which the
sag does not exist. Newton's method solves f(t) = 0 for the path length t from the vertex plane, where
r^2 = r0^2 + 2 (r0 . d) t + (1 - N^2) t^2, and starts from the conic. A ray stops iterating after a short step, and
never starts if it is blocked, so its bits do not depend on its packet. A ray whose residual stays too large has missed.
"""

import math
from typing import NamedTuple

from pipeline.jit.decorators import fma, inline, opaque
from pipeline.optics.crossing import Ray, put, put_point, ray_of
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
"""Largest number of Newton steps from the conic to the asphere. Two or three suffice, also on strong aspheres at full
aperture."""
_AT_FIRST = math.inf
"""Length of the step before the first one: every ray that is not blocked takes a step."""
STILL_MM = 1e-6
"""Step length at which iteration stops: the remaining error is its square times half the curvature [1/mm], below 1e-12
mm."""
RESIDUAL_MM = 1e-9
"""Residual beyond which a ray has missed the asphere [mm]."""


PATH, STEP, SQUARED, TWICE_ACROSS, POWER, POLYNOMIAL, DERIVATIVE = range(7)
"""Rows of a packet's scratch array during the iteration: the fields of `Path`, then v, p(v) and p'(v) of `all_powers`.
Once the rays have landed the first three hold the fields of `Normal`."""


class Normal(NamedTuple):
    """Surface normal m = (-q x, -q y, n), not normalised, where a ray meets a surface: m . D, q and n."""

    along: float
    slope: float
    upright: float


class Path(NamedTuple):
    """State of Newton's method along a ray: path length t from the vertex plane, last step, r0^2 and 2 r0 . d."""

    t: float
    step: float
    squared: float
    twice_across: float


class Shape(NamedTuple):
    """Coefficients of a conic or asphere: those of `crossing.Cap`, 1 + k, and the polynomial.

    `share` is 1, or 1/2 with odd powers. `a` are the low coefficients of S / r^2, `b` factors or coefficients of dS /
    d(r^2).
    """

    vertex: float
    curvature: float
    limit: float
    conic: float
    bulge: float
    share: float
    a0: float
    a1: float
    a2: float
    a3: float
    a4: float
    b1: float
    b2: float
    b3: float
    b4: float


@inline
def has_low_powers(row):
    """Whether the polynomial of an asphere has low even powers only."""
    return row[ODD] == 0.0 and row[TERMS] == LOW_TERMS


@inline
def shape_of(row):
    """The conic or asphere in a row of a table; without a polynomial its coefficients are meaningless and unused."""
    share = 0.5 if row[ODD] > 0.0 else 1.0
    first = COEFFICIENTS if row[TERMS] > 0.0 else 0
    a0, a1, a2, a3, a4 = row[first], row[first + 1], row[first + 2], row[first + 3], row[first + 4]
    b1, b2, b3, b4 = (1.0 + share) * a1, (1.0 + 2.0 * share) * a2, (1.0 + 3.0 * share) * a3, 1.0 + 4.0 * share
    c, conic = row[CURVATURE], row[CONIC]
    return Shape(
        row[VERTEX], c, row[SEMI_DIAMETER_SQUARED], conic, 1.0 + conic, share, a0, a1, a2, a3, a4, b1, b2, b3, b4
    )


@inline
def refracted(mu, ray, normal):
    """The ray refracted at its current point.

    With M = m . m, Snell's law is D' = mu D + (sqrt(M - mu^2 (M - (m . D)^2)) - mu m . D) m / M.
    """
    along, slope, upright = normal.along, normal.slope, normal.upright
    length = slope * slope * (ray.x * ray.x + ray.y * ray.y) + upright * upright
    squared = length - mu * mu * (length - along * along)
    step = (math.sqrt(max(squared, 0.0)) - mu * along) / length
    return Ray(
        ray.x,
        ray.y,
        ray.z,
        mu * ray.dx - step * slope * ray.x,
        mu * ray.dy - step * slope * ray.y,
        mu * ray.dz + step * upright,
        ray.alive if squared >= 0.0 else 0.0,
    )


@inline
def on_conic(shape, ray):
    """The ray moved from the vertex plane to the conic, and the normal there."""
    squared, across = ray.x * ray.x + ray.y * ray.y, ray.x * ray.dx + ray.y * ray.dy
    t, root, discriminant = _conic_root(shape.curvature, shape.conic, squared, across, ray.dz)
    px, py = ray.x + t * ray.dx, ray.y + t * ray.dy
    r2 = px * px + py * py
    n = 1.0 - (1.0 + shape.conic) * shape.curvature * (t * ray.dz)
    # The other sheet of a hyperboloid and the far side of an ellipsoid have a normal that points backwards.
    hit = (discriminant >= 0.0) & (n > 0.0) & (r2 <= shape.limit)
    alive = ray.alive if hit else 0.0
    return Ray(px, py, shape.vertex + t * ray.dz, ray.dx, ray.dy, ray.dz, alive), Normal(root, shape.curvature, n)


@inline
def _conic_root(c, conic, squared, across, dz):
    """Path length from the vertex plane to the conic, m . D there, and the discriminant."""
    f = c * squared
    g = dz - c * across
    discriminant = g * g - c * (1.0 + conic * dz * dz) * f
    root = math.sqrt(max(discriminant, 0.0))
    return f / (g + root), root, discriminant


@inline
def through_cylinder(shape, mu, ray):
    """The ray moved from the vertex plane to the cylinder of a conic, straight along x, and refracted there.

    Its projection onto the plane of y and z meets the profile; motion along x is uniform.
    """
    share = math.sqrt(ray.dy * ray.dy + ray.dz * ray.dz)
    met, normal = on_conic(shape, Ray(0.0, ray.y, ray.z, 0.0, ray.dy / share, ray.dz / share, ray.alive))
    x = ray.x + (met.z - shape.vertex) / ray.dz * ray.dx
    alive = met.alive if x * x + met.y * met.y <= shape.limit else 0.0
    at_surface = Ray(0.0, met.y, met.z, ray.dx, ray.dy, ray.dz, alive)
    behind = refracted(mu, at_surface, Normal(share * normal.along, normal.slope, normal.upright))
    return Ray(x, behind.y, behind.z, behind.dx, behind.dy, behind.dz, behind.alive)


@inline
def begun(shape, ray):
    """Start of Newton's method: the path from the vertex plane to the conic of an asphere."""
    squared, across = ray.x * ray.x + ray.y * ray.y, ray.x * ray.dx + ray.y * ray.dy
    t, _, _ = _conic_root(shape.curvature, shape.conic, squared, across, ray.dz)
    return Path(t, _AT_FIRST if ray.alive > 0.0 else 0.0, squared, 2.0 * across)


@inline
def squared_height(path, dz):
    """r^2 at the end of a path."""
    return fma(fma(fma(-dz, dz, 1.0), path.t, path.twice_across), path.t, path.squared)


@inline
def stepped(shape, path, dz, r2, s, ds):
    """The path after one Newton step; `s` is S / r^2 and `ds` dS / d(r^2) at its end."""
    across = fma(-dz, dz, 1.0)
    f, n, q = _implicit(shape.curvature, shape.bulge, r2, path.t * dz, s, ds)
    step = f / fma(q, fma(2.0 * across, path.t, path.twice_across), -n * dz)
    step = step if path.step > STILL_MM else 0.0
    return Path(path.t + step, abs(step), path.squared, path.twice_across)


@inline
def landed(shape, ray, t, s, ds):
    """The ray at the end of its path, and the surface normal there."""
    px, py, depth = ray.x + t * ray.dx, ray.y + t * ray.dy, t * ray.dz
    r2 = px * px + py * py
    f, n, q = _implicit(shape.curvature, shape.bulge, r2, depth, s, ds)
    q *= 2.0
    cosine = n * ray.dz - q * (px * ray.dx + py * ray.dy)
    along = cosine if abs(f) <= RESIDUAL_MM * n else -1.0
    alive = ray.alive if (along >= 0.0) & (n > 0.0) & (r2 <= shape.limit) else 0.0
    return Ray(px, py, shape.vertex + depth, ray.dx, ray.dy, ray.dz, alive), Normal(along, q, n)


@inline
def _implicit(c, bulge, squared, z, p, ds):
    """f of the asphere at a point, its derivative along z, and its derivative along r over -2 r."""
    # `squared` is r^2, `p` S / r^2 and `ds` dS / d(r^2).
    w = fma(-squared, p, z)
    n = fma(-c * bulge, w, 1.0)
    return fma(-0.5 * c, fma(bulge * w, w, squared), w), n, fma(n, ds, 0.5 * c)


@inline
def low_powers(shape, r2):
    """S / r^2 and dS / d(r^2) of an asphere without high or odd powers."""
    v2 = r2 * r2
    return (
        _quartic(r2, v2, shape.a0, shape.a1, shape.a2, shape.a3, shape.a4),
        _quartic(r2, v2, shape.a0, shape.b1, shape.b2, shape.b3, shape.b4 * shape.a4),
    )


@inline
def all_powers(shape, v, p, dp):
    """S / r^2 and dS / d(r^2) from p(v), the polynomial from the fifth coefficient on, and p'(v).

    v is r^2, or r with odd powers. S = r^2 p(v), and dS / d(r^2) is p + v p', or p + v p' / 2.
    """
    v2 = v * v
    return (
        _quartic(v, v2, shape.a0, shape.a1, shape.a2, shape.a3, p),
        _quartic(v, v2, shape.a0, shape.b1, shape.b2, shape.b3, fma(shape.share * v, dp, shape.b4 * p)),
    )


@inline
def _quartic(v, v2, a0, a1, a2, a3, a4):
    """A quartic by Estrin's scheme, whose chain of dependent operations is half as long as Horner's."""
    return fma(v2, fma(v2, a4, fma(a3, v, a2)), fma(a1, v, a0))


@opaque
def cross_asphere(row, packet, count):
    """Move rays of a packet from the vertex plane to one conic or asphere and refract them."""
    scratch = packet.scratch
    mu = row[INDEX_RATIO]
    if row[TERMS] > 0.0:
        _meet_asphere(row, packet, count)
    else:
        shape = shape_of(row)
        for i in range(count):
            ray, normal = on_conic(shape, ray_of(packet, i))
            put_point(packet, i, ray)
            scratch[0, i], scratch[1, i], scratch[2, i] = normal
    if mu != 1.0:
        for i in range(count):
            put(packet, i, refracted(mu, ray_of(packet, i), Normal(scratch[0, i], scratch[1, i], scratch[2, i])))


@opaque
def _meet_asphere(row, packet, count):
    """Move rays from the vertex plane to the asphere by Newton's method on f(t) = 0, and leave normals in scratch."""
    shape = shape_of(row)
    scratch = packet.scratch
    is_low = has_low_powers(row)
    # Start on the conic of the asphere.
    paths, last_step, squared, twice_across = scratch[PATH], scratch[STEP], scratch[SQUARED], scratch[TWICE_ACROSS]
    for i in range(count):
        paths[i], last_step[i], squared[i], twice_across[i] = begun(shape, ray_of(packet, i))
    # Iterate until no ray of the packet moves.
    steps = 0
    moving = 1
    while steps < NEWTON_STEPS and moving > 0:
        steps += 1
        moving = _newton(row, shape, packet.dz, scratch, count)
    # Test the residual, and take the normal, at the end of each path.
    if not is_low:
        _high_powers(row, packet.dz, scratch, count)
    for i in range(count):  # scratch as one array: the compiler does not vectorise loops over many that may overlap
        ray = ray_of(packet, i)
        t = scratch[PATH, i]
        if is_low:
            px, py = ray.x + t * ray.dx, ray.y + t * ray.dy
            s, ds = low_powers(shape, px * px + py * py)
        else:
            s, ds = all_powers(shape, scratch[POWER, i], scratch[POLYNOMIAL, i], scratch[DERIVATIVE, i])
        ray, normal = landed(shape, ray, t, s, ds)
        put_point(packet, i, ray)
        scratch[0, i], scratch[1, i], scratch[2, i] = normal


@inline
def _newton(row, shape, dz, scratch, count):
    """One Newton step of all rays that still move; returns how many still do."""
    t, last_step, squared, twice_across = scratch[PATH], scratch[STEP], scratch[SQUARED], scratch[TWICE_ACROSS]
    v, p, dp = scratch[POWER], scratch[POLYNOMIAL], scratch[DERIVATIVE]
    moving = 0
    if has_low_powers(row):
        for i in range(count):
            path = Path(t[i], last_step[i], squared[i], twice_across[i])
            r2 = squared_height(path, dz[i])
            s, ds = low_powers(shape, r2)
            path = stepped(shape, path, dz[i], r2, s, ds)
            t[i], last_step[i] = path.t, path.step
            moving += 1 if path.step > STILL_MM else 0
    else:
        _high_powers(row, dz, scratch, count)
        for i in range(count):
            path = Path(t[i], last_step[i], squared[i], twice_across[i])
            s, ds = all_powers(shape, v[i], p[i], dp[i])
            path = stepped(shape, path, dz[i], squared_height(path, dz[i]), s, ds)
            t[i], last_step[i] = path.t, path.step
            moving += 1 if path.step > STILL_MM else 0
    return moving


@inline
def _high_powers(row, dz, scratch, count):
    """v, and p and p' by Horner's rule down to the fifth coefficient. The outer loop runs over the coefficients."""
    t, squared, twice_across = scratch[PATH], scratch[SQUARED], scratch[TWICE_ACROSS]
    v, p, dp = scratch[POWER], scratch[POLYNOMIAL], scratch[DERIVATIVE]
    for i in range(count):
        v[i] = squared[i] + (twice_across[i] + (1.0 - dz[i] * dz[i]) * t[i]) * t[i]  # r^2 at the end of a path
    if row[ODD] > 0.0:
        for i in range(count):
            v[i] = math.sqrt(max(v[i], 0.0))
    last = int(row[TERMS]) - 1
    top = row[COEFFICIENTS + last]
    for i in range(count):
        p[i], dp[i] = top, 0.0
    for j in range(last - 1, LOW_TERMS - 2, -1):
        a = row[COEFFICIENTS + j]
        for i in range(count):
            dp[i], p[i] = fma(dp[i], v[i], p[i]), fma(p[i], v[i], a)
