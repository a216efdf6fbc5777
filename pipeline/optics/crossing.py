"""One ray at one surface: plain numbers in and out, for the loops of packets.

Lengths in mm, directions are unit vectors with a positive z component. A blocked ray only loses its `alive` flag and is
carried along; nothing here has a branch that depends on the ray. Conics and aspheres: `optics.aspheres`.

The intersection with a sphere is the cancellation-free root of the quadratic next to the vertex,
t = F / (N + sqrt(N^2 - c F)) with F = c p . p - 2 p_z, after moving the ray to p, its point nearest to the vertex
(Feder, J. Opt. Soc. Am. 41, 1951, 630). An ideal thin lens bends rays at its plane. Where spheres take most of the time
a b + c is rounded once: a third fewer instructions, and a processor sees more rays ahead.

A surface off its place is met in the frame in which it stands in its place: rays move there and back.
"""

import math
from typing import NamedTuple

from pipeline.jit.decorators import fma, inline
from pipeline.optics.table import CURVATURE, INDEX_RATIO, SEMI_DIAMETER_SQUARED, VERTEX


class Ray(NamedTuple):
    """A point on a ray [mm], its unit direction, and 1 if it passes, 0 if something has blocked it."""

    x: float
    y: float
    z: float
    dx: float
    dy: float
    dz: float
    alive: float


class Cap(NamedTuple):
    """Numbers of a plane or sphere: vertex z [mm], curvature [1/mm], index ratio, squared semi-diameter [mm^2]."""

    vertex: float
    curvature: float
    mu: float
    limit: float


class Motion(NamedTuple):
    """Upper three rows of a rigid motion's matrix."""

    xx: float
    xy: float
    xz: float
    x: float
    yx: float
    yy: float
    yz: float
    y: float
    zx: float
    zy: float
    zz: float
    z: float


@inline
def ray_of(packet, i):
    """One ray of a packet: of arrays named as the fields of a ray."""
    return Ray(packet.x[i], packet.y[i], packet.z[i], packet.dx[i], packet.dy[i], packet.dz[i], packet.alive[i])


@inline
def put(packet, i, ray):
    """Write a ray into a packet."""
    packet.x[i], packet.y[i], packet.z[i] = ray.x, ray.y, ray.z
    packet.dx[i], packet.dy[i], packet.dz[i] = ray.dx, ray.dy, ray.dz
    packet.alive[i] = ray.alive


@inline
def put_point(packet, i, ray):
    """Write into a packet the point and the flag of a ray whose direction is still the same: less to tell apart."""
    packet.x[i], packet.y[i], packet.z[i], packet.alive[i] = ray.x, ray.y, ray.z, ray.alive


@inline
def cap_of(row):
    """The plane or sphere of a table's row."""
    return Cap(row[VERTEX], row[CURVATURE], row[INDEX_RATIO], row[SEMI_DIAMETER_SQUARED])


@inline
def motion_of_row(row, place):
    """The motion that takes the surface of a table's row off its place, as rays leave it or, at ENTRY, enter it."""
    i = int(row[place])
    return Motion(
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
def through_sphere(cap, ray):
    """The ray on a sphere, refracted: one division and two roots.

    Snell: D' = mu D + (cos' - mu cos) n, n the unit normal with positive z; cos is the root of the quadratic.
    """
    c, mu = cap.curvature, cap.mu
    ox, oy, oz = ray.dx, ray.dy, ray.dz
    px, py, pz = ray.x, ray.y, ray.z - cap.vertex
    back = fma(px, ox, fma(py, oy, pz * oz))
    px, py, pz = fma(-back, ox, px), fma(-back, oy, py), fma(-back, oz, pz)
    f = fma(c, fma(px, px, fma(py, py, pz * pz)), -2.0 * pz)
    discriminant = fma(oz, oz, -c * f)
    root = math.sqrt(max(discriminant, 0.0))
    t = f / (oz + root)
    px, py, pz = fma(t, ox, px), fma(t, oy, py), fma(t, oz, pz)
    squared = fma(mu * mu, max(discriminant, 0.0), 1.0 - mu * mu)
    step = fma(-mu, root, math.sqrt(max(squared, 0.0)))
    passes = (discriminant >= 0.0) & (fma(px, px, py * py) <= cap.limit) & (squared >= 0.0)
    bend = -step * c
    return Ray(
        px,
        py,
        pz + cap.vertex,
        fma(bend, px, mu * ox),
        fma(bend, py, mu * oy),
        fma(bend, pz, fma(mu, oz, step)),
        ray.alive if passes else 0.0,
    )


@inline
def to_plane(cap, ray):
    """The ray on a plane, not refracted yet."""
    t = (cap.vertex - ray.z) / ray.dz
    px, py = ray.x + t * ray.dx, ray.y + t * ray.dy
    alive = ray.alive if px * px + py * py <= cap.limit else 0.0
    return Ray(px, py, cap.vertex, ray.dx, ray.dy, ray.dz, alive)


@inline
def bent_at_plane(mu, ray):
    """The ray refracted where it is by a plane across the axis."""
    squared = (1.0 - mu * mu) + mu * mu * (ray.dz * ray.dz)
    alive = ray.alive if squared >= 0.0 else 0.0
    return Ray(ray.x, ray.y, ray.z, mu * ray.dx, mu * ray.dy, math.sqrt(max(squared, 0.0)), alive)


@inline
def to_vertex_plane(vertex, ray):
    """The ray on the vertex plane, its z left as it was."""
    t = (vertex - ray.z) / ray.dz
    return Ray(ray.x + t * ray.dx, ray.y + t * ray.dy, ray.z, ray.dx, ray.dy, ray.dz, ray.alive)


@inline
def turned_ideally(vertex, power, limit, ray):
    """The ray on the plane of an ideal thin lens, turned by its power; the same for light going either way."""
    across = ray.dx / ray.dz - power * ray.x
    up = ray.dy / ray.dz - power * ray.y
    dz = 1.0 / math.sqrt(1.0 + across * across + up * up)
    alive = ray.alive if ray.x * ray.x + ray.y * ray.y <= limit else 0.0
    return Ray(ray.x, ray.y, vertex, across * dz, up * dz, dz, alive)


@inline
def entered(m, ray):
    """The ray moved as if the surface had come back to its place in the centred lens.

    A ray that then travels along -z meets the back of the surface: blocked, here as in `left`.
    """
    px, py, pz, ox, oy, oz = ray.x - m.x, ray.y - m.y, ray.z - m.z, ray.dx, ray.dy, ray.dz
    dz = m.xz * ox + m.yz * oy + m.zz * oz
    return Ray(
        m.xx * px + m.yx * py + m.zx * pz,
        m.xy * px + m.yy * py + m.zy * pz,
        m.xz * px + m.yz * py + m.zz * pz,
        m.xx * ox + m.yx * oy + m.zx * oz,
        m.xy * ox + m.yy * oy + m.zy * oz,
        dz,
        ray.alive if dz > 0.0 else 0.0,
    )


@inline
def left(m, ray):
    """The ray moved along with the surface to where it stands."""
    px, py, pz, ox, oy, oz = ray.x, ray.y, ray.z, ray.dx, ray.dy, ray.dz
    dz = m.zx * ox + m.zy * oy + m.zz * oz
    return Ray(
        m.xx * px + m.xy * py + m.xz * pz + m.x,
        m.yx * px + m.yy * py + m.yz * pz + m.y,
        m.zx * px + m.zy * py + m.zz * pz + m.z,
        m.xx * ox + m.xy * oy + m.xz * oz,
        m.yx * ox + m.yy * oy + m.yz * oz,
        dz,
        ray.alive if dz > 0.0 else 0.0,
    )
