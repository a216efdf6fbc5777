"""The image of an ideal corner, or of a disc, by many rays and a fine grid: no nodes, no polynomials, no edges traced.

Rays start anywhere near an image position (Sobol points over position and exit pupil), go through the textbook's lens,
and ask the target's colour. Light is gathered in small squares; a pixel at any of them is the sum of those it covers.
"""

import numpy as np
from naive import textbook
from scipy.stats import qmc

from pipeline.camera.parts.camera import Camera
from pipeline.camera.tracer import Tracer

SQUARES = 8
"""Per pixel, along each axis."""


def rendered(
    camera: Camera,
    x_px: np.ndarray,
    half_px: np.ndarray,
    pose: np.ndarray,
    colour,
    rays: int,
    lens: tuple[np.ndarray, float] | None = None,
) -> np.ndarray:
    """Light of squares around an image position, rows from the top, (2 h SQUARES, 2 w SQUARES).

    `half_px` is half of the window's width and height, (2,); `colour` takes coordinates on the target's plane (n, 2);
    `lens`, vertex and focal length, is a microlens of a hexagonal array whose cells face +x.
    """
    array, tracer = camera.microlenses, Tracer(camera)
    vertex, focal = (np.zeros(2), np.inf) if lens is None else lens

    def send(start: np.ndarray, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        position, way, passes, weight = textbook.sent(camera, start, points, (points - vertex) / focal)
        if array is not None:
            passes &= textbook.in_hexagon(points - vertex, array.pitch_mm)
        return textbook.at_plane(position, way, pose), np.where(passes, weight, 0.0)

    # Which box of the sampling plane the corners of the window need.
    size = 25.0 if array is None else 0.6 * array.pitch_mm
    grid = np.stack(np.meshgrid(*2 * [np.linspace(-size, size, 201)]), axis=-1).reshape(-1, 2) + vertex
    corners = x_px + half_px * np.array([[-1, -1], [-1, 1], [1, -1], [1, 1]])
    used = np.concatenate([grid[send(start, grid)[1] > 0] for start in tracer.positions_mm(*corners.T)])
    low, high = used.min(axis=0) - size / 50, used.max(axis=0) + size / 50

    light = np.zeros(2 * SQUARES * half_px[::-1])
    sequence = qmc.Sobol(4, seed=7)
    with np.errstate(invalid="ignore"):
        for _ in range(max(1, rays >> 18)):
            u = sequence.random(min(rays, 1 << 18))
            start = tracer.positions_mm(*(x_px + (2 * u[:, :2] - 1) * half_px).T)
            hit, weight = send(start, low + u[:, 2:] * (high - low))
            weight[weight > 0] *= colour(hit[weight > 0])
            column, row = (u[:, :2] * 2 * SQUARES * half_px).astype(int).T
            np.add.at(light, (row, column), weight)
    return light


def pixels(light: np.ndarray) -> np.ndarray:
    """Light of pixels at every square that one fits into."""
    total = np.pad(light.cumsum(axis=0).cumsum(axis=1), ((1, 0), (1, 0)))
    s = SQUARES
    return total[s:, s:] - total[:-s, s:] - total[s:, :-s] + total[:-s, :-s]


def saddle_of(light: np.ndarray, reach_px: float) -> np.ndarray:
    """Offset of the saddle from the middle of the window [px]: a cubic fitted to the pixels around it, in steps."""
    image = pixels(light)
    y, x = ((np.arange(n) - (n - 1) / 2) / SQUARES for n in image.shape)
    x, y = np.meshgrid(x, y)
    found = np.zeros(2)
    for _ in range(20):
        near = np.hypot(x - found[0], y - found[1]) <= reach_px
        u, v, value = x[near] - found[0], y[near] - found[1], image[near]
        terms = np.stack([u**i * v**j for i in range(4) for j in range(4 - i)], axis=1)
        powers = [(i, j) for i in range(4) for j in range(4 - i)]
        c = dict(zip(powers, np.linalg.lstsq(terms, value, rcond=None)[0], strict=True))
        step = -np.linalg.solve([[2 * c[2, 0], c[1, 1]], [c[1, 1], 2 * c[0, 2]]], [c[1, 0], c[0, 1]])
        step *= min(1.0, 0.5 * reach_px / np.hypot(*step))
        found = found + step
        if np.hypot(*step) < 1e-6:
            break
    return found
