"""Packets of rays that start on the sensor: random points in a region, aim, weight. Kernels only; vision frame, mm.

A ray from the sensor through a point at distance d, on a plane at distance h, has the weight cos(theta) d omega / dA =
h^2 / d^4 for irradiance, or 1 for area, times the acceptance of its angle. A thin microlens of focal length f changes
its slope by -offset / f. `camera` is a `camera.tracing.records.CameraArrays`, `start` a
`camera.tracing.records.SensorPoints`.
"""

import math
from typing import NamedTuple

import numpy as np

from pipeline.camera.parts.polygon import triangle_of
from pipeline.camera.tracing.acceptance import accepted_share, is_limited
from pipeline.camera.tracing.microlens_kernels import AIM, FOCAL, PLAIN, X, Y, through_microlens
from pipeline.camera.tracing.records import SensorPoints
from pipeline.camera.tracing.sobol import scrambled
from pipeline.jit.decorators import inline, opaque, unit
from pipeline.optics.crossing import Ray, put
from pipeline.optics.kernels import Packet, trace_packet

_MANY = 12
"""Number of triangles of a fan beyond which a search is faster than counting."""
_VERTEX_X, _VERTEX_Y, _POWER = range(3)
"""Scratch arrays of a packet that hold the plain microlens of each ray; they are free before the trace."""


@unit
def draw(bits, first, size, seed, values):
    """Scrambled coordinates of samples first ... first + size of one dimension."""
    for i in range(size):
        values[i] = scrambled(bits[first + i], seed)


class Anchor(NamedTuple):
    """The sensor position for which a region is bound [mm], and the motion of the region per distance from it."""

    x: float
    y: float
    drift: float


class Aims(NamedTuple):
    """Points that rays pass through, and starts on the sensor, (size,) each [mm]; scratch arrays (SCRATCH, PACKET)."""

    x: np.ndarray
    y: np.ndarray
    start_x: np.ndarray
    start_y: np.ndarray
    scratch: np.ndarray


@opaque
def aim_into(region, fan, anchor, aims):
    """Map two random numbers of each ray, in x and y, to a point of a region.

    Results have the bits of `point_in_fan`, called ray by ray. Here each step runs over all rays: in a fan of few
    triangles the one of a ray is found by counting those before it, not by a search. The first vertex of the polygon is
    repeated behind its last one.
    """
    polygon, cumulative = region.polygon, region.cumulative
    count, cx, cy = fan.vertices, fan.x, fan.y
    x, y, start_x, start_y, scratch = aims
    triangle, below, above = scratch[0], scratch[5], scratch[6]
    ax, ay, bx, by = scratch[1], scratch[2], scratch[3], scratch[4]
    polygon[count, 0], polygon[count, 1] = polygon[0, 0], polygon[0, 1]
    # The first random number chooses a triangle by its area.
    if count > _MANY:
        for i in range(x.shape[0]):
            triangle[i] = triangle_of(cumulative, count, x[i] * cumulative[count - 1], int(x[i] * count))
            x[i] *= cumulative[count - 1]
    else:
        for i in range(x.shape[0]):
            x[i], triangle[i] = x[i] * cumulative[count - 1], 0.0
        for k in range(count - 1):
            area = cumulative[k]
            for i in range(x.shape[0]):
                triangle[i] += 1.0 if area <= x[i] else 0.0
    # Fetch the corners of each ray's triangle, and the areas up to it and including it.
    for i in range(x.shape[0]):
        k = int(triangle[i])
        ax[i], ay[i] = polygon[k, 0], polygon[k, 1]
        bx[i], by[i] = polygon[k + 1, 0], polygon[k + 1, 1]
        below[i] = cumulative[k - 1] if k > 0 else 0.0
        above[i] = cumulative[k]
    # What is left of the first number is the point's position along the outer edge; the root of the second its radius.
    for i in range(x.shape[0]):
        along_edge, radius = (x[i] - below[i]) / (above[i] - below[i]), math.sqrt(y[i])
        ex = (1.0 - along_edge) * (ax[i] - cx) + along_edge * (bx[i] - cx)
        ey = (1.0 - along_edge) * (ay[i] - cy) + along_edge * (by[i] - cy)
        x[i] = cx + radius * ex + anchor.drift * (start_x[i] - anchor.x)
        y[i] = cy + radius * ey + anchor.drift * (start_y[i] - anchor.y)


@opaque
def spread(diffraction, microlens, aims):
    """Move starts by diffraction at the apertures, by three random numbers each, in the scratch arrays.

    Between the nodes of a grid one of the four pictures around is drawn, with bilinear probabilities.
    """
    x, y, scratch = aims.start_x, aims.start_y, aims.scratch
    for i in range(x.shape[0]):
        if microlens >= 0:
            picture = diffraction.of_microlens[microlens]
        else:
            nodes = round(math.sqrt(diffraction.edge_mm.shape[0]))
            column, rest = _node(x[i] / diffraction.node_mm[0], nodes, scratch[0, i])
            row, _ = _node(y[i] / diffraction.node_mm[1], nodes, rest)
            picture = row * nodes + column
        edge, rows = diffraction.edge_mm[picture], diffraction.rows[picture]
        row, up = _drawn(rows, scratch[2, i])
        _, across = _drawn(diffraction.cells[picture, row], scratch[1, i])
        x[i], y[i] = x[i] - edge * (across - 0.5 * rows.shape[0]), y[i] - edge * (up - 0.5 * rows.shape[0])


@inline
def _node(position, nodes, choice):
    """One of the two nodes around a position counted from the middle one, drawn, and the random number left over.

    `choice`: a random number, uniform between 0 and 1.
    """
    from_first = min(max(position + 0.5 * (nodes - 1), 0.0), nodes - 1.0)
    low = min(int(from_first), max(nodes - 2, 0))
    chance_of_next = from_first - low
    if choice < chance_of_next:
        return low + 1, choice / chance_of_next
    return low, (choice - chance_of_next) / (1.0 - chance_of_next)


@inline
def _drawn(cumulative, choice):
    """The cell in which a cumulative sum passes a random number, and the position at which it does, in cells from the
    start of the first.
    """
    low, high = 0, cumulative.shape[0] - 1
    while low < high:
        middle = (low + high) // 2
        if cumulative[middle] > choice:
            high = middle
        else:
            low = middle + 1
    before = cumulative[low - 1] if low > 0 else 0.0
    return low, low + min((choice - before) / (cumulative[low] - before), 1.0)


@inline
def region_drift(camera, microlens):
    """Motion of a region per motion of its sensor position: the drift of the outlines, 0 behind a microlens."""
    return camera.optics.drift if microlens < 0 else 0.0


@inline
def send_packet(camera, microlens, start, size, packet):
    """Send rays from sensor positions through given points of the sampling plane and trace them into the scene.

    The weight of a ray is per area of that plane: cos^4 / h^2 for irradiance, or 1, times its acceptance.
    `packet`: x and y hold the points on entry; the rays behind the front vertex and their weights on exit.
    """
    aim_packet(camera, microlens, start, size, packet)
    trace_packet(camera.table, packet, size)


@opaque
def aim_packet(camera, microlens, start, size, packet):
    """Send rays as `send_packet` does, but only up to the main lens."""
    if microlens >= 0 and camera.elements.model != PLAIN:
        _through(camera, microlens, start, size, packet)
    else:
        _set_microlens(camera.microlenses, microlens, 0, size, packet.scratch)
        _aim(camera, microlens >= 0, start, size, packet)


@inline
def send_mixed(camera, microlens, owner, start, size, packet):
    """Like `send_packet`, for rays of several positions: `microlens` of each position, `owner` the position of each
    ray.

    A packet that is not full costs nearly as much as a full one, and a position may have two rays.
    """
    aim_mixed(camera, microlens, owner, start, size, packet)
    trace_packet(camera.table, packet, size)


@opaque
def aim_mixed(camera, microlens, owner, start, size, packet):
    """Send rays as `send_mixed` does, but only up to the main lens."""
    x, y, z, dx, dy, dz, alive, scratch, weight = packet
    plain = microlens[owner[0]] < 0 or camera.elements.model == PLAIN
    first = 0
    # Rays behind the same microlens follow each other.
    while first < size:
        end, n = first + 1, microlens[owner[first]]
        while end < size and microlens[owner[end]] == n:
            end += 1
        if plain:
            _set_microlens(camera.microlenses, n, first, end, scratch)
        else:
            span = slice(first, end)
            part = Packet(x[span], y[span], z[span], dx[span], dy[span], dz[span], alive[span], scratch, weight[span])
            _through(camera, n, SensorPoints(start.x[span], start.y[span]), end - first, part)
        first = end
    if plain:
        _aim(camera, microlens[owner[0]] >= 0, start, size, packet)


@opaque
def _through(camera, microlens, start, size, packet):
    """Aim rays through a microlens that is not plain."""
    through_microlens(camera, microlens, start, size, packet)
    _weigh(camera.acceptance, camera.microlenses[microlens, AIM], packet.weight, packet.alive, size)


@inline
def _set_microlens(microlenses, microlens, first, end, scratch):
    """Set the vertex [mm] and the power [1/mm] of the plain microlens of some rays; 0 without a microlens."""
    x, y, power = 0.0, 0.0, 0.0
    if microlens >= 0:
        x, y, power = microlenses[microlens, X], microlenses[microlens, Y], 1.0 / microlenses[microlens, FOCAL]
    for i in range(first, end):
        scratch[_VERTEX_X, i], scratch[_VERTEX_Y, i], scratch[_POWER, i] = x, y, power


@inline
def _aim(camera, has_microlens, start, size, packet):
    """Directions behind plain microlenses, if any, and weights of rays from the sensor through points of the plane."""
    # A sample at distance d from the sensor position, on a plane at distance h from the sensor, weighs cos(theta) d
    # omega = h^2 / d^4 dA: irradiance.
    vx, vy, power = packet.scratch[_VERTEX_X], packet.scratch[_VERTEX_Y], packet.scratch[_POWER]
    sampling_z = camera.optics.sampling_z_mm
    disc = camera.elements.disc_mm
    h = sampling_z - camera.optics.sensor_z_mm
    per_h = 1.0 / h
    for i in range(size):
        x, y = packet.x[i], packet.y[i]
        sx, sy = (x - start.x[i]) * per_h, (y - start.y[i]) * per_h
        ax, ay = x - vx[i], y - vy[i]
        cos2_per_h = per_h / (1.0 + sx * sx + sy * sy)
        # An ideal thin lens changes slopes by offset / focal length.
        sx, sy = sx - ax * power[i], sy - ay * power[i]
        w = 1.0 / math.sqrt(1.0 + sx * sx + sy * sy)
        put(packet, i, Ray(x, y, sampling_z, sx * w, sy * w, w, 1.0))
        packet.weight[i] = cos2_per_h * cos2_per_h
    if has_microlens and disc > 0.0:
        for i in range(size):
            ax, ay = packet.x[i] - vx[i], packet.y[i] - vy[i]
            packet.alive[i] = 1.0 if ax * ax + ay * ay <= disc * disc else 0.0
    _weigh(camera.acceptance, h, packet.weight, packet.alive, size)


@inline
def _weigh(acceptance, h, weight, alive, size):
    """Apply the acceptance and the kind of weight to weights cos^4 / h^2."""
    if is_limited(acceptance) or acceptance.by_area:
        for i in range(size):
            accepted = 1.0
            if is_limited(acceptance):
                cosine = math.sqrt(h * math.sqrt(weight[i]))
                accepted = accepted_share(acceptance, cosine)
            weight[i] = accepted if acceptance.by_area else weight[i] * accepted
            alive[i] = alive[i] if accepted > 0.0 else 0.0
