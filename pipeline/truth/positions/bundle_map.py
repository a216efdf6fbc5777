"""Bundle maps: hits and weights of a bundle's nodes as functions of the image position, by interpolation."""

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from pipeline.camera.integrating.polar_hits import Polar, bundle_hits
from pipeline.camera.tracer import Tracer
from pipeline.records.shapes import Float64


class Position(NamedTuple):
    """An image position of a point other than that of J, and its estimated error; NaN where there is none."""

    x_px: np.ndarray  # (2,) float64
    error_px: float


NONE = Position(np.full(2, np.nan), np.nan)
"""The position of a point that has none."""


class TracedGrid(NamedTuple):
    """Traced positions of a bundle map: middle of the grid, half its size, positions along each axis."""

    x_px: np.ndarray
    half_px: np.ndarray
    order: int


@dataclass(frozen=True, slots=True)
class BundleMap:
    """Polynomials of the image position for each node, through a grid of traced positions."""

    # middle of the grid, and half its size
    x_px: Float64[np.ndarray, "2"]
    half_px: Float64[np.ndarray, "2"]
    offsets: Float64[np.ndarray, "k"]  # grid lines along each axis, from -1 to 1
    # per position (x runs slowest), direction and share of the radius: coordinates on the plane [mm], and weight per
    # area of the unit disc [sr]
    fields: Float64[np.ndarray, "positions directions rings 3"]
    angle_to_next_rad: Float64[np.ndarray, "directions"]  # from each direction to the next

    def basis(self, x_px: Float64[np.ndarray, "... 2"]) -> np.ndarray:
        """Lagrange polynomials of the grid at positions (..., 2): the weights of `fields`, (..., k k)."""
        t = (x_px - self.x_px) / self.half_px
        x, y = self._lagrange(t[..., 0]), self._lagrange(t[..., 1])
        return (x[..., :, None] * y[..., None, :]).reshape(*t.shape[:-1], -1)

    def at(self, x_px: Float64[np.ndarray, "2"]) -> np.ndarray:
        """Coordinates and density of every node at one position, (a, r, 3)."""
        return np.einsum("k,karc->arc", self.basis(x_px), self.fields)

    def coarser(self) -> "BundleMap":
        """The map through every second grid line, whose difference estimates the error of interpolation."""
        kept = np.arange(len(self.fields)).reshape(len(self.offsets), -1)[::2, ::2].ravel()
        return replace(self, offsets=self.offsets[::2], fields=self.fields[kept])

    def _lagrange(self, t: np.ndarray) -> np.ndarray:
        """Lagrange polynomials of the grid lines at coordinates from -1 to 1, (..., k)."""
        result = np.ones((*t.shape, len(self.offsets)))
        for i, node in enumerate(self.offsets):
            for other in np.delete(self.offsets, i):
                result[..., i] *= (t - other) / (node - other)
        return result


def bundle_map(
    tracer: Tracer, microlens: int, plane: Float64[np.ndarray, "4 3"], grid: TracedGrid, nodes: Polar
) -> BundleMap | None:
    """Trace the bundles of a grid of positions; None if one of them is dark or not star-shaped."""
    offsets = -np.cos(np.pi * np.arange(grid.order) / (grid.order - 1))
    nodes_of_grid = np.stack(np.meshgrid(offsets, offsets, indexing="ij"), axis=-1).reshape(-1, 2)
    positions = tracer.positions_mm(*(grid.x_px + grid.half_px * nodes_of_grid).T)
    hits = bundle_hits(tracer.arrays, positions, microlens, plane, nodes)
    if not hits.is_star_shaped.all():
        return None
    fields = np.concatenate([hits.on_plane, hits.density_sr[..., None]], axis=-1)
    return BundleMap(grid.x_px, grid.half_px, offsets, fields, hits.angle_to_next_rad)


def bundle_maps(
    tracer: Tracer, microlens: int, plane: Float64[np.ndarray, "4 3"], grid: TracedGrid, nodes: Polar
) -> list[tuple[float, BundleMap]] | None:
    """The maps of a grid in each wavelength of a camera's light, with its share; None if one of them is None."""
    maps = []
    for light in tracer.lights:
        traced_map = bundle_map(light.tracer, microlens, plane, grid, nodes)
        if traced_map is None:
            return None
        maps.append((light.share, traced_map))
    return maps
