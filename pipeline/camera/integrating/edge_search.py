"""Search of the edge of what passes, from inner points of bundles, by real rays, and what blocks rays beyond it.

Unlike the searches of `camera.boundary`, this one asks of a ray not only whether it passes but by what clearance, and
interpolates: to 3e-8 of a way behind a double Gauss it takes 7 rays where halving takes 25. Method `direct` spends most
of its time here. So the loop is a kernel, too, in which new ways follow as soon as some are found.

Kernels only; vision frame, mm. `camera` is a `camera.tracing.records.CameraArrays`.
"""

import math
from typing import NamedTuple

import numpy as np

from pipeline.camera.tracing.microlens_kernels import KIND, PLAIN, X, Y, towards_microlens
from pipeline.camera.tracing.packets import aim_mixed
from pipeline.camera.tracing.records import SensorPoints
from pipeline.camera.tracing.sampling_bounds import SHORTEST_EDGE_MM
from pipeline.jit.decorators import inline, kernel, opaque
from pipeline.optics.crossing import entered, motion_of_row, ray_of
from pipeline.optics.kernels import PACKET, Packet, new_packet, trace_packet
from pipeline.optics.table import EDGES, FIRST_EDGE, INNER_SQUARED, POSE, SEMI_DIAMETER_SQUARED

PASSES = -1
"""Label of a ray that leaves the camera; other labels name what blocks it."""
_STRAIGHT = 1 << 10
"""Step of labels from one straight edge of an aperture to the next: no lens has a thousand surfaces."""
LOW, HIGH, INNER, OUTER, HERE, ROOM = range(6)
"""Rows of a search: between which shares of the way the edge lies, the clearance at both, the share that is tried, and
how far apart the bounds may stay."""
_TRUNCATION, _SLACK = 0.05, 4.0
"""A search steps beyond its estimate by this share of the squared width, and may lag one halving behind bisection."""
_KNOWN = 64
"""Angles whose cosines are kept: ways from different points often have the same."""


class Labels(NamedTuple):
    """Obstacles of the rays of a packet, and distances from all edges at which they pass, (PACKET,) each."""

    label: np.ndarray
    clearance: np.ndarray


@opaque
def label_packet(camera, microlens, owner, points, start, size, packet, labels):
    """Send rays through points that x and y of the packet hold, and say what blocks each, and how far from an edge.

    Written: PASSES, or the row of the blocking surface, with a number for each straight edge of its aperture; the
    number of rows stands for the pixel's acceptance and plain microlenses, numbers above it for faces of others.
    The clearance is positive inside of all apertures and negative beyond that which blocks, in shares of them; its sign
    is wrong where something else blocks.
    """
    microlenses, elements, label, clearance = camera.microlenses, camera.elements, labels.label, labels.clearance
    alive, rows = packet.alive, camera.table.shape[0]
    is_behind, is_plain = microlens[owner[0]] >= 0, elements.model == PLAIN
    for i in range(size):
        label[i], clearance[i] = PASSES, 1.0
    if is_behind and not is_plain:
        _label_faces(camera, microlens, owner, start, size, packet, labels)
        for i in range(size):
            packet.x[i], packet.y[i] = points[i, 0], points[i, 1]
    aim_mixed(camera, microlens, owner, start, size, packet)
    for i in range(size):
        label[i] = rows if (label[i] == PASSES) & (not alive[i] > 0.0) else label[i]
    if is_behind and is_plain:
        for i in range(size):
            n = microlens[owner[i]]
            ax, ay = points[i, 0] - microlenses[n, X], points[i, 1] - microlenses[n, Y]
            if elements.disc_mm > 0.0:
                clearance[i] = 1.0 - (ax * ax + ay * ay) / (elements.disc_mm * elements.disc_mm)
            elif label[i] == rows:
                label[i] += _STRAIGHT * (1 + _side_of(camera.aperture, ax, ay))
    label_surfaces(camera.table, 0, packet, size, labels)


@opaque
def _label_faces(camera, microlens, owner, start, size, packet, labels):
    """Label what the faces of microlenses block; the packet is left there."""
    x, y, z, dx, dy, dz, alive, scratch, weight = packet
    first = 0
    while first < size:
        end, n = first + 1, microlens[owner[first]]
        while end < size and microlens[owner[end]] == n:
            end += 1
        here = slice(first, end)
        part = Packet(x[here], y[here], z[here], dx[here], dy[here], dz[here], alive[here], scratch, weight[here])
        towards_microlens(camera, n, SensorPoints(start.x[here], start.y[here]), end - first, part)
        faces = camera.elements.faces[int(camera.microlenses[n, KIND])]
        some = Labels(labels.label[here], labels.clearance[here])
        label_surfaces(faces, camera.table.shape[0] + 1, part, end - first, some)
        first = end


@opaque
def label_surfaces(table, base, packet, size, labels):
    """Trace a packet surface by surface and name, from `base` on, what blocks rays that nothing has blocked before."""
    x, y, alive, label, clearance = packet.x, packet.y, packet.alive, labels.label, labels.clearance
    for k in range(table.shape[0]):
        trace_packet(table[k : k + 1], packet, size)
        per_squared, is_round = 1.0 / table[k, SEMI_DIAMETER_SQUARED], not table[k, EDGES] > 0.0
        inner = table[k, INNER_SQUARED] * per_squared
        for i in range(size):
            squared = (x[i] * x[i] + y[i] * y[i]) * per_squared
            room = min(1.0 - squared, squared - inner) if inner > 0.0 else 1.0 - squared
            # Written so that a ray that has become NaN counts as blocked.
            comes, falls = label[i] == PASSES, not alive[i] > 0.0
            clearance[i] = room if comes & (room < clearance[i]) else clearance[i]
            label[i] = base + k if comes & falls & is_round else label[i]
        if not is_round:
            is_posed = table[k, POSE] > 0.0
            for i in range(size):
                if label[i] == PASSES:
                    px, py = x[i], y[i]
                    if is_posed:  # edges are stated where the surface was before it was displaced
                        there = entered(motion_of_row(table[k], POSE), ray_of(packet, i))
                        px, py = there.x, there.y
                    side, room = _straight_edge(table[k], px, py)
                    clearance[i] = min(clearance[i], room)
                    if not alive[i] > 0.0:
                        label[i] = base + k + _STRAIGHT * side


@inline
def _side_of(polygon, x, y):
    """Number of the side of a polygon about the origin that a point lies farthest towards."""
    worst, side = -np.inf, 0
    for i in range(polygon.shape[0]):
        j = i + 1 if i + 1 < polygon.shape[0] else 0
        ex, ey = polygon[j, 0] - polygon[i, 0], polygon[j, 1] - polygon[i, 1]
        reach = (ey * x - ex * y) / (ey * polygon[i, 0] - ex * polygon[i, 1])
        if reach > worst:
            worst, side = reach, i
    return side


@inline
def _straight_edge(row, x, y):
    """Number, from 1, of the straight edge of an aperture that a point lies farthest beyond, 0: of none; and how far
    inside of the nearest edge the point lies, in semi-diameters.
    """
    worst, edge, nearest = 0.0, 0, -math.inf
    for j in range(int(row[EDGES])):
        first = int(row[FIRST_EDGE]) + 3 * j
        beyond = row[first] * x + row[first + 1] * y - row[first + 2]
        nearest = max(nearest, beyond)
        if beyond > worst:
            worst, edge = beyond, j + 1
    return edge, -nearest / math.sqrt(row[SEMI_DIAMETER_SQUARED])


class Spokes(NamedTuple):
    """Ways from inner points of bundles."""

    owner: np.ndarray  # (m,) int64, the bundle of each, ascending
    angle: np.ndarray  # (m,) float64, direction [rad]
    limit: np.ndarray  # (m,) float64, distance of the bound of what passes, from `reach` [mm]
    along: np.ndarray  # (2, m) float64, cosine and sine of the angle, from `reach`


@kernel
def reach(polygons, counts, centres, spokes, side):
    """Write how far it is from inner points to convex polygons, and the number of the edge that is met, (m,).

    Edges of no length are passed over: rounding turns them anywhere, also across the polygon.
    """
    owner, angle, limit, along = spokes
    known, first = np.full((3, _KNOWN), np.nan), 0
    while first < owner.shape[0]:
        n, end = owner[first], first
        while end < owner.shape[0] and owner[end] == n:
            _turn(angle, end, end - first, known, along)
            limit[end], end = np.inf, end + 1
        for i in range(counts[n]):
            j = i + 1 if i + 1 < counts[n] else 0
            ex, ey = polygons[n, j, 0] - polygons[n, i, 0], polygons[n, j, 1] - polygons[n, i, 1]
            if ex * ex + ey * ey > SHORTEST_EDGE_MM * SHORTEST_EDGE_MM:
                px, py = polygons[n, i, 0] - centres[n, 0], polygons[n, i, 1] - centres[n, 1]
                for f in range(first, end):
                    across = along[0, f] * ey - along[1, f] * ex
                    distance = (px * ey - py * ex) / across
                    nearer = (across > 0.0) & (distance < limit[f])
                    limit[f], side[f] = distance if nearer else limit[f], i if nearer else side[f]
        first = end


@inline
def _turn(angle, f, place, known, along):
    """Cosine and sine of the angle of a way: mostly those of the way at the same place from the inner point before."""
    k = place % _KNOWN
    if known[0, k] != angle[f]:
        known[0, k], known[1, k], known[2, k] = angle[f], math.cos(angle[f]), math.sin(angle[f])
    along[0, f], along[1, f] = known[1, k], known[2, k]


@kernel
def find_edges(camera, positions, microlens, centres, spokes, steps, radius, label):
    """Search the edge of what passes along directions from inner points (n, 2); returns the number of rays.

    Packets are filled with as many directions as fit; new ones follow when some are found.
    `steps`: the radius errs by less than 2^-(steps + 1) of the way to the bound.
    `radius`, `label`: (m,), written: where light ends, and what ends it; the bound itself, and no label, where a ray
        passes there.
    """
    owner, _, limit, towards = spokes
    packet, start_x, start_y = new_packet(), np.empty(PACKET), np.empty(PACKET)
    x, y, start = packet.x, packet.y, SensorPoints(start_x, start_y)
    way, at, points = np.empty(PACKET, np.int64), np.empty(PACKET, np.int64), np.empty((PACKET, 2))
    blocker, clearance, search = np.empty(PACKET, np.int64), np.empty(PACKET), np.empty((6, PACKET))
    labels = Labels(blocker, clearance)
    along, blockers = np.empty((2, PACKET)), np.empty(PACKET, np.int64)
    size, following, rays, narrow = 0, 0, 0, 0.5 ** (steps + 1)
    while True:
        while size < PACKET and following < owner.shape[0]:
            way[size], following = following, following + 1
            along[0, size], along[1, size] = towards[0, way[size]], towards[1, way[size]]
            search[LOW, size], search[HIGH, size], search[INNER, size] = 0.0, 1.0, 1.0
            search[OUTER, size], search[HERE, size], search[ROOM, size] = -1.0, 1.0, _SLACK
            size += 1
        if size == 0:
            return rays
        for i in range(size):
            f = way[i]
            n, far = owner[f], limit[f] * search[HERE, i]
            at[i], start_x[i], start_y[i] = n, positions[n, 0], positions[n, 1]
            points[i, 0], points[i, 1] = centres[n, 0] + far * along[0, i], centres[n, 1] + far * along[1, i]
            x[i], y[i] = points[i, 0], points[i, 1]
        label_packet(camera, microlens, at[:size], points, start, size, packet, labels)
        rays += size
        kept = 0
        for i in range(size):
            passes = blocker[i] == PASSES
            is_done = passes and search[HERE, i] == 1.0
            if is_done:
                radius[way[i]] = limit[way[i]]
            else:
                blockers[i] = blockers[i] if passes else blocker[i]
                is_done = _narrowed(search[:, i], passes, clearance[i], narrow)
                if is_done:
                    radius[way[i]], label[way[i]] = limit[way[i]] * search[HERE, i], blockers[i]
            if not is_done:  # in their order: rays behind one microlens stay side by side
                way[kept], blockers[kept] = way[i], blockers[i]
                along[0, kept], along[1, kept] = along[0, i], along[1, i]
                for k in range(search.shape[0]):
                    search[k, kept] = search[k, i]
                kept += 1
        size = kept


@inline
def _narrowed(search, passes, clearance, narrow):
    """Take in a ray and choose the next; whether the bounds are so close that the choice is the edge."""
    # The root of the clearance by interpolation, truncation and projection: nearly as few rays as the secant method on
    # smooth edges, three more than bisection at worst (Oliveira and Takahashi, ACM Trans. Math. Softw. 47, 2021, 5).
    # Where the clearance says nothing the bounds are halved.
    # As a length, not an area: about linear along the way.
    clearance = 1.0 - math.sqrt(max(1.0 - clearance, 0.0))
    if passes:
        search[LOW] = search[HERE]
        search[INNER] = clearance if clearance > 0.0 else -search[OUTER]
    elif search[HERE] > 0.0:
        search[HIGH] = search[HERE]
        search[OUTER] = clearance if clearance < 0.0 else -search[INNER]
        if search[HIGH] == 1.0:
            search[HERE] = 0.0  # the inner point itself
            return False
    low, high, inner, outer = search[LOW], search[HIGH], search[INNER], search[OUTER]
    width, middle = high - low, 0.5 * (low + high)
    crossing = low + width * inner / (inner - outer)
    if width <= narrow:
        search[HERE] = crossing
        return True
    search[ROOM] *= 0.5
    # A step of a quarter of what may be left: once the estimate is good, both bounds soon are.
    off, cut = middle - crossing, max(_TRUNCATION * width * width, 0.25 * narrow)
    nearer = crossing + math.copysign(cut, off) if cut <= abs(off) else middle
    most = max(search[ROOM] - 0.5 * width, 0.0)
    search[HERE] = nearer if abs(nearer - middle) <= most else middle - math.copysign(most, off)
    return False
