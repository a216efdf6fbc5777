"""Bundles and image rays on a device: one thread for each bundle, or for each pixel and microlens.

Threads run the functions of `camera.tracing.bundle_kernels` on packets of one ray, and draw and add samples in its
order: moments have the bits of processors wherever division, root and a b + c are rounded alike. Image rays start and
are aimed in float64, so that they use the random numbers of processors; the trace through microlens and lens is
float32.
"""

import math
from typing import NamedTuple

import numpy as np

from pipeline.camera.parts.camera import REPLICAS
from pipeline.camera.parts.polygon import MAX_VERTICES
from pipeline.camera.tracing.bundle_kernels import (
    SAMPLES_OF_REPLICA,
    Shots,
    aim_shots,
    bound_bundle,
    draw_bundle,
    reach_of,
)
from pipeline.camera.tracing.moments import accumulate, clear, cross_packet, finish, set_pivot
from pipeline.camera.tracing.packets import Aims, Anchor, aim_into, region_drift, send_packet
from pipeline.camera.tracing.records import CameraArrays, Diffraction, Samples, SensorPoints, Squares, Starts
from pipeline.camera.tracing.sampling_bounds import Region, bound
from pipeline.errors import EnvironmentFault
from pipeline.jit.binding import Single, in_single
from pipeline.jit.decorators import inline, kernel
from pipeline.jit.device import DeviceKernel, cuda, fetched, require_device, resident, unfilled
from pipeline.optics.kernels import SCRATCH, Packet
from pipeline.records.shapes import Float32, Float64, Int64

_COLUMNS, _WEIGHT = 7, 6
"""Numbers of a ray: a point, its direction, and its weight, 0 if it is blocked or carries no light."""
_AT_ONCE, _THREADS = 1 << 16, 64
"""Bundles on the device at once; threads of a block, few because each has buffers of its own."""

send_single = Single(send_packet, STILL_MM=1e-3, RESIDUAL_MM=1e-4, SETTLED_SQUARED=1e-12)
"""Trace of a packet in float32, with tolerances to match. Newton's method on an asphere stops when the next step would
be below rounding; residuals of some roundings of 100 mm are accepted; Brown's model has converged at six digits."""


@DeviceKernel
def sum_bundles(camera, planes, samples, starts, moments):
    """Moments of bundles, one for each thread; parameters are those of `bundle_kernels.bundle_moments`."""
    outlines, cumulative = (
        cuda.local.array((3, MAX_VERTICES, 2), np.float64),
        cuda.local.array(MAX_VERTICES, np.float64),
    )
    rays, scratch = cuda.local.array((10, 1), np.float64), cuda.local.array((SCRATCH, 1), np.float64)
    of_samples = cuda.local.array((6, SAMPLES_OF_REPLICA), np.float64)  # coordinates of crossings, weights and flags
    sums, total = cuda.local.array((REPLICAS, 5), np.float64), cuda.local.array(10, np.float64)
    pivot = cuda.local.array(4, np.float64)
    n = cuda.grid(1)
    if n >= moments.shape[0]:
        return
    region = Region(outlines[0], outlines[1], outlines[2], cumulative)
    fan = bound_bundle(camera, samples, starts, n, region, moments[n])
    if not fan.area > 0.0:
        return
    packet, aims = _packet_of(rays, scratch), Aims(rays[0], rays[1], rays[8], rays[9], scratch)
    microlens = starts.microlens[n]
    row = n if planes.shape[0] > 1 else 0
    has_pivot = False
    anchor = Anchor(starts.anchors[n, 0], starts.anchors[n, 1], region_drift(camera, microlens))
    count = samples.bits.shape[1]
    crossing, weight, alive = of_samples[:4], of_samples[4], of_samples[5]
    clear(sums, total)
    for first in range(0, count, SAMPLES_OF_REPLICA):
        size = min(SAMPLES_OF_REPLICA, count - first)
        for r in range(REPLICAS):
            for i in range(size):
                draw_bundle(samples, starts, n, r, first + i, aims)
                aim_into(region, fan, anchor, aims)
                send_packet(camera, microlens, SensorPoints(rays[8], rays[9]), 1, packet)
                cross_packet(planes[row, 0], planes[row, 1], packet, 0, 1, crossing[:, i:])
                weight[i], alive[i] = packet.weight[0], packet.alive[0]
            has_pivot = has_pivot or set_pivot(crossing, alive, 0, size, pivot)
            if has_pivot:
                accumulate(crossing, weight, alive, 0, size, pivot, sums[r], total)
    if has_pivot:
        finish(sums, total, pivot, fan.area / (count * REPLICAS), moments[n])


@inline
def _packet_of(rays, scratch):
    """A packet over buffers: (8 or more, size), and scratch arrays."""
    return Packet(rays[0], rays[1], rays[2], rays[3], rays[4], rays[5], rays[6], scratch, rays[7])


def moments_on_device(
    device: str,
    camera: CameraArrays,
    planes: Float64[np.ndarray, "#n 2 4 3"],
    samples: Samples,
    starts: Starts,
    moments: Float64[np.ndarray, "n COLUMNS"],
) -> None:
    """Write the moments of many bundles; EnvironmentFault: the device of that name cannot be used."""
    require_device(device)
    has_own_planes = len(planes) > 1
    camera, samples = resident(camera), resident(samples)
    for first in range(0, len(moments), _AT_ONCE):
        batch = slice(first, first + _AT_ONCE)
        device_starts = resident(starts.part(batch))
        device_moments = unfilled(moments[batch].shape)
        device_planes = resident(planes[batch] if has_own_planes else planes)
        sum_bundles(
            _blocks(len(device_moments)), _THREADS, camera, device_planes, samples, device_starts, device_moments
        )
        moments[batch] = fetched(device_moments)


def _blocks(count: int) -> int:
    """Blocks of threads for this many tasks."""
    return -(-count // _THREADS)


class Started(NamedTuple):
    """Owners of rays, numbered as in `Leaving.owner`, (m,) int64, and the number of the first ray of each."""

    owner: np.ndarray
    first: np.ndarray

    @staticmethod
    def of(counts: Int64[np.ndarray, "n s"]) -> "Started":
        """Owners of rays, by the number of rays of each square and microlens."""
        owner = np.flatnonzero(counts)
        used = counts.reshape(-1)[owner]
        return Started(owner, np.cumsum(used) - used)


@DeviceKernel
def trace_squares(cameras, samples, squares, diffraction, started, rays):
    """Trace all rays of one square and microlens in each thread; writes `rays` (_COLUMNS, rays) float32."""
    outlines, cumulative = (
        cuda.local.array((3, MAX_VERTICES, 2), np.float64),
        cuda.local.array(MAX_VERTICES, np.float64),
    )
    aimed, scratch = cuda.local.array((4, 1), np.float64), cuda.local.array((SCRATCH, 1), np.float64)
    single, single_scratch = cuda.local.array((10, 1), np.float32), cuda.local.array((SCRATCH, 1), np.float32)
    k = cuda.grid(1)
    if k < started.owner.shape[0]:
        region = Region(outlines[0], outlines[1], outlines[2], cumulative)
        aims = Aims(aimed[0], aimed[1], aimed[2], aimed[3], scratch)
        packet, start = _packet_of(single, single_scratch), SensorPoints(single[8], single[9])
        trace_square(cameras, (samples, squares, diffraction), (started, k), region, aims, start, packet, rays)


@inline
def trace_square(cameras, light, task, region, aims, start, packet, rays):
    """Trace all rays of one square and microlens, one by one, with buffers for a ray in float64 and in float32."""
    (samples, squares, diffraction), (started, k) = light, task
    n, j = started.owner[k] // squares.strata.shape[1], started.owner[k] % squares.strata.shape[1]
    microlens = squares.strata[n, j]
    count = squares.counts[n, j]
    x = squares.positions[n, 0]
    y = squares.positions[n, 1]
    fan = bound(cameras[0], microlens, x, y, reach_of(samples, diffraction), region)
    for i in range(count):
        number = started.first[k] + i
        rays[_WEIGHT, number] = 0.0
        if fan.area > 0.0:
            aim_shots(
                cameras[0], samples, squares, diffraction, Shots(n, j, squares.skipped[n, j] + i, fan), region, aims
            )
            packet.x[0], packet.y[0], start.x[0], start.y[0] = aims.x[0], aims.y[0], aims.start_x[0], aims.start_y[0]
            send_single(cameras[1], microlens, start, 1, packet)
            if packet.alive[0] > 0.0:
                rays[0, number], rays[1, number], rays[2, number] = packet.x[0], packet.y[0], packet.z[0]
                rays[3, number], rays[4, number], rays[5, number] = packet.dx[0], packet.dy[0], packet.dz[0]
                rays[_WEIGHT, number] = packet.weight[0] * np.float32(fan.area / count)


class ImageRays:
    """Image rays of a camera; data that do not depend on pixels stay on the device.

    Raises EnvironmentFault: the device cannot be used, or a number of the lens is too small for float32.
    """

    def __init__(self, device: str, camera: CameraArrays, samples: Samples, diffraction: Diffraction) -> None:
        require_device(device)
        # Zeros and cut numbers would make another surface, and nothing would say so.
        if np.any((camera.table != 0) & (np.abs(camera.table) < np.finfo(np.float32).tiny)):
            raise EnvironmentFault(
                "a coefficient of the lens is too small for float32, in which devices trace images",
                hint="leave --device out",
            )
        self._cameras = resident(camera), resident(in_single(camera))
        self._samples, self._diffraction = resident(samples), resident(diffraction)

    def started(self, squares: Squares) -> Float32[np.ndarray, "7 rays"]:
        """All rays from squares, in the order of squares, microlenses and samples, for `leaving_rays`."""
        started = Started.of(squares.counts)
        rays = unfilled((_COLUMNS, int(squares.counts.sum())), np.float32)
        if rays.size:
            light = self._samples, resident(squares), self._diffraction
            trace_squares(_blocks(len(started.owner)), _THREADS, self._cameras, *light, resident(started), rays)
        return fetched(rays)


@kernel
def leaving_rays(rays, first, counts, leaving):
    """Copy the rays that leave the camera, as `bundle_kernels.image_rays` writes them, and return their number.

    `first`: number of the first ray of these squares in `rays`, from `ImageRays.started`.
    `counts`: (m, s) int64, rays of each square through each microlens.
    """
    origin, direction, share, owner = leaving
    of_owner = counts.reshape(-1)
    i = first
    written = 0
    for k in range(of_owner.shape[0]):
        for _ in range(of_owner[k]):
            if rays[_WEIGHT, i] > 0.0:
                origin[written, 0], origin[written, 1], origin[written, 2] = rays[0, i], rays[1, i], rays[2, i]
                dx, dy, dz = np.float64(rays[3, i]), np.float64(rays[4, i]), np.float64(rays[5, i])
                to_unit = 1.0 / math.sqrt(dx * dx + dy * dy + dz * dz)
                direction[written, 0], direction[written, 1] = to_unit * dx, to_unit * dy
                direction[written, 2] = to_unit * dz
                share[written], owner[written] = rays[_WEIGHT, i], k
                written += 1
            i += 1
    return written
