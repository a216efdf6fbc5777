"""The image of a point with diffraction: point-spread function, Strehl ratio, transfer function, shift of a corner.

With P the pupil over the direction cosines (a, b), W the wavefront error and k = 2 pi / wavelength, the amplitude at
(x, y) from the image position is the integral of P exp(i k (W - a x - b y)) da db (Huygens's sum; each wave is plane
over the few micrometres of an image). It is computed by matrix products at any points, and by a Fourier transform on a
grid that holds the complete image; the transfer function is the Fourier transform of the image.

The corner is infinite, of four sectors, black and white, with its edges along x and y of the image, and its image is
everywhere that of one point: E is the convolution of the corner with the point-spread function, integrated over the
square of a pixel. Its derivative along x is the light of the spread in the pixel's column above a position less that
below, and vanishes where both are equal; likewise along y.
"""

from collections.abc import Callable

import numpy as np

from pipeline.camera.tracer import Tracer
from pipeline.camera.tracing.records import Diffraction
from pipeline.camera.tracing.sampling_bounds import NO_MICROLENS
from pipeline.camera.wave.wavefront import View, Wavefront, aperture
from pipeline.records.shapes import Float64

_PEAK = 0.2
"""Spacing of points around a peak over wavelength / (2 numerical aperture) [1]: it is a parabola to a thousandth
there."""
_STEPS = 60
"""Most steps of the search; each reduces the miss, the more the more symmetric the spread."""
_DONE = 1e-9
"""Step at which the search has converged, over a pixel's edge [1]."""
_SOFT = 1 / 16
"""Width of the soft sides of a pixel over its edge [1]: rays are single points, and sums over them must vary
smoothly."""
Middle = tuple[float, float, int]
"""A position on the sensor, vision frame [mm], and the row of the microlens that lights it."""
NODES = 5
"""Nodes along an axis of the sensor: between them the vignetted pupils of camera lenses change by a few percent."""
_CELLS, _PER_WIDTH = 160, 8
"""Cells of a picture along an axis, and cells per wavelength over the pupil's width: the picture ends behind the ninth
dark ring, with 2 percent of the light beyond it, and a cell blurs less than a hundredth of the contrast."""
_PUPIL = 64
"""Cells of a pupil along an axis: the image of its edge repeats 64 widths away, far beyond the picture."""


def phasors(front: Wavefront) -> np.ndarray:
    """P exp(i k W) in each cell, (n, n) complex."""
    return np.asarray(front.share * np.exp(2j * np.pi / front.wavelength_mm * front.path_mm))


def intensity(front: Wavefront, x_mm: Float64[np.ndarray, "m"], y_mm: Float64[np.ndarray, "n"]) -> np.ndarray:
    """Light per area at points of a grid on the sensor, from the image position, (n, m) [1/mm^2]; its integral is 1."""
    a, b = front.cosines
    wave_number = 2 * np.pi / front.wavelength_mm
    to_x, to_y = (np.exp(-1j * wave_number * np.outer(u, v)) for u, v in ((a, x_mm), (b, y_mm)))
    amplitude = to_y.T @ phasors(front) @ to_x * front.step**2
    return np.abs(amplitude) ** 2 / _energy(front)


def full_image(front: Wavefront) -> tuple[np.ndarray, np.ndarray]:
    """The complete image on the grid that determines it, by a fast Fourier transform.

    Returns (2n,) float64, (2n, 2n) float64: x of columns and y of rows [mm], and the light per area [1/mm^2].
    """
    size = 2 * len(front.share)
    # Points are wavelength / (2 n step) apart: the autocorrelation of the pupil, twice as wide as it, just fits.
    amplitude = np.fft.fftshift(np.fft.fft2(phasors(front), s=(size, size))) * front.step**2
    x_mm = (np.arange(size) - size // 2) * front.wavelength_mm / (size * front.step)
    return x_mm, np.abs(amplitude) ** 2 / _energy(front)


def _energy(front: Wavefront) -> float:
    """Integral of the squared amplitude over the sensor, by Parseval's theorem: each part of a cell is lit or dark."""
    return front.wavelength_mm**2 * front.area


def strehl_ratio(front: Wavefront) -> float:
    """Largest light per area over that of the aberration-free pupil in its middle."""
    x_mm, image = full_image(front)
    row, column = np.unravel_index(np.argmax(image), image.shape)
    # Refine the brightest point of the grid by the vertex of parabolas along x and along y, twice.
    step = _PEAK * front.wavelength_mm / (2 * front.numerical_aperture)
    peak_mm = np.array([x_mm[column], x_mm[row]])
    for _ in range(2):
        near = step * np.arange(-1, 2)
        light = intensity(front, peak_mm[0] + near, peak_mm[1] + near)
        moves = [_vertex(light[1]) * step, _vertex(light[:, 1]) * step]
        peak_mm = peak_mm + np.clip(moves, -step, step)
        step = step / 8
    peak = intensity(front, peak_mm[:1], peak_mm[1:])[0, 0]
    return float(peak / intensity(front.perfect(), np.zeros(1), np.zeros(1))[0, 0])


def _vertex(values: np.ndarray) -> float:
    """Position of the extremum of a parabola through values at -1, 0 and 1."""
    bend = values[0] - 2 * values[1] + values[2]
    return float((values[0] - values[2]) / (2 * bend)) if bend else 0.0


def transfer(front: Wavefront, per_mm: Float64[np.ndarray, "n"], along: Float64[np.ndarray, "2"]) -> np.ndarray:
    """Optical transfer function at spatial frequencies along a unit vector of the sensor, (n,) complex.

    Its absolute value is the modulation transfer function. The image is band-limited, so its sum over the grid of
    `full_image` is exact at any frequency; only the cusp at 0, where the value is 1, is rounded off by the cells.
    """
    x_mm, image = full_image(front)
    waves = [np.exp(-2j * np.pi * np.outer(x_mm, per_mm * part)) for part in along]
    sums = np.sum(waves[1] * (image @ waves[0]), axis=0)
    area = (x_mm[1] - x_mm[0]) ** 2
    width = len(front.share) * front.step
    shift = front.wavelength_mm * np.abs(per_mm) * np.abs(along).max()
    return np.where(per_mm == 0, 1.0, np.where(shift < width, sums * area, 0.0))


def transfer_of_rays(front: Wavefront, per_mm: Float64[np.ndarray, "n"], along: Float64[np.ndarray, "2"]) -> np.ndarray:
    """Optical transfer function by geometry: the Fourier transform of the spots of rays, (n,) complex."""
    lit = front.share > 0
    spot = front.crossings_mm[lit] @ along
    weight = front.share[lit] / front.share.sum()
    return np.array([weight @ np.exp(-2j * np.pi * frequency * spot) for frequency in per_mm])


def saddle_of_light(front: Wavefront, pitch_mm: float) -> np.ndarray:
    """Saddle in the image with diffraction, relative to the mean of the rays, (2,) [mm]; vision frame."""
    x_mm, image = full_image(front)
    light = image / image.sum()
    return _saddle(lambda x, y: y(x_mm) @ light @ x(x_mm), pitch_mm)


def saddle_of_rays(front: Wavefront, pitch_mm: float) -> np.ndarray:
    """Saddle in the image by geometry, relative to the mean of the rays, (2,) [mm]."""
    lit = front.share > 0
    spots = front.crossings_mm[lit]
    weight = front.share[lit] / front.share.sum()
    return _saddle(lambda x, y: np.sum(weight * x(spots[:, 0]) * y(spots[:, 1])), pitch_mm)


def _saddle(light_of, edge_mm: float) -> np.ndarray:  # type: ignore[no-untyped-def]
    """The corner position where both derivatives vanish; `light_of` weights the spread by functions of x and y.

    A quasi-Newton method, whose mixed derivative is that of a spread within one pixel.
    """

    def inside(position: float) -> Callable[[np.ndarray], np.ndarray]:
        """Indicator of the pixel about a position along an axis: 1 inside, with soft sides."""
        return lambda x: np.clip((edge_mm / 2 - np.abs(x - position)) / (_SOFT * edge_mm) + 0.5, 0.0, 1.0)

    def side(position: float) -> Callable[[np.ndarray], np.ndarray]:
        """Share of the pixel about x before an edge at a position, less the share beyond it."""
        return lambda x: np.clip(2 * (position - x) / edge_mm, -1.0, 1.0)

    corner = np.zeros(2)
    for _ in range(_STEPS):
        in_x, in_y = inside(corner[0]), inside(corner[1])
        slope = light_of(in_x, in_y) * 2 / edge_mm
        step = np.array([light_of(side(corner[0]), in_y), light_of(in_x, side(corner[1]))]) / slope
        step = np.clip(step, -edge_mm, edge_mm)
        corner = corner - step
        if np.abs(step).max() < _DONE * edge_mm:
            break
    return corner


def spread_of(tracer: Tracer, wavelength_nm: float, middles: tuple[Middle, ...]) -> Diffraction:
    """Spread of a camera's apertures at one wavelength; `middles`: one for each type of microlens."""
    # One picture for each type of microlens, or for each node of a grid over the sensor.
    if middles and tracer.lattice is not None:
        views = [View(np.array([x, y]), row, np.inf) for x, y, row in middles]
        node_mm = np.ones(2)
        of_microlens = tracer.lattice.type.astype(np.int64)
    else:
        sensor = tracer.camera.sensor
        nodes = np.arange(NODES) - (NODES - 1) / 2
        extent = np.abs([sensor.offset_x_mm, sensor.offset_y_mm]) + np.array(sensor.size_mm) / 2
        node_mm = 2 * extent / (NODES - 1)
        of_microlens = np.zeros(0, np.int64)
        views = [View(np.array([x, y]) * node_mm, NO_MICROLENS, np.inf) for y in nodes for x in nodes]
    pictures, edges = zip(*(_picture(tracer, wavelength_nm, view) for view in views), strict=True)
    # Cumulative sums, by which a random number draws a row and another one a cell of it.
    rows = np.cumsum(np.stack(pictures).sum(axis=2), axis=1)
    cells = np.cumsum(pictures, axis=2)
    rows, cells = (np.ascontiguousarray(sums / sums[..., -1:]) for sums in (rows, cells))
    return Diffraction(rows, cells, np.array(edges), node_mm, of_microlens)


def _picture(tracer: Tracer, wavelength_nm: float, view: View) -> tuple[Float64[np.ndarray, "n n"], float]:
    """Light in the cells of a picture, and their edge [mm]; for a dark position all light lies in the middle."""
    front = aperture(tracer, view, wavelength_nm, _PUPIL)
    if front is None:
        picture = np.full((_CELLS, _CELLS), 1e-12)
        picture[_CELLS // 2, _CELLS // 2] = 1.0
        return picture, tracer.camera.sensor.pitch_mm * 1e-6
    edge = front.wavelength_mm / ((_PUPIL - 2) * front.step) / _PER_WIDTH
    middles = (np.arange(_CELLS) - (_CELLS - 1) / 2) * edge
    light = intensity(front, middles, middles) * edge**2
    # Light beyond the picture becomes an even veil over it, which reduces contrast as the real one does.
    return light + max(1 - light.sum(), 0.0) / light.size, edge
