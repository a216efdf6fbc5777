"""The image of an ideal corner, integrated over a pixel at a continuous position, and its derivatives."""

import itertools

import numpy as np

from pipeline.records.shapes import Float64
from pipeline.truth.positions import saddle_kernels as kernels
from pipeline.truth.positions.bundle_map import BundleMap

_DIFFERENCE_PX = 0.05
"""Half the difference of a Hessian [px]: a corner that is seen through a pixel bends little over it."""
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(4)
"""Nodes on [-1, 1] along each part of a pixel's side, and their weights: exact to the seventh degree."""
_SIDES = np.array([[[1, -1], [1, 1]], [[-1, -1], [-1, 1]], [[-1, 1], [1, 1]], [[-1, -1], [1, -1]]]) / 2
"""Ends of the right, left, lower and upper side of a pixel."""


class CornerImage:
    """The image of a corner seen by the bundles of a map.

    Parameters
    ----------
    around : BundleMap
    ratio : float
        (white + black) / (white - black).
    step : int
        Takes every so many nodes of the map only.
    """

    def __init__(self, around: BundleMap, ratio: float, step: int = 1) -> None:
        self.around, self.ratio = around, ratio
        self.fields = np.ascontiguousarray(around.fields[:, ::step, ::step])
        self.nodes = np.empty(self.fields.shape[1:])

    def gradient(self, x_px: Float64[np.ndarray, "2"]) -> np.ndarray:
        """Derivative of the light of a pixel by its position, (2,) [sr per px]."""
        right, left, lower, upper = (self._along(x_px + side) for side in _SIDES)
        return np.array([right - left, lower - upper])

    def hessian(self, x_px: Float64[np.ndarray, "2"]) -> np.ndarray:
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
        for low, high in itertools.pairwise(cuts):
            for node, weight in zip(_NODES, _WEIGHTS, strict=True):
                t = (low + high) / 2 + (high - low) / 2 * node
                light = kernels.corner_light(self._at(ends[0] + t * (ends[1] - ends[0])), self.ratio)
                total += (high - low) / 2 * weight * light
        return total

    def _extremes(self, x_px: np.ndarray) -> np.ndarray:
        """Least and greatest value of both coordinates over the bundle, (4,)."""
        flat = self._at(x_px)[..., :2].reshape(-1, 2)
        return np.concatenate([flat.min(axis=0), flat.max(axis=0)])
