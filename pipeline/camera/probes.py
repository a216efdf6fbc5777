"""Single rays through given points of the sampling plane: what passes, what blocks the rest, and sums over nodes.

Kernels only; vision frame, mm. Rays come sorted by the sensor position (`owner`) that they start from.
"""

import math

import numpy as np

from pipeline.camera.camera import REPLICAS
from pipeline.camera.elements import DISC, KIND, MODEL, PLAIN, free_weight, towards_microlens
from pipeline.camera.moments import accumulate, cross, cross_packet, finish, set_pivot
from pipeline.camera.packets import send_packet
from pipeline.camera.polygon import fan, point_in_fan
from pipeline.camera.regions import SHORTEST_EDGE_MM, SKIP, bound, new_region
from pipeline.jit import inline, kernel
from pipeline.optics.kernels import PACKET, new_packet, trace_packet
from pipeline.optics.table import EDGES, FIRST_EDGE

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
            polygons[n, :count] = region[0][:count]


@kernel
def spread(polygons, counts, points):
    """Fill polygons evenly with points (n, m, 2), written."""
    cumulative = np.empty(polygons.shape[1])
    for n in range(points.shape[0]):
        cx, cy, _ = fan(polygons[n], counts[n], cumulative)
        for i in range(points.shape[1]):
            u, v = (0.5 + _GOLDEN_U * i) % 1.0, (0.5 + _GOLDEN_V * i) % 1.0
            points[n, i] = point_in_fan(polygons[n], counts[n], cumulative, cx, cy, u, v)


@kernel
def reach(polygons, counts, centres, owner, angle, limit, side):
    """Distance from inner points to convex polygons in given directions, and the number of the edge that is met.

    Edges of no length are passed over: rounding turns them anywhere, also across the polygon.
    """
    for f in range(owner.shape[0]):
        n, c, s = owner[f], math.cos(angle[f]), math.sin(angle[f])
        limit[f] = np.inf
        for i in range(counts[n]):
            j = i + 1 if i + 1 < counts[n] else 0
            ex, ey = polygons[n, j, 0] - polygons[n, i, 0], polygons[n, j, 1] - polygons[n, i, 1]
            across = c * ey - s * ex
            if across > 0.0 and ex * ex + ey * ey > SHORTEST_EDGE_MM * SHORTEST_EDGE_MM:
                px, py = polygons[n, i, 0] - centres[n, 0], polygons[n, i, 1] - centres[n, 1]
                distance = (px * ey - py * ex) / across
                if distance < limit[f]:
                    limit[f], side[f] = distance, i


@kernel
def probe(optics, table, lenses, aperture, mosaic, positions, lens, owner, points, label):
    """Trace one ray through each point and say what blocks it.

    Parameters
    ----------
    owner : (m,) int64
        Sensor position that a ray starts from, ascending.
    points : (m, 2) float64
        On the sampling plane.
    label : (m,) int64
        Written: PASSES, or the row of the blocking surface, with a number for each straight edge of its aperture; the
        number of rows stands for the pixel's acceptance and plain microlenses, numbers above it for faces of others.
    """
    packet, start_x, start_y = new_packet(), np.empty(PACKET), np.empty(PACKET)
    x, y, blocker = packet[0], packet[1], np.empty(PACKET, np.int64)
    first = 0
    while first < owner.shape[0]:
        n, size = owner[first], _stretch(owner, first)
        start_x[:size], start_y[:size] = positions[n, 0], positions[n, 1]
        for i in range(size):
            x[i], y[i] = points[first + i]
        what_blocks(table, optics, lenses, mosaic, lens[n], start_x, start_y, size, packet, blocker)
        for i in range(size):
            label[first + i] = blocker[i]
            if (
                lens[n] >= 0
                and blocker[i] == table.shape[0]
                and mosaic[0][MODEL] == PLAIN
                and not mosaic[0][DISC] > 0.0
            ):
                label[first + i] += _STRAIGHT * (1 + _side_of(aperture, points[first + i] - lenses[lens[n], :2]))
        if lens[n] >= 0 and mosaic[0][MODEL] != PLAIN:
            for i in range(size):
                x[i], y[i] = points[first + i]
            towards_microlens(optics, lenses, mosaic[0], lens[n], start_x, start_y, size, packet)
            faces = mosaic[1][int(lenses[lens[n], KIND])]
            _label_surfaces(faces, table.shape[0] + 1, table.shape[0], packet, size, label[first : first + size])
        first += size


@inline
def what_blocks(table, optics, lenses, mosaic, lens, start_x, start_y, size, packet, blocker):
    """Send rays from sensor positions through points that x and y of the packet hold, and say what blocks each.

    Written: PASSES; the row of the blocking surface, with a number for each straight edge of its aperture; or the
    number of rows for the microlens and the pixel's acceptance.
    """
    alive = packet[6]
    send_packet(table[:0], optics, lenses, mosaic, lens, start_x, start_y, size, packet)
    for i in range(size):
        blocker[i] = PASSES if alive[i] > 0.0 else table.shape[0]
    _label_surfaces(table, 0, PASSES, packet, size, blocker)


@inline
def _label_surfaces(table, base, unknown, packet, size, label):
    """Trace a packet surface by surface and name what blocks the rays whose label is still `unknown`."""
    x, y, z, dx, dy, dz, alive, scratch, _ = packet
    for k in range(table.shape[0]):
        trace_packet(table[k : k + 1], x, y, z, dx, dy, dz, alive, scratch, size)
        for i in range(size):
            # Written so that a ray that has become NaN counts as blocked.
            if not alive[i] > 0.0 and label[i] == unknown:
                label[i] = base + k + _STRAIGHT * _straight_edge(table[k], x[i], y[i])


@kernel
def integrate(optics, table, lenses, mosaic, planes, positions, lens, owner, points, measure, moments, whole):
    """Sum moments on two planes of each position over nodes of a quadrature.

    Parameters
    ----------
    planes : (n, 2, 4, 3) float64
    owner, points : (m,) int64, (m, 2) float64
        As in `probe`.
    measure : (m,) float64
        Area that each node stands for [mm^2].
    moments : (n, COLUMNS) float64
        Written where a position has nodes, but for the free weight.
    whole : (n,) bool
        Written: every node passes.
    """
    packet, start_x, start_y = new_packet(), np.empty(PACKET), np.empty(PACKET)
    x, y, alive, weight = packet[0], packet[1], packet[6], packet[8]
    crossing, sums, total, pivot = np.empty((4, PACKET)), np.zeros((REPLICAS, 5)), np.zeros(10), np.zeros(4)
    started, first = False, 0
    while first < owner.shape[0]:
        n, size = owner[first], _stretch(owner, first)
        if first == 0 or owner[first - 1] != n:
            sums[:], total[:], started, whole[n] = 0.0, 0.0, False, True
        start_x[:size], start_y[:size] = positions[n, 0], positions[n, 1]
        for i in range(size):
            x[i], y[i] = points[first + i]
        send_packet(table, optics, lenses, mosaic, lens[n], start_x, start_y, size, packet)
        for i in range(size):
            weight[i] *= measure[first + i]
            if not alive[i] > 0.0:
                whole[n] = False
        cross_packet(planes[n, 0], planes[n, 1], packet, size, crossing)
        if not started:
            started = set_pivot(crossing, alive, size, pivot)
        if started:
            accumulate(crossing, weight, alive, size, pivot, sums[0], total)
        first += size
        if started and (first == owner.shape[0] or owner[first] != n):
            finish(sums, total, pivot, 1.0, moments[n])


@kernel
def hits(optics, table, lenses, mosaic, planes, positions, lens, owner, points, hit):
    """Trace the ray through each point to the plane of its position.

    Parameters
    ----------
    planes : (n, 4, 3) float64
    owner, points : (m,) int64, (m, 2) float64
        As in `probe`.
    hit : (m, 4) float64
        Written: coordinates on the plane, weight per area of the sampling plane, and 1 for a ray that passes, else 0.
    """
    packet, start_x, start_y = new_packet(), np.empty(PACKET), np.empty(PACKET)
    x, y, z, dx, dy, dz, alive, _, weight = packet
    first = 0
    while first < owner.shape[0]:
        n, size = owner[first], _stretch(owner, first)
        start_x[:size], start_y[:size] = positions[n, 0], positions[n, 1]
        for i in range(size):
            x[i], y[i] = points[first + i]
        send_packet(table, optics, lenses, mosaic, lens[n], start_x, start_y, size, packet)
        for i in range(size):
            hit[first + i, 0], hit[first + i, 1] = cross(planes[n], x[i], y[i], z[i], dx[i], dy[i], dz[i])
            hit[first + i, 2] = weight[i]
            hit[first + i, 3] = 1.0 if alive[i] > 0.0 else 0.0
        first += size


@inline
def _stretch(owner, first):
    """Number of rays from `first` on, at most PACKET, that start from the same position."""
    size = 1
    while size < PACKET and first + size < owner.shape[0] and owner[first + size] == owner[first]:
        size += 1
    return size


@inline
def _side_of(polygon, point):
    """Number of the side of a polygon about the origin that a point lies farthest towards."""
    worst, found = -np.inf, 0
    for i in range(polygon.shape[0]):
        j = i + 1 if i + 1 < polygon.shape[0] else 0
        ex, ey = polygon[j, 0] - polygon[i, 0], polygon[j, 1] - polygon[i, 1]
        reach = (ey * point[0] - ex * point[1]) / (ey * polygon[i, 0] - ex * polygon[i, 1])
        if reach > worst:
            worst, found = reach, i
    return found


@inline
def _straight_edge(row, x, y):
    """Number, from 1, of the straight edge of a surface's aperture that a point lies farthest beyond; 0: of none."""
    worst, found = 0.0, 0
    for j in range(int(row[EDGES])):
        first = int(row[FIRST_EDGE]) + 3 * j
        beyond = row[first] * x + row[first + 1] * y - row[first + 2]
        if beyond > worst:
            worst, found = beyond, j + 1
    return found
