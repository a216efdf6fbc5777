"""Ways from inner points of bundles to the edge of what passes, found by real rays; vision frame, mm."""

from dataclasses import dataclass

import numpy as np

from pipeline.camera.boundary import even_angles
from pipeline.camera.integrating import edge_kernels, edge_search
from pipeline.camera.integrating.edge_search import Spokes
from pipeline.camera.integrating.label_kernels import PASSES
from pipeline.camera.tracing.records import CameraArrays
from pipeline.records.shapes import Float64, Int64

_POLYGON = 1 << 20
"""Labels from here on: an edge of the polygon, i.e. of the microlens aperture."""
_EDGE_STEPS = 24
"""Bisections of an edge: to 3e-8 of the way to the polygon, so that a weight errs by less than 1e-7 by it."""
_AROUND, _OUTWARDS = 256, np.append(np.arange(1, 24) / 24, 1 - 1e-6)
"""Directions, and shares of the way to the edge, of points all over a region: they miss what is hidden at its edge only
below a few hundred-thousandths of it, and a thousandth inside."""


@dataclass(frozen=True, slots=True)
class Ways:
    """Regions that rays pass, for many sensor positions, each seen from an inner point.

    `positions`, `microlens`: (n, 2) float64, (n,) int64, sensor positions and their microlens.
    `polygons`, `counts`: (n, MAX_VERTICES, 2) float64, (n,) int64, polygons that enclose what passes.
    `free_sr`: (n,) float64, weight of all rays through the position's own microlens; 0 without one.
    `centres`: (n, 2) float64, inner points; NaN where nothing passes.
    """

    arrays: CameraArrays
    positions: Float64[np.ndarray, "n 2"]
    microlens: Int64[np.ndarray, "n"]
    polygons: Float64[np.ndarray, "n MAX_VERTICES 2"]
    counts: Int64[np.ndarray, "n"]
    free_sr: Float64[np.ndarray, "n"]
    centres: Float64[np.ndarray, "n 2"]

    @property
    def lit(self) -> np.ndarray:
        """Rows of the positions that have an inner point, ascending."""
        return np.flatnonzero(~np.isnan(self.centres[:, 0]))

    def spokes(self, count: int) -> tuple[np.ndarray, np.ndarray]:
        """Evenly spaced directions about every inner point: positions, ascending, and angles."""
        return np.repeat(self.lit, count), np.tile(even_angles(count), len(self.lit))

    def spread(self, rows: Int64[np.ndarray, "n"], count: int) -> np.ndarray:
        """So many points all over the polygons of some positions, (rows, count, 2)."""
        points = np.empty((len(rows), count, 2))
        edge_kernels.spread(self.polygons[rows], self.counts[rows], points)
        return points

    def probe(
        self, owner: Int64[np.ndarray, "n"], points: Float64[np.ndarray, "n 2"], is_named: bool = False
    ) -> np.ndarray:
        """Labels, as of `edge_kernels.probe`, of what blocks the ray of each position through each point; owners
        ascend.

        Without names, which cost more, all that are blocked have one label.
        """
        label, points = np.empty(len(owner), np.int64), np.ascontiguousarray(points)
        edge_kernels.probe(self.arrays, self.positions, self.microlens, owner, points, is_named, label)
        edge_kernels.probe.count(len(owner), len(self.arrays.table))
        return label

    def find(
        self, owner: Int64[np.ndarray, "n"], angle: Float64[np.ndarray, "n"], steps: int = _EDGE_STEPS
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, int]:
        """Radius of the edge, its label, the polygon's radius, and the number of rays, for directions sorted by owner.

        The radius errs by less than 2^-(steps + 1) of the way to the polygon.
        """
        m = len(owner)
        spokes, label = Spokes(owner, angle, np.empty(m), np.empty((2, m))), np.empty(m, np.int64)
        edge_search.reach(self.polygons, self.counts, self.centres, spokes, label)
        label += _POLYGON
        radius = np.empty(m)
        way = self.positions, self.microlens, self.centres, spokes
        rays = edge_search.find_edges(self.arrays, *way, steps, radius, label)
        edge_search.find_edges.count(rays, len(self.arrays.table))
        return radius, label, spokes.limit, rays

    def all_over(self, rows: Int64[np.ndarray, "n"]) -> np.ndarray:
        """Points of some regions up to their very edge, (rows, m, 2)."""
        owner, angle = np.repeat(rows, _AROUND), np.tile(even_angles(_AROUND), len(rows))
        radius, *_ = self.find(owner, angle)
        way = radius[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
        return (self.centres[owner, None] + _OUTWARDS[:, None] * way[:, None]).reshape(len(rows), -1, 2)

    def nothing_beyond(
        self,
        owner: Int64[np.ndarray, "n"],
        along: Float64[np.ndarray, "n 2"],
        radius: Float64[np.ndarray, "n"],
        limit: Float64[np.ndarray, "n"],
    ) -> np.ndarray:
        """Whether no ray passes beyond the edge, (n,): one per direction is sent there, at four heights in turn."""
        height = 0.125 + 0.25 * (np.arange(len(owner)) % 4)
        open_ = radius < limit * (1 - 1e-9)
        points = self.centres[owner] + (radius + height * (limit - radius))[:, None] * along
        label = self.probe(owner[open_], points[open_])
        clear = np.ones(len(self.positions), bool)
        clear[owner[open_][label == PASSES]] = False
        return clear
