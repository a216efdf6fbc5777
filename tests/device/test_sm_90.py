"""Claim: kernels of devices compile for sm_90, spill nothing and stay below a number of registers. Nothing runs."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from device.sm_90 import assembled
from laws import rigs

from pipeline.camera.tracer import Tracer
from pipeline.camera.tracing import device_moments
from pipeline.camera.tracing.moments import COLUMNS
from pipeline.camera.tracing.records import Samples, Starts
from pipeline.jit.device import DeviceKernel, cuda
from pipeline.optics.crossing import Ray, cap_of, through_sphere

SPHERES, BINDING, SUMMING = 64, 160, 255
"""Ceilings of registers per thread: a double counts twice. A block of 256 threads with 255 leaves no room for another
one on a processor of an H100."""


@DeviceKernel
def through_spheres(table, rays):  # type: ignore[no-untyped-def]
    """Trace one ray per thread through spheres: the inner loop of any lens."""
    i = cuda.blockIdx.x * cuda.blockDim.x + cuda.threadIdx.x
    if i < rays.shape[0]:
        ray = Ray(rays[i, 0], rays[i, 1], rays[i, 2], rays[i, 3], rays[i, 4], rays[i, 5], rays[i, 6])
        for k in range(table.shape[0]):
            ray = through_sphere(cap_of(table[k]), ray)
        rays[i, 0], rays[i, 1], rays[i, 2], rays[i, 3] = ray.x, ray.y, ray.z, ray.alive
        rays[i, 4], rays[i, 5], rays[i, 6] = ray.dx, ray.dy, ray.dz


def bundles() -> dict[str, tuple[Any, ...]]:
    """Arguments of both kernels of the moments of bundles."""
    camera = Tracer(rigs.conventional()).arrays
    samples = Samples(np.zeros((4, 64), np.uint32), 1, 0.0)
    starts = Starts(np.zeros((1, 2), np.int64), np.zeros((1, 2)), np.zeros((1, 2)), np.zeros(1, np.int64))
    regions, moments = device_moments.empty_regions(1), np.zeros((1, COLUMNS))
    return {
        "bind_bundles": (camera, samples, starts, regions, moments),
        "sum_bundles": (camera, np.zeros((1, 2, 4, 3)), samples, starts, regions, moments),
    }


def test_spheres_keep_a_ray_in_registers(tmp_path: Path) -> None:
    found = assembled(through_spheres.bound, (np.zeros((1, 11)), np.zeros((1, 7))), tmp_path)
    assert found.spilled == 0
    assert found.registers <= SPHERES


@pytest.mark.heavy
@pytest.mark.parametrize(("name", "ceiling"), [("bind_bundles", BINDING), ("sum_bundles", SUMMING)])
def test_moments_of_bundles_spill_nothing(name: str, ceiling: int, tmp_path: Path) -> None:
    found = assembled(getattr(device_moments, name).bound, bundles()[name], tmp_path)
    assert found.spilled == 0
    assert found.registers <= ceiling
    assert found.shared <= 48 * 1024
