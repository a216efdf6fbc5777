"""Rays of images in float32 as Numba compiles them for processors: the twin of what a device runs.

It says how far float32 moves rays, and judges what CUDA and its simulator make of the same functions.
"""

import functools
from typing import Any

import numpy as np

from pipeline.camera.on_device import image_rays
from pipeline.camera.on_device.regions import room_for_regions
from pipeline.camera.tracing.records import CameraArrays, Diffraction, Leaving, Samples, Squares, room_for
from pipeline.camera.tracing.sampling_bounds import bound, new_region
from pipeline.jit.binding import bound_anew, in_single
from pipeline.jit.decorators import _numba, fma


def single_leaving(camera: CameraArrays, samples: Samples, squares: Squares, diffraction: Diffraction) -> Leaving:
    """The rays that leave the camera, as those of `image_rays` on processors."""
    room = room_for(int(squares.counts.sum()))
    rays = single_rays(camera, samples, squares, diffraction)
    return room.first(image_rays.leaving_rays(rays, 0, squares.counts, room))


def single_rays(camera: CameraArrays, samples: Samples, squares: Squares, diffraction: Diffraction) -> np.ndarray:
    """The same as `ImageRays.started`, in the simulator or without any device."""
    shots = image_rays.Shots.of(squares.counts)
    regions, rays = room_for_regions(len(shots.owner), np.empty), np.zeros((7, len(shots.of_ray)), np.float32)
    reach_mm = image_rays.reach_of.function(samples, diffraction)
    _traced()((camera, in_single(camera)), samples, squares, diffraction, shots, regions, reach_mm, rays)
    return rays


@functools.cache
def _traced() -> Any:
    """All rays, one after the other."""
    numba = _numba()
    compiled = numba.njit(nogil=True, error_model="numpy")
    shot = compiled(bound_anew(image_rays.shot.function, compiled, fma=fma))
    bounded, buffers = bound.compiled, new_region.compiled

    @compiled
    def trace(cameras, samples, squares, diffraction, shots, regions, reach, rays):  # type: ignore[no-untyped-def]
        region, places = buffers(), squares.strata.shape[1]
        for k in range(shots.owner.shape[0]):
            n, j = shots.owner[k] // places, shots.owner[k] % places
            x, y = squares.positions[n, 0], squares.positions[n, 1]
            fan = bounded(cameras[0], squares.strata[n, j], x, y, reach, region)
            regions.polygons[k], regions.cumulative[k] = region.polygon, region.cumulative
            regions.vertices[k], regions.area[k] = fan.vertices, fan.area
            regions.centre[k, 0], regions.centre[k, 1] = fan.x, fan.y
        for i in range(rays.shape[1]):
            if not regions.area[shots.of_ray[i]] > 0.0:
                continue
            ray, share = shot(cameras, samples, squares, diffraction, shots, regions, i)
            if ray.alive > 0.0:
                rays[0, i], rays[1, i], rays[2, i] = ray.x, ray.y, ray.z
                rays[3, i], rays[4, i], rays[5, i], rays[6, i] = ray.dx, ray.dy, ray.dz, share

    return trace
