"""Rays of all pixels of a conventional camera by few traced ones: polynomials over square patches of the image.

Where no edge of the lens begins or ends to vignette, the mean ray of a position is an analytic function of it, and a
polynomial through Chebyshev nodes converges geometrically (Trefethen, Approximation Theory and Approximation Practice,
theorem 8.2). Each patch is judged by rays traced elsewhere on it; one that errs is quartered, and the pixels of small
ones are traced one by one.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING

import numpy as np

from pipeline.results.answers import PixelRays

if TYPE_CHECKING:
    from pipeline.results.ready_camera import ReadyCamera  # loads the tracer, which few formats need

EDGE_PX = 64
"""Edge of the patches [px]: 76 traced rays stand for 4,096."""
_LEAST_PX = 16
"""Edge of the smallest patches [px]: 256 pixels, for which 76 rays are still fewer."""
_NODES = 8
"""Nodes along each axis: degree 7."""
_CHEBYSHEV = -np.cos((2 * np.arange(_NODES) + 1) * np.pi / (2 * _NODES))
"""Nodes between -1 and 1."""
_AGREES_PX = 1e-9
"""Difference from traced rays that patches may have in any case [px]; more only where these err more themselves."""
_GOLDEN = np.array([0.7548776662466927, 0.5698402909980532])
"""Steps of an even sequence in the square: powers of the inverse of the plastic number (Roberts 2018)."""
_JUDGES = np.concatenate([[[-1, -1], [1, -1], [-1, 1], [1, 1]], 2 * (np.outer(np.arange(1, 9), _GOLDEN) % 1) - 1])
"""Positions on a patch at which it is judged, from -1 to 1 along each axis: its corners, and eight inside."""


@dataclass(frozen=True, slots=True)
class Patch:
    """First column and row, and size [px]."""

    x: int
    y: int
    width: int
    height: int

    @property
    def quarters(self) -> list["Patch"]:
        """Its four quarters, or two where it is a pixel wide or high."""
        left = (self.width + 1) // 2
        upper = (self.height + 1) // 2
        across = [(self.x, left), (self.x + left, self.width - left)]
        down = [(self.y, upper), (self.y + upper, self.height - upper)]
        return [Patch(x, y, width, height) for y, height in down for x, width in across if width and height]

    def positions(self, coordinates: np.ndarray) -> np.ndarray:
        """Image positions (k, 2) of coordinates on the patch, from -1 to 1 between the outer edges of its pixels."""
        size = np.array([self.width, self.height])
        return np.asarray(np.array([self.x, self.y]) - 0.5 + (coordinates + 1) / 2 * size)


def rows_of_rays(
    sight: "ReadyCamera", width: int, rows: tuple[int, int], planes_mm: tuple[float, float]
) -> tuple[np.ndarray, np.ndarray]:
    """Origins (h, w, 3) and directions (h, w, 3) of the pixels of some rows, vision frame.

    `rows`: first and end. Where they are multiples of EDGE_PX, or the last, the rays do not depend on them.
    `planes_mm`: vision z of two planes on which rays are compared.
    """
    first, end = rows
    lines = np.full((end - first, width, 4), np.nan)  # x, y at z = 0, then slopes
    patches = [
        Patch(x, y, min(EDGE_PX, width - x), min(EDGE_PX, end - y))
        for y in range(first, end, EDGE_PX)
        for x in range(0, width, EDGE_PX)
    ]
    small: list[Patch] = []  # whose pixels are traced one by one
    while patches:
        interpolated, refused = _interpolated(sight, patches, planes_mm)
        for patch, values in interpolated:
            lines[patch.y - first : patch.y - first + patch.height, patch.x : patch.x + patch.width] = values
        quarters = [quarter for patch in refused for quarter in patch.quarters]
        patches = [patch for patch in quarters if min(patch.width, patch.height) >= _LEAST_PX]
        small += [patch for patch in quarters if min(patch.width, patch.height) < _LEAST_PX]
    if small:
        pixels = [np.mgrid[p.y : p.y + p.height, p.x : p.x + p.width].reshape(2, -1) for p in small]
        y, x = np.concatenate(pixels, axis=1)
        lines[y - first, x], _ = _lines(sight.rays(x.astype(float), y.astype(float)))
    direction = np.concatenate([lines[..., 2:], np.ones_like(lines[..., :1])], axis=-1)
    origin = np.concatenate([lines[..., :2], np.where(np.isnan(lines[..., :1]), np.nan, 0.0)], axis=-1)
    return origin, direction / np.linalg.norm(direction, axis=-1, keepdims=True)


def _interpolated(
    sight: "ReadyCamera", patches: list[Patch], planes_mm: tuple[float, float]
) -> tuple[list[tuple[Patch, np.ndarray]], list[Patch]]:
    """Patches with the lines (h, w, 4) of their pixels, interpolated between nodes, and the patches on which this errs
    at a judging position.
    """
    grid = np.stack(np.meshgrid(_CHEBYSHEV, _CHEBYSHEV), axis=-1).reshape(-1, 2)
    coordinates = np.concatenate([grid, _JUDGES])
    x_px = np.concatenate([patch.positions(coordinates) for patch in patches])
    lines, error_px = _lines(sight.rays(x_px[:, 0], x_px[:, 1]))
    interpolated = []
    refused = []
    at_judges = _weights(tuple(_JUDGES[:, 1])), _weights(tuple(_JUDGES[:, 0]))
    for number, patch in enumerate(patches):
        of_patch = slice(number * len(coordinates), (number + 1) * len(coordinates))
        values = lines[of_patch][: len(grid)].reshape(_NODES, _NODES, 4)
        differences = np.einsum("kj,ki,jic->kc", *at_judges, values) - lines[of_patch][len(grid) :]
        allowed_px = max(_AGREES_PX, float(error_px[of_patch].max(initial=0.0)))
        if _largest_px(differences, values, patch, planes_mm) <= allowed_px:  # false for NaN
            centres = ((2 * np.arange(count) + 1) / count - 1 for count in (patch.height, patch.width))
            down, across = (_weights(tuple(centre)) for centre in centres)
            interpolated.append((patch, np.einsum("yj,xi,jic->yxc", down, across, values, optimize=True)))
        else:
            refused.append(patch)
    return interpolated, refused


def _largest_px(differences: np.ndarray, values: np.ndarray, patch: Patch, planes_mm: tuple[float, float]) -> float:
    """Largest difference of lines (k, 4) on two planes, as a distance of image positions; NaN where one has no light.

    `values` are the lines at the nodes of the patch: its diagonal in the image and on a plane give the scale.
    """
    largest_px = []
    for z_mm in planes_mm:
        points = values[..., :2] + z_mm * values[..., 2:]
        span_mm = np.linalg.norm(points[-1, -1] - points[0, 0])
        px_per_mm = np.hypot(patch.width, patch.height) / span_mm
        off_mm = np.linalg.norm(differences[:, :2] + z_mm * differences[:, 2:], axis=1)
        largest_px.append(off_mm.max() * px_per_mm)
    return float(np.max(largest_px))


def _lines(rays: PixelRays) -> tuple[np.ndarray, np.ndarray]:
    """Lines (n, 4): x and y at z = 0, and slopes; and their errors (n,) [px]."""
    slopes = rays.direction[:, :2] / rays.direction[:, 2:]
    return np.concatenate([rays.origin_mm[:, :2], slopes], axis=1), np.hypot(*rays.error_px.T)


@cache
def _weights(coordinates: tuple[float, ...]) -> np.ndarray:
    """Weights (k, nodes) of the values at the nodes in the polynomial through them, at coordinates from -1 to 1."""
    at_nodes = np.polynomial.chebyshev.chebvander(_CHEBYSHEV, _NODES - 1)
    return np.asarray(np.polynomial.chebyshev.chebvander(np.array(coordinates), _NODES - 1) @ np.linalg.inv(at_nodes))


def bands(height: int, most_rows: int) -> Iterator[tuple[int, int]]:
    """First and end rows of bands of whole patches, with at most so many rows, but a patch at least."""
    rows = max(EDGE_PX, most_rows // EDGE_PX * EDGE_PX)
    for first in range(0, height, rows):
        yield first, min(first + rows, height)
