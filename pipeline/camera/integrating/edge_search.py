"""Search of the edge of what passes, from inner points of bundles, by real rays. Kernels only; vision frame, mm.

Unlike the searches of `camera.boundary`, this one asks of a ray not only whether it passes but by what clearance, and
interpolates: to 3e-8 of a way behind a double Gauss it takes 7 rays where halving takes 25. Method `direct` spends most
of its time here. So the loop is a kernel, too, in which new ways take the places of those that are found.
"""

import math
from typing import NamedTuple

import numpy as np

from pipeline.camera.integrating.label_kernels import PASSES, Labels, label_packet
from pipeline.camera.tracing.records import SensorPoints
from pipeline.camera.tracing.sampling_bounds import SHORTEST_EDGE_MM
from pipeline.jit.decorators import inline, kernel
from pipeline.optics.kernels import PACKET, new_packet

LOW, HIGH, INNER, OUTER, HERE, ROOM = range(6)
"""Rows of a search: between which shares of the way the edge lies, the clearance at both, the share that is tried, and
how far apart the bounds may stay."""
_TRUNCATION, _SLACK = 0.05, 4.0
"""A search steps beyond its estimate by this share of the squared width, and may lag one halving behind bisection."""

_KNOWN = 64
"""Angles whose cosines are kept: ways from different points often have the same."""


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
    """Search the edge of what passes along directions from inner points; returns the number of rays.

    Packets are filled with as many directions as fit; a new one takes the place of one that is found.

    `camera`, `positions`, `microlens`: as in `probes.probe`.
    `centres`: (n, 2) float64, inner points.
    `steps`: the radius errs by less than 2^-(steps + 1) of the way to the bound.
    `radius`, `label`: (m,) float64, (m,) int64, written: where light ends, and what ends it; the bound itself, and no
        label, where a ray passes there.
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
        for i in range(size - 1, -1, -1):
            passes = blocker[i] == PASSES
            is_done = passes and search[HERE, i] == 1.0
            if is_done:
                radius[way[i]] = limit[way[i]]
            else:
                blockers[i] = blockers[i] if passes else blocker[i]
                is_done = _narrowed(search[:, i], passes, clearance[i], narrow)
                if is_done:
                    radius[way[i]], label[way[i]] = limit[way[i]] * search[HERE, i], blockers[i]
            if is_done:
                size -= 1
                way[i], blockers[i] = way[size], blockers[size]
                along[0, i], along[1, i] = along[0, size], along[1, size]
                for k in range(search.shape[0]):
                    search[k, i] = search[k, size]


@inline
def _narrowed(search, passes, clearance, narrow):
    """Take in a ray and choose the next; whether the bounds are so close that the choice is the edge.

    The root of the clearance by interpolation, truncation and projection: nearly as few rays as the secant method on
    smooth edges, three more than bisection at worst (Oliveira and Takahashi, ACM Trans. Math. Softw. 47, 2021, 5).
    Where the clearance says nothing the bounds are halved.
    """
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
