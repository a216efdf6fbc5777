"""Bundles: from sensor positions through one microlens each, or none, and the main lens to rays in the scene.

Vision frame, mm. A conventional camera samples the rear vertex plane, a plenoptic one the plane of its microlenses; all
else is the same code. A microlens is its row, `NO_MICROLENS`, or `SKIP`; `camera.tracing.records` names the other
arguments.
"""

import math

import numpy as np

from pipeline.camera.parts.camera import REPLICAS
from pipeline.camera.tracing.microlens_kernels import free_weight
from pipeline.camera.tracing.moments import FREE_WEIGHT, WEIGHT, accumulate, clear, cross_packet, finish, set_pivot
from pipeline.camera.tracing.packets import Anchor, aim_into, draw, region_drift, send_mixed, send_packet
from pipeline.camera.tracing.records import SensorPoints
from pipeline.camera.tracing.sampling_bounds import SKIP, bound, new_region
from pipeline.camera.tracing.sobol import hash32
from pipeline.camera.tracing.spreading import spread
from pipeline.jit.decorators import inline, kernel
from pipeline.optics.kernels import PACKET, new_packet

IMAGE_STREAM = 1 << 16
"""First stream of random numbers of images, four for each microlens of a pixel: far behind those of moments."""
START_STREAM = 2 * REPLICAS
"""First stream of where rays start on a square: behind two per replica for where they go."""
_SHARE = PACKET // REPLICAS
"""Samples of each replica in a packet."""
SPREAD_STREAM = 1 << 24
"""First stream of random numbers of diffraction, three for each microlens of a pixel: far behind all others."""
CIRCUMRADIUS = 0.7072
"""Circumradius of a square of edge 1, rounded up."""
_GAUSS = 0.28867513459481287
"""Both nodes of Gauss and Legendre stand so far from the middle of an interval of length 1."""


@inline
def mean_free_weight(camera, microlens, x, y, square, polygon):
    """Free weight of a position, or its mean over the square around it; over a few pixels it is all but quadratic."""
    points = 4 if square > 0.0 else 1
    total, off = 0.0, _GAUSS * square
    for i in range(points):
        a, b = x + (off if i % 2 else -off), y + (off if i // 2 else -off)
        total += free_weight(camera, microlens, a, b, polygon) / points
    return total


@kernel
def bundle_moments(camera, planes, samples, starts, moments):
    """Moments of the bundles of many sensor positions on two planes.

    `planes`: (n or 1, 2, 4, 3) float64, two planes of each position, or of all, as rows origin, first axis, second
        axis, normal.
    `moments`: (n, COLUMNS) float64, written, see `camera.tracing.moments`; NaN where the bundle is empty.
    """
    bits, seed, square = samples
    pixels, anchors, positions, microlens = starts
    region, packet, crossing = new_region(), new_packet(), np.empty((4, PACKET))
    x, y, alive, weight = packet.x, packet.y, packet.alive, packet.weight
    start_x, start_y = np.empty(PACKET), np.empty(PACKET)
    start = SensorPoints(start_x, start_y)
    sums, total, pivot = np.zeros((REPLICAS, 5)), np.zeros(10), np.zeros(4)
    count = bits.shape[1]
    for n in range(positions.shape[0]):
        for k in range(moments.shape[1]):
            moments[n, k] = np.nan
        moments[n, WEIGHT], moments[n, FREE_WEIGHT] = 0.0, 0.0
        if microlens[n] == SKIP:
            continue
        sx, sy = positions[n]
        of_planes = n if planes.shape[0] > 1 else 0
        if microlens[n] >= 0:
            moments[n, FREE_WEIGHT] = mean_free_weight(camera, microlens[n], sx, sy, square, region.polygon)
        ax, ay = anchors[n]
        slack = CIRCUMRADIUS * square + math.hypot(sx - ax, sy - ay)
        fan = bound(camera, microlens[n], ax, ay, slack, region)
        if not fan.area > 0.0:
            continue
        base = hash32(hash32(seed, pixels[n, 0]), pixels[n, 1])
        clear(sums, total)
        for i in range(PACKET):
            start_x[i], start_y[i] = sx, sy
        started = False
        # A packet holds samples of all replicas: short packets are slow ones.
        for first in range(0, count, _SHARE):
            size = min(_SHARE, count - first)
            for r in range(REPLICAS):
                here = slice(r * size, (r + 1) * size)
                draw(bits[0], first, size, hash32(base, 2 * r), x[here])
                draw(bits[1], first, size, hash32(base, 2 * r + 1), y[here])
                if square > 0.0:
                    draw(bits[2], first, size, hash32(base, START_STREAM + 2 * r), start_x[here])
                    draw(bits[3], first, size, hash32(base, START_STREAM + 2 * r + 1), start_y[here])
            full = REPLICAS * size
            if square > 0.0:
                for i in range(full):
                    start_x[i] = sx + square * (start_x[i] - 0.5)
                    start_y[i] = sy + square * (start_y[i] - 0.5)
            here, anchor = slice(0, full), Anchor(ax, ay, region_drift(camera, microlens[n]))
            aim_into(region, fan, anchor, SensorPoints(start_x[here], start_y[here]), x[here], y[here], packet.scratch)
            send_packet(camera, microlens[n], start, full, packet)
            cross_packet(planes[of_planes, 0], planes[of_planes, 1], packet, 0, full, crossing)
            started = started or set_pivot(crossing, alive, 0, full, pivot)
            if started:
                for r in range(REPLICAS):
                    accumulate(crossing, weight, alive, r * size, (r + 1) * size, pivot, sums[r], total)
        if started:
            finish(sums, total, pivot, fan.area / (count * REPLICAS), moments[n])


@inline
def reach_of(samples, diffraction):
    """Farthest that a ray starts from the middle of its square [mm]."""
    reach = CIRCUMRADIUS * samples.edge_mm
    for i in range(diffraction.edge_mm.shape[0]):
        reach = max(reach, CIRCUMRADIUS * (samples.edge_mm + diffraction.rows.shape[1] * diffraction.edge_mm[i]))
    return reach


@kernel
def image_rays(camera, samples, squares, diffraction, rays):
    """Rays that leave the camera from many squares of the sensor, compacted.

    With diffraction a ray that arrives in a square starts where it would arrive by geometry.

    Returns int: number of rays written.
    """
    region, packet = new_region(), new_packet()
    start_x, start_y, area, held_by = np.empty(PACKET), np.empty(PACKET), np.empty(PACKET), np.empty(PACKET, np.int64)
    start, x, y = SensorPoints(start_x, start_y), packet.x, packet.y
    bits, microlens_of = samples.bits, squares.strata.reshape(-1)
    held, written, edge, places = 0, 0, samples.edge_mm, squares.strata.shape[1]
    choice, along_x, along_y = np.empty(PACKET), np.empty(PACKET), np.empty(PACKET)
    spreads, reach = diffraction.edge_mm.shape[0] > 0, reach_of(samples, diffraction)
    for n in range(squares.positions.shape[0]):
        sx, sy = squares.positions[n]
        base = hash32(hash32(samples.seed, squares.pixels[n, 0]), squares.pixels[n, 1])
        for j in range(places):
            microlens, stream = squares.strata[n, j], IMAGE_STREAM + 4 * j
            if microlens == SKIP:
                continue
            fan = bound(camera, microlens, sx, sy, reach, region)
            if not fan.area > 0.0:
                continue
            count, skipped = squares.counts[n, j], squares.skipped[n, j]
            for first in range(0, count, PACKET):
                size = min(PACKET, count - first)
                if held + size > PACKET:
                    send_mixed(camera, microlens_of, held_by, start, held, packet)
                    written = _release(packet, held, held_by, area, rays, written)
                    held = 0
                here = slice(held, held + size)
                draw(bits[0], skipped + first, size, hash32(base, stream), start_x[here])
                draw(bits[1], skipped + first, size, hash32(base, stream + 1), start_y[here])
                draw(bits[2], skipped + first, size, hash32(base, stream + 2), x[here])
                draw(bits[3], skipped + first, size, hash32(base, stream + 3), y[here])
                for i in range(held, held + size):
                    held_by[i], area[i] = n * places + j, fan.area / count
                    start_x[i] = sx + edge * (start_x[i] - 0.5)
                    start_y[i] = sy + edge * (start_y[i] - 0.5)
                if spreads:
                    draw(bits[4], skipped + first, size, hash32(base, SPREAD_STREAM + 3 * j), choice)
                    draw(bits[5], skipped + first, size, hash32(base, SPREAD_STREAM + 3 * j + 1), along_x)
                    draw(bits[6], skipped + first, size, hash32(base, SPREAD_STREAM + 3 * j + 2), along_y)
                    spread(diffraction, microlens, start_x[here], start_y[here], choice, along_x, along_y)
                anchor = Anchor(sx, sy, region_drift(camera, microlens))
                aim_into(
                    region, fan, anchor, SensorPoints(start_x[here], start_y[here]), x[here], y[here], packet.scratch
                )
                held += size
    if held > 0:
        send_mixed(camera, microlens_of, held_by, start, held, packet)
        written = _release(packet, held, held_by, area, rays, written)
    return written


@inline
def _release(packet, size, held_by, area, rays, written):
    """Append the rays of a packet that leave the camera; their number so far."""
    x, y, z, dx, dy, dz, alive, _, weight = packet
    origin, direction, share, owner = rays
    for i in range(size):
        if alive[i] > 0.0:
            origin[written, 0], origin[written, 1], origin[written, 2] = x[i], y[i], z[i]
            direction[written, 0], direction[written, 1], direction[written, 2] = dx[i], dy[i], dz[i]
            share[written], owner[written] = weight[i] * area[i], held_by[i]
            written += 1
    return written
