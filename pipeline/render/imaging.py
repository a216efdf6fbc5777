"""Images: relative irradiance of every pixel, by tracing rays from the pixel's square through the camera."""

from collections.abc import Callable

import numpy as np

from pipeline.camera import kernels
from pipeline.camera.micro_images import MicroImages, strata
from pipeline.camera.regions import SKIP
from pipeline.camera.sobol import sobol_bits
from pipeline.camera.tracer import Tracer

Radiance = Callable[[np.ndarray, np.ndarray], np.ndarray]
"""(n, 3) origins and directions, vision frame, to (n,) radiances."""

_RAYS_PER_CHUNK = 1 << 20


def irradiance(
    tracer: Tracer,
    images: MicroImages | None,
    samples: int,
    radiance: Radiance | None,
    rows: tuple[int, int] | None = None,
) -> np.ndarray:
    """Integral of L over each pixel's rays, by the camera's weight, relative to that of a white scene on the axis.

    Parameters
    ----------
    images : MicroImages or None
        None for a conventional camera. Light through neighbouring microlenses is included.
    samples : int
        Rays per pixel and microlens, a power of two.
    radiance : callable or None
        None stands for a white scene: the white image.
    rows : (int, int), optional
        First and end of the rows that are wanted: the values of the whole image there.

    Returns
    -------
    (height, width) float64
    """
    return irradiance_and_crosstalk(tracer, images, samples, radiance, rows)[0]


def irradiance_and_crosstalk(
    tracer: Tracer,
    images: MicroImages | None,
    samples: int,
    radiance: Radiance | None,
    rows: tuple[int, int] | None = None,
) -> tuple[np.ndarray, np.ndarray]:
    """The image, and its part that came through other microlenses than that of the pixel's cell.

    Returns
    -------
    (height, width) float64, (height, width) float64
        See `irradiance`.
    """
    sensor = tracer.camera.sensor
    first_row, end_row = rows or (0, sensor.height_px)
    before = first_row * sensor.width_px
    result, foreign = np.zeros((2, (end_row - first_row) * sensor.width_px))
    bits = sobol_bits(samples)
    chunk = max(1, _RAYS_PER_CHUNK // (samples * _ways(tracer, images)))
    buffers = _buffers(0)
    for first in range(0, result.size, chunk):
        pixel = np.arange(first, min(first + chunk, result.size))
        x_px, y_px = pixel % sensor.width_px, (pixel + before) // sensor.width_px
        positions = tracer.positions_mm(x_px, y_px)
        lenses = strata(tracer, images, positions)
        most = int(np.count_nonzero(lenses != SKIP)) * samples
        if len(buffers[0]) < most:
            buffers = _buffers(most)
        origin, direction, weight, owner = buffers
        count = kernels.image_rays(
            *tracer.arrays,
            bits,
            tracer.seed,
            sensor.pitch_mm,
            np.stack([x_px, y_px], axis=1),
            positions,
            lenses,
            *buffers,
        )
        kernels.image_rays.count(most, len(tracer.table))
        value = weight[:count]
        if radiance is not None:
            value = value * radiance(origin[:count], direction[:count])
        row, way = np.divmod(owner[:count], lenses.shape[1])
        result[pixel] = np.bincount(row, value, minlength=len(pixel))
        foreign[pixel] = np.bincount(row[way > 0], value[way > 0], minlength=len(pixel))
    shape = end_row - first_row, sensor.width_px
    return result.reshape(shape) / tracer.reference_weight_sr, foreign.reshape(shape) / tracer.reference_weight_sr


def _ways(tracer: Tracer, images: MicroImages | None) -> int:
    """About how many microlenses light a pixel where most do; it decides only how many pixels go together."""
    if images is None:
        return 1
    middle = images.centre_mm[[len(images.centre_mm) // 2]]
    return max(4, int(np.count_nonzero(strata(tracer, images, middle) != SKIP)))


def _buffers(rays: int) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    return np.empty((rays, 3)), np.empty((rays, 3)), np.empty(rays), np.empty(rays, np.int64)
