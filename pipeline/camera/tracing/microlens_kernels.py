"""Rays through a microlens that is tilted or thick, in its own frame. Kernels only; mm.

A thin microlens of focal length f changes the slope of a ray by -offset / f; a two-plane one refracts at a plane with
the normals of a sphere, D' = mu D + (cos' - mu cos) n; a refractive one is traced through both faces.

The local frame of a microlens has its origin at the vertex of the rear face and z along its axis, to the scene; `turn`
rotates the vision frame into it. `camera` is a `camera.tracing.records.CameraArrays`, `microlens` the row of one.
"""

import math

import numpy as np

from pipeline.camera.tracing.acceptance import disc_weight, is_limited, region_weight
from pipeline.camera.tracing.records import SensorPoints
from pipeline.jit.decorators import inline, kernel, opaque
from pipeline.optics.crossing import Ray, put, ray_of
from pipeline.optics.kernels import PACKET, new_packet, trace_packet

X, Y, FOCAL, KIND, Z, AIM, BY_START, BY_AIM, OUTLINE_X, OUTLINE_Y, BASE_X, BASE_Y, MARGIN, INFLATION = range(14)
"""Columns of `CameraArrays.microlenses`: vertex, focal length, type, aim plane, and the linear map that bounds rays."""
COLUMNS = 14
"""Number of these columns."""

PLAIN, THIN, TWO_PLANE, REFRACTIVE = range(4)
"""Models. A plain microlens is thin and parallel to the sensor. It keeps a path of its own beside the general one
because THIN gives the same rows to 6e-8 px but costs half as much CPU again (example 02 built cold: 24.1 against 16.5
CPU s)."""

CURVATURE_OF_NORMALS, INDEX, IN_FRONT, BENDS = range(4)
"""Columns of `bends`, one row per type: curvature of the normals of the two-plane model [1/mm], index, and whether the
aperture is that of the front face, behind a plane; the last is their number."""


@opaque
def through_microlens(camera, microlens, start, size, packet):
    """Trace rays from sensor positions towards aim points, in x and y, through one microlens: vision frame."""
    elements = camera.elements
    row = camera.microlenses[microlens]
    kind = int(row[KIND])
    turn = elements.turn
    vx, vy, vz = row[X], row[Y], row[Z]
    towards_microlens(camera, microlens, start, size, packet)
    trace_packet(elements.faces[kind], packet, size)
    if elements.model == THIN:
        focal = row[FOCAL]
        for i in range(size):
            put(packet, i, _bent_thinly(focal, ray_of(packet, i)))
    elif elements.model == TWO_PLANE:
        curvature, mu = elements.bends[kind, CURVATURE_OF_NORMALS], elements.bends[kind, INDEX]
        for i in range(size):
            put(packet, i, _bent_by_normals(curvature, mu, ray_of(packet, i)))
    for i in range(size):
        ray = ray_of(packet, i)
        dx, dy, dz = turned_back(turn, ray.dx, ray.dy, ray.dz)
        x, y, z = turned_back(turn, ray.x, ray.y, ray.z)
        put(packet, i, Ray(x + vx, y + vy, z + vz, dx, dy, dz, ray.alive))


@inline
def towards_microlens(camera, microlens, start, size, packet):
    """Rays from sensor positions towards aim points, in x and y, with their weights: frame of the microlens."""
    row = camera.microlenses[microlens]
    turn = camera.elements.turn
    vx, vy = row[X], row[Y]
    h = row[AIM]
    below = camera.optics.sensor_z_mm - row[Z]
    for i in range(size):
        start_x, start_y = start.x[i], start.y[i]
        sx, sy = (packet.x[i] - start_x) / h, (packet.y[i] - start_y) / h
        squared = 1.0 + sx * sx + sy * sy
        w = 1.0 / math.sqrt(squared)
        dx, dy, dz = turned(turn, sx * w, sy * w, w)
        px, py, pz = turned(turn, start_x - vx, start_y - vy, below)
        put(packet, i, Ray(px, py, pz, dx, dy, dz, 1.0))
        packet.weight[i] = 1.0 / (h * h * squared * squared)


@inline
def _bent_thinly(focal, ray):
    """The ray deflected at its current point by a thin microlens."""
    a, b = ray.dx / ray.dz - ray.x / focal, ray.dy / ray.dz - ray.y / focal
    w = 1.0 / math.sqrt(1.0 + a * a + b * b)
    return Ray(ray.x, ray.y, ray.z, a * w, b * w, w, ray.alive)


@inline
def _bent_by_normals(curvature, mu, ray):
    """Snell's law at a plane with the normals of a sphere, for a ray that leaves a medium of index mu."""
    nx, ny = -curvature * ray.x, -curvature * ray.y
    flat = 1.0 - nx * nx - ny * ny
    nz = math.sqrt(max(flat, 0.0))
    cosine = ray.dx * nx + ray.dy * ny + ray.dz * nz
    squared = 1.0 - mu * mu * (1.0 - cosine * cosine)
    step = math.sqrt(max(squared, 0.0)) - mu * cosine
    return Ray(
        ray.x,
        ray.y,
        ray.z,
        mu * ray.dx + step * nx,
        mu * ray.dy + step * ny,
        mu * ray.dz + step * nz,
        ray.alive if (squared >= 0.0) & (flat >= 0.0) else 0.0,
    )


@inline
def turned(turn, x, y, z):
    """A vector of the vision frame in the array's frame."""
    a, b, c = turn[0], turn[1], turn[2]
    return a[0] * x + a[1] * y + a[2] * z, b[0] * x + b[1] * y + b[2] * z, c[0] * x + c[1] * y + c[2] * z


@inline
def turned_back(turn, x, y, z):
    """A vector of the array's frame in the vision frame."""
    a, b, c = turn[0], turn[1], turn[2]
    return a[0] * x + b[0] * y + c[0] * z, a[1] * x + b[1] * y + c[1] * z, a[2] * x + b[2] * y + c[2] * z


@inline
def aim_for(camera, microlens, sx, sy, px, py, pz):
    """The aim point of the ray from a sensor position that meets a point (px, py, pz) of the aperture, local frame.

    If a plane face comes first, Newton's method solves Snell's law for the slope u in front of it: gap u + slab u /
    sqrt(n^2 + (n^2 - 1) u^2) is the distance across.
    """
    turn = camera.elements.turn
    bends = camera.elements.bends
    row = camera.microlenses[microlens]
    sensor_z = camera.optics.sensor_z_mm
    if camera.elements.model == PLAIN:
        return row[X] + px, row[Y] + py
    kind = int(row[KIND])
    h = row[AIM]
    x, y, z = turned(turn, sx - row[X], sy - row[Y], sensor_z - row[Z])
    across_x, across_y = px - x, py - y
    if bends[kind, IN_FRONT] > 0.0:
        gap, slab = -z, pz
        n2 = bends[kind, INDEX] ** 2
        across = math.sqrt(across_x * across_x + across_y * across_y)
        u = across / (gap + slab / bends[kind, INDEX])
        for _ in range(6):
            root = math.sqrt(n2 + (n2 - 1.0) * u * u)
            u -= (gap * u + slab * u / root - across) / (gap + slab * n2 / (root * root * root))
        scale = u / across if across > 0.0 else 0.0
        dx, dy, dz = turned_back(turn, across_x * scale, across_y * scale, 1.0)
    else:
        dx, dy, dz = turned_back(turn, across_x, across_y, pz - z)
    return sx + h * dx / dz, sy + h * dy / dz


@opaque
def free_weight(camera, microlens, sx, sy, polygon) -> float:
    """Weight of all rays from a sensor position through the aperture of a microlens, main lens ignored [sr or mm^2]."""
    aperture, acceptance = camera.aperture, camera.acceptance
    elements, rims = camera.elements, camera.elements.rims
    row = camera.microlenses[microlens]
    x, y, distance = sx - row[X], sy - row[Y], row[AIM]
    if elements.model == PLAIN:
        if not elements.disc_mm > 0.0:
            return region_weight(aperture, aperture.shape[0], x, y, distance, acceptance)
        if not (is_limited(acceptance) or acceptance.by_area):
            return disc_weight(elements.disc_mm, x, y, distance)
        return region_weight(rims[0], rims.shape[1], x, y, distance, acceptance)
    rim = rims[int(row[KIND])]
    for i in range(rim.shape[0]):
        polygon[i, 0], polygon[i, 1] = aim_for(camera, microlens, sx, sy, rim[i, 0], rim[i, 1], rim[i, 2])
    return region_weight(polygon, rim.shape[0], sx, sy, distance, acceptance)


@kernel
def rays_before(camera, microlens, starts, aims, position, direction, passes):
    """Rays from sensor positions (n, 2) through aim points (n, 2), in front of the microlens of each, (n,).

    Written: (n, 3) points on the front face, (n, 3) unit directions, (n,) flags.
    """
    packet, start = new_packet(), SensorPoints(np.empty(PACKET), np.empty(PACKET))
    for n in range(starts.shape[0]):
        start.x[0], start.y[0] = starts[n, 0], starts[n, 1]
        packet.x[0], packet.y[0] = aims[n, 0], aims[n, 1]
        through_microlens(camera, microlens[n], start, 1, packet)
        ray = ray_of(packet, 0)
        position[n, 0], position[n, 1], position[n, 2] = ray.x, ray.y, ray.z
        direction[n, 0], direction[n, 1], direction[n, 2] = ray.dx, ray.dy, ray.dz
        passes[n] = ray.alive


@kernel
def aims_for(camera, microlens, starts, points, aims):
    """Write the aim points (n, 2) of rays from sensor positions (n, 2) to points (n, 3) of apertures, local frame."""
    for n in range(starts.shape[0]):
        px, py, pz = points[n]
        aims[n, 0], aims[n, 1] = aim_for(camera, microlens[n], starts[n, 0], starts[n, 1], px, py, pz)
