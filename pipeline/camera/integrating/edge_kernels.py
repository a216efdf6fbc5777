"""Single rays through given points of the sampling plane: their obstacles, and sums of moments over quadrature nodes.

A bundle's moment is the integral of weight times crossing over the region within its boundary, in polar coordinates
about an interior point: sum over directions and radial nodes of w r dr dphi, with Gauss-Legendre nodes along the
radius.

Kernels only; vision frame, mm. `camera` is a `camera.tracing.records.CameraArrays`. Rays come sorted by the sensor
position (`owner`) from which they start; `microlens` is that of each position.
"""

from typing import NamedTuple

import numpy as np

from pipeline.camera.integrating.edge_search import PASSES, Labels, label_packet
from pipeline.camera.parts.camera import REPLICAS
from pipeline.camera.parts.polygon import fan, point_in_fan
from pipeline.camera.tracing.microlens_kernels import free_weight
from pipeline.camera.tracing.moments import accumulate, clear, cross, cross_packet, finish, set_pivot
from pipeline.camera.tracing.packets import send_mixed
from pipeline.camera.tracing.records import SensorPoints
from pipeline.camera.tracing.sampling_bounds import SKIP, bound, new_region
from pipeline.jit.decorators import inline, kernel
from pipeline.optics.kernels import PACKET, new_packet

_GOLDEN_U, _GOLDEN_V = 0.7548776662466927, 0.5698402909980532
"""Steps of an additive sequence that fills the unit square evenly: 1 / g and 1 / g^2 for the real root of g^3 = g + 1
(Roberts, "The unreasonable effectiveness of quasirandom sequences", 2018)."""


class Spans(NamedTuple):
    """Radii from interior points of bundles to the boundary, in pieces on which the weight is smooth."""

    centres: np.ndarray  # (n, 2) float64, interior points [mm]
    owner: np.ndarray  # (m,) int64, sensor position of each, ascending
    along: np.ndarray  # (m, 2) float64, unit vector of its direction
    angular_weight: np.ndarray  # (m,) float64, weight of the direction in an integral over the angle [rad]
    # (m, pieces) float64, pieces of the radius [mm]
    start: np.ndarray
    length: np.ndarray


class Rule(NamedTuple):
    """Nodes and weights of a quadrature on [0, 1], (k,) each."""

    node: np.ndarray
    weight: np.ndarray


class SingleHits(NamedTuple):
    """Intersections of single rays with a plane each."""

    on_plane: np.ndarray  # (m, 2) float64, coordinates on the plane [mm]
    density: np.ndarray  # (m,) float64, weight per area of the sampling plane
    passes: np.ndarray  # (m,) bool, whether the ray leaves the camera


def empty_hits(count: int) -> SingleHits:
    """Arrays for `count` rays."""
    return SingleHits(np.empty((count, 2)), np.empty(count), np.empty(count, bool))


@kernel
def bounds(camera, positions, microlens, polygons, counts, free):
    """Polygons that enclose the passing rays, and the weight of all rays through each position's own microlens [sr].

    `polygons`, `counts`, `free`: (n, MAX_VERTICES, 2) counter-clockwise, (n,), (n,), written; 0: nothing passes, or
    there is no microlens.
    """
    region = new_region()
    polygon = region.polygon
    for n in range(positions.shape[0]):
        counts[n], free[n] = 0, 0.0
        if microlens[n] == SKIP:
            continue
        x, y = positions[n]
        if microlens[n] >= 0:
            free[n] = free_weight(camera, microlens[n], x, y, polygon)
        slack = 0.0  # rays start at the position itself
        region_fan = bound(camera, microlens[n], x, y, slack, region)
        if region_fan.area > 0.0:
            counts[n] = region_fan.vertices
            for i in range(region_fan.vertices):
                polygons[n, i, 0], polygons[n, i, 1] = polygon[i, 0], polygon[i, 1]


@kernel
def spread(polygons, counts, points):
    """Write points (n, m, 2) that fill polygons evenly."""
    cumulative = np.empty(polygons.shape[1])
    for n in range(points.shape[0]):
        cx, cy, _ = fan(polygons[n], counts[n], cumulative)
        for i in range(points.shape[1]):
            u, v = (0.5 + _GOLDEN_U * i) % 1.0, (0.5 + _GOLDEN_V * i) % 1.0
            points[n, i, 0], points[n, i, 1] = point_in_fan(polygons[n], counts[n], cumulative, cx, cy, u, v)


@kernel
def probe(camera, positions, microlens, owner, points, is_named, label):
    """Trace the ray from a sensor position, `owner`, ascending, through each point of the sampling plane (m, 2).

    `label`: (m,), written: PASSES or the obstacle. Naming obstacles, see `label_packet`, costs more; otherwise their
    label is 0.
    """
    packet, start = new_packet(), SensorPoints(np.empty(PACKET), np.empty(PACKET))
    obstacle = np.empty(PACKET, np.int64)
    labels = Labels(obstacle, np.empty(PACKET))
    for first in range(0, owner.shape[0], PACKET):
        size = min(PACKET, owner.shape[0] - first)
        part = slice(first, first + size)
        _set_rays(positions, owner[part], points[part], start, packet)
        if is_named:
            label_packet(camera, microlens, owner[part], points[part], start, size, packet, labels)
        else:
            send_mixed(camera, microlens, owner[part], start, size, packet)
        for i in range(size):
            passes = PASSES if packet.alive[i] > 0.0 else 0
            label[first + i] = obstacle[i] if is_named else passes


@kernel
def integrate(camera, planes, positions, microlens, spans, rule, moments, all_pass):
    """Sum moments on two planes (n, 2, 4, 3) of each position over quadrature nodes; returns the number of nodes.

    Sums do not depend on the other rays of a packet: rays of one position follow each other from its first on.
    `spans`, `rule`: the radii, and the rule along each of their pieces.
    `moments`, `all_pass`: (n, COLUMNS), (n,), written where a position has nodes, except the free weight; whether all
    nodes pass.
    """
    # Lay out the nodes of all radii.
    most_nodes = spans.start.size * rule.node.shape[0]
    owner = np.empty(most_nodes, np.int64)
    points = np.empty((most_nodes, 2))
    area = np.empty(most_nodes)
    count = _lay_nodes(spans, rule, owner, points, area)
    owner, points, area = owner[:count], points[:count], area[:count]
    packet = new_packet()
    start = SensorPoints(np.empty(PACKET), np.empty(PACKET))
    alive, weight = packet.alive, packet.weight
    crossing = np.empty((4, PACKET))
    sums, total, pivot = np.zeros((REPLICAS, 5)), np.zeros(10), np.zeros(4)
    has_pivot = False
    first = 0
    while first < owner.shape[0]:
        # Trace a packet of complete runs, each the rays of one position.
        size = _complete_runs(owner, first)
        part = slice(first, first + size)
        _set_rays(positions, owner[part], points[part], start, packet)
        send_mixed(camera, microlens, owner[part], start, size, packet)
        # Add each run to the sums of its position, and finish those that are complete.
        begin = 0
        while begin < size:
            k, n = first + begin, owner[first + begin]
            end = begin + _run(owner[part], begin)
            if k == 0 or owner[k - 1] != n:
                clear(sums, total)
                has_pivot, all_pass[n] = False, True
            for i in range(begin, end):
                weight[i] *= area[first + i]
                if not alive[i] > 0.0:
                    all_pass[n] = False
            cross_packet(planes[n, 0], planes[n, 1], packet, begin, end, crossing)
            has_pivot = has_pivot or set_pivot(crossing, alive, begin, end, pivot)
            if has_pivot:
                accumulate(crossing, weight, alive, begin, end, pivot, sums[0], total)
            next_ray = first + end
            if has_pivot and (next_ray == owner.shape[0] or owner[next_ray] != n):
                sample_area = 1.0  # weights hold the areas of the nodes
                finish(sums, total, pivot, sample_area, moments[n])
            begin = end
        first += size
    return count


@inline
def _lay_nodes(spans, rule, owner, points, area):
    """Lay out nodes along all radii, each with its area r dr dphi [mm^2]; returns their number: pieces may be empty."""
    count = 0
    for d in range(spans.owner.shape[0]):
        n, ux, uy = spans.owner[d], spans.along[d, 0], spans.along[d, 1]
        for k in range(spans.start.shape[1]):
            start, length = spans.start[d, k], spans.length[d, k]
            dr_dphi = length * spans.angular_weight[d]
            for j in range(rule.node.shape[0]):
                r = start + length * rule.node[j]
                node_area = r * (dr_dphi * rule.weight[j])
                if node_area > 0.0:
                    owner[count], area[count] = n, node_area
                    points[count, 0] = spans.centres[n, 0] + r * ux
                    points[count, 1] = spans.centres[n, 1] + r * uy
                    count += 1
    return count


@kernel
def hits(camera, planes, positions, microlens, owner, points, hit):
    """Trace the ray through each point, as in `probe`, to the plane (n, 4, 3) of its position; writes `hit`."""
    packet, start = new_packet(), SensorPoints(np.empty(PACKET), np.empty(PACKET))
    x, y, z, dx, dy, dz, alive, _, weight = packet
    on_plane, density, passes = hit
    for first in range(0, owner.shape[0], PACKET):
        size = min(PACKET, owner.shape[0] - first)
        part = slice(first, first + size)
        _set_rays(positions, owner[part], points[part], start, packet)
        send_mixed(camera, microlens, owner[part], start, size, packet)
        for i in range(size):
            plane = planes[owner[first + i]]
            on_plane[first + i, 0], on_plane[first + i, 1] = cross(plane, x[i], y[i], z[i], dx[i], dy[i], dz[i])
            density[first + i], passes[first + i] = weight[i], alive[i] > 0.0


@inline
def _set_rays(positions, owner, points, start, packet):
    """Set the starts of the rays of a packet and the points that they pass through."""
    for i in range(owner.shape[0]):
        start.x[i], start.y[i] = positions[owner[i], 0], positions[owner[i], 1]
        packet.x[i], packet.y[i] = points[i, 0], points[i, 1]


@inline
def _run(owner, first):
    """Number of rays from `first` on, at most PACKET, that share its position."""
    size = 1
    while size < PACKET and first + size < owner.shape[0] and owner[first + size] == owner[first]:
        size += 1
    return size


@inline
def _complete_runs(owner, first):
    """Number of rays from `first` on that fill a packet with complete runs."""
    size = _run(owner, first)
    while first + size < owner.shape[0]:
        next_size = _run(owner, first + size)
        if size + next_size > PACKET:
            break
        size += next_size
    return size
