"""Control cages of subdivision surfaces: polygons with their edges, half-edges and fans of corners around vertices."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from pipeline.records.shapes import Bool, Float64, Int64

INFINITELY_SHARP = 10.0
"""Sharpness from which creases and corners stay sharp at all levels [levels]: UsdGeom.Mesh.SHARPNESS_INFINITE."""


class NotManifold(ValueError):
    """Faces meet in a way for which there is no rule: more than two at an edge, turned over, or in fans at a vertex."""


@dataclass(frozen=True)
class Cage:
    """A control cage: the corners of its polygons, face by face, anticlockwise as seen from the front.

    A corner also stands for the half-edge from it to the next corner.
    """

    vertex: Int64[np.ndarray, "c"]  # of each corner
    count: Int64[np.ndarray, "f"]  # corners of each face
    sharp: Float64[np.ndarray, "c"]  # of the edge from a corner to the next [levels]
    corner: Float64[np.ndarray, "v"]  # sharpness of each vertex [levels]

    @cached_property
    def face(self) -> np.ndarray:
        """Face of each corner."""
        return np.repeat(np.arange(len(self.count)), self.count)

    @cached_property
    def after(self) -> np.ndarray:
        """The next corner of the same face."""
        after, last = np.arange(1, len(self.vertex) + 1), np.cumsum(self.count)
        after[last - 1] = last - self.count
        return after

    @cached_property
    def before(self) -> np.ndarray:
        """The previous corner of the same face."""
        before = np.empty_like(self.after)
        before[self.after] = np.arange(len(before))
        return before

    @cached_property
    def _edges(self) -> tuple[np.ndarray, np.ndarray]:
        """Vertices of each edge, the lower number first, and the edge of each corner."""
        pairs = np.sort(np.stack([self.vertex, self.vertex[self.after]], axis=1), axis=1)
        key = pairs[:, 0].astype(np.int64) * len(self.corner) + pairs[:, 1]
        _, first, edge = np.unique(key, return_index=True, return_inverse=True)
        return pairs[first], edge

    @property
    def ends(self) -> np.ndarray:
        """Vertices of each edge, (e, 2)."""
        return self._edges[0]

    @property
    def edge(self) -> np.ndarray:
        """Edge from each corner to the next."""
        return self._edges[1]

    @cached_property
    def faces_at_edge(self) -> np.ndarray:
        return np.bincount(self.edge, minlength=len(self.ends))

    @cached_property
    def edge_sharp(self) -> np.ndarray:
        """Sharpness of each edge; boundaries are infinitely sharp."""
        sharp = np.zeros(len(self.ends))
        np.maximum.at(sharp, self.edge, self.sharp)
        sharp[(self.faces_at_edge == 1) | (sharp >= INFINITELY_SHARP)] = np.inf
        return sharp

    @cached_property
    def twin(self) -> np.ndarray:
        """Twin of each half-edge, that of the other face along the same edge; -1 at a boundary."""
        order = np.argsort(self.edge, kind="stable")
        same = np.flatnonzero(self.edge[order][1:] == self.edge[order][:-1])
        twin = np.full(len(self.vertex), -1)
        twin[order[same]], twin[order[same + 1]] = order[same + 1], order[same]
        return twin

    def marked_at(self, edges: Bool[np.ndarray, "e"]) -> np.ndarray:
        """Number of the marked edges at each vertex."""
        return np.bincount(self.ends[edges].ravel(), minlength=len(self.corner))

    def require_manifold(self) -> None:
        """Raise NotManifold unless each edge has two faces, or one, and each vertex one fan of them."""
        if (self.ends[:, 0] == self.ends[:, 1]).any() or (self.faces_at_edge > 2).any():
            raise NotManifold("an edge has more than two faces")
        paired = self.twin >= 0
        if (self.vertex[self.twin[paired]] == self.vertex[paired]).any():
            raise NotManifold("neighbouring faces are turned over")
        fan, _ = self.fans(self.faces_at_edge == 1)
        first = np.full(len(self.corner), -1)
        first[self.vertex] = fan
        if (first[self.vertex] != fan).any():
            raise NotManifold("faces meet at a vertex alone")

    def fans(self, cut: Bool[np.ndarray, "e"]) -> tuple[np.ndarray, np.ndarray]:
        """Fan of each corner, and its rank there from 0, anticlockwise.

        Fans are the sectors into which marked edges divide the corners around a vertex; a single marked edge divides
        none. They are numbered by their first corner.
        """
        divided = (self.marked_at(cut) > 1)[self.vertex]
        turned = self.twin[self.before]  # the next corner around the vertex, anticlockwise
        ends = (turned < 0) | (cut[self.edge[self.before]] & divided)
        fan, rank = np.full(len(self.vertex), -1), np.zeros(len(self.vertex), int)
        starts = np.flatnonzero((cut[self.edge] & divided) | (self.twin < 0))
        while True:
            # Walk around all vertices at once, a corner of each fan at a time.
            corner, number, step = starts, starts, 0
            while len(corner):
                fan[corner], rank[corner] = number, step
                goes_on = ~ends[corner]
                corner, number, step = turned[corner[goes_on]], number[goes_on], step + 1
                is_new = fan[corner] < 0
                corner, number = corner[is_new], number[is_new]
            # Fans that are left are closed and begin anywhere.
            unnumbered = np.flatnonzero(fan < 0)
            if not len(unnumbered):
                return fan, rank
            starts = unnumbered[np.unique(self.vertex[unnumbered], return_index=True)[1]]
