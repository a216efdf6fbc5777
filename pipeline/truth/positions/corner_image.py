"""The image of an ideal corner, integrated over a pixel at any position, and its derivatives."""

import itertools
from collections.abc import Callable, Sequence

import numpy as np

from pipeline.records.shapes import Float64
from pipeline.truth.positions import saddle_kernels as kernels
from pipeline.truth.positions.bundle_map import BundleMap

_DIFFERENCE_PX = 0.05
"""Half the step of difference quotients for the Hessian [px]: the image of a corner, integrated over a pixel, bends
little over it.
"""
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(4)
"""Gauss-Legendre nodes on [-1, 1] along each part of a pixel's side, and their weights: exact to the seventh degree."""
_SIDES = np.array([[[1, -1], [1, 1]], [[-1, -1], [-1, 1]], [[-1, 1], [1, 1]], [[-1, -1], [1, -1]]]) / 2
"""Ends of the right, left, lower and upper side of a pixel."""


class CornerImage:
    """The image of a corner as seen by every `step`-th node of a map; `ratio` is (white + black) / (white - black)."""

    def __init__(self, around: BundleMap, ratio: float, step: int = 1) -> None:
        self.around, self.ratio = around, ratio
        self.fields = np.ascontiguousarray(around.fields[:, ::step, ::step])
        self.nodes = np.empty(self.fields.shape[1:])

    def gradient(self, x_px: Float64[np.ndarray, "2"]) -> np.ndarray:
        """Derivative of the light of a pixel by its position, (2,) [sr per px]."""
        right, left, lower, upper = (self._along(x_px + side) for side in _SIDES)
        return np.array([right - left, lower - upper])

    def _at(self, x_px: np.ndarray) -> np.ndarray:
        kernels.blend(self.fields, self.around.basis(x_px), self.nodes)
        return self.nodes

    def _along(self, ends: np.ndarray) -> float:
        """Integral of the point image along a line of length 1 px.

        If the bundle is sharp, the light changes within a short piece of the line: so Gauss-Legendre nodes lie between
        the positions where the first and the last ray cross an edge.
        """
        first, last = (self._extremes(end) for end in ends)
        with np.errstate(divide="ignore", invalid="ignore"):
            cut = first / (first - last)
        cuts = np.sort(np.concatenate([[0.0, 1.0], cut[(cut > 0) & (cut < 1)]]))
        total = 0.0
        for low, high in itertools.pairwise(cuts):
            for node, weight in zip(_NODES, _WEIGHTS, strict=True):
                t = (low + high) / 2 + (high - low) / 2 * node
                light = kernels.corner_light(self._at(ends[0] + t * (ends[1] - ends[0])), self.ratio)
                total += (high - low) / 2 * weight * light
        return total

    def _extremes(self, x_px: np.ndarray) -> np.ndarray:
        flat = self._at(x_px)[..., :2].reshape(-1, 2)
        return np.concatenate([flat.min(axis=0), flat.max(axis=0)])


class CornerImages:
    """The sum of the images that a corner has in the wavelengths of a camera's light, each with its share."""

    def __init__(self, around: Sequence[tuple[float, BundleMap]], ratio: float, step: int = 1) -> None:
        self.images = [(share, CornerImage(bundle, ratio, step)) for share, bundle in around]

    def gradient(self, x_px: Float64[np.ndarray, "2"]) -> np.ndarray:
        """Derivative of the light of a pixel by its position, (2,) [sr per px]."""
        return np.sum([share * image.gradient(x_px) for share, image in self.images], axis=0)

    def hessian(self, x_px: Float64[np.ndarray, "2"]) -> np.ndarray:
        """Its derivative, (2, 2), by differences."""
        return hessian_of(self.gradient, x_px)


def hessian_of(gradient: Callable[[np.ndarray], np.ndarray], x_px: Float64[np.ndarray, "2"]) -> np.ndarray:
    """Symmetric derivative of a gradient, (2, 2), by differences over a small part of a pixel."""
    steps = _DIFFERENCE_PX * np.eye(2)
    rows = np.array([gradient(x_px + step) - gradient(x_px - step) for step in steps])
    return (rows + rows.T) / (4 * _DIFFERENCE_PX)
