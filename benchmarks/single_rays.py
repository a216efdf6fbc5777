"""Rays of images in float32 as Numba compiles them for processors: the twin of what a device runs.

It says how far float32 moves rays, and judges what CUDA and its simulator make of the same functions.
"""

import functools
from typing import Any

import numpy as np

from pipeline.camera import on_device
from pipeline.camera.tracing.packets import Aims
from pipeline.camera.tracing.records import (
    CameraArrays,
    Diffraction,
    Leaving,
    Samples,
    SensorPoints,
    Squares,
)
from pipeline.camera.tracing.sampling_bounds import new_region
from pipeline.jit.binding import bound_anew, in_single
from pipeline.jit.decorators import _numba, fma
from pipeline.optics.kernels import SCRATCH, Packet


def single_leaving(camera: CameraArrays, samples: Samples, squares: Squares, diffraction: Diffraction) -> Leaving:
    """The rays that leave the camera, as those of `image_rays` on processors."""
    leaving, rays = Leaving.empty(int(squares.counts.sum())), np.zeros((7, int(squares.counts.sum())), np.float32)
    started = on_device.Started.of(squares.counts)
    aims, single = np.zeros((4, 1)), np.zeros((10, 1), np.float32)
    buffers = (
        new_region.function(),
        Aims(*aims, np.zeros((SCRATCH, 1))),
        SensorPoints(*single[8:]),
        Packet(*single[:7], np.zeros((SCRATCH, 1), np.float32), single[7]),
    )
    _traced()((camera, in_single(camera)), (samples, squares, diffraction), started, *buffers, rays)
    return leaving.first(on_device.leaving_rays(rays, 0, squares.counts, leaving))


@functools.cache
def _traced() -> Any:
    """All rays, one after the other."""
    compiled = _numba().njit(nogil=True, error_model="numpy")
    trace_square = compiled(bound_anew(on_device.trace_square.function, compiled, fma=fma))

    @compiled
    def trace(cameras, light, started, region, aims, start, packet, rays):  # type: ignore[no-untyped-def]
        for k in range(started.owner.shape[0]):
            trace_square(cameras, light, (started, k), region, aims, start, packet, rays)

    return trace
