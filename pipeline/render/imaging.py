"""Images: relative irradiance of every pixel, by tracing rays from the pixel's square through the camera."""

from collections.abc import Callable

import numpy as np

from pipeline.camera import kernels
from pipeline.camera.micro_images import MicroImages, strata
from pipeline.camera.sobol import sobol_bits
from pipeline.camera.tracer import Tracer

Radiance = Callable[[np.ndarray, np.ndarray], np.ndarray]
"""(n, 3) origins and directions, vision frame, to (n,) radiances."""

_RAYS_PER_CHUNK = 1 << 20


def irradiance(tracer: Tracer, images: MicroImages | None, samples: int, radiance: Radiance | None) -> np.ndarray:
    """Integral of L cos(theta) d omega over each pixel, relative to that of a white scene on the axis.

    Parameters
    ----------
    images : MicroImages or None
        None for a conventional camera. Light through neighbouring microlenses is included.
    samples : int
        Rays per pixel and microlens, a power of two.
    radiance : callable or None
        None stands for a white scene: the white image.

    Returns
    -------
    (height, width) float64
    """
    sensor = tracer.camera.sensor
    result = np.zeros(sensor.height_px * sensor.width_px)
    bits = sobol_bits(samples)
    lenses = 4 if images else 1
    chunk = max(1, _RAYS_PER_CHUNK // (samples * lenses))
    buffers = _buffers(chunk * samples * lenses)
    for first in range(0, result.size, chunk):
        pixel = np.arange(first, min(first + chunk, result.size))
        x_px, y_px = pixel % sensor.width_px, pixel // sensor.width_px
        positions = tracer.positions_mm(x_px, y_px)
        origin, direction, weight, owner = buffers
        count = kernels.image_rays(
            *tracer.arrays,
            bits,
            tracer.seed,
            sensor.pitch_mm,
            np.stack([x_px, y_px], axis=1),
            positions,
            strata(tracer, images, positions),
            *buffers,
        )
        value = weight[:count]
        if radiance is not None:
            value = value * radiance(origin[:count], direction[:count])
        result[pixel] = np.bincount(owner[:count], value, minlength=len(pixel))
    return result.reshape(sensor.height_px, sensor.width_px) / tracer.reference_weight_sr


def _buffers(rays: int) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    return np.empty((rays, 3)), np.empty((rays, 3)), np.empty(rays), np.empty(rays, np.int64)
