"""The image of a point by diffraction: its spread on the sensor, Strehl ratio and transfer of contrast.

With P the pupil over the direction cosines (a, b), W the wavefront error and k = 2 pi / wavelength, the amplitude at
(x, y) from the image position is the integral of P exp(i k (W - a x - b y)) da db (Huygens's sum, each wave plane over
the few micrometres of an image). It is computed by matrix products at any points, and by a Fourier transform on a grid
that holds the whole image; the transfer function is the Fourier transform of the image.
"""

import numpy as np

from pipeline.camera.wave.wavefront import Wavefront
from pipeline.records.shapes import Float64

_PEAK = 0.2
"""Distance of the points at which the peak is sought over wavelength / (2 numerical aperture) [1]: between them it is a
parabola to a thousandth."""


def phasors(front: Wavefront) -> np.ndarray:
    """P exp(i k W) in each cell, (n, n) complex."""
    return np.asarray(front.share * np.exp(2j * np.pi / front.wavelength_mm * front.path_mm))


def intensity(front: Wavefront, x_mm: Float64[np.ndarray, "m"], y_mm: Float64[np.ndarray, "n"]) -> np.ndarray:
    """Light per area at points of a grid on the sensor, from the image position, (n, m) [1/mm^2]; in all it is 1."""
    a, b = front.cosines
    wave_number = 2 * np.pi / front.wavelength_mm
    to_x, to_y = (np.exp(-1j * wave_number * np.outer(u, v)) for u, v in ((a, x_mm), (b, y_mm)))
    amplitude = to_y.T @ phasors(front) @ to_x * front.step**2
    return np.abs(amplitude) ** 2 / _energy(front)


def whole_image(front: Wavefront) -> tuple[np.ndarray, np.ndarray]:
    """The whole image on the grid that determines it, by a fast Fourier transform.

    Returns
    -------
    (2n,) float64, (2n, 2n) float64
        x of columns and y of rows [mm], and the light per area [1/mm^2].
    """
    size = 2 * len(front.share)
    # Points are wavelength / (2 n step) apart: the autocorrelation of the pupil, twice as wide as it, just fits.
    amplitude = np.fft.fftshift(np.fft.fft2(phasors(front), s=(size, size))) * front.step**2
    x_mm = (np.arange(size) - size // 2) * front.wavelength_mm / (size * front.step)
    return x_mm, np.abs(amplitude) ** 2 / _energy(front)


def _energy(front: Wavefront) -> float:
    """Integral of the squared amplitude over the sensor, by Parseval's theorem: a cell is lit or dark in each place."""
    return front.wavelength_mm**2 * front.area


def strehl_ratio(front: Wavefront) -> float:
    """Largest light per area over that of the same pupil without any error in its middle."""
    x_mm, image = whole_image(front)
    row, column = np.unravel_index(np.argmax(image), image.shape)
    step = _PEAK * front.wavelength_mm / (2 * front.numerical_aperture)
    place = np.array([x_mm[column], x_mm[row]])
    for _ in range(2):
        near = step * np.arange(-1, 2)
        light = intensity(front, place[0] + near, place[1] + near)
        moves = [_vertex(light[1]) * step, _vertex(light[:, 1]) * step]
        place, step = place + np.clip(moves, -step, step), step / 8
    peak = intensity(front, place[:1], place[1:])[0, 0]
    return float(peak / intensity(front.perfect(), np.zeros(1), np.zeros(1))[0, 0])


def _vertex(values: np.ndarray) -> float:
    """Place of the extreme of a parabola through values at -1, 0 and 1."""
    bend = values[0] - 2 * values[1] + values[2]
    return float((values[0] - values[2]) / (2 * bend)) if bend else 0.0


def transfer(front: Wavefront, per_mm: Float64[np.ndarray, "n"], along: Float64[np.ndarray, "2"]) -> np.ndarray:
    """Optical transfer function at spatial frequencies along a unit vector of the sensor, (n,) complex.

    Its absolute value is the modulation transfer function. The image is band-limited, so its sum over the grid of
    `whole_image` is exact at any frequency; only the cusp at 0, where the value is 1, is rounded off by the cells.
    """
    x_mm, image = whole_image(front)
    waves = [np.exp(-2j * np.pi * np.outer(x_mm, per_mm * part)) for part in along]
    found = np.sum(waves[1] * (image @ waves[0]), axis=0)
    area, width = (x_mm[1] - x_mm[0]) ** 2, len(front.share) * front.step
    shift = front.wavelength_mm * np.abs(per_mm) * np.abs(along).max()
    return np.where(per_mm == 0, 1.0, np.where(shift < width, found * area, 0.0))


def transfer_of_rays(front: Wavefront, per_mm: Float64[np.ndarray, "n"], along: Float64[np.ndarray, "2"]) -> np.ndarray:
    """The same by geometry: the Fourier transform of the spots of rays, (n,) complex."""
    lit = front.share > 0
    spot, weight = front.crossings_mm[lit] @ along, front.share[lit] / front.share.sum()
    return np.array([weight @ np.exp(-2j * np.pi * frequency * spot) for frequency in per_mm])
