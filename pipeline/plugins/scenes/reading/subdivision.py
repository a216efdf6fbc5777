"""Subdivision surfaces: control cages, refined until their triangles are within a tolerance of the limit surface.

Catmull-Clark, Loop and bilinear surfaces with boundaries, and with creases and corners that are infinitely sharp or
semi-sharp. The rules are those of OpenSubdiv, to which USD refers, with uniform creases. Each level is a sparse matrix
on the points of the cage, so primvars at its vertices follow by the same rule. Lengths are in the unit of the points.
"""

from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from scipy import sparse

from pipeline.plugins.scenes.reading.cage import INFINITELY_SHARP, Cage
from pipeline.records.shapes import Float64

CATMULL_CLARK, LOOP, BILINEAR = "catmullClark", "loop", "bilinear"
_SPREAD = {CATMULL_CLARK: 1.0, BILINEAR: 1.0, LOOP: 4.0 / 3.0}
"""Largest distance of a triangle from a curved surface, over that at the middles of its edges [1]: a right triangle is
farthest off at the middle of its longest edge, an equilateral one at its centre."""
_ROUNDED = 1.0 / 3.0
"""Distance of a semi-sharp crease that turns smooth from a sharp one, in edges of that level [1]: of a knife."""
_PARALLEL = 1e-9
"""Sine of the angle between two tangents up to which they count as parallel [1]: they are sums that round to 1e-16."""
_MEASURED = 50_000
"""Most faces of a level whose distance is measured at the next one [1]; beyond, each level halves the distance."""


def _matrix(row: np.ndarray, column: np.ndarray, value: Any, shape: tuple[int, int]) -> sparse.csr_matrix:
    return sparse.csr_matrix((np.broadcast_to(value, row.shape).astype(float), (row, column)), shape=shape)


def _scaled(factor: np.ndarray, matrix: sparse.csr_matrix) -> sparse.csr_matrix:
    return sparse.diags(factor).tocsr() @ matrix


def _loop_share(valence: np.ndarray) -> np.ndarray:
    """Weight of each neighbour of a smooth vertex by Loop's rule (1987) [1]."""
    return (5 / 8 - (3 / 8 + np.cos(2 * np.pi / valence) / 4) ** 2) / valence


class _Rules:
    """The matrices of one level of a scheme on a cage."""

    def __init__(self, cage: Cage, scheme: str) -> None:
        self.cage, self.scheme = cage, scheme
        self.v, self.e, self.f = len(cage.corner), len(cage.ends), len(cage.count)
        self.faces = _matrix(cage.face, cage.vertex, 1.0 / cage.count[cage.face], (self.f, self.v))
        each = np.repeat(np.arange(self.e), 2)
        self.middles = _matrix(each, cage.ends.ravel(), 0.5, (self.e, self.v))
        self.valence = np.bincount(cage.vertex, minlength=self.v)

    def edge_points(self) -> sparse.csr_matrix:
        """Points of the edges, smooth or sharp."""
        cage = self.cage
        if self.scheme == BILINEAR:
            return self.middles
        if self.scheme == LOOP:
            opposite = _matrix(cage.edge, cage.vertex[cage.before], 0.125, (self.e, self.v))
            smooth = 0.75 * self.middles + opposite
        else:
            smooth = 0.5 * self.middles + 0.25 * _matrix(cage.edge, cage.face, 1.0, (self.e, self.f)) @ self.faces
        sharp = np.minimum(cage.edge_sharp, 1.0)
        return _scaled(sharp, self.middles) + _scaled(1 - sharp, smooth)

    def vertex_points(self) -> sparse.csr_matrix:
        """Points of the vertices: by the rule of this level, blended with the next one's where a sharpness ends."""
        if self.scheme == BILINEAR:
            return sparse.identity(self.v, format="csr")
        edge, corner = self.cage.edge_sharp, self.cage.corner
        ending = (edge > 0) & (edge <= 1)
        corner_ends = (corner > 0) & (corner <= 1)
        total = np.bincount(self.cage.ends[ending].ravel(), np.repeat(edge[ending], 2), self.v)
        number = self.cage.marked_at(ending) + corner_ends
        share = np.where(number > 0, (total + np.where(corner_ends, corner, 0.0)) / np.maximum(number, 1), 1.0)
        smooth = self._smooth()
        now, after = (self._mixed(edge > level, corner > level, smooth, 1 / 8) for level in (0, 1))
        return _scaled(share, now) + _scaled(1 - share, after)

    def _mixed(
        self, sharp: np.ndarray, is_corner: np.ndarray, smooth: sparse.csr_matrix, beside: float
    ) -> sparse.csr_matrix:
        """Rows of smooth vertices, of creases with the weight `beside` of both neighbours, and of corners."""
        number = self.cage.marked_at(sharp)
        is_corner = is_corner | (number > 2)
        is_crease = ~is_corner & (number == 2)
        a, b = self.cage.ends[sharp].T
        along = _matrix(np.concatenate([a, b]), np.concatenate([b, a]), beside, (self.v, self.v))
        itself = np.where(is_corner, 1.0, np.where(is_crease, 1 - 2 * beside, 0.0))
        mixed = sparse.diags(itself).tocsr() + _scaled(is_crease.astype(float), along)
        return mixed + _scaled((~is_corner & ~is_crease).astype(float), smooth)

    def _smooth(self) -> sparse.csr_matrix:
        """Rows of smooth vertices v of n neighbours e with the face points f: ((n - 2) v + mean e + mean f) / n by
        Catmull and Clark, (1 - n b) v + b sum e by Loop.
        """
        cage, n = self.cage, np.maximum(self.valence, 1)
        around = _matrix(cage.vertex, cage.vertex[cage.after], 1.0, (self.v, self.v))
        if self.scheme == LOOP:
            share = _loop_share(n)
            return sparse.diags(1 - n * share).tocsr() + _scaled(share, around)
        around = around + _matrix(cage.vertex, cage.face, 1.0, (self.v, self.f)) @ self.faces
        return sparse.diags((n - 2) / n).tocsr() + _scaled(1.0 / n**2, around)

    def limits(self) -> sparse.csr_matrix:
        """Limit points of the vertices of a cage of quads (triangles for Loop); remaining creases count as infinitely
        sharp.
        """
        if self.scheme == BILINEAR:
            return sparse.identity(self.v, format="csr")
        cage, n = self.cage, np.maximum(self.valence, 1)
        around = _matrix(cage.vertex, cage.vertex[cage.after], 1.0, (self.v, self.v))
        if self.scheme == LOOP:
            share = 1.0 / (3.0 / (8.0 * _loop_share(n)) + n)
            smooth = sparse.diags(1 - n * share).tocsr() + _scaled(share, around)
        else:
            across = _matrix(cage.vertex, cage.vertex[cage.after[cage.after]], 1.0, (self.v, self.v))
            smooth = sparse.diags(n / (n + 5)).tocsr() + _scaled(1.0 / (n * (n + 5)), 4.0 * around + across)
        return self._mixed(cage.edge_sharp > 0, cage.corner > 0, smooth, 1 / 6)


def _child(cage: Cage, scheme: str) -> Cage:
    """The cage of the next level: vertices, then edges, then faces; one quad for each corner, and for Loop one triangle
    for each corner and then one for each face."""
    v, e, f = len(cage.corner), len(cage.ends), len(cage.count)
    sharp = np.maximum(cage.edge_sharp - 1, 0)[cage.edge]
    at_edge = v + cage.edge
    nothing = np.zeros(len(sharp))
    if scheme == LOOP:
        rows = [cage.vertex, at_edge, at_edge[cage.before]]
        edges = [sharp, nothing, sharp[cage.before]]
        vertex = np.concatenate([np.stack(rows, axis=1).ravel(), at_edge])
        sharpness = np.concatenate([np.stack(edges, axis=1).ravel(), nothing])
        count, more = np.full(len(vertex) // 3, 3), e
    else:
        rows = [cage.vertex, at_edge, v + e + cage.face, at_edge[cage.before]]
        vertex = np.stack(rows, axis=1).ravel()
        sharpness = np.stack([sharp, nothing, nothing, sharp[cage.before]], axis=1).ravel()
        count, more = np.full(len(cage.vertex), 4), e + f
    corner = np.where(cage.corner >= INFINITELY_SHARP, np.inf, np.maximum(cage.corner - 1, 0))
    return Cage(vertex, count, sharpness, np.concatenate([corner, np.zeros(more)]))


class Levels:
    """The levels of one cage, refined on demand. Bilinear cages need not be manifold."""

    def __init__(self, cage: Cage, scheme: str, split: str = "") -> None:
        if scheme != BILINEAR:
            cage.require_manifold()
        self.scheme = scheme
        self._split = split or scheme  # into quads, or triangles as Loop does
        self._cages = [cage]
        self._points = [sparse.identity(len(cage.corner), format="csr")]
        self._origin = [np.arange(len(cage.count))]

    def cage(self, level: int) -> Cage:
        while len(self._cages) <= level:
            cage, origin = self._cages[-1], self._origin[-1]
            rules = _Rules(cage, self.scheme)
            parts = [rules.vertex_points(), rules.edge_points()]
            is_loop = self._split == LOOP
            step = sparse.vstack(parts if is_loop else [*parts, rules.faces], format="csr")
            self._points.append(step @ self._points[-1])
            self._cages.append(_child(cage, self._split))
            self._origin.append(np.concatenate([origin[cage.face], origin]) if is_loop else origin[cage.face])
        return self._cages[level]

    def origin(self, level: int) -> np.ndarray:
        """Face of the first cage of each face of a level."""
        self.cage(level)
        return self._origin[level]

    def points(self, level: int, *, of_limit: bool = True) -> sparse.csr_matrix:
        """Weights of the vertices of the first cage for each vertex of a level, of the limit or of the level itself."""
        cage = self.cage(level)
        return _Rules(cage, self.scheme).limits() @ self._points[level] if of_limit else self._points[level]

    def normals(self, level: int, points: Float64[np.ndarray, "v 3"]) -> Float64[np.ndarray, "c 3"]:
        """Unit normals of the limit at the corners of a level; `points` are those of the first cage."""
        return limit_normals(self.cage(level), self.scheme, self._points[level] @ points)

    @cached_property
    def least(self) -> int:
        """The first level with a rule for its limit: faces with other numbers of corners are split once."""
        corners = 3 if self._split == LOOP else 4
        return 0 if (self._cages[0].count == corners).all() else 1

    def level_for(self, points: Float64[np.ndarray, "v 3"], tolerance: float, most_faces: int) -> tuple[int, float]:
        """The first level whose limit points, joined by triangles, are within a distance of the limit surface, and that
        distance: measured at the points of the next level. No level with more faces than `most_faces` is taken.
        """
        level, distance = self.least, np.inf
        while True:
            faces = len(self.cage(level).count)
            if faces <= _MEASURED or (level == self.least and 4 * faces <= most_faces):
                distance = self._distance(level, points)
            else:
                distance /= 2
            if distance <= tolerance or 4 * faces > most_faces:
                return level, distance
            level += 1

    def _distance(self, level: int, points: np.ndarray) -> float:
        """Largest distance of triangles of a level from the limit, at the middles of edges and diagonals: along the
        normal, of creases across the edge.
        """
        cage, finer = self.cage(level), self.cage(level + 1)
        flat, limit = (self.points(n) @ points for n in (level, level + 1))
        v, e = len(cage.corner), len(cage.ends)
        normal = np.zeros((len(finer.corner), 3))
        np.add.at(normal, finer.vertex, self.normals(level + 1, points))
        normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-300)
        chord = flat[cage.ends[:, 1]] - flat[cage.ends[:, 0]]
        off = limit[v : v + e] - flat[cage.ends].mean(axis=1)
        along = chord / np.maximum(np.linalg.norm(chord, axis=1, keepdims=True), 1e-300)
        beside = np.linalg.norm(off - np.sum(off * along, axis=1, keepdims=True) * along, axis=1)
        across = np.abs(np.sum(off * normal[v : v + e], axis=1))
        sharp = cage.edge_sharp > 0
        distances = [np.where(sharp, beside, across)]
        ending = sharp & np.isfinite(cage.edge_sharp)  # becomes smooth later, where edges are shorter
        shorter = 2.0 ** -np.floor(cage.edge_sharp[ending])
        distances.append(_ROUNDED * shorter * np.linalg.norm(chord[ending], axis=1))
        if self._split != LOOP:
            first = np.cumsum(cage.count) - cage.count
            middle = (flat[cage.vertex[first]] + flat[cage.vertex[first + 2]]) / 2
            distances.append(np.abs(np.sum((limit[v + e :] - middle) * normal[v + e :], axis=1)))
        return _SPREAD[self.scheme] * float(np.concatenate(distances).max(initial=0.0))


class _Weights(NamedTuple):
    """Weights of points around a vertex, for a tangent there, by corner [1].

    `near` is that of the neighbour at which the face of a corner begins, and `far` that of the vertex diagonally across
    the face; an open fan also has its last neighbour, `last`, and the vertex itself, `apex`.
    """

    near: np.ndarray
    far: np.ndarray
    last: np.ndarray
    apex: np.ndarray


def _tangent_weights(scheme: str, n: np.ndarray, i: np.ndarray, is_open: np.ndarray) -> tuple[_Weights, _Weights]:
    """Weights for two tangents of the limit at the vertex of a fan of n faces, of its i-th corner.

    They are left eigenvectors of the rule: sines around the vertex (Stam 1998), over half a turn in an open fan, whose
    first tangent is that of its crease. More than four quads, or six triangles, on one side of a crease have no common
    tangent plane by these rules.

    With the angle t of a face, 2 pi / n or pi / n, neighbours have near cos(i t), and near sin(i t); diagonals have
    far (cos(i t) + cos((i + 1) t)), and so with sines. By Catmull and Clark near = 4, far = 1 / (4 l - 1) and the
    eigenvalue l = 5/16 + [cos t + cos(t/2) sqrt(18 + 2 cos t)] / 16; by Loop near = 1, far = 0, l = 3/8 + cos t / 4.
    """
    angle = np.where(is_open, np.pi, 2 * np.pi) / n
    cosine, sine = np.cos(angle), np.sin(angle)
    is_wide = angle < np.pi
    if scheme == LOOP:
        near, far, beside = 1.0, np.zeros(len(n)), 1 / 8
        eigenvalue = 3 / 8 + cosine / 4
    else:
        near, beside = 4.0, 1 / 16
        eigenvalue = 5 / 16 + (cosine + np.cos(angle / 2) * np.sqrt(2 * (9 + cosine))) / 16
        far = 1.0 / np.where(is_wide, 4 * eigenvalue - 1, np.inf)
    # The end of an open fan: its row of the rule, (l - 1/4) end = (beside near + far / 4) sin t - total / 8
    total = (near + 2 * far) / np.tan(angle / 2)
    ends = np.where(is_wide, (beside * near + far / 4) * sine - total / 8, 1.0)
    ends = ends / np.where(is_wide, eigenvalue - 1 / 4, 1.0)
    c, s = (wave(i * angle) for wave in (np.cos, np.sin))
    c1, s1 = (wave((i + 1) * angle) for wave in (np.cos, np.sin))
    # The first tangent of an open fan is the difference of its ends, along the crease.
    first_near = np.where(is_open, (i == 0).astype(float), near * c)
    first_far = np.where(is_open, 0.0, far * (c + c1))
    second_near = np.where(is_open & (i == 0), ends, near * s)
    return (
        _Weights(first_near, first_far, -np.ones(len(n)), np.zeros(len(n))),
        _Weights(second_near, far * (s + s1), ends, -2 * ends - total),
    )


def limit_normals(cage: Cage, scheme: str, points: Float64[np.ndarray, "v 3"]) -> Float64[np.ndarray, "c 3"]:
    """Unit normals of the limit at the corners of a cage of quads or triangles, whose points are those of the cage: one
    for each side of a crease; at corners and for bilinear faces those of the faces.
    """
    after, before = points[cage.vertex[cage.after]], points[cage.vertex[cage.before]]
    across = points[cage.vertex[cage.after[cage.after]]]
    apex = points[cage.vertex]
    flat = _unit(np.cross(after - apex, before - apex))
    if scheme == BILINEAR:
        return flat
    # Creases divide the corners around a vertex into fans, each with tangents of its own: sums over its corners.
    sharp = cage.edge_sharp > 0
    fan, rank = cage.fans(sharp)
    size = np.bincount(fan, minlength=len(fan))[fan]
    sharp_edges = cage.marked_at(sharp)
    is_open = (sharp_edges > 1)[cage.vertex]
    is_last, is_first = is_open & (rank == size - 1), is_open & (rank == 0)
    tangents = []
    for of in _tangent_weights(scheme, size, rank, is_open):
        part = of.near[:, None] * after + of.far[:, None] * across
        part += np.where(is_last, of.last, 0.0)[:, None] * before + np.where(is_first, of.apex, 0.0)[:, None] * apex
        tangents.append(_sums(fan, part))
    normal = np.cross(tangents[0], tangents[1])
    # Corners have no tangents, and some fans parallel ones: these have the mean normal of their faces.
    is_corner = np.zeros(len(fan), bool)
    is_corner[fan] = ((cage.corner > 0) | (sharp_edges > 2))[cage.vertex]
    scale = np.linalg.norm(tangents[0], axis=1) * np.linalg.norm(tangents[1], axis=1)
    is_degenerate = is_corner | ~(np.linalg.norm(normal, axis=1) > _PARALLEL * scale)
    return np.where(is_degenerate[:, None], _unit(_sums(fan, flat)), _unit(normal))[fan]


def _sums(fan: np.ndarray, vectors: np.ndarray) -> np.ndarray:
    """Sums of the vectors of the corners of each fan, (c, 3)."""
    return np.stack([np.bincount(fan, vectors[:, k], len(fan)) for k in range(3)], axis=1)


def _unit(vectors: np.ndarray) -> np.ndarray:
    return vectors / np.maximum(np.linalg.norm(vectors, axis=1, keepdims=True), 1e-300)
