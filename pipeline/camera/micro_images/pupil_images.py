"""Light through points of microlens apertures: images of the exit pupil.

A pencil is all rays through one point of an aperture. The sensor positions whose ray through it passes the camera fill
a region, the pinhole image of the exit pupil. The light of a microlens is the integral over its aperture of the
integrals over these regions, each in polar coordinates: sum of w L r dr dphi. `camera` is a
`camera.tracing.records.CameraArrays`.

The boundary of such an image is bisected with real rays along directions from an interior point. They are evenly spaced
if one aperture blocks all around, else Gauss-Legendre nodes on the arcs between corners, where the obstacle changes.
"""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from pipeline.camera.boundary import corners, directions, even_angles, halved, inner_points, unit_vectors, widened
from pipeline.camera.integrating.edge_kernels import probe
from pipeline.camera.integrating.edge_search import PASSES
from pipeline.camera.tracing.acceptance import accepted_share, is_limited
from pipeline.camera.tracing.microlens_kernels import AIM, PLAIN, aim_for, aims_for
from pipeline.camera.tracing.records import CameraArrays
from pipeline.jit.decorators import inline, kernel
from pipeline.records.shapes import Float64

LIGHT, BY_X, BY_Y, FILLED, SUMS = range(5)
"""Columns of the sums of `add_light`; the last is their number."""
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(5)
"""Nodes along the radius on [-1, 1], and their weights: exact to the ninth degree."""
_CONE_NODES, _CONE_WEIGHTS = np.polynomial.legendre.leggauss(16)
"""The nodes and weights for pixels that accept a cone of light: with its roll-off the weight of a ray has kinks."""
DIRECTIONS = 24
"""Directions of the first search for a boundary: even nodes converge fast if one aperture blocks all around."""
_EDGE_STEPS = 17
"""Bisections of a boundary: to 1e-5 of its radius."""
_WIDENINGS = 11
"""Times that the radius of a search grows by half while light passes at its end: up to 86-fold."""
_CORNER_STEPS = 10
"""Bisections of the 15 degrees that contain a corner: to 0.015 degrees."""
_AROUND, _LEAST_PER_ARC = 48, 8
"""Nodes over a full circle with corners, and least number on each arc."""
_OFF_CENTRE = 0.1
"""Distance of a base from the centroid, over the mean radius, beyond which it moves there."""
_SPREAD = 256
"""Points of a spiral that are tried where a base is dark: one per 1/256 of the disc that light can reach."""
_GOLDEN_RAD = 2.399963229728653
"""Angle from one to the next [rad]: the golden angle, (3 - sqrt(5)) pi, which fills a disc evenly (Vogel, 1979)."""


class Pencils(NamedTuple):
    """Microlenses and points of their apertures."""

    # (n,) int64, rows and types
    microlens: np.ndarray
    kind: np.ndarray
    # (types, k, 3) or (types, k, 5, 3) float64, points in the frame of the microlens; for `add_light` each with its
    # neighbours, see `_density`
    points: np.ndarray


class Rays(NamedTuple):
    """Rays from the sensor through points of microlens apertures."""

    owner: np.ndarray  # (m,) int64, the row of pencils that each belongs to, ascending
    point: np.ndarray  # (m,) int64, the point of its type that it passes
    starts: np.ndarray  # (m, 2) float64, sensor positions


class Sectors(NamedTuple):
    """Thin sectors of the regions of pencils."""

    # (f,) int64, the microlens, one of n, and the point of its aperture
    owner: np.ndarray
    point: np.ndarray
    # (f, 2) float64, the tip, and a unit vector
    bases: np.ndarray
    directions: np.ndarray
    # (f,) float64, radius of the light, and the angle that the direction represents
    radius: np.ndarray
    angle: np.ndarray


def probe_points(camera: CameraArrays, pencils: Pencils, rays: Rays, is_named: bool = False) -> np.ndarray:
    """Labels of rays, (m,): `PASSES` or another one, which names the obstacle if names are requested."""
    starts = np.ascontiguousarray(rays.starts)
    microlens = pencils.microlens[rays.owner]
    count = len(rays.owner)
    points = pencils.points[pencils.kind[rays.owner], rays.point]
    aims = np.empty((count, 2))
    aims_for(camera, microlens, starts, points, aims)
    label = np.empty(count, np.int64)
    probe(camera, starts, microlens, np.arange(count), aims, is_named, label)
    probe.count(count, len(camera.table))
    return label


@inline
def _density(camera, microlens, near, sx, sy):
    """Weight of a ray per area of the sensor and of the aperture, in the frame of the aperture [sr / mm^2]."""
    # `near` holds the point of the aperture and its neighbours along +x, -x, +y and -y.
    acceptance = camera.acceptance
    h = camera.microlenses[microlens, AIM]
    stretch = 1.0
    qx, qy = aim_for(camera, microlens, sx, sy, near[0, 0], near[0, 1], near[0, 2])
    if camera.elements.model != PLAIN:
        ax, ay = aim_for(camera, microlens, sx, sy, near[1, 0], near[1, 1], near[1, 2])
        bx, by = aim_for(camera, microlens, sx, sy, near[2, 0], near[2, 1], near[2, 2])
        cx, cy = aim_for(camera, microlens, sx, sy, near[3, 0], near[3, 1], near[3, 2])
        dx, dy = aim_for(camera, microlens, sx, sy, near[4, 0], near[4, 1], near[4, 2])
        stretch = abs((ax - bx) * (cy - dy) - (ay - by) * (cx - dx))
        stretch /= (near[1, 0] - near[2, 0]) * (near[3, 1] - near[4, 1])
    u, v = (qx - sx) / h, (qy - sy) / h
    squared = 1.0 + u * u + v * v
    share = accepted_share(acceptance, 1.0 / math.sqrt(squared)) if is_limited(acceptance) else 1.0
    return share * stretch / (h * h * squared * squared)


@kernel
def add_light(camera, pencils, shares, middle, sectors, sums):
    """Integrate light over the regions of pencils, whose points are nodes of a quadrature with weights `shares`.

    `sums`: (n, 4), added to: light [sr], its moments along x and y from `middle` [sr mm], and the area filled by light
    through node 0 [mm^2].
    """
    owner, point, bases, directions, radius, angle = sectors
    microlens, kind, points = pencils
    is_cone = camera.acceptance.half_angle > 0.0
    for f in range(owner.shape[0]):
        n, m = owner[f], point[f]
        near = points[kind[n], m]
        if m == 0:
            sums[n, FILLED] += 0.5 * radius[f] * radius[f] * angle[f]
        for k in range(len(_CONE_NODES) if is_cone else len(_NODES)):
            node, weight = (_CONE_NODES[k], _CONE_WEIGHTS[k]) if is_cone else (_NODES[k], _WEIGHTS[k])
            r = 0.5 * (1.0 + node) * radius[f]
            x, y = bases[f, 0] + r * directions[f, 0], bases[f, 1] + r * directions[f, 1]
            light = shares[m] * 0.5 * weight * radius[f] * r * angle[f]
            light *= _density(camera, microlens[n], near, x, y)
            sums[n, LIGHT] += light
            sums[n, BY_X] += light * (x - middle[n, 0])
            sums[n, BY_Y] += light * (y - middle[n, 1])


@dataclass(frozen=True, slots=True)
class Apertures:
    """Microlenses with points of their apertures."""

    camera: CameraArrays
    # n microlenses; points with neighbours, (types, m, 5, 3), as `add_light` takes them; the vertex first
    pencils: Pencils
    shares: Float64[np.ndarray, "m"]  # weights of a quadrature over the aperture

    def light(
        self, middle: Float64[np.ndarray, "n 2"], shift: Float64[np.ndarray, "n"], limit: Float64[np.ndarray, "n"]
    ) -> np.ndarray:
        """Light of each microlens, its moments from `middle`, and the area that it fills: (n, 4), see `add_light`.

        `middle`: approximate centre of the light through the vertex.
        `shift`: motion of that centre per motion of the aperture point.
        `limit`: approximate radius of the light through one point.
        """
        n, m = len(self.pencils.microlens), len(self.shares)
        owner, point = np.divmod(np.arange(n * m), m)
        from_vertex = self.pencils.points[self.pencils.kind, :, 0, :2]
        bases = (middle[:, None] + shift[:, None, None] * from_vertex).reshape(-1, 2)
        # Find a lit base in the region of every pencil, and its boundary in even directions.
        lit = self._find_bases(owner, point, bases, limit)
        tips = _Tips(owner, point, bases, limit[owner])
        row = np.repeat(np.arange(n * m), DIRECTIONS)
        angle = np.tile(even_angles(DIRECTIONS), n * m)
        radius, blocker = (values.reshape(-1, DIRECTIONS) for values in self._edges(tips, row, unit_vectors(angle)))
        # Integrate regions with a smooth boundary.
        offset, is_smooth = _middles(radius, blocker)
        sums = np.zeros((n, SUMS))
        smooth = np.repeat(lit & is_smooth, DIRECTIONS)
        share = np.full(np.count_nonzero(smooth), 2 * np.pi / DIRECTIONS)
        sectors = _sectors(tips, row[smooth], angle[smooth], radius.ravel()[smooth], share)
        add_light(self.camera, self.pencils, self.shares, middle, sectors, sums)
        # Integrate the rest between their corners.
        with_corners = np.flatnonzero(lit & ~is_smooth)
        if len(with_corners):
            sectors = self._between_corners(tips.only(with_corners), offset[with_corners])
            add_light(self.camera, self.pencils, self.shares, middle, sectors, sums)
        return sums

    def reach(
        self,
        origins: Float64[np.ndarray, "n 2"],
        directions: Float64[np.ndarray, "m 2"],
        limit: Float64[np.ndarray, "n"],
    ) -> np.ndarray:
        """Radius of the light through the vertex from origins (n, 2) along (d, 2), (n, d); NaN from dark ones."""
        n, d = len(self.pencils.microlens), len(directions)
        owner = np.arange(n)
        vertex = np.zeros(n, np.int64)
        lit = self._passes(owner, vertex, origins)
        tips = _Tips(owner, vertex, origins, limit)
        radius, _ = self._edges(tips, np.repeat(owner, d), np.tile(directions, (n, 1)))
        return np.where(lit[:, None], radius.reshape(n, d), np.nan)

    def _edges(self, tips: "_Tips", row: np.ndarray, along: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Radius of the light from the tips of some rows (m,), ascending, along (m, 2), and its obstacle, (m,) each."""
        owner, point, bases, limit = tips.only(row)

        def label(distance: np.ndarray, is_named: bool = False) -> np.ndarray:
            """Labels of the rays at these distances from the tips, (m,)."""
            starts = bases + distance[:, None] * along
            return probe_points(self.camera, self._points, Rays(owner, point, starts), is_named)

        def passes(distance: np.ndarray) -> np.ndarray:
            return label(distance) == PASSES

        bounds = widened(passes, np.zeros(len(row)), limit, lambda far: 1.5 * far, _WIDENINGS)
        low, high = halved(passes, *bounds, _EDGE_STEPS)
        return (low + high) / 2, label(high, is_named=True)

    @property
    def _points(self) -> Pencils:
        """The pencils without the neighbours of their points."""
        return self.pencils._replace(points=np.ascontiguousarray(self.pencils.points[:, :, 0]))

    def _passes(self, owner: np.ndarray, point: np.ndarray, starts: np.ndarray) -> np.ndarray:
        """Whether rays from sensor positions (m, 2) through points (m,) pass."""
        return probe_points(self.camera, self._points, Rays(owner, point, starts)) == PASSES

    def _find_bases(self, owner: np.ndarray, point: np.ndarray, bases: np.ndarray, limit: np.ndarray) -> np.ndarray:
        """Whether any light passes each point, (p,); dark bases move to a lit position."""
        lit = self._passes(owner, point, bases)
        dark = np.flatnonzero(~lit)
        # Try the points of a spiral around each dark base, and take the middle one of those that are lit.
        number = np.arange(_SPREAD)
        spiral = np.sqrt(number / _SPREAD)[:, None] * unit_vectors(number * _GOLDEN_RAD)
        trials = bases[dark, None] + limit[owner[dark], None, None] * spiral
        passes = self._passes(np.repeat(owner[dark], _SPREAD), np.repeat(point[dark], _SPREAD), trials.reshape(-1, 2))
        moved = inner_points(trials, passes.reshape(-1, _SPREAD))
        lit[dark] = ~np.isnan(moved[:, 0])
        bases[lit & np.isin(np.arange(len(lit)), dark)] = moved[lit[dark]]
        return lit

    def _between_corners(self, tips: "_Tips", offset: np.ndarray) -> Sectors:
        """Sectors of pencils with corners, about their centroids, `offset` (p, 2) from their tips, if those are lit."""
        # Move the tips to the centroids.
        centroid = tips.bases + offset
        passes = self._passes(tips.owner, tips.point, centroid)
        tips = tips._replace(bases=np.where(passes[:, None], centroid, tips.bases))
        # Find the corners, by the obstacles in even directions, and the directions of nodes between them.
        rows = np.arange(len(offset))
        row = np.repeat(rows, DIRECTIONS)
        angle = np.tile(even_angles(DIRECTIONS), len(rows))
        label = self._edges(tips, row, unit_vectors(angle))[1].reshape(-1, DIRECTIONS)

        def label_at(row: np.ndarray, angle: np.ndarray) -> np.ndarray:
            """Obstacles at the boundary in other directions."""
            return self._edges(tips, row, unit_vectors(angle))[1]

        edge_corners = corners(label_at, rows, label, _CORNER_STEPS)
        row, angle, share = directions(rows, edge_corners, _AROUND, _LEAST_PER_ARC, DIRECTIONS)
        order = np.lexsort((angle, row))
        row, angle, share = row[order], angle[order], share[order]
        return _sectors(tips, row, angle, self._edges(tips, row, unit_vectors(angle))[0], share)


class _Tips(NamedTuple):
    """Tips of sectors: rows of microlenses and points of apertures (p,), sensor positions (p, 2), first bounds (p,)."""

    owner: np.ndarray
    point: np.ndarray
    bases: np.ndarray
    limit: np.ndarray

    def only(self, rows: np.ndarray) -> "_Tips":
        """The tips of these rows, repeated as the rows are."""
        return _Tips(*(values[rows] for values in self))


def _sectors(tips: _Tips, row: np.ndarray, angle: np.ndarray, radius: np.ndarray, share: np.ndarray) -> Sectors:
    """Sectors at the tips of some rows (f,)."""
    owner, point, bases, _ = tips.only(row)
    return Sectors(owner, point, bases, unit_vectors(angle), radius, share)


def _middles(radius: np.ndarray, blocker: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Centroids of regions (p, directions) relative to their bases, and whether their boundary is smooth: one aperture
    blocks all around, and the base is near the centroid.
    """
    # A thin sector has its centroid at 2 r / 3: the centroid of all is the sum of r^3 u over 3/2 of the sum of r^2.
    denominator = np.maximum(1.5 * (radius**2).sum(axis=1), np.finfo(float).tiny)
    offset = (radius**3) @ unit_vectors(even_angles(DIRECTIONS)) / denominator[:, None]
    has_one_obstacle = (blocker == blocker[:, :1]).all(axis=1)
    return offset, has_one_obstacle & (np.hypot(*offset.T) < _OFF_CENTRE * radius.mean(axis=1))
