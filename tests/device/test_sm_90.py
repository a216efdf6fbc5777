"""Claim: kernels of devices compile for sm_90, spill nothing and stay below a number of registers. Nothing runs."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from device.sm_90 import assembled
from laws import rigs

from pipeline.camera.on_device import image_rays, moments
from pipeline.camera.on_device.regions import room_for_regions
from pipeline.camera.tracer import Tracer
from pipeline.camera.tracing.moments import COLUMNS
from pipeline.camera.tracing.records import Samples, Squares, Starts, no_diffraction
from pipeline.jit.binding import Single, in_single
from pipeline.jit.decorators import inline
from pipeline.jit.device import DeviceKernel, cuda
from pipeline.optics.crossing import Ray, cap_of, through_sphere

SPHERES, SINGLE, BOUNDING, SUMMING, TRACING = 64, 40, 160, 255, 128
"""Ceilings of registers per thread: a double counts twice. A block of 256 threads with 255 leaves no room for another
one on a processor of an H100."""


@inline
def through_spheres(table, rays, i):  # type: ignore[no-untyped-def]
    """Trace a ray through spheres: the inner loop of any lens."""
    ray = Ray(rays[i, 0], rays[i, 1], rays[i, 2], rays[i, 3], rays[i, 4], rays[i, 5], rays[i, 6])
    for k in range(table.shape[0]):
        ray = through_sphere(cap_of(table[k]), ray)
    rays[i, 0], rays[i, 1], rays[i, 2], rays[i, 3] = ray.x, ray.y, ray.z, ray.alive
    rays[i, 4], rays[i, 5], rays[i, 6] = ray.dx, ray.dy, ray.dz


through_in_single = Single(through_spheres)


@DeviceKernel
def spheres(table, rays):  # type: ignore[no-untyped-def]
    """One ray per thread."""
    i = cuda.blockIdx.x * cuda.blockDim.x + cuda.threadIdx.x
    if i < rays.shape[0]:
        through_spheres(table, rays, i)


@DeviceKernel
def spheres_in_single(table, rays):  # type: ignore[no-untyped-def]
    """The same in float32."""
    i = cuda.blockIdx.x * cuda.blockDim.x + cuda.threadIdx.x
    if i < rays.shape[0]:
        through_in_single(table, rays, i)


def launches() -> dict[str, tuple[DeviceKernel, int, tuple[Any, ...]]]:
    """Every kernel of devices by name, with its ceiling of registers and arguments."""
    camera = Tracer(rigs.conventional()).arrays
    samples = Samples(np.zeros((7, 64), np.uint32), 1, 0.05)
    starts = Starts(np.zeros((1, 2), np.int64), np.zeros((1, 2)), np.zeros((1, 2)), np.zeros(1, np.int64))
    found, one = np.zeros((1, COLUMNS)), np.ones((1, 1), np.int64)
    squares, shots = Squares(np.zeros((1, 2), np.int64), np.zeros((1, 2)), one, one, one), image_rays.Shots.of(one)
    light, rays = (samples, squares, no_diffraction()), np.zeros((7, 1), np.float32)
    regions = room_for_regions(1, np.zeros)
    planes, both = np.zeros((1, 2, 4, 3)), (camera, in_single(camera))
    return {
        "bound_bundles": (moments.bound_bundles, BOUNDING, (camera, samples, starts, regions, found)),
        "sum_bundles": (moments.sum_bundles, SUMMING, (camera, planes, samples, starts, regions, found)),
        "bound_squares": (image_rays.bound_squares, BOUNDING, (camera, squares, shots.owner, 0.1, regions)),
        "trace_shots": (image_rays.trace_shots, TRACING, (both, *light, shots, regions, rays)),
    }


@pytest.mark.parametrize(
    ("kernel", "kind", "ceiling"), [(spheres, np.float64, SPHERES), (spheres_in_single, np.float32, SINGLE)]
)
def test_spheres_keep_a_ray_in_registers(kernel: DeviceKernel, kind: type, ceiling: int, tmp_path: Path) -> None:
    found = assembled(kernel.bound, (np.zeros((1, 11), kind), np.zeros((1, 7), kind)), tmp_path)
    assert found.spilled == 0
    assert found.registers <= ceiling


@pytest.mark.heavy
@pytest.mark.parametrize("name", ["bound_bundles", "sum_bundles", "bound_squares", "trace_shots"])
def test_kernels_spill_nothing(name: str, tmp_path: Path) -> None:
    kernel, ceiling, arguments = launches()[name]
    found = assembled(kernel.bound, arguments, tmp_path)
    assert found.spilled == 0
    assert found.registers <= ceiling
    assert found.shared <= 48 * 1024
