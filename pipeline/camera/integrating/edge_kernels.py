"""Single rays through given points of the sampling plane: what passes, what blocks the rest, and sums over nodes.

Kernels only; vision frame, mm. Rays come sorted by the sensor position (`owner`) that they start from.
"""

import math

import numpy as np

from pipeline.camera.parts.camera import REPLICAS
from pipeline.camera.parts.polygon import fan, point_in_fan
from pipeline.camera.tracing.microlens_kernels import DISC, KIND, MODEL, PLAIN, free_weight, towards_microlens
from pipeline.camera.tracing.moments import accumulate, clear, cross, cross_packet, finish, set_pivot
from pipeline.camera.tracing.packets import aim_mixed, send_mixed, send_packet
from pipeline.camera.tracing.sampling_bounds import SKIP, bound, new_region
from pipeline.jit.decorators import buffers, inline, kernel, unit
from pipeline.optics.kernels import PACKET, Packet, new_packet, trace_packet
from pipeline.optics.table import EDGES, FIRST_EDGE, INNER_SQUARED, SEMI_DIAMETER_SQUARED

PASSES = -1
"""Label of a ray that leaves the camera; other labels name what blocks it."""
_STRAIGHT = 1 << 10
_GOLDEN_U, _GOLDEN_V = 0.7548776662466927, 0.5698402909980532


@kernel
def bounds(optics, outlines, lenses, aperture, mosaic, positions, lens, polygons, counts, free):
    """Polygons that enclose what passes, and the weight of all rays through each position's own microlens.

    Parameters
    ----------
    polygons, counts : (n, MAX_VERTICES, 2) float64, (n,) int64
        Written, counter-clockwise; 0 vertices where nothing passes.
    free : (n,) float64
        Written; 0 without a microlens [sr].
    """
    region = new_region()
    for n in range(positions.shape[0]):
        counts[n], free[n] = 0, 0.0
        if lens[n] == SKIP:
            continue
        x, y = positions[n]
        if lens[n] >= 0:
            free[n] = free_weight(optics, lenses, aperture, mosaic, lens[n], x, y, region[0])
        count, _, _, area = bound(optics, outlines, lenses, aperture, lens[n], x, y, 0.0, region)
        if area > 0.0:
            counts[n] = count
            for i in range(count):
                polygons[n, i, 0], polygons[n, i, 1] = region[0][i, 0], region[0][i, 1]


@kernel
def spread(polygons, counts, points):
    """Fill polygons evenly with points (n, m, 2), written."""
    cumulative = np.empty(polygons.shape[1])
    for n in range(points.shape[0]):
        cx, cy, _ = fan(polygons[n], counts[n], cumulative)
        for i in range(points.shape[1]):
            u, v = (0.5 + _GOLDEN_U * i) % 1.0, (0.5 + _GOLDEN_V * i) % 1.0
            points[n, i, 0], points[n, i, 1] = point_in_fan(polygons[n], counts[n], cumulative, cx, cy, u, v)


@kernel
def probe(camera, positions, lens, owner, points, label):
    """Trace one ray through each point and say what blocks it.

    Parameters
    ----------
    camera : tuple
        Optics, table, lenses, aperture and mosaic of `Tracer.arrays`.
    owner : (m,) int64
        Sensor position that a ray starts from, ascending.
    points : (m, 2) float64
        On the sampling plane.
    label : (m,) int64
        Written: see `label_packet`.
    """
    packet, start_x, start_y = new_packet(), np.empty(PACKET), np.empty(PACKET)
    here, clearance = np.empty(PACKET, np.int64), np.empty(PACKET)
    for first in range(0, owner.shape[0], PACKET):
        size = min(PACKET, owner.shape[0] - first)
        part = slice(first, first + size)
        _set_rays(positions, owner[part], points[part], start_x, start_y, packet)
        label_packet(camera, lens, owner[part], points[part], start_x, start_y, size, packet, here, clearance)
        for i in range(size):
            label[first + i] = here[i]


@unit
def label_packet(camera, lens, owner, points, start_x, start_y, size, packet, label, clearance):
    """Send rays through points that x and y of the packet hold, and say what blocks each, and how far from an edge.

    Written: PASSES, or the row of the blocking surface, with a number for each straight edge of its aperture; the
    number of rows stands for the pixel's acceptance and plain microlenses, numbers above it for faces of others.
    The clearance is positive inside of all apertures and negative beyond that which blocks, in shares of them; its sign
    is wrong where something else blocks.
    """
    optics, table, lenses, aperture, mosaic = camera
    alive, rows, detail = packet[6], table.shape[0], mosaic[0]
    aim_mixed(optics, lenses, mosaic, lens, owner, start_x, start_y, size, packet)
    for i in range(size):
        label[i] = PASSES if alive[i] > 0.0 else rows
        clearance[i] = 1.0
    label_surfaces(table, 0, PASSES, packet, size, label, clearance)
    if lens[owner[0]] < 0:
        return
    if detail[MODEL] != PLAIN:
        _label_faces(camera, lens, owner, points, start_x, start_y, size, packet, label)
    elif not detail[DISC] > 0.0:
        for i in range(size):
            if label[i] == rows:
                n = lens[owner[i]]
                label[i] += _STRAIGHT * (
                    1 + _side_of(aperture, points[i, 0] - lenses[n, 0], points[i, 1] - lenses[n, 1])
                )


@inline
def _label_faces(camera, lens, owner, points, start_x, start_y, size, packet, label):
    """Say which face of its microlens blocks a ray that does not reach the main lens; weights are lost."""
    optics, table, lenses, _, mosaic = camera
    x, y, z, dx, dy, dz, alive, scratch, weight = packet
    first = 0
    while first < size:
        end, n = first + 1, lens[owner[first]]
        while end < size and owner[end] == owner[first]:
            end += 1
        here = slice(first, end)
        for i in range(first, end):
            x[i], y[i] = points[i, 0], points[i, 1]
        part = Packet(x[here], y[here], z[here], dx[here], dy[here], dz[here], alive[here], scratch, weight[here])
        towards_microlens(optics, lenses, mosaic[0], n, start_x[here], start_y[here], end - first, part)
        faces, rows = mosaic[1][int(lenses[n, KIND])], table.shape[0]
        label_surfaces(faces, rows + 1, rows, part, end - first, label[here], weight[here])  # a clearance nobody wants
        first = end


@buffers
def what_blocks(table, optics, lenses, mosaic, lens, start_x, start_y, size, packet, label):
    """Labels of rays from positions behind one microlens, or none; its sides and faces are not told apart."""
    alive, clearance = packet[6], np.empty(PACKET)
    send_packet(table[:0], optics, lenses, mosaic, lens, start_x, start_y, size, packet)
    for i in range(size):
        label[i] = PASSES if alive[i] > 0.0 else table.shape[0]
    label_surfaces(table, 0, PASSES, packet, size, label, clearance)


@unit
def label_surfaces(table, base, unknown, packet, size, label, clearance):
    """Trace a packet surface by surface and name what blocks the rays whose label is still `unknown`."""
    x, y, alive = packet.x, packet.y, packet.alive
    for k in range(table.shape[0]):
        trace_packet(table[k : k + 1], packet, size)
        per_squared, is_round = 1.0 / table[k, SEMI_DIAMETER_SQUARED], not table[k, EDGES] > 0.0
        inner = table[k, INNER_SQUARED] * per_squared
        for i in range(size):
            squared = (x[i] * x[i] + y[i] * y[i]) * per_squared
            room = min(1.0 - squared, squared - inner) if inner > 0.0 else 1.0 - squared
            # Written so that a ray that has become NaN counts as blocked.
            comes, falls = label[i] == unknown, not alive[i] > 0.0
            clearance[i] = room if comes & (room < clearance[i]) else clearance[i]
            label[i] = base + k if comes & falls & is_round else label[i]
        if not is_round:
            for i in range(size):
                if label[i] == unknown:
                    side, room = _straight_edge(table[k], x[i], y[i])
                    clearance[i] = min(clearance[i], room)
                    if not alive[i] > 0.0:
                        label[i] = base + k + _STRAIGHT * side


@kernel
def integrate(camera, planes, positions, lens, owner, points, measure, moments, whole):
    """Sum moments on two planes of each position over nodes of a quadrature.

    Sums do not depend on what else is in a packet: rays of one position follow each other from its first on.

    Parameters
    ----------
    planes : (n, 2, 4, 3) float64
    camera, owner, points : tuple, (m,) int64, (m, 2) float64
        As in `probe`.
    measure : (m,) float64
        Area that each node stands for [mm^2].
    moments : (n, COLUMNS) float64
        Written where a position has nodes, but for the free weight.
    whole : (n,) bool
        Written: every node passes.
    """
    optics, table, lenses, _, mosaic = camera
    packet, start_x, start_y = new_packet(), np.empty(PACKET), np.empty(PACKET)
    alive, weight, crossing = packet[6], packet[8], np.empty((4, PACKET))
    sums, total, pivot = np.zeros((REPLICAS, 5)), np.zeros(10), np.zeros(4)
    started, first = False, 0
    while first < owner.shape[0]:
        size = _several(owner, first)
        part = slice(first, first + size)
        _set_rays(positions, owner[part], points[part], start_x, start_y, packet)
        send_mixed(table, optics, lenses, mosaic, lens, owner[part], start_x, start_y, size, packet)
        begin = 0
        while begin < size:
            here, n = first + begin, owner[first + begin]
            end = begin + _stretch(owner[part], begin)
            if here == 0 or owner[here - 1] != n:
                clear(sums, total)
                started, whole[n] = False, True
            for i in range(begin, end):
                weight[i] *= measure[first + i]
                if not alive[i] > 0.0:
                    whole[n] = False
            cross_packet(planes[n, 0], planes[n, 1], packet, begin, end, crossing)
            started = started or set_pivot(crossing, alive, begin, end, pivot)
            if started:
                accumulate(crossing, weight, alive, begin, end, pivot, sums[0], total)
            following = first + end
            if started and (following == owner.shape[0] or owner[following] != n):
                finish(sums, total, pivot, 1.0, moments[n])
            begin = end
        first += size


@kernel
def hits(camera, planes, positions, lens, owner, points, hit):
    """Trace the ray through each point to the plane of its position.

    Parameters
    ----------
    planes : (n, 4, 3) float64
    camera, owner, points : tuple, (m,) int64, (m, 2) float64
        As in `probe`.
    hit : (m, 4) float64
        Written: coordinates on the plane, weight per area of the sampling plane, and 1 for a ray that passes, else 0.
    """
    optics, table, lenses, _, mosaic = camera
    packet, start_x, start_y = new_packet(), np.empty(PACKET), np.empty(PACKET)
    x, y, z, dx, dy, dz, alive, _, weight = packet
    for first in range(0, owner.shape[0], PACKET):
        size = min(PACKET, owner.shape[0] - first)
        part = slice(first, first + size)
        _set_rays(positions, owner[part], points[part], start_x, start_y, packet)
        send_mixed(table, optics, lenses, mosaic, lens, owner[part], start_x, start_y, size, packet)
        for i in range(size):
            plane = planes[owner[first + i]]
            hit[first + i, 0], hit[first + i, 1] = cross(plane, x[i], y[i], z[i], dx[i], dy[i], dz[i])
            hit[first + i, 2] = weight[i]
            hit[first + i, 3] = 1.0 if alive[i] > 0.0 else 0.0


@inline
def _set_rays(positions, owner, points, start_x, start_y, packet):
    """Set where the rays of a packet start, and the points that they go through."""
    for i in range(owner.shape[0]):
        start_x[i], start_y[i] = positions[owner[i], 0], positions[owner[i], 1]
        packet[0][i], packet[1][i] = points[i, 0], points[i, 1]


@inline
def _stretch(owner, first):
    """Number of rays from `first` on, at most PACKET, that start from the same position."""
    size = 1
    while size < PACKET and first + size < owner.shape[0] and owner[first + size] == owner[first]:
        size += 1
    return size


@inline
def _several(owner, first):
    """Number of rays from `first` on that fill a packet with whole stretches."""
    size = _stretch(owner, first)
    while first + size < owner.shape[0]:
        more = _stretch(owner, first + size)
        if size + more > PACKET:
            break
        size += more
    return size


@inline
def _side_of(polygon, x, y):
    """Number of the side of a polygon about the origin that a point lies farthest towards."""
    worst, found = -np.inf, 0
    for i in range(polygon.shape[0]):
        j = i + 1 if i + 1 < polygon.shape[0] else 0
        ex, ey = polygon[j, 0] - polygon[i, 0], polygon[j, 1] - polygon[i, 1]
        reach = (ey * x - ex * y) / (ey * polygon[i, 0] - ex * polygon[i, 1])
        if reach > worst:
            worst, found = reach, i
    return found


@inline
def _straight_edge(row, x, y):
    """Number, from 1, of the straight edge of an aperture that a point lies farthest beyond, 0: of none; and how far
    inside of the nearest edge the point lies, in semi-diameters.
    """
    worst, found, nearest = 0.0, 0, -math.inf
    for j in range(int(row[EDGES])):
        first = int(row[FIRST_EDGE]) + 3 * j
        beyond = row[first] * x + row[first + 1] * y - row[first + 2]
        nearest = max(nearest, beyond)
        if beyond > worst:
            worst, found = beyond, j + 1
    return found, -nearest / math.sqrt(row[SEMI_DIAMETER_SQUARED])
