"""First guess of a saddle: with coma J is far off, and a wide image has other stationary points."""

from dataclasses import dataclass

import numpy as np

from pipeline.camera.integrating.polar_bundle import Polar
from pipeline.camera.tracer import Tracer
from pipeline.records.shapes import Float64
from pipeline.truth.positions.bundle_map import BundleMap, TracedGrid, bundle_map
from pipeline.truth.positions.corner_image import CornerImage

_RINGS, _DIRECTIONS = 16, 64
"""Rings and directions of the bundle: the coarsest level of `saddle` suffices for a guess."""
_ORDER, _HALF_PX = 3, 0.75
"""Number of positions along an axis for the polynomials, and half their span [px]: as in `saddle`."""
_DIFFERENCE_PX = 0.25
"""Half the step of difference quotients [px]: within the traced positions."""
_WIDE_PX = 1.0
"""Standard deviation of a bundle above which its image may have several stationary points [px]; a narrower one is
smoothed by the pixel.
"""
_SWEEPS = 3
"""Number of times that both edges are followed in turn: each brings the guess nearer."""
_ROUGH = 0.02
"""Precision of a move along an edge over the standard deviation [1]: Newton's method improves it."""


@dataclass(frozen=True, slots=True)
class Start:
    """A position from which Newton's method finds the saddle.

    Attributes
    ----------
    x_px : (2,) float64
    spread_px : float
        Standard deviation of the bundle in the image.
    """

    x_px: Float64[np.ndarray, "2"]
    spread_px: float


def start_of(
    tracer: Tracer, microlens: int, x_px: Float64[np.ndarray, "2"], plane: Float64[np.ndarray, "4 3"], ratio: float
) -> Start | None:
    """The position where both edges halve the bundle; for a wide bundle, where each edge halves it on the other
    edge.

    None if bundles around J's position are cut. Parameters are those of `saddle.saddle`.
    """
    half, nodes = np.full(2, _HALF_PX), Polar(np.arange(_RINGS + 1) / _RINGS, _DIRECTIONS)
    around = bundle_map(tracer, microlens, plane, TracedGrid(x_px, half, _ORDER), nodes)
    if around is None:
        return None
    weight = _weights(around.at(x_px))
    px_per_mm = np.linalg.inv(_jacobian(around, weight))
    hits = around.at(x_px)[..., :2].reshape(-1, 2)
    x_px = x_px - px_per_mm @ [_median(values, weight) for values in hits.T]
    spread = float(np.sqrt(weight @ (((hits - weight @ hits) @ px_per_mm.T) ** 2).sum(axis=1)))
    if spread < _WIDE_PX:
        return Start(x_px, spread)
    wide = bundle_map(tracer, microlens, plane, TracedGrid(x_px, half + spread, _ORDER), nodes)
    if wide is None:
        return None
    x_px = _halved(CornerImage(wide, ratio), x_px, px_per_mm, spread)
    return Start(x_px, spread)


def _halved(image: CornerImage, x_px: np.ndarray, px_per_mm: np.ndarray, spread_px: float) -> np.ndarray:
    """Move along both edges in turn to the position where the derivative along the other one vanishes and grows in
    that direction.
    """
    from scipy.optimize import brentq

    first, second = (px_per_mm / np.linalg.norm(px_per_mm, axis=0)).T
    for along, across in ((first, second), (second, first)) * _SWEEPS:

        def slope(s: float, x: np.ndarray = x_px, along: np.ndarray = along, across: np.ndarray = across) -> float:
            return float(image.gradient(x + s * along) @ across)

        reach = 2 * spread_px
        if slope(-reach) * slope(reach) < 0:
            x_px = x_px + brentq(slope, -reach, reach, xtol=_ROUGH * spread_px) * along
    return x_px


def _weights(nodes: np.ndarray) -> np.ndarray:
    """Shares of the bundle for all nodes (a, r, 3), as one array."""
    weight = (nodes[..., 2] * np.linspace(0, 1, nodes.shape[1])).ravel()
    return weight / weight.sum()


def _median(values: np.ndarray, weight: np.ndarray) -> float:
    order = np.argsort(values)
    return float(np.interp(0.5, np.cumsum(weight[order]) - weight[order] / 2, values[order]))


def _jacobian(around: BundleMap, weight: np.ndarray) -> np.ndarray:
    """Derivative of the mean hit by the position, (2, 2) [mm per px]."""
    steps = _DIFFERENCE_PX * np.eye(2)
    means = [
        [weight @ around.at(around.x_px + sign * step)[..., :2].reshape(-1, 2) for sign in (1, -1)] for step in steps
    ]
    return np.stack([plus - minus for plus, minus in means], axis=1) / (2 * _DIFFERENCE_PX)
