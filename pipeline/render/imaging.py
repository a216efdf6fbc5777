"""Images: relative irradiance of every pixel, by tracing rays from the pixel's square through the camera.

What leaves the camera does not know the scene: images of several scenes share the rays.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from pipeline.camera import kernels
from pipeline.camera.micro_images import MicroImages, strata
from pipeline.camera.regions import SKIP
from pipeline.camera.sobol import sobol_bits
from pipeline.camera.tracer import Tracer

Radiance = Callable[[np.ndarray, np.ndarray], np.ndarray]
"""(n, 3) origins and directions, vision frame, to (n,) radiances."""

Rows = tuple[int, int]
"""First and end of some rows of an image."""

_RAYS_PER_CHUNK = 1 << 18
"""Rays that are traced before they are shaded, 64 bytes each: of 2^14 to 2^20 the fastest for one and for 8 scenes."""


def irradiance(
    tracer: Tracer, images: MicroImages | None, samples: int, radiance: Radiance | None, rows: Rows | None = None
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
        The rows that are wanted: the values of the whole image there.

    Returns
    -------
    (height, width) float64
    """
    return irradiances(tracer, images, samples, [radiance], rows)[0]


def irradiances(
    tracer: Tracer,
    images: MicroImages | None,
    samples: int,
    radiances: Sequence[Radiance | None],
    rows: Rows | None = None,
) -> np.ndarray:
    """Images of several scenes by the same rays, (scenes, height, width): each as `irradiance` gives it alone."""
    result = np.zeros((len(radiances), *_shape(tracer, rows)))
    flat = result.reshape(len(radiances), -1)
    for rays in _rays(tracer, images, samples, rows):
        for scene, radiance in zip(flat, radiances, strict=True):
            scene[rays.pixels] = np.bincount(rays.row, _value(rays, radiance), minlength=rays.count)
    return result / tracer.reference_weight_sr


def irradiance_and_crosstalk(
    tracer: Tracer, images: MicroImages | None, samples: int, radiance: Radiance | None, rows: Rows | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """The image, and its part that came through other microlenses than that of the pixel's cell.

    Returns
    -------
    (height, width) float64, (height, width) float64
        See `irradiance`.
    """
    shape = _shape(tracer, rows)
    result, foreign = np.zeros((2, shape[0] * shape[1]))
    for rays in _rays(tracer, images, samples, rows):
        value, other = _value(rays, radiance), rays.way > 0
        result[rays.pixels] = np.bincount(rays.row, value, minlength=rays.count)
        foreign[rays.pixels] = np.bincount(rays.row[other], value[other], minlength=rays.count)
    return result.reshape(shape) / tracer.reference_weight_sr, foreign.reshape(shape) / tracer.reference_weight_sr


def _shape(tracer: Tracer, rows: Rows | None) -> tuple[int, int]:
    first, end = rows or (0, tracer.camera.sensor.height_px)
    return end - first, tracer.camera.sensor.width_px


@dataclass(frozen=True, slots=True)
class _Rays:
    """Rays of a stretch of pixels.

    Attributes
    ----------
    pixels : slice
        The pixels, counted from the first row that is wanted.
    origin, direction : (n, 3) float64
        A point behind the front vertex and the unit direction, vision frame, mm.
    weight : (n,) float64
        Share of the pixel's integral.
    row, way : (n,) int64
        Pixel within the stretch, and place of the microlens among those that light it; 0 is that of its cell.
    """

    pixels: slice
    origin: np.ndarray
    direction: np.ndarray
    weight: np.ndarray
    row: np.ndarray
    way: np.ndarray

    @property
    def count(self) -> int:
        """Number of pixels."""
        return int(self.pixels.stop - self.pixels.start)


def _value(rays: _Rays, radiance: Radiance | None) -> np.ndarray:
    return rays.weight if radiance is None else rays.weight * radiance(rays.origin, rays.direction)


def _rays(tracer: Tracer, images: MicroImages | None, samples: int, rows: Rows | None) -> Iterator[_Rays]:
    """The rays of all pixels, stretch by stretch; the next stretch takes the arrays of the last one."""
    sensor, (height, width) = tracer.camera.sensor, _shape(tracer, rows)
    before = rows[0] * width if rows else 0
    bits = sobol_bits(samples)
    stretch = max(1, _RAYS_PER_CHUNK // (samples * _ways(tracer, images)))
    buffers = _buffers(0)
    for first in range(0, height * width, stretch):
        pixels = slice(first, min(first + stretch, height * width))
        y_px, x_px = np.divmod(np.arange(pixels.start + before, pixels.stop + before), width)
        positions = tracer.positions_mm(x_px, y_px)
        lenses = strata(tracer, images, positions)
        most = int(np.count_nonzero(lenses != SKIP)) * samples
        if len(buffers[0]) < most:
            buffers = _buffers(most)
        numbers = np.stack([x_px, y_px], axis=1)
        count = kernels.image_rays(
            *tracer.arrays, bits, tracer.seed, sensor.pitch_mm, numbers, positions, lenses, *buffers
        )
        kernels.image_rays.count(most, len(tracer.table))
        origin, direction, weight, owner = (buffer[:count] for buffer in buffers)
        yield _Rays(pixels, origin, direction, weight, *np.divmod(owner, lenses.shape[1]))


def _ways(tracer: Tracer, images: MicroImages | None) -> int:
    """About how many microlenses light a pixel where most do; it decides only how many pixels go together."""
    if images is None:
        return 1
    middle = images.centre_mm[[len(images.centre_mm) // 2]]
    return max(4, int(np.count_nonzero(strata(tracer, images, middle) != SKIP)))


def _buffers(rays: int) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    return np.empty((rays, 3)), np.empty((rays, 3)), np.empty(rays), np.empty(rays, np.int64)
