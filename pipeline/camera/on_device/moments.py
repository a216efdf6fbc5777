"""Moments of bundles on a device: a thread bounds each bundle, then a block of threads traces it, a ray each in turn.

The same as `camera.tracing.bundle_kernels.bundle_moments` on processors, by the same functions of one ray. Threads take
samples in the order of its packets and keep the sums of their rays' moments in registers; in the end every sum over
threads runs in their order. So where division, root and a b + c are rounded alike, up to PACKET samples give the bits
of processors, and more differ by the order of sums alone.
"""

import math
from typing import NamedTuple

import numpy as np

from pipeline.camera.on_device.one_ray import send_ray
from pipeline.camera.on_device.regions import AT_ONCE, THREADS, blocks_for, room_for_regions, write_region
from pipeline.camera.parts.camera import REPLICAS
from pipeline.camera.parts.polygon import MAX_VERTICES, point_in_fan
from pipeline.camera.tracing.bundle_kernels import CIRCUMRADIUS, START_STREAM, mean_free_weight
from pipeline.camera.tracing.moments import COLUMNS, FREE_WEIGHT, WEIGHT, cross, finish
from pipeline.camera.tracing.packets import region_drift
from pipeline.camera.tracing.records import CameraArrays, Samples, Starts
from pipeline.camera.tracing.sampling_bounds import SKIP, Region
from pipeline.camera.tracing.sobol import hash32, scrambled
from pipeline.jit.decorators import inline
from pipeline.jit.device import DeviceKernel, cuda, fetched, require_device, resident, room
from pipeline.optics.kernels import PACKET
from pipeline.records.shapes import Float64

_ALIVE = 4
"""Place of a ray's flag, and of whether there is a pivot, behind the four coordinates of a crossing."""
_FIRST, _SECOND, _SUMS = 5, 10, 15
"""Sums of a thread: weight and first moments, second moments, and all."""


class Sums(NamedTuple):
    """Weight, first and second moments of a thread's rays about the pivot: as `moments.accumulate` has them."""

    w: float
    a: float
    b: float
    c: float
    d: float
    aa: float
    ab: float
    ac: float
    ad: float
    bb: float
    bc: float
    bd: float
    cc: float
    cd: float
    dd: float


def block_size(samples: int) -> int:
    """Threads of a block, for so many samples of each replica: the rays of a packet."""
    return REPLICAS * min(PACKET // REPLICAS, samples)


@DeviceKernel
def bound_bundles(camera, samples, starts, regions, moments):
    """Bound what passes of every bundle, one by each thread, and clear its moments but for the free weight.

    `camera`, `samples`, `starts`, `moments`: as in `sum_bundles`.
    `regions`: written.
    """
    outline = cuda.local.array((MAX_VERTICES, 2), np.float64)
    scratch = cuda.local.array((MAX_VERTICES, 2), np.float64)
    n = cuda.blockIdx.x * cuda.blockDim.x + cuda.threadIdx.x
    if n >= moments.shape[0]:
        return
    _, anchors, positions, microlenses = starts
    square, microlens = samples.edge_mm, microlenses[n]
    sx, sy, ax, ay = positions[n, 0], positions[n, 1], anchors[n, 0], anchors[n, 1]
    row, region = moments[n], Region(regions.polygons[n], outline, scratch, regions.cumulative[n])
    for k in range(row.shape[0]):
        row[k] = math.nan
    row[WEIGHT], row[FREE_WEIGHT], regions.area[n] = 0.0, 0.0, 0.0
    if microlens == SKIP:
        return
    if microlens >= 0:
        row[FREE_WEIGHT] = mean_free_weight(camera, microlens, sx, sy, square, region.polygon)
    slack = CIRCUMRADIUS * square + math.hypot(sx - ax, sy - ay)
    write_region(camera, microlens, ax, ay, slack, region, regions, n)


@DeviceKernel
def sum_bundles(camera, planes, samples, starts, regions, moments):
    """Moments of the bundle of one sensor position, by one block of `block_size` threads.

    `camera`, `planes`, `samples`, `starts`: as in `camera.tracing.bundle_kernels.bundle_moments`.
    `regions`: from `bound_bundles`.
    `moments`: (n, COLUMNS) float64, written, where anything passes.
    """
    parts = cuda.shared.array((_SUMS, PACKET), np.float64)
    ends = cuda.shared.array((_SUMS, REPLICAS), np.float64)
    first_sums = cuda.shared.array((REPLICAS, _FIRST), np.float64)
    second_sums = cuda.shared.array(_SECOND, np.float64)
    pivot = cuda.shared.array(5, np.float64)
    n, thread, threads = cuda.blockIdx.x, cuda.threadIdx.x, cuda.blockDim.x
    area, share, count = regions.area[n], threads // REPLICAS, samples.bits.shape[1]
    if not area > 0.0:
        return
    if thread == 0:
        pivot[_ALIVE] = 0.0
    cuda.syncthreads()
    row_of_planes = n if planes.shape[0] > 1 else 0
    sums = Sums(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    for first in range(0, count, share):
        index, alive, weight, a, b, c, d = first + thread % share, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
        if index < count:
            ray, weight = _sent(camera, samples, starts, regions, n, index, thread // share)
            alive = ray.alive
            a, b = cross(planes[row_of_planes, 0], ray.x, ray.y, ray.z, ray.dx, ray.dy, ray.dz)
            c, d = cross(planes[row_of_planes, 1], ray.x, ray.y, ray.z, ray.dx, ray.dy, ray.dz)
        if not pivot[_ALIVE] > 0.0:  # the first ray of all that passes, in the order of threads
            parts[0, thread], parts[1, thread], parts[2, thread], parts[3, thread] = a, b, c, d
            parts[_ALIVE, thread] = alive
            cuda.syncthreads()
            if thread == 0:
                _set_pivot(parts, threads, pivot)
        cuda.syncthreads()
        if alive > 0.0:
            sums = _added(sums, weight, a - pivot[0], b - pivot[1], c - pivot[2], d - pivot[3])
        cuda.syncthreads()
    _put(sums, parts, thread)
    cuda.syncthreads()
    for k in range(thread, _SUMS * REPLICAS, threads):
        ends[k // REPLICAS, k % REPLICAS] = _sum_of(parts, k // REPLICAS, k % REPLICAS * share, share)
    cuda.syncthreads()
    if thread == 0 and pivot[_ALIVE] > 0.0:
        for r in range(REPLICAS):
            for k in range(_FIRST):
                first_sums[r, k] = ends[k, r]
        for k in range(_SECOND):
            second_sums[k] = _sum_of(ends, _FIRST + k, 0, REPLICAS)
        finish(first_sums, second_sums, pivot, area / (count * REPLICAS), moments[n])


@inline
def _sent(camera, samples, starts, regions, n, index, replica):
    """The ray of one sample of a bundle, and its weight."""
    bits, seed, square = samples
    pixels, anchors, positions, microlens = starts
    base = hash32(hash32(seed, pixels[n, 0]), pixels[n, 1])
    u = scrambled(bits[0, index], hash32(base, 2 * replica))
    v = scrambled(bits[1, index], hash32(base, 2 * replica + 1))
    sx, sy, ax, ay = positions[n, 0], positions[n, 1], anchors[n, 0], anchors[n, 1]
    if square > 0.0:
        sx += square * (scrambled(bits[2, index], hash32(base, START_STREAM + 2 * replica)) - 0.5)
        sy += square * (scrambled(bits[3, index], hash32(base, START_STREAM + 2 * replica + 1)) - 0.5)
    polygons, cumulative, vertices, centre, _ = regions
    px, py = point_in_fan(polygons[n], vertices[n], cumulative[n], centre[n, 0], centre[n, 1], u, v)
    drift = region_drift(camera, microlens[n])
    return send_ray(camera, microlens[n], sx, sy, px + drift * (sx - ax), py + drift * (sy - ay))


@inline
def _set_pivot(parts, threads, pivot):
    """Take the crossing of the first living ray as the pivot, and mark that there is one."""
    for t in range(threads):
        if parts[_ALIVE, t] > 0.0:
            for k in range(5):
                pivot[k] = parts[k, t]
            return


@inline
def _added(s, w, a, b, c, d):
    """Sums with one more ray."""
    wa, wb, wc, wd = w * a, w * b, w * c, w * d
    return Sums(
        s.w + w,
        s.a + wa,
        s.b + wb,
        s.c + wc,
        s.d + wd,
        s.aa + wa * a,
        s.ab + wa * b,
        s.ac + wa * c,
        s.ad + wa * d,
        s.bb + wb * b,
        s.bc + wb * c,
        s.bd + wb * d,
        s.cc + wc * c,
        s.cd + wc * d,
        s.dd + wd * d,
    )


@inline
def _put(s, parts, thread):
    """Write a thread's sums into its column."""
    values = s.w, s.a, s.b, s.c, s.d, s.aa, s.ab, s.ac, s.ad, s.bb, s.bc, s.bd, s.cc, s.cd, s.dd
    for k in range(len(values)):
        parts[k, thread] = values[k]


@inline
def _sum_of(values, row, first, count):
    """Sum of some columns of a row, in their order."""
    total = 0.0
    for i in range(first, first + count):
        total += values[row, i]
    return total


def moments_on_device(
    device: str,
    camera: CameraArrays,
    planes: Float64[np.ndarray, "#n 2 4 3"],
    samples: Samples,
    starts: Starts,
    moments: Float64[np.ndarray, "n COLUMNS"],
) -> None:
    """Moments of many bundles, written; `device` is its name, other parameters are as of `sum_bundles`.

    Raises EnvironmentFault: no device can be used.
    """
    require_device(device)
    threads, each_its_planes = block_size(samples.bits.shape[1]), len(planes) > 1
    camera, samples, planes = resident(camera), resident(samples), planes if each_its_planes else resident(planes)
    regions = room_for_regions(min(len(moments), AT_ONCE))
    for first in range(0, len(moments), AT_ONCE):
        some = slice(first, first + AT_ONCE)
        count = len(moments[some])
        here, on_device = resident(starts.part(some)), room((count, COLUMNS))
        bound_bundles(blocks_for(count), THREADS, camera, samples, here, regions, on_device)
        sum_bundles(
            count,
            threads,
            camera,
            resident(planes[some]) if each_its_planes else planes,
            samples,
            here,
            regions,
            on_device,
        )
        moments[some] = fetched(on_device)
