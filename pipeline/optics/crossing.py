"""Intersection and refraction of one ray at one surface: plain numbers in and out, for the loops of packets.

A sphere of curvature c with its vertex at the origin is c (x^2 + y^2 + z^2) - 2 z = 0. From p, the point of the ray
nearest to the vertex, the path to it is the cancellation-free root next to the vertex, t = F / (N + sqrt(N^2 - c F))
with F = c p . p - 2 p_z and N the z component of the direction (Feder, J. Opt. Soc. Am. 41, 1951, 630). Snell's law in
vectors bends the ray: D' = mu D + (cos' - mu cos) n. An ideal thin lens of power P adds -P h to the slope of a ray at
height h.

Lengths in mm; directions are unit vectors with a positive z component. A blocked ray only loses its `alive` flag and is
carried along: no branch here depends on the ray. Conics and aspheres: `optics.aspheres`. On spheres, which take most of
the time, a b + c is rounded once (fused multiply-add): a third fewer instructions, and a processor overlaps more rays.

A displaced surface is met in the frame of its centred position: rays are moved into that frame and back.
"""

import math
from typing import NamedTuple

from pipeline.jit.decorators import fma, inline
from pipeline.optics.table import CURVATURE, INDEX_RATIO, SEMI_DIAMETER_SQUARED, VERTEX


class Ray(NamedTuple):
    """A point on a ray [mm], its unit direction, and 1 if it passes, 0 if it is blocked."""

    x: float
    y: float
    z: float
    dx: float
    dy: float
    dz: float
    alive: float


class Cap(NamedTuple):
    """A plane or sphere: vertex z [mm], curvature [1/mm], index ratio, squared semi-diameter [mm^2]."""

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
    """One ray of a packet, whose arrays are named like the fields of a ray."""
    return Ray(packet.x[i], packet.y[i], packet.z[i], packet.dx[i], packet.dy[i], packet.dz[i], packet.alive[i])


@inline
def put(packet, i, ray):
    """Write a ray into a packet."""
    packet.x[i], packet.y[i], packet.z[i] = ray.x, ray.y, ray.z
    packet.dx[i], packet.dy[i], packet.dz[i] = ray.dx, ray.dy, ray.dz
    packet.alive[i] = ray.alive


@inline
def put_point(packet, i, ray):
    """Write the point and the flag of a ray into a packet whose direction has not changed."""
    packet.x[i], packet.y[i], packet.z[i], packet.alive[i] = ray.x, ray.y, ray.z, ray.alive


@inline
def cap_of(row):
    """The plane or sphere in a row of a table."""
    return Cap(row[VERTEX], row[CURVATURE], row[INDEX_RATIO], row[SEMI_DIAMETER_SQUARED])


@inline
def motion_of_row(row, column):
    """The displacement of a surface, by the column that holds it: POSE as rays leave it, ENTRY as they enter it."""
    i = int(row[column])
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
    dx, dy, dz = ray.dx, ray.dy, ray.dz
    # Move to p, the point of the ray nearest to the vertex.
    px, py, pz = ray.x, ray.y, ray.z - cap.vertex
    beyond = fma(px, dx, fma(py, dy, pz * dz))
    px, py, pz = fma(-beyond, dx, px), fma(-beyond, dy, py), fma(-beyond, dz, pz)
    # Solve the quadratic for the path from p to the sphere; its root is cos, the cosine of the angle of incidence.
    f = fma(c, fma(px, px, fma(py, py, pz * pz)), -2.0 * pz)
    discriminant = fma(dz, dz, -c * f)
    root = math.sqrt(max(discriminant, 0.0))
    t = f / (dz + root)
    px, py, pz = fma(t, dx, px), fma(t, dy, py), fma(t, dz, pz)
    # Refract: cos'^2 = 1 - mu^2 (1 - cos^2), and n = (-c p_x, -c p_y, 1 - c p_z).
    squared = fma(mu * mu, max(discriminant, 0.0), 1.0 - mu * mu)
    step = fma(-mu, root, math.sqrt(max(squared, 0.0)))
    passes = (discriminant >= 0.0) & (fma(px, px, py * py) <= cap.limit) & (squared >= 0.0)
    bend = -step * c
    return Ray(
        px,
        py,
        pz + cap.vertex,
        fma(bend, px, mu * dx),
        fma(bend, py, mu * dy),
        fma(bend, pz, fma(mu, dz, step)),
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
    """The ray refracted at its current point by a plane across the axis."""
    squared = (1.0 - mu * mu) + mu * mu * (ray.dz * ray.dz)
    alive = ray.alive if squared >= 0.0 else 0.0
    return Ray(ray.x, ray.y, ray.z, mu * ray.dx, mu * ray.dy, math.sqrt(max(squared, 0.0)), alive)


@inline
def to_vertex_plane(vertex, ray):
    """The ray on the vertex plane, with its z left unchanged."""
    t = (vertex - ray.z) / ray.dz
    return Ray(ray.x + t * ray.dx, ray.y + t * ray.dy, ray.z, ray.dx, ray.dy, ray.dz, ray.alive)


@inline
def turned_ideally(vertex, power, limit, ray):
    """The ray on the plane of an ideal thin lens, deflected by its power; identical for light in either direction."""
    across = ray.dx / ray.dz - power * ray.x
    up = ray.dy / ray.dz - power * ray.y
    dz = 1.0 / math.sqrt(1.0 + across * across + up * up)
    alive = ray.alive if ray.x * ray.x + ray.y * ray.y <= limit else 0.0
    return Ray(ray.x, ray.y, vertex, across * dz, up * dz, dz, alive)


@inline
def entered(m, ray):
    """The ray in the frame of the surface's centred position.

    A ray that then travels along -z meets the back of the surface: blocked, here as in `left`.
    """
    px, py, pz = ray.x - m.x, ray.y - m.y, ray.z - m.z
    dz = m.xz * ray.dx + m.yz * ray.dy + m.zz * ray.dz
    return Ray(
        m.xx * px + m.yx * py + m.zx * pz,
        m.xy * px + m.yy * py + m.zy * pz,
        m.xz * px + m.yz * py + m.zz * pz,
        m.xx * ray.dx + m.yx * ray.dy + m.zx * ray.dz,
        m.xy * ray.dx + m.yy * ray.dy + m.zy * ray.dz,
        dz,
        ray.alive if dz > 0.0 else 0.0,
    )


@inline
def left(m, ray):
    """The ray moved back from that frame to the displaced surface."""
    dz = m.zx * ray.dx + m.zy * ray.dy + m.zz * ray.dz
    return Ray(
        m.xx * ray.x + m.xy * ray.y + m.xz * ray.z + m.x,
        m.yx * ray.x + m.yy * ray.y + m.yz * ray.z + m.y,
        m.zx * ray.x + m.zy * ray.y + m.zz * ray.z + m.z,
        m.xx * ray.dx + m.xy * ray.dy + m.xz * ray.dz,
        m.yx * ray.dx + m.yy * ray.dy + m.yz * ray.dz,
        dz,
        ray.alive if dz > 0.0 else 0.0,
    )
