"""The saddle of the noise-free image of a corner.

An infinite X-corner with the edges of the target point lies in its tangent plane. Its image, integrated over the square
of a pixel at a continuous position x, is a smooth function E(x); the saddle is where grad E = 0 and det Hess E < 0. By
Gauss's theorem the derivative of E is the light on one side of the pixel minus that on the opposite side, so a gradient
needs the image along four lines only. Weight, stop and own microlens are those of J.
"""

from dataclasses import dataclass

import numpy as np

from pipeline.camera.integrating.polar_bundle import Polar
from pipeline.camera.tracer import Tracer
from pipeline.records.shapes import Float64
from pipeline.truth.positions.bundle_map import TracedGrid, bundle_maps
from pipeline.truth.positions.corner_image import CornerImages
from pipeline.truth.positions.saddle_start import start_of

_LEVELS = ((16, 64), (32, 128), (64, 256), (128, 512))
"""Rings and directions of the triangles of a bundle; the error falls with the square of these numbers."""
_GOOD_PX = 5e-4
"""Error below which no finer level is needed [px]: half of the default claim."""
_ORDER = 3
"""Number of positions along an axis for the polynomials: bundles change nearly linearly over a pixel."""
_CENTRED_PX = 0.25
"""Distance of the saddle from the middle of the traced positions up to which it is accepted [px], because the
polynomials hold there.
"""
_HALF_PX = 0.5 + _CENTRED_PX
"""Half the span of the traced positions [px]: it reaches the sides of a pixel that lies so far off the middle."""
_ROUNDS = 8
"""Most times that positions are traced anew around the saddle; a solution that moves on after that is given up."""
_STEPS = 20
"""Most steps of Newton's method between two traces."""
_LONGEST_PX = 1.0
"""Distance after which positions are traced anew [px], and half the longest step: the map spans a pixel and a half."""
_DONE_PX = 1e-7
"""Step that ends the search [px]: a ten-thousandth of the default claim."""


@dataclass(frozen=True, slots=True)
class Saddle:
    """Position of the saddle of a corner's image; NaN if none was found.

    Attributes
    ----------
    x_px : (2,) float64
    error_px : float
        Error due to the approximation of the bundle by triangles.
    """

    x_px: Float64[np.ndarray, "2"]
    error_px: float


def corner_plane(plane: Float64[np.ndarray, "4 3"], edges: Float64[np.ndarray, "n 3"]) -> np.ndarray:
    """A tangent plane (4, 3) whose coordinate axes are two edges (2, 3) of the same frame."""
    normal = plane[3]
    first, second = np.cross(edges[1], normal), np.cross(normal, edges[0])
    return np.stack([plane[0], first / (first @ edges[0]), second / (second @ edges[1]), normal])


def saddle(
    tracer: Tracer, microlens: int, x_px: Float64[np.ndarray, "2"], plane: Float64[np.ndarray, "4 3"], ratio: float
) -> Saddle:
    """Find the saddle near an image position.

    Parameters
    ----------
    x_px : (2,) float64
        Position of J, near which the search begins.
    plane : (4, 3) float64
        Plane from `corner_plane`, vision frame.
    ratio : float
        (white + black) / (white - black).
    """
    lost, start = Saddle(np.full(2, np.nan), np.nan), start_of(tracer, microlens, x_px, plane, ratio)
    if start is None:
        return lost
    x_px, moved, apart, hessian = start.x_px, np.inf, np.full(2, np.nan), np.full((2, 2), np.nan)
    for level, (rings, directions) in enumerate(_LEVELS):
        for _ in range(_ROUNDS):
            nodes = Polar(np.arange(rings + 1) / rings, directions)
            around = bundle_maps(tracer, microlens, plane, TracedGrid(x_px, np.full(2, _HALF_PX), _ORDER), nodes)
            if around is None:
                return lost
            image = CornerImages(around, ratio)
            hessian = hessian if level else image.hessian(x_px)
            solution, hessian = _newton(image, x_px, hessian)
            moved, x_px = np.hypot(*(solution - x_px)), solution
            if not moved > _CENTRED_PX:
                break
        if not moved <= _CENTRED_PX:
            break
        assert around is not None
        apart = (x_px - _newton(CornerImages(around, ratio, 2), x_px, hessian)[0]) / 3
        if np.hypot(*apart) < _GOOD_PX:
            break
    near = np.hypot(*(x_px - start.x_px)) <= max(1.0, start.spread_px)
    if not (moved <= _CENTRED_PX and near and np.linalg.det(hessian) < 0):
        return lost
    return Saddle(x_px + apart, float(np.hypot(*apart)))


def _newton(image: CornerImages, x_px: np.ndarray, hessian: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Position within a pixel where the gradient vanishes, and the updated Hessian; NaN if there is none."""
    x, gradient = x_px, image.gradient(x_px)
    for _ in range(_STEPS):
        if not np.abs(np.linalg.det(hessian)) > 0:
            return np.full(2, np.nan), hessian
        step = -np.linalg.solve(hessian, gradient)
        step *= min(1.0, _LONGEST_PX / 2 / max(np.hypot(*step), 1e-300))
        x, before = x + step, gradient
        if np.hypot(*step) < _DONE_PX or np.hypot(*(x - x_px)) > _LONGEST_PX:
            break
        gradient = image.gradient(x)
        surprise = gradient - before - hessian @ step
        # Powell's symmetric update: like Broyden's, for symmetric derivatives.
        n = step @ step
        hessian = hessian + (np.outer(surprise, step) + np.outer(step, surprise)) / n
        hessian -= (surprise @ step) * np.outer(step, step) / n**2
    return x, hessian
