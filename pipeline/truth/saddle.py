"""The saddle of a corner's noise-free image: what corner detectors look for.

An infinite X-corner with the edges of the target point lies in its tangent plane. Its image, integrated over the square
of a pixel at a continuous position x, is a smooth function E(x); the saddle is where grad E = 0 and det Hess E < 0. By
Gauss's theorem the derivative of E is the light on one side of the pixel minus that on the opposite side, so a gradient
needs the image along four lines only. Weight, stop and own microlens are those of J.
"""

from dataclasses import dataclass

import numpy as np

from pipeline.camera.tracer import Tracer
from pipeline.truth import saddle_kernels as kernels
from pipeline.truth.bundle_map import BundleMap, bundle_map

_LEVELS = ((16, 64), (32, 128), (64, 256), (128, 512))
"""Rings and directions of the bundle's triangles; their error falls with the square of these numbers."""
_GOOD_PX = 5e-4
_ORDER, _CENTRED_PX = 3, 0.25
_HALF_PX = 0.5 + _CENTRED_PX
"""Positions are traced out to the sides of a pixel that lies so far off the middle."""
_LONGEST_PX = 1.0
_ROUNDS, _STEPS = 8, 20
_DONE_PX = 1e-7
_DIFFERENCE_PX = 0.05
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(4)
_SIDES = np.array([[[1, -1], [1, 1]], [[-1, -1], [-1, 1]], [[-1, 1], [1, 1]], [[-1, -1], [1, -1]]]) / 2
"""Ends of the right, left, lower and upper side of a pixel."""


@dataclass(frozen=True, slots=True)
class Saddle:
    """Where a corner's image has its saddle; NaN where none was found.

    Attributes
    ----------
    x_px : (2,) float64
    error_px : float
        Of the triangles that stand for the bundle.
    rays : int
    """

    x_px: np.ndarray
    error_px: float
    rays: int


def corner_plane(plane: np.ndarray, edges: np.ndarray) -> np.ndarray:
    """A tangent plane (4, 3) whose coordinates run along two edges (2, 3) of the same frame."""
    normal = plane[3]
    first, second = np.cross(edges[1], normal), np.cross(normal, edges[0])
    return np.stack([plane[0], first / (first @ edges[0]), second / (second @ edges[1]), normal])


def saddle(tracer: Tracer, lens: int, x_px: np.ndarray, plane: np.ndarray, ratio: float) -> Saddle:
    """Find the saddle near an image position.

    Parameters
    ----------
    x_px : (2,) float64
        J's position.
    plane : (4, 3) float64
        Of `corner_plane`, vision frame.
    ratio : float
        (white + black) / (white - black).
    """
    rays, moved, apart, hessian = 0, np.inf, np.nan, np.full((2, 2), np.nan)
    for rings, directions in _LEVELS:
        shares, first = np.arange(rings + 1) / rings, rings == _LEVELS[0][0]
        for turn in range(_ROUNDS):
            around = bundle_map(tracer, lens, x_px, np.full(2, _HALF_PX), plane, _ORDER, shares, directions)
            if around is None:
                return Saddle(np.full(2, np.nan), np.nan, rays)
            rays += around.rays
            if first and turn == 0:
                x_px = x_px + _to_medians(around)
                continue
            image = _Image(around.fields, around, ratio)
            if first:
                hessian = image.hessian(x_px)
            found, hessian = _newton(image, x_px, hessian)
            moved, x_px = np.hypot(*(found - x_px)), found
            if not moved > _CENTRED_PX:
                break
        if not moved <= _CENTRED_PX:
            break
        coarse = _Image(np.ascontiguousarray(around.fields[:, ::2, ::2]), around, ratio)
        apart = (x_px - _newton(coarse, x_px, hessian)[0]) / 3
        if np.hypot(*apart) < _GOOD_PX:
            break
    if not moved <= _CENTRED_PX or not np.linalg.det(hessian) < 0:
        return Saddle(np.full(2, np.nan), np.nan, rays)
    return Saddle(x_px + apart, float(np.hypot(*apart)), rays)


def _to_medians(around: BundleMap) -> np.ndarray:
    """The step after which either edge halves the bundle: near the saddle even where coma has moved the mean far off."""
    nodes = around.at(around.x_px)
    share = np.linspace(0, 1, nodes.shape[1])
    weight = (nodes[..., 2] * share).ravel()
    median = []
    for value in (nodes[..., 0].ravel(), nodes[..., 1].ravel()):
        order = np.argsort(value)
        below = np.cumsum(weight[order]) - weight[order] / 2
        median.append(np.interp(weight.sum() / 2, below, value[order]))
    mean = [
        np.average(around.at(around.x_px + step)[..., :2], axis=(0, 1), weights=nodes[..., 2] * share)
        for step in (*np.eye(2), *-np.eye(2))
    ]
    jacobian = np.stack([mean[0] - mean[2], mean[1] - mean[3]], axis=1) / 2
    return -np.linalg.solve(jacobian, median)


def _newton(image: "_Image", x_px: np.ndarray, hessian: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Where the gradient vanishes, within a pixel, and the updated Hessian; NaN: nowhere."""
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
        # Powell's symmetric update, as Broyden's but for symmetric derivatives.
        n = step @ step
        hessian = hessian + (np.outer(surprise, step) + np.outer(step, surprise)) / n
        hessian -= (surprise @ step) * np.outer(step, step) / n**2
    return x, hessian


class _Image:
    """The image of a corner, integrated over pixels."""

    def __init__(self, fields: np.ndarray, around: BundleMap, ratio: float) -> None:
        self.around, self.fields, self.ratio = around, fields, ratio
        self.nodes = np.empty(fields.shape[1:])

    def gradient(self, x_px: np.ndarray) -> np.ndarray:
        """Derivative of the light of a pixel by its position, (2,) [sr per px]."""
        right, left, lower, upper = (self._along(x_px + side) for side in _SIDES)
        return np.array([right - left, lower - upper])

    def hessian(self, x_px: np.ndarray) -> np.ndarray:
        """Its derivative, (2, 2), by differences."""
        steps = _DIFFERENCE_PX * np.eye(2)
        rows = np.array([self.gradient(x_px + step) - self.gradient(x_px - step) for step in steps])
        return (rows + rows.T) / (4 * _DIFFERENCE_PX)

    def _at(self, x_px: np.ndarray) -> np.ndarray:
        kernels.blend(self.fields, self.around.basis(x_px), self.nodes)
        return self.nodes

    def _along(self, ends: np.ndarray) -> float:
        """Integral of the point image along a line of length 1 px.

        A sharp bundle's light changes within a short piece of the line: nodes of Gauss and Legendre between the places
        where the first and the last ray crosses an edge.
        """
        first, last = (self._extremes(end) for end in ends)
        with np.errstate(divide="ignore", invalid="ignore"):
            cut = first / (first - last)
        cuts = np.sort(np.concatenate([[0.0, 1.0], cut[(cut > 0) & (cut < 1)]]))
        total = 0.0
        for low, high in zip(cuts[:-1], cuts[1:], strict=True):
            for node, weight in zip(_NODES, _WEIGHTS, strict=True):
                t = (low + high) / 2 + (high - low) / 2 * node
                light = kernels.corner_light(self._at(ends[0] + t * (ends[1] - ends[0])), self.ratio)
                total += (high - low) / 2 * weight * light
        return total

    def _extremes(self, x_px: np.ndarray) -> np.ndarray:
        """Least and greatest value of both coordinates over the bundle, (4,)."""
        flat = self._at(x_px)[..., :2].reshape(-1, 2)
        return np.concatenate([flat.min(axis=0), flat.max(axis=0)])
