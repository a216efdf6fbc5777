"""Rays through a microlens that is more than an untilted thin one, in its own frame. Kernels only; mm.

The local frame of a microlens has its origin at the vertex of the rear face and z along its axis, to the scene;
`detail` holds the turn from the vision frame. `camera` is a `camera.tracing.records.CameraArrays`, `microlens` the row
of one.
"""

import math
from typing import NamedTuple

import numpy as np

from pipeline.camera.tracing.acceptance import BY_AREA, disc_weight, is_limited, region_weight
from pipeline.camera.tracing.records import SensorPoints
from pipeline.jit.decorators import inline, kernel, unit
from pipeline.optics.crossing import Ray, put, ray_of
from pipeline.optics.kernels import PACKET, new_packet, trace_packet

X, Y, FOCAL, KIND, Z, AIM, BY_START, BY_AIM, OUTLINE_X, OUTLINE_Y, BASE_X, BASE_Y, MARGIN, INFLATION = range(14)
"""Columns of `lenses`. Plain microlenses have the first three."""
PLAIN_COLUMNS, COLUMNS = 3, 14
"""Numbers of columns of `lenses`, where all microlenses are plain and where they are not."""

DISC, MODEL, TURN = 4, 5, 6
"""Places in `detail` behind those of `camera.tracing.acceptance`: radius of the disc or 0, the model, the turn (9)."""
PLAIN, THIN, TWO_PLANE, REFRACTIVE = 0.0, 1.0, 2.0, 3.0
"""Models; a plain microlens is thin and parallel to the sensor."""

CURVATURE_OF_NORMALS, INDEX, IN_FRONT, BENDS = range(4)
"""Columns of `bends`, one row per type: curvature of the normals of the two-plane model [1/mm], index, and whether the
aperture is that of the front face, behind a plane; the last is their number."""


class MicrolensPlace(NamedTuple):
    """Place of a microlens's rear vertex [mm], height of its aim plane above the sensor, sensor below the vertex."""

    x: float
    y: float
    z: float
    aim: float
    below: float


@inline
def place_of_microlens(camera, microlens):
    """The place of a microlens that is not plain."""
    row = camera.lenses[microlens]
    return MicrolensPlace(row[X], row[Y], row[Z], row[AIM], camera.optics.sensor_z_mm - row[Z])


@unit
def through_microlens(camera, microlens, start, size, packet):
    """From sensor positions towards aim points, in x and y, through one microlens: vision frame."""
    detail, faces, bends, _ = camera.mosaic
    kind, place = int(camera.lenses[microlens, KIND]), place_of_microlens(camera, microlens)
    towards_microlens(camera, microlens, start, size, packet)
    trace_packet(faces[kind], packet, size)
    if detail[MODEL] == THIN:
        focal = camera.lenses[microlens, FOCAL]
        for i in range(size):
            put(packet, i, bent_thinly(focal, ray_of(packet, i)))
    elif detail[MODEL] == TWO_PLANE:
        curvature, mu = bends[kind, CURVATURE_OF_NORMALS], bends[kind, INDEX]
        for i in range(size):
            put(packet, i, bent_by_normals(curvature, mu, ray_of(packet, i)))
    for i in range(size):
        put(packet, i, out_of_microlens(place, detail, ray_of(packet, i)))


@inline
def towards_microlens(camera, microlens, start, size, packet):
    """Rays from sensor positions towards aim points, in x and y, with their weights: frame of the microlens."""
    place, detail, x, y = place_of_microlens(camera, microlens), camera.mosaic.detail, packet.x, packet.y
    for i in range(size):
        ray, packet.weight[i] = into_microlens(place, detail, start.x[i], start.y[i], x[i], y[i])
        put(packet, i, ray)


@inline
def into_microlens(place, detail, start_x, start_y, x, y):
    """The ray from a sensor position towards an aim point (x, y), and its weight: frame of the microlens."""
    h = place.aim
    sx, sy = (x - start_x) / h, (y - start_y) / h
    squared = 1.0 + sx * sx + sy * sy
    w = 1.0 / math.sqrt(squared)
    dx, dy, dz = turned(detail, sx * w, sy * w, w)
    px, py, pz = turned(detail, start_x - place.x, start_y - place.y, place.below)
    return Ray(px, py, pz, dx, dy, dz, 1.0), 1.0 / (h * h * squared * squared)


@inline
def bent_thinly(focal, ray):
    """The ray bent where it is by a thin microlens."""
    a, b = ray.dx / ray.dz - ray.x / focal, ray.dy / ray.dz - ray.y / focal
    w = 1.0 / math.sqrt(1.0 + a * a + b * b)
    return Ray(ray.x, ray.y, ray.z, a * w, b * w, w, ray.alive)


@inline
def bent_by_normals(curvature, mu, ray):
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
def out_of_microlens(place, detail, ray):
    """The ray in the vision frame."""
    dx, dy, dz = turned_back(detail, ray.dx, ray.dy, ray.dz)
    x, y, z = turned_back(detail, ray.x, ray.y, ray.z)
    return Ray(x + place.x, y + place.y, z + place.z, dx, dy, dz, ray.alive)


@inline
def turned(detail, x, y, z):
    """A vector of the vision frame in the array's frame."""
    r = detail[TURN : TURN + 9]
    return r[0] * x + r[1] * y + r[2] * z, r[3] * x + r[4] * y + r[5] * z, r[6] * x + r[7] * y + r[8] * z


@inline
def turned_back(detail, x, y, z):
    """A vector of the array's frame in the vision frame."""
    r = detail[TURN : TURN + 9]
    return r[0] * x + r[3] * y + r[6] * z, r[1] * x + r[4] * y + r[7] * z, r[2] * x + r[5] * y + r[8] * z


@inline
def aim_for(camera, microlens, sx, sy, px, py, pz):
    """The aim point of the ray from a sensor position that meets a point (px, py, pz) of the aperture, local frame.

    Where a plane face comes first, the slope u in front of it follows from Snell's law by Newton's method:
    gap u + slab u / sqrt(n^2 + (n^2 - 1) u^2) is the distance across.
    """
    detail, _, bends, _ = camera.mosaic
    row, sensor_z = camera.lenses[microlens], camera.optics.sensor_z_mm
    kind, h = int(row[KIND]), row[AIM]
    x, y, z = turned(detail, sx - row[X], sy - row[Y], sensor_z - row[Z])
    across_x, across_y = px - x, py - y
    if bends[kind, IN_FRONT] > 0.0:
        gap, slab, n2 = -z, pz, bends[kind, INDEX] ** 2
        across = math.sqrt(across_x * across_x + across_y * across_y)
        u = across / (gap + slab / bends[kind, INDEX])
        for _ in range(6):
            root = math.sqrt(n2 + (n2 - 1.0) * u * u)
            u -= (gap * u + slab * u / root - across) / (gap + slab * n2 / (root * root * root))
        scale = u / across if across > 0.0 else 0.0
        dx, dy, dz = turned_back(detail, across_x * scale, across_y * scale, 1.0)
    else:
        dx, dy, dz = turned_back(detail, across_x, across_y, pz - z)
    return sx + h * dx / dz, sy + h * dy / dz


@unit
def free_weight(camera, microlens, sx, sy, polygon):
    """Weight of all rays from a sensor position through the aperture of a microlens, main lens ignored [sr or mm^2]."""
    optics, aperture, detail, rims = camera.optics, camera.aperture, camera.mosaic.detail, camera.mosaic.rims
    row = camera.lenses[microlens]
    x, y = sx - row[X], sy - row[Y]
    if detail[MODEL] == PLAIN:
        distance = optics.sampling_z_mm - optics.sensor_z_mm
        if not detail[DISC] > 0.0:
            return region_weight(aperture, aperture.shape[0], x, y, distance, detail)
        if not (is_limited(detail) or detail[BY_AREA] > 0.0):
            return disc_weight(detail[DISC], x, y, distance)
        return region_weight(rims[0], rims.shape[1], x, y, distance, detail)
    rim = rims[int(row[KIND])]
    for i in range(rim.shape[0]):
        polygon[i, 0], polygon[i, 1] = aim_for(camera, microlens, sx, sy, rim[i, 0], rim[i, 1], rim[i, 2])
    return region_weight(polygon, rim.shape[0], sx, sy, row[AIM], detail)


@kernel
def rays_before(camera, microlens, starts, aims, position, direction, passes):
    """Rays from sensor positions (n, 2) through aim points (n, 2) behind, and then before, the microlens of each, (n,).

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
    """Aim points (n, 2), written, of rays from sensor positions (n, 2) to points (n, 3) of apertures, local frame."""
    for n in range(starts.shape[0]):
        px, py, pz = points[n]
        aims[n, 0], aims[n, 1] = aim_for(camera, microlens[n], starts[n, 0], starts[n, 1], px, py, pz)
