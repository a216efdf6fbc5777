"""Bundles: from sensor positions through one microlens each, or none, and the main lens to rays in the scene.

Moments of a bundle are Monte Carlo integrals over a sampling region of area A: A / N times the sum of w f over N
scrambled Sobol points, w the weight of a ray per area. Vision frame, mm. A conventional camera samples the rear vertex
plane, a plenoptic one the plane of its microlenses; all other code is shared. A microlens is its row, `NO_MICROLENS`,
or `SKIP`; `camera.tracing.records` names the other arguments.
"""

import math
from typing import NamedTuple

import numpy as np

from pipeline.camera.parts.camera import REPLICAS
from pipeline.camera.tracing.microlens_kernels import free_weight
from pipeline.camera.tracing.moments import FREE_WEIGHT, WEIGHT, accumulate, clear, cross_packet, finish, set_pivot
from pipeline.camera.tracing.packets import Aims, Anchor, aim_into, draw, region_drift, send_mixed, send_packet, spread
from pipeline.camera.tracing.records import SensorPoints
from pipeline.camera.tracing.sampling_bounds import SKIP, Fan, bound, new_region
from pipeline.camera.tracing.sobol import hash32
from pipeline.jit.decorators import inline, kernel
from pipeline.optics.kernels import PACKET, new_packet

IMAGE_STREAM = 1 << 16
"""First stream of random numbers of images, four for each microlens of a pixel: far behind those of moments."""
START_STREAM = 2 * REPLICAS
"""First stream for the starts of rays on a square: behind two per replica for their aims."""
SAMPLES_OF_REPLICA = PACKET // REPLICAS
"""Samples of each replica in a packet."""
SPREAD_STREAM = 1 << 24
"""First stream of random numbers of diffraction, three for each microlens of a pixel: far behind all others."""
CIRCUMRADIUS = 0.7072
"""Circumradius of a square of edge 1, rounded up."""
_GAUSS = 0.28867513459481287
"""Distance of both Gauss-Legendre nodes from the middle of an interval of length 1."""


@inline
def bound_bundle(camera, samples, starts, n, region, row):
    """Bound the rays of a bundle and reset its moments to those of an empty one, except the free weight.

    The free weight is the mean over the square from which rays start; over a few pixels it is nearly quadratic.
    """
    _, anchors, positions, microlens = starts
    square = samples.edge_mm
    sx, sy = positions[n, 0], positions[n, 1]
    ax, ay = anchors[n, 0], anchors[n, 1]
    for k in range(row.shape[0]):
        row[k] = math.nan
    row[WEIGHT] = 0.0
    row[FREE_WEIGHT] = 0.0
    if microlens[n] == SKIP:
        return Fan(0, 0.0, 0.0, 0.0)
    if microlens[n] >= 0:
        # The mean over the square by Gauss's rule with two nodes along each axis.
        points = 4 if square > 0.0 else 1
        offset = _GAUSS * square
        for i in range(points):
            x, y = sx + (offset if i % 2 else -offset), sy + (offset if i // 2 else -offset)
            row[FREE_WEIGHT] += free_weight(camera, microlens[n], x, y, region.polygon) / points
    return bound(camera, microlens[n], ax, ay, CIRCUMRADIUS * square + math.hypot(sx - ax, sy - ay), region)


@inline
def draw_bundle(samples, starts, n, replica, first, aims):
    """Draw random numbers, and the starts, for some samples of one replica."""
    bits, seed, square = samples
    sx, sy = starts.positions[n, 0], starts.positions[n, 1]
    size = aims.x.shape[0]
    base = hash32(hash32(seed, starts.pixels[n, 0]), starts.pixels[n, 1])
    draw(bits[0], first, size, hash32(base, 2 * replica), aims.x)
    draw(bits[1], first, size, hash32(base, 2 * replica + 1), aims.y)
    if square > 0.0:
        draw(bits[2], first, size, hash32(base, START_STREAM + 2 * replica), aims.start_x)
        draw(bits[3], first, size, hash32(base, START_STREAM + 2 * replica + 1), aims.start_y)
        for i in range(size):
            aims.start_x[i] = sx + square * (aims.start_x[i] - 0.5)
            aims.start_y[i] = sy + square * (aims.start_y[i] - 0.5)
    else:
        for i in range(size):
            aims.start_x[i], aims.start_y[i] = sx, sy


@kernel
def bundle_moments(camera, planes, samples, starts, moments):
    """Moments of the bundles of many sensor positions on two planes.

    `planes`: (n or 1, 2, 4, 3), two of each position, or of all, as rows origin, first axis, second axis, normal.
    `moments`: (n, COLUMNS), written, see `camera.tracing.moments`; NaN where the bundle is empty.
    """
    region = new_region()
    packet = new_packet()
    crossing = np.empty((4, PACKET))
    x, y, alive, weight, scratch = packet.x, packet.y, packet.alive, packet.weight, packet.scratch
    start_x, start_y = np.empty(PACKET), np.empty(PACKET)
    sums, total, pivot = np.zeros((REPLICAS, 5)), np.zeros(10), np.zeros(4)
    count = samples.bits.shape[1]
    for n in range(starts.positions.shape[0]):
        fan = bound_bundle(camera, samples, starts, n, region, moments[n])
        if not fan.area > 0.0:
            continue
        microlens = starts.microlens[n]
        of_planes = n if planes.shape[0] > 1 else 0
        anchor = Anchor(starts.anchors[n, 0], starts.anchors[n, 1], region_drift(camera, microlens))
        clear(sums, total)
        has_pivot = False
        # A packet holds samples of all replicas: short packets are slow ones.
        for first in range(0, count, SAMPLES_OF_REPLICA):
            size = min(SAMPLES_OF_REPLICA, count - first)
            for r in range(REPLICAS):
                of_replica = slice(r * size, (r + 1) * size)
                draw_bundle(
                    samples,
                    starts,
                    n,
                    r,
                    first,
                    Aims(x[of_replica], y[of_replica], start_x[of_replica], start_y[of_replica], scratch),
                )
            full = REPLICAS * size
            aim_into(region, fan, anchor, Aims(x[:full], y[:full], start_x[:full], start_y[:full], scratch))
            send_packet(camera, microlens, SensorPoints(start_x, start_y), full, packet)
            cross_packet(planes[of_planes, 0], planes[of_planes, 1], packet, 0, full, crossing)
            has_pivot = has_pivot or set_pivot(crossing, alive, 0, full, pivot)
            if has_pivot:
                for r in range(REPLICAS):
                    accumulate(crossing, weight, alive, r * size, (r + 1) * size, pivot, sums[r], total)
        if has_pivot:
            finish(sums, total, pivot, fan.area / (count * REPLICAS), moments[n])


@inline
def reach_of(samples, diffraction):
    """Farthest start of a ray from the middle of its square [mm]."""
    reach = CIRCUMRADIUS * samples.edge_mm
    for i in range(diffraction.edge_mm.shape[0]):
        reach = max(reach, CIRCUMRADIUS * (samples.edge_mm + diffraction.rows.shape[1] * diffraction.edge_mm[i]))
    return reach


class Shots(NamedTuple):
    """Samples of one square through one of its microlenses: rows, number of the first sample, and the region."""

    square: int
    stratum: int
    first: int
    fan: Fan


@inline
def aim_shots(camera, samples, squares, diffraction, shots, region, aims):
    """Draw the starts and the aims of rays."""
    bits, edge = samples.bits, samples.edge_mm
    n, j, first, fan = shots
    size = aims.x.shape[0]
    sx, sy = squares.positions[n, 0], squares.positions[n, 1]
    microlens = squares.strata[n, j]
    base = hash32(hash32(samples.seed, squares.pixels[n, 0]), squares.pixels[n, 1])
    stream = IMAGE_STREAM + 4 * j
    draw(bits[0], first, size, hash32(base, stream), aims.start_x)
    draw(bits[1], first, size, hash32(base, stream + 1), aims.start_y)
    draw(bits[2], first, size, hash32(base, stream + 2), aims.x)
    draw(bits[3], first, size, hash32(base, stream + 3), aims.y)
    for i in range(size):
        aims.start_x[i] = sx + edge * (aims.start_x[i] - 0.5)
        aims.start_y[i] = sy + edge * (aims.start_y[i] - 0.5)
    if diffraction.edge_mm.shape[0] > 0:
        for k in range(3):
            draw(bits[4 + k], first, size, hash32(base, SPREAD_STREAM + 3 * j + k), aims.scratch[k])
        spread(diffraction, microlens, aims)
    aim_into(region, fan, Anchor(sx, sy, region_drift(camera, microlens)), aims)


@kernel
def image_rays(camera, samples, squares, diffraction, rays):
    """Rays that leave the camera from many squares of the sensor, compacted; returns their number.

    With diffraction, a ray that arrives in a square starts where it would arrive by geometry.
    """
    region = new_region()
    packet = new_packet()
    x, y = packet.x, packet.y
    start_x, start_y = np.empty(PACKET), np.empty(PACKET)
    start = SensorPoints(start_x, start_y)
    # Of each ray in the packet: area of the sampling region per ray, and its square and stratum in one number.
    area, stratum_of = np.empty(PACKET), np.empty(PACKET, np.int64)
    microlens_of = squares.strata.reshape(-1)
    reach = reach_of(samples, diffraction)
    in_packet = 0
    written = 0
    strata = squares.strata.shape[1]
    for n in range(squares.positions.shape[0]):
        for j in range(strata):
            # Bound the rays from a square through one of its microlenses.
            microlens = squares.strata[n, j]
            if microlens == SKIP:
                continue
            fan = bound(camera, microlens, squares.positions[n, 0], squares.positions[n, 1], reach, region)
            if not fan.area > 0.0:
                continue
            # Add them to the packet, and trace it whenever no more fit.
            count = squares.counts[n, j]
            for first in range(0, count, PACKET):
                size = min(PACKET, count - first)
                if in_packet + size > PACKET:
                    send_mixed(camera, microlens_of, stratum_of, start, in_packet, packet)
                    written = _release(packet, in_packet, stratum_of, area, rays, written)
                    in_packet = 0
                new = slice(in_packet, in_packet + size)
                shots = Shots(n, j, squares.skipped[n, j] + first, fan)
                aims = Aims(x[new], y[new], start_x[new], start_y[new], packet.scratch)
                aim_shots(camera, samples, squares, diffraction, shots, region, aims)
                for i in range(in_packet, in_packet + size):
                    stratum_of[i], area[i] = n * strata + j, fan.area / count
                in_packet += size
    if in_packet > 0:
        send_mixed(camera, microlens_of, stratum_of, start, in_packet, packet)
        written = _release(packet, in_packet, stratum_of, area, rays, written)
    return written


@inline
def _release(packet, size, stratum_of, area, rays, written):
    """Append the rays of a packet that leave the camera; returns the number written."""
    x, y, z, dx, dy, dz, alive, _, weight = packet
    origin, direction, share, owner = rays
    for i in range(size):
        if alive[i] > 0.0:
            origin[written, 0], origin[written, 1], origin[written, 2] = x[i], y[i], z[i]
            direction[written, 0], direction[written, 1], direction[written, 2] = dx[i], dy[i], dz[i]
            share[written], owner[written] = weight[i] * area[i], stratum_of[i]
            written += 1
    return written
