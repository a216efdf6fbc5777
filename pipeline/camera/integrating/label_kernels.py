"""Obstacles of single rays: which surface of the lens, edge or face of a microlens blocks each, and how narrowly.

Kernels only; vision frame, mm. `camera` is a `camera.tracing.records.CameraArrays`.
"""

import math
from typing import NamedTuple

import numpy as np

from pipeline.camera.tracing.microlens_kernels import KIND, PLAIN, X, Y, towards_microlens
from pipeline.camera.tracing.packets import aim_mixed
from pipeline.camera.tracing.records import SensorPoints
from pipeline.jit.decorators import inline, unit
from pipeline.optics.kernels import Packet, trace_packet
from pipeline.optics.table import EDGES, FIRST_EDGE, INNER_SQUARED, SEMI_DIAMETER_SQUARED

PASSES = -1
"""Label of a ray that leaves the camera; other labels name what blocks it."""
_STRAIGHT = 1 << 10
"""Step of labels from one straight edge of an aperture to the next; below it they count surfaces, and no lens has a
thousand."""


class Labels(NamedTuple):
    """Obstacles of the rays of a packet, and distances from all edges at which they pass, (PACKET,) each."""

    label: np.ndarray
    clearance: np.ndarray


@unit
def label_packet(camera, microlens, owner, points, start, size, packet, labels):
    """Send rays through points that x and y of the packet hold, and say what blocks each, and how far from an edge.

    Written: PASSES, or the row of the blocking surface, with a number for each straight edge of its aperture; the
    number of rows stands for the pixel's acceptance and plain microlenses, numbers above it for faces of others.
    The clearance is positive inside of all apertures and negative beyond that which blocks, in shares of them; its sign
    is wrong where something else blocks.
    """
    microlenses, table, label = camera.microlenses, camera.table, labels.label
    alive, rows = packet.alive, table.shape[0]
    aim_mixed(camera, microlens, owner, start, size, packet)
    for i in range(size):
        label[i] = PASSES if alive[i] > 0.0 else rows
        labels.clearance[i] = 1.0
    label_surfaces(table, 0, PASSES, packet, size, labels)
    if microlens[owner[0]] < 0:
        return
    if camera.elements.model != PLAIN:
        _label_faces(camera, microlens, owner, points, start, size, packet, label)
    elif not camera.elements.disc_mm > 0.0:
        for i in range(size):
            if label[i] == rows:
                n = microlens[owner[i]]
                side = _side_of(camera.aperture, points[i, 0] - microlenses[n, X], points[i, 1] - microlenses[n, Y])
                label[i] += _STRAIGHT * (1 + side)


@inline
def _label_faces(camera, microlens, owner, points, start, size, packet, label):
    """Say which face of its microlens blocks a ray that does not reach the main lens; weights are lost."""
    x, y, z, dx, dy, dz, alive, scratch, weight = packet
    first = 0
    while first < size:
        end, n = first + 1, microlens[owner[first]]
        while end < size and microlens[owner[end]] == n:
            end += 1
        here = slice(first, end)
        for i in range(first, end):
            x[i], y[i] = points[i, 0], points[i, 1]
        part = Packet(x[here], y[here], z[here], dx[here], dy[here], dz[here], alive[here], scratch, weight[here])
        towards_microlens(camera, n, SensorPoints(start.x[here], start.y[here]), end - first, part)
        faces, rows = camera.elements.faces[int(camera.microlenses[n, KIND])], camera.table.shape[0]
        labels = Labels(label[here], weight[here])  # a clearance nobody wants
        label_surfaces(faces, rows + 1, rows, part, end - first, labels)
        first = end


@unit
def label_surfaces(table, base, unknown, packet, size, labels):
    """Trace a packet surface by surface and name what blocks the rays whose label is still `unknown`."""
    x, y, alive, label, clearance = packet.x, packet.y, packet.alive, labels.label, labels.clearance
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
