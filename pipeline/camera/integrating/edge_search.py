"""Root search for the boundary of a bundle along directions from interior points, and the obstacles beyond it.

Along a direction the clearance g(r) of the ray at radius r is its least distance from the edge of any aperture,
positive inside; the boundary is the root g(r) = 0. Unlike the bisections of `camera.boundary`, this search interpolates
g (ITP: interpolate, truncate, project): behind a double Gauss it takes 7 rays to 3e-8 of the radius where bisection
takes 25. Method `direct` spends most of its time here, so the loop is a kernel, too, and new directions replace those
that have converged.

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
"""Label of a ray that leaves the camera; other labels name its obstacle."""
_STRAIGHT = 1 << 10
"""Step of labels from one straight edge of an aperture to the next: no lens has a thousand surfaces."""
LOW, HIGH, INNER, OUTER, TRIAL, LAG = range(6)
"""State of a search: fractions of the radius that bracket the boundary, the clearance at both, the fraction on trial,
and the width up to which the bracket may lag behind bisection."""
_TRUNCATION, _SLACK = 0.05, 4.0
"""Truncation of a step, in squared widths, and initial width of the projection: a search lags at most one halving
behind bisection."""
_KEPT_ANGLES = 64
"""Angles whose cosines are kept: directions from different points often share them."""


class Labels(NamedTuple):
    """Obstacles of the rays of a packet, and their clearance, (PACKET,) each."""

    label: np.ndarray
    clearance: np.ndarray


@opaque
def label_packet(camera, microlens, owner, points, start, size, packet, labels):
    """Send rays through the points held in x and y of the packet, and label the obstacle and the clearance of each.

    Labels: PASSES, or the row of the blocking surface plus a multiple of _STRAIGHT for a straight edge of its aperture.
    The number of rows represents the pixel's acceptance and plain microlenses, higher numbers faces of other
    microlenses. The clearance is positive inside of all apertures and negative beyond the blocking one, relative to
    their size; its sign is wrong if something else blocks.
    """
    microlenses, elements, label, clearance = camera.microlenses, camera.elements, labels.label, labels.clearance
    alive = packet.alive
    rows = camera.table.shape[0]
    is_behind, is_plain = microlens[owner[0]] >= 0, elements.model == PLAIN
    for i in range(size):
        label[i], clearance[i] = PASSES, 1.0
    # Label the rays that the faces of microlenses block.
    if is_behind and not is_plain:
        _label_faces(camera, microlens, owner, start, size, packet, labels)
        for i in range(size):
            packet.x[i], packet.y[i] = points[i, 0], points[i, 1]
    # Start the rays on the sensor, and label those that miss the pixel's acceptance or a plain microlens.
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
    # Label the rays that the main lens blocks.
    label_surfaces(camera.table, 0, packet, size, labels)


@opaque
def _label_faces(camera, microlens, owner, start, size, packet, labels):
    """Label the rays that faces of microlenses block, and leave the packet there."""
    x, y, z, dx, dy, dz, alive, scratch, weight = packet
    first = 0
    while first < size:
        end, n = first + 1, microlens[owner[first]]
        while end < size and microlens[owner[end]] == n:
            end += 1
        span = slice(first, end)
        part = Packet(x[span], y[span], z[span], dx[span], dy[span], dz[span], alive[span], scratch, weight[span])
        towards_microlens(camera, n, SensorPoints(start.x[span], start.y[span]), end - first, part)
        faces = camera.elements.faces[int(camera.microlenses[n, KIND])]
        part_labels = Labels(labels.label[span], labels.clearance[span])
        label_surfaces(faces, camera.table.shape[0] + 1, part, end - first, part_labels)
        first = end


@opaque
def label_surfaces(table, base, packet, size, labels):
    """Trace a packet surface by surface and label, from `base` on, the obstacle of rays not blocked before."""
    x, y, alive, label, clearance = packet.x, packet.y, packet.alive, labels.label, labels.clearance
    for k in range(table.shape[0]):
        trace_packet(table[k : k + 1], packet, size)
        per_squared = 1.0 / table[k, SEMI_DIAMETER_SQUARED]
        is_round = not table[k, EDGES] > 0.0
        inner = table[k, INNER_SQUARED] * per_squared
        for i in range(size):
            squared = (x[i] * x[i] + y[i] * y[i]) * per_squared
            at_surface = min(1.0 - squared, squared - inner) if inner > 0.0 else 1.0 - squared
            # Written so that a ray that has become NaN counts as blocked.
            arrives, is_blocked = label[i] == PASSES, not alive[i] > 0.0
            clearance[i] = at_surface if arrives & (at_surface < clearance[i]) else clearance[i]
            label[i] = base + k if arrives & is_blocked & is_round else label[i]
        if not is_round:
            is_displaced = table[k, POSE] > 0.0
            for i in range(size):
                if label[i] == PASSES:
                    px, py = x[i], y[i]
                    if is_displaced:  # edges are stated for the centred position of the surface
                        undisplaced = entered(motion_of_row(table[k], POSE), ray_of(packet, i))
                        px, py = undisplaced.x, undisplaced.y
                    side, from_edge = _straight_edge(table[k], px, py)
                    clearance[i] = min(clearance[i], from_edge)
                    if not alive[i] > 0.0:
                        label[i] = base + k + _STRAIGHT * side


@inline
def _side_of(polygon, x, y):
    """Number of the side through which the ray from the origin to a point leaves a polygon about the origin."""
    farthest, side = -np.inf, 0
    for i in range(polygon.shape[0]):
        j = i + 1 if i + 1 < polygon.shape[0] else 0
        ex, ey = polygon[j, 0] - polygon[i, 0], polygon[j, 1] - polygon[i, 1]
        # Distance of the point along the normal of the side, over that of the side.
        reach = (ey * x - ex * y) / (ey * polygon[i, 0] - ex * polygon[i, 1])
        if reach > farthest:
            farthest, side = reach, i
    return side


@inline
def _straight_edge(row, x, y):
    """Number of the straight edge beyond which a point lies farthest, from 1, 0: none, and its clearance.

    The clearance from the nearest edge is in semi-diameters, positive inside.
    """
    worst = 0.0
    edge = 0
    nearest = -math.inf
    for j in range(int(row[EDGES])):
        first = int(row[FIRST_EDGE]) + 3 * j
        beyond = row[first] * x + row[first + 1] * y - row[first + 2]
        nearest = max(nearest, beyond)
        if beyond > worst:
            worst, edge = beyond, j + 1
    return edge, -nearest / math.sqrt(row[SEMI_DIAMETER_SQUARED])


class Spokes(NamedTuple):
    """Directions from interior points of bundles."""

    owner: np.ndarray  # (m,) int64, the bundle of each, ascending
    angle: np.ndarray  # (m,) float64, direction [rad]
    polygon_radius: np.ndarray  # (m,) float64, radius of the bounding polygon, from `reach` [mm]
    along: np.ndarray  # (2, m) float64, cosine and sine of the angle, from `reach`


@kernel
def reach(polygons, counts, centres, spokes, side):
    """Write the radius of convex polygons along directions from interior points, and the number of the edge met, (m,).

    Edges of zero length are skipped: rounding gives them any direction, also one across the polygon.
    """
    owner, angle, polygon_radius, along = spokes
    kept = np.full((3, _KEPT_ANGLES), np.nan)
    first = 0
    while first < owner.shape[0]:
        # Take the directions of one bundle, from `first` to `end`.
        n, end = owner[first], first
        while end < owner.shape[0] and owner[end] == n:
            _direction(angle, end, end - first, kept, along)
            polygon_radius[end], end = np.inf, end + 1
        # Cut each by the lines of all edges: the nearest cut ahead is the boundary of a convex polygon.
        for i in range(counts[n]):
            j = i + 1 if i + 1 < counts[n] else 0
            ex, ey = polygons[n, j, 0] - polygons[n, i, 0], polygons[n, j, 1] - polygons[n, i, 1]
            if ex * ex + ey * ey > SHORTEST_EDGE_MM * SHORTEST_EDGE_MM:
                px, py = polygons[n, i, 0] - centres[n, 0], polygons[n, i, 1] - centres[n, 1]
                for f in range(first, end):
                    across = along[0, f] * ey - along[1, f] * ex
                    distance = (px * ey - py * ex) / across
                    nearer = (across > 0.0) & (distance < polygon_radius[f])
                    polygon_radius[f], side[f] = distance if nearer else polygon_radius[f], i if nearer else side[f]
        first = end


@inline
def _direction(angle, f, number, kept, along):
    """Write cosine and sine of a direction, mostly kept from the one with this number at the interior point before."""
    k = number % _KEPT_ANGLES
    if kept[0, k] != angle[f]:
        kept[0, k], kept[1, k], kept[2, k] = angle[f], math.cos(angle[f]), math.sin(angle[f])
    along[0, f], along[1, f] = kept[1, k], kept[2, k]


@kernel
def find_edges(camera, positions, microlens, centres, spokes, steps, radius, label):
    """Search the boundary along directions from interior points (n, 2); returns the number of rays.

    Packets are filled with as many directions as fit; new ones follow when some have converged.
    `steps`: the radius errs by less than 2^-(steps + 1) of the bounding radius.
    `radius`, `label`: (m,), written: where light ends, and its obstacle; the bounding radius itself, and no label,
    where a ray passes there.
    """
    owner, _, polygon_radius, along_spoke = spokes
    packet = new_packet()
    x, y = packet.x, packet.y
    start_x, start_y = np.empty(PACKET), np.empty(PACKET)
    start = SensorPoints(start_x, start_y)
    # Of each ray of the packet: its direction and bundle, the point on trial, the state of the search, the obstacle of
    # the ray on trial, and that of the last blocked one.
    spoke, bundle = np.empty(PACKET, np.int64), np.empty(PACKET, np.int64)
    points, search = np.empty((PACKET, 2)), np.empty((6, PACKET))
    blocker, clearance = np.empty(PACKET, np.int64), np.empty(PACKET)
    labels = Labels(blocker, clearance)
    along, blockers = np.empty((2, PACKET)), np.empty(PACKET, np.int64)
    size, next_spoke, rays = 0, 0, 0
    narrow = 0.5 ** (steps + 1)
    while True:
        # Fill the packet with new directions.
        while size < PACKET and next_spoke < owner.shape[0]:
            spoke[size] = next_spoke
            along[0, size], along[1, size] = along_spoke[0, next_spoke], along_spoke[1, next_spoke]
            search[LOW, size], search[HIGH, size] = 0.0, 1.0
            search[INNER, size], search[OUTER, size] = 1.0, -1.0
            search[TRIAL, size] = 1.0
            search[LAG, size] = _SLACK
            next_spoke += 1
            size += 1
        if size == 0:
            return rays
        # Trace the ray on trial in each direction.
        for i in range(size):
            f = spoke[i]
            n = owner[f]
            radius_on_trial = polygon_radius[f] * search[TRIAL, i]
            bundle[i] = n
            start_x[i], start_y[i] = positions[n, 0], positions[n, 1]
            points[i, 0] = centres[n, 0] + radius_on_trial * along[0, i]
            points[i, 1] = centres[n, 1] + radius_on_trial * along[1, i]
            x[i], y[i] = points[i, 0], points[i, 1]
        label_packet(camera, microlens, bundle[:size], points, start, size, packet, labels)
        rays += size
        # Narrow the brackets, write the boundaries that have converged, and keep the rest.
        kept = 0
        for i in range(size):
            passes = blocker[i] == PASSES
            is_done = passes and search[TRIAL, i] == 1.0
            if is_done:
                radius[spoke[i]] = polygon_radius[spoke[i]]
            else:
                blockers[i] = blockers[i] if passes else blocker[i]
                is_done = _narrowed(search[:, i], passes, clearance[i], narrow)
                if is_done:
                    radius[spoke[i]], label[spoke[i]] = polygon_radius[spoke[i]] * search[TRIAL, i], blockers[i]
            if not is_done:  # in their order: rays behind one microlens stay side by side
                spoke[kept], blockers[kept] = spoke[i], blockers[i]
                along[0, kept], along[1, kept] = along[0, i], along[1, i]
                for k in range(search.shape[0]):
                    search[k, kept] = search[k, i]
                kept += 1
        size = kept


@inline
def _narrowed(search, passes, clearance, narrow):
    """Take in the ray on trial and choose the next; whether the bracket is so narrow that this is the boundary."""
    # ITP: interpolate, truncate, project. Nearly as few rays as the secant method on smooth edges, three more than
    # bisection at worst (Oliveira and Takahashi, ACM Trans. Math. Softw. 47, 2021, 5). Without a clearance of the right
    # sign the step is a bisection.
    # Convert the clearance from an area to a length, which is about linear along the radius.
    along_radius = 1.0 - math.sqrt(max(1.0 - clearance, 0.0))
    # Move the end of the bracket on the ray's side.
    if passes:
        search[LOW] = search[TRIAL]
        search[INNER] = along_radius if along_radius > 0.0 else -search[OUTER]
    elif search[TRIAL] > 0.0:
        search[HIGH] = search[TRIAL]
        search[OUTER] = along_radius if along_radius < 0.0 else -search[INNER]
        if search[HIGH] == 1.0:
            search[TRIAL] = 0.0  # the inner point itself
            return False
    low, high, inner, outer = search[LOW], search[HIGH], search[INNER], search[OUTER]
    width, middle = high - low, 0.5 * (low + high)
    # Interpolate: the secant's estimate of the boundary.
    crossing = low + width * inner / (inner - outer)
    if width <= narrow:
        search[TRIAL] = crossing
        return True
    # Truncate: step beyond the estimate towards the middle, by at least a quarter of the final width, so that both ends
    # soon close in.
    to_middle = middle - crossing
    cut = max(_TRUNCATION * width * width, 0.25 * narrow)
    truncated = crossing + math.copysign(cut, to_middle) if cut <= abs(to_middle) else middle
    # Project: stay near enough to the middle that the bracket lags at most so far behind bisection.
    search[LAG] *= 0.5
    allowed = max(search[LAG] - 0.5 * width, 0.0)
    is_near = abs(truncated - middle) <= allowed
    search[TRIAL] = truncated if is_near else middle - math.copysign(allowed, to_middle)
    return False
