"""Light through points of microlens apertures: images of the exit pupil, and contours of all light of a microlens.

A pencil is all rays through one point of an aperture. The sensor positions whose ray through it passes the camera fill
a region, the pinhole image of the exit pupil. The light of a microlens is the integral over its aperture of the
integrals over these regions, each in polar coordinates: sum of w L r dr dphi. `camera` is a
`camera.tracing.records.CameraArrays`.

The boundary of such an image is bisected with real rays along directions from an interior point. They are evenly spaced
if one aperture blocks all around, else Gauss-Legendre nodes on the arcs between corners, where the obstacle changes.

Along a direction the light of a microlens ends where the last point of its aperture goes dark, and that is a point of
the rim: just inside of it light passes a thin sliver of the aperture. Rays through points of the rim find it: first
coarse points all around, then finer ones about those that go dark last.
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
RIM = 384
"""Points around an aperture, about one per degree: a multiple of 4 and 6, so that corners of a cell are among them."""
_COARSE, _FINE = 24, 9
"""Points that are tried: first all around, then between the neighbours of the one that goes dark last."""
_STRIDE = RIM // _COARSE
"""Points of the rim from one coarse point to the next."""
_FINE_STRIDE = 2 * _STRIDE // (_FINE - 1)
"""Points of the rim from one fine point to the next: the fine ones span two coarse strides."""
_COARSE_STEPS, _FINE_STEPS = 7, 8
"""Bisections by coarse points, to 1/128 of a step, and then by fine ones, to 1/256 of what these leave."""
_CONTOUR_WIDENINGS = 20
"""Most steps inwards or outwards to where light and dark meet: a step is nearly a third of the pupil's image or of the
penumbra, whichever is smaller, and the search begins near the boundary."""


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


def look(camera: CameraArrays, pencils: Pencils, rays: Rays, is_named: bool = False) -> np.ndarray:
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
        off_vertex = self.pencils.points[self.pencils.kind, :, 0, :2]
        bases = (middle[:, None] + shift[:, None, None] * off_vertex).reshape(-1, 2)
        # Find a lit base in the region of every pencil, and its boundary in even directions.
        lit = self._find_bases(owner, point, bases, limit)
        tips = _Tips(owner, point, bases, limit[owner])
        row, angle = np.repeat(np.arange(n * m), DIRECTIONS), np.tile(even_angles(DIRECTIONS), n * m)
        radius, blocker = (values.reshape(-1, DIRECTIONS) for values in self._edges(tips, row, unit_vectors(angle)))
        # Integrate regions with a smooth boundary.
        off, is_round = _middles(radius, blocker)
        sums = np.zeros((n, SUMS))
        rounds = np.repeat(lit & is_round, DIRECTIONS)
        share = np.full(np.count_nonzero(rounds), 2 * np.pi / DIRECTIONS)
        sectors = _sectors(tips, row[rounds], angle[rounds], radius.ravel()[rounds], share)
        add_light(self.camera, self.pencils, self.shares, middle, sectors, sums)
        # Integrate the rest between their corners.
        cornered = np.flatnonzero(lit & ~is_round)
        if len(cornered):
            sectors = self._between_corners(tips.only(cornered), off[cornered])
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
        owner, vertex = np.arange(n), np.zeros(n, np.int64)
        lit = self._passes(owner, vertex, origins)
        tips = _Tips(owner, vertex, origins, limit)
        radius, _ = self._edges(tips, np.repeat(owner, d), np.tile(directions, (n, 1)))
        return np.where(lit[:, None], radius.reshape(n, d), np.nan)

    def _edges(self, tips: "_Tips", row: np.ndarray, along: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Radius of the light from the tips of some rows (m,), ascending, along (m, 2), and its obstacle, (m,) each."""
        owner, point, bases, limit = tips.only(row)

        def label(far: np.ndarray, is_named: bool = False) -> np.ndarray:
            return look(self.camera, self._points, Rays(owner, point, bases + far[:, None] * along), is_named)

        def passes(far: np.ndarray) -> np.ndarray:
            return label(far) == PASSES

        bounds = widened(passes, np.zeros(len(row)), limit, lambda far: 1.5 * far, _WIDENINGS)
        low, high = halved(passes, *bounds, _EDGE_STEPS)
        return (low + high) / 2, label(high, is_named=True)

    @property
    def _points(self) -> Pencils:
        """The pencils without the neighbours of their points."""
        return self.pencils._replace(points=np.ascontiguousarray(self.pencils.points[:, :, 0]))

    def _passes(self, owner: np.ndarray, point: np.ndarray, starts: np.ndarray) -> np.ndarray:
        """Whether rays from sensor positions (m, 2) through points (m,) pass."""
        return look(self.camera, self._points, Rays(owner, point, starts)) == PASSES

    def _find_bases(self, owner: np.ndarray, point: np.ndarray, bases: np.ndarray, limit: np.ndarray) -> np.ndarray:
        """Whether any light passes each point, (p,); dark bases move to a lit position."""
        lit = self._passes(owner, point, bases)
        dark = np.flatnonzero(~lit)
        number = np.arange(_SPREAD)
        spiral = np.sqrt(number / _SPREAD)[:, None] * unit_vectors(number * _GOLDEN_RAD)
        tried = bases[dark, None] + limit[owner[dark], None, None] * spiral
        passes = self._passes(np.repeat(owner[dark], _SPREAD), np.repeat(point[dark], _SPREAD), tried.reshape(-1, 2))
        moved = inner_points(tried, passes.reshape(-1, _SPREAD))
        lit[dark] = ~np.isnan(moved[:, 0])
        bases[lit & np.isin(np.arange(len(lit)), dark)] = moved[lit[dark]]
        return lit

    def _between_corners(self, tips: "_Tips", off: np.ndarray) -> Sectors:
        """Sectors of pencils with corners, about their centroids, `off` their tips (p, 2), if those are lit."""
        moved = tips.bases + off
        passes = self._passes(tips.owner, tips.point, moved)
        tips = tips._replace(bases=np.where(passes[:, None], moved, tips.bases))
        rows = np.arange(len(off))
        even = np.repeat(rows, DIRECTIONS), np.tile(even_angles(DIRECTIONS), len(rows))
        label = self._edges(tips, even[0], unit_vectors(even[1]))[1].reshape(-1, DIRECTIONS)

        def label_at(row: np.ndarray, angle: np.ndarray) -> np.ndarray:
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
    """Centroids of regions (p, directions) from their bases, and whether one aperture blocks all around, centred."""
    area = np.maximum(1.5 * (radius**2).sum(axis=1), np.finfo(float).tiny)
    off = (radius**3) @ unit_vectors(even_angles(DIRECTIONS)) / area[:, None]
    has_one_obstacle = (blocker == blocker[:, :1]).all(axis=1)
    return off, has_one_obstacle & (np.hypot(*off.T) < _OFF_CENTRE * radius.mean(axis=1))


class _Points(NamedTuple):
    """Rim points to try: the first one of each direction (n, d), their number, and their stride."""

    first: np.ndarray
    number: int
    stride: int


class Contours:
    """Outer boundaries of light along directions (d, 2) from origins (n, 2).

    `rims`: microlenses, and rings * RIM points around the aperture of each type. Several rings are for rims that are
    dark because another face cuts the light.
    """

    def __init__(
        self,
        camera: CameraArrays,
        rims: Pencils,
        origins: Float64[np.ndarray, "n 2"],
        directions: Float64[np.ndarray, "m 2"],
    ) -> None:
        self._camera, self._rims = camera, rims
        self._origins, self._directions = origins, directions

    def distances(self, outside: Float64[np.ndarray, "n d"], step: Float64[np.ndarray, "n"]) -> np.ndarray:
        """Distances (n, d) on the sensor from the origins to where the light ends [mm]; NaN where none was found.

        A position is lit if a ray from it through any of the rim points that are tried passes the camera.

        `outside`: distance beyond which it is dark, approximately. The search runs inwards from there, because near the
        middle a small pupil may be visible through the inside of the aperture only, and no rim point is lit.
        `step`: shorter than the distance over which the rim stays lit once light has reached it.
        """
        # Step outwards until all coarse rim points are dark.
        coarse = _Points(np.zeros(outside.shape, np.int64), _COARSE, _STRIDE)
        step = np.broadcast_to(step[:, None], outside.shape)
        _, high = self._darkened(outside, outside, step, coarse)
        # Step inwards, as far as the origin, until one of them is lit: then the light ends between low and high.
        low = high - step
        lit_point = np.full(high.shape, -1)
        for _ in range(_CONTOUR_WIDENINGS):
            lit_point = np.where(lit_point < 0, self._lit(low, coarse), lit_point)
            goes_on = (lit_point < 0) & (low > 0)
            if not goes_on.any():
                break
            low, high = np.where(goes_on, low - step, low), np.where(goes_on, low, high)
        # Bisect to where the last coarse point goes dark.
        low, high, lit_point = self._bisected(low, high, lit_point, coarse, _COARSE_STEPS)
        # Between that point and its neighbours the rim may be lit farther out: step outwards again, by fine points, and
        # bisect.
        fine = _Points(lit_point - _STRIDE, _FINE, _FINE_STRIDE)
        low, high = self._darkened(low, high, high - low, fine)
        low, high, _ = self._bisected(low, high, lit_point, fine, _FINE_STEPS)
        return np.where(lit_point >= 0, (low + high) / 2, np.nan)

    def _darkened(
        self, low: np.ndarray, high: np.ndarray, step: np.ndarray, tried: _Points
    ) -> tuple[np.ndarray, np.ndarray]:
        """Outer bounds moved outwards by steps until they are dark; inner ones follow."""
        return widened(lambda far: self._lit(far, tried) >= 0, low, high, lambda far: far + step, _CONTOUR_WIDENINGS)

    def _bisected(
        self, low: np.ndarray, high: np.ndarray, where: np.ndarray, tried: _Points, steps: int
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Narrowed brackets between light and dark, and the rim point that was lit last."""

        def passes(distance: np.ndarray) -> np.ndarray:
            nonlocal where
            lit = self._lit(distance, tried)
            where = np.where(lit >= 0, lit, where)
            return lit >= 0

        low, high = halved(passes, low, high, steps)
        return low, high, where

    def _lit(self, distance: np.ndarray, tried: _Points) -> np.ndarray:
        """The middle one of the lit rim points, (n, d); -1: all are dark."""
        first, count, stride = tried
        n, d = distance.shape
        point = (first[..., None] + stride * np.arange(count)) % RIM
        starts = self._origins[:, None] + distance[..., None] * self._directions
        rings = self._rims.points.shape[1] // RIM
        points = point[..., None] + RIM * np.arange(rings)
        each = count * rings
        rays = Rays(np.repeat(np.arange(n), d * each), points.ravel(), np.repeat(starts.reshape(-1, 2), each, axis=0))
        passes = (look(self._camera, self._rims, rays) == PASSES).reshape(n, d, count, rings).any(axis=3)
        # The middle of the first run: far from each other two parts of the rim may be lit.
        begins = np.argmax(passes & ~np.roll(passes, 1, axis=2), axis=2)[..., None]
        run = np.take_along_axis(passes, (begins + np.arange(count)) % count, axis=2)
        length = np.where(run.all(axis=2), count, np.argmin(run, axis=2))
        middle = first + stride * begins[..., 0] + stride * (length - 1) // 2
        return np.where(length > 0, middle % RIM, -1)
