"""Rays of images on a device, one by each thread, in single precision.

The same rays as those of `camera.tracing.bundle_kernels.image_rays` on processors, and in the same order. Where a ray
starts and where it is aimed are float64, so that both have the same random numbers; its way through microlens and lens
is float32. Functions of one ray are those of processors.
"""

import math
from typing import NamedTuple

import numpy as np

from pipeline.camera.on_device.one_ray import send_ray
from pipeline.camera.on_device.regions import THREADS, blocks_for, room_for_regions, write_region
from pipeline.camera.parts.polygon import MAX_VERTICES, point_in_fan
from pipeline.camera.tracing.bundle_kernels import IMAGE_STREAM, SPREAD_STREAM, reach_of
from pipeline.camera.tracing.packets import region_drift
from pipeline.camera.tracing.records import CameraArrays, Diffraction, Samples, Squares
from pipeline.camera.tracing.sampling_bounds import Region
from pipeline.camera.tracing.sobol import hash32, scrambled
from pipeline.camera.tracing.spreading import moved
from pipeline.errors import EnvironmentFault
from pipeline.jit.binding import Single, in_single
from pipeline.jit.decorators import inline, kernel
from pipeline.jit.device import DeviceKernel, cuda, fetched, require_device, resident, room
from pipeline.records.shapes import Float32, Float64, Int64

_COLUMNS, _SHARE = 7, 6
"""Numbers of a ray: a point, its direction, and its share, which is 0 if it is blocked or carries no light."""
_TRACING = 256
"""Threads of a block that traces rays."""

send_single = Single(send_ray, STILL_MM=1e-3, RESIDUAL_MM=1e-4, SETTLED_SQUARED=1e-12)
"""One ray in float32. A step of Newton's method to an asphere is the last one if the next would be below rounding, and
a residual of some roundings of 100 mm is none; directions of Brown's model are found if six of their digits are."""


class Shots(NamedTuple):
    """Rays that start, by the squares and microlenses that they belong to."""

    owner: np.ndarray  # (m,) int64, what has any rays: numbers as in `Leaving.owner`
    first: np.ndarray  # (m,) int64, number of the first ray of each
    of_ray: np.ndarray  # (rays,) int32, which of them each ray belongs to

    @staticmethod
    def of(counts: Int64[np.ndarray, "n s"]) -> "Shots":
        """So many rays of each square and microlens."""
        owner = np.flatnonzero(counts)
        some = counts.reshape(-1)[owner]
        return Shots(owner, np.cumsum(some) - some, np.repeat(np.arange(len(owner), dtype=np.int32), some))


@DeviceKernel
def bound_squares(camera, squares, owner, reach, regions):
    """Bound what passes of the rays of every square and microlens, one by each thread.

    `owner`: (m,) int64, as in `Shots`.
    `reach`: farthest that a ray starts from the middle of its square [mm].
    `regions`: written.
    """
    outline = cuda.local.array((MAX_VERTICES, 2), np.float64)
    scratch = cuda.local.array((MAX_VERTICES, 2), np.float64)
    k = cuda.blockIdx.x * cuda.blockDim.x + cuda.threadIdx.x
    if k < owner.shape[0]:
        n, j = owner[k] // squares.strata.shape[1], owner[k] % squares.strata.shape[1]
        x, y, region = squares.positions[n, 0], squares.positions[n, 1], regions.polygons[k]
        buffers = Region(region, outline, scratch, regions.cumulative[k])
        write_region(camera, squares.strata[n, j], x, y, reach, buffers, regions, k)


@DeviceKernel
def trace_shots(cameras, samples, squares, diffraction, shots, regions, rays):
    """Trace every ray, one by each thread.

    `cameras`: (CameraArrays, CameraArrays), the camera, and the same in float32.
    `samples`, `squares`, `diffraction`: as in `camera.tracing.bundle_kernels.image_rays`.
    `regions`: from `bound_squares`.
    `rays`: (_COLUMNS, rays) float32, written.
    """
    i = cuda.blockIdx.x * cuda.blockDim.x + cuda.threadIdx.x
    if i >= rays.shape[1]:
        return
    rays[_SHARE, i] = 0.0
    if regions.area[shots.of_ray[i]] > 0.0:
        ray, share = shot(cameras, samples, squares, diffraction, shots, regions, i)
        if ray.alive > 0.0:
            rays[0, i], rays[1, i], rays[2, i] = ray.x, ray.y, ray.z
            rays[3, i], rays[4, i], rays[5, i] = ray.dx, ray.dy, ray.dz
            rays[_SHARE, i] = share


@inline
def shot(cameras, samples, squares, diffraction, shots, regions, i):
    """A ray of an image, and its share if it passes; from where something passes."""
    camera, single = cameras
    bits, seed, edge = samples
    k, places = shots.of_ray[i], squares.strata.shape[1]
    n, j = shots.owner[k] // places, shots.owner[k] % places
    microlens, index = squares.strata[n, j], squares.skipped[n, j] + i - shots.first[k]
    base, stream = hash32(hash32(seed, squares.pixels[n, 0]), squares.pixels[n, 1]), IMAGE_STREAM + 4 * j
    sx, sy = squares.positions[n, 0], squares.positions[n, 1]
    x = sx + edge * (scrambled(bits[0, index], hash32(base, stream)) - 0.5)
    y = sy + edge * (scrambled(bits[1, index], hash32(base, stream + 1)) - 0.5)
    if diffraction.edge_mm.shape[0] > 0:
        choice = scrambled(bits[4, index], hash32(base, SPREAD_STREAM + 3 * j))
        along_x = scrambled(bits[5, index], hash32(base, SPREAD_STREAM + 3 * j + 1))
        along_y = scrambled(bits[6, index], hash32(base, SPREAD_STREAM + 3 * j + 2))
        x, y = moved(diffraction, microlens, x, y, choice, along_x, along_y)
    u = scrambled(bits[2, index], hash32(base, stream + 2))
    v = scrambled(bits[3, index], hash32(base, stream + 3))
    polygons, cumulative, vertices, centre, area = regions
    px, py = point_in_fan(polygons[k], vertices[k], cumulative[k], centre[k, 0], centre[k, 1], u, v)
    drift = region_drift(camera, microlens)
    px, py = px + drift * (x - sx), py + drift * (y - sy)
    ray, weight = send_single(single, microlens, np.float32(x), np.float32(y), np.float32(px), np.float32(py))
    return ray, weight * np.float32(area[k] / squares.counts[n, j])


class ImageRays:
    """Rays of a camera's images; what does not depend on pixels is on the device.

    `device`: name of the device, see `pipeline.jit.device`.
    `samples`, `diffraction`: as in `camera.tracing.bundle_kernels.image_rays`.
    Raises EnvironmentFault: the device cannot be used, or a number of the lens is too small for float32.
    """

    def __init__(self, device: str, camera: CameraArrays, samples: Samples, diffraction: Diffraction) -> None:
        require_device(device)
        _require_normal(camera.table)
        self._reach_mm = reach_of.function(samples, diffraction)
        self._cameras = resident(camera), resident(in_single(camera))
        self._samples, self._diffraction = resident(samples), resident(diffraction)

    def started(self, squares: Squares) -> Float32[np.ndarray, "7 rays"]:
        """All rays that start from squares, in the order of squares, microlenses and samples, for `leaving_rays`."""
        shots = Shots.of(squares.counts)
        count = len(shots.owner)
        on_device, owners = resident(squares), resident(shots)
        regions, rays = room_for_regions(count), room((_COLUMNS, len(shots.of_ray)), np.float32)
        if rays.size:
            blocks = blocks_for(count)
            bound_squares(blocks, THREADS, self._cameras[0], on_device, owners.owner, self._reach_mm, regions)
            blocks, parts = blocks_for(rays.shape[1], _TRACING), (self._samples, on_device, self._diffraction)
            trace_shots(blocks, _TRACING, self._cameras, *parts, owners, regions, rays)
        return fetched(rays)


def _require_normal(table: Float64[np.ndarray, "surfaces columns"]) -> None:
    """Refuse numbers that float32 would make zero or cut: a surface would be another one, and nothing would say so."""
    if np.any((table != 0) & (np.abs(table) < np.finfo(np.float32).tiny)):
        raise EnvironmentFault(
            "a coefficient of the lens is too small for float32, in which devices trace images",
            hint="leave --device out",
        )


@kernel
def leaving_rays(rays, first, counts, leaving):
    """Copy those of started rays that leave the camera, as `camera.tracing.bundle_kernels.image_rays` writes them.

    `rays`: (_COLUMNS, n) float32, from `ImageRays.started`.
    `first`: number of the first ray of these squares.
    `counts`: (m, s) int64, rays of each square through each microlens.
    `leaving`: written; room for all rays.
    Returns int: number of rays written.
    """
    origin, direction, share, owner = leaving
    of_owner, i, written = counts.reshape(-1), first, 0
    for k in range(of_owner.shape[0]):
        for _ in range(of_owner[k]):
            if rays[_SHARE, i] > 0.0:
                origin[written, 0], origin[written, 1], origin[written, 2] = rays[0, i], rays[1, i], rays[2, i]
                dx, dy, dz = np.float64(rays[3, i]), np.float64(rays[4, i]), np.float64(rays[5, i])
                to_unit = 1.0 / math.sqrt(dx * dx + dy * dy + dz * dz)
                direction[written, 0], direction[written, 1] = to_unit * dx, to_unit * dy
                direction[written, 2] = to_unit * dz
                share[written], owner[written] = rays[_SHARE, i], k
                written += 1
            i += 1
    return written
