"""Images of the exit pupil through points of microlens apertures, by their edges and corners, and the light in them.

The edge of such an image is bisected with real rays along directions from an inner point, evenly spaced ones where one
thing blocks all around. Else nodes of Gauss and Legendre lie on the arcs between corners, where what blocks changes.
"""

import functools
from dataclasses import dataclass

import numpy as np

from pipeline.camera.integrating.edge_kernels import PASSES
from pipeline.camera.micro_images import pinhole_kernels
from pipeline.camera.micro_images.pinhole_kernels import Bisections, Pencils, Sectors
from pipeline.camera.tracing.records import CameraArrays

DIRECTIONS = 24
"""Directions of a first look at an edge, 15 degrees apart: where one thing blocks all around, even nodes converge
faster than any power of their number."""
_EDGE_STEPS = 17
"""Bisections of an edge: to 1e-5 of its reach."""
_CORNER_STEPS = 10
"""Bisections of the 15 degrees in which a corner lies: to 0.015 degrees."""
_AROUND, _LEAST_PER_ARC = 48, 8
"""Nodes over a full circle with corners, and on each arc at least."""
_OFF_CENTRE = 0.1
"""Share of the mean radius: a base that lies farther from the middle moves there."""
_SPREAD = 256
"""Points of a spiral that are tried where a base is dark: one per 1/256 of the disc that light can reach."""
_GOLDEN_RAD = 2.399963229728653
"""Turn from one to the next [rad]: the golden angle, (3 - sqrt(5)) pi, which fills a disc evenly (Vogel, 1979)."""


@dataclass(frozen=True, slots=True)
class Apertures:
    """Microlenses, and points of their apertures.

    Attributes
    ----------
    camera : CameraArrays
    pencils : Pencils
        n of them, their points with neighbours, (types, m, 5, 3), as `pencils.add_light` takes them; the vertex first.
    shares : (m,) float64
        Weights of a quadrature over the aperture.
    """

    camera: CameraArrays
    pencils: Pencils
    shares: np.ndarray

    def light(self, middle: np.ndarray, shift: np.ndarray, limit: np.ndarray) -> np.ndarray:
        """Light of each microlens, its moments from `middle`, what it fills: (n, 4), see `pencils.add_light`.

        Parameters
        ----------
        middle : (n, 2) float64
            About the middle of the light through the vertex.
        shift : (n,) float64
            How far that moves per distance of the point in the aperture.
        limit : (n,) float64
            About how far light through one point may reach.
        """
        n, m = len(self.pencils.microlens), len(self.shares)
        owner, which = np.divmod(np.arange(n * m), m)
        off_vertex = self.pencils.points[self.pencils.kind, :, 0, :2]
        bases = (middle[:, None] + shift[:, None, None] * off_vertex).reshape(-1, 2)
        lit = self._settle(owner, which, bases, limit)
        along = _circle(np.tile(_even(), m))
        # All pencils of a microlens in one go: packets fill.
        radius, blocker = self.edges(
            np.arange(n),
            np.tile(np.repeat(np.arange(m), DIRECTIONS), (n, 1)),
            np.repeat(bases, DIRECTIONS, axis=0).reshape(n, -1, 2),
            np.broadcast_to(along, (n, *along.shape)),
            limit,
        )
        radius, blocker = radius.reshape(-1, DIRECTIONS), blocker.reshape(-1, DIRECTIONS)
        off, is_round = _middles(radius, blocker)
        sums, rounds = np.zeros((n, pinhole_kernels.SUMS)), np.flatnonzero(lit & is_round)
        angle = np.full((len(rounds), DIRECTIONS), 2 * np.pi / DIRECTIONS)
        sectors = _sectors(owner[rounds], which[rounds], bases[rounds], _even(), radius[rounds], angle)
        pinhole_kernels.add_light(self.camera, self.pencils, self.shares, middle, sectors, sums)
        others = np.flatnonzero(lit & ~is_round)
        if len(others):
            owner, which, bases, off = owner[others], which[others], bases[others], off[others]
            moved = bases + off
            passes = self._passes(owner, which[:, None], moved[:, None])[:, 0]
            bases = np.where(passes[:, None], moved, bases)
            turn, angle = self._between_corners(owner, which, bases, limit[owner])
            radius, _ = self._around(owner, which, bases, turn, limit[owner])
            sectors = _sectors(owner, which, bases, turn, radius, angle)
            pinhole_kernels.add_light(self.camera, self.pencils, self.shares, middle, sectors, sums)
        return sums

    def reach(self, origins: np.ndarray, directions: np.ndarray, limit: np.ndarray) -> np.ndarray:
        """Reach of light through the vertex from origins (n, 2) along (d, 2), (n, d); NaN from dark ones."""
        owner = np.arange(len(self.pencils.microlens))
        vertex = np.zeros(len(owner), np.int64)
        lit = self._passes(owner, vertex[:, None], origins[:, None])
        shape = len(owner), len(directions)
        which, starts = np.zeros(shape, np.int64), np.broadcast_to(origins[:, None], (*shape, 2))
        radius, _ = self.edges(owner, which, starts, np.broadcast_to(directions, (*shape, 2)), limit)
        return np.where(lit, radius, np.nan)

    def edges(
        self,
        owner: np.ndarray,
        which: np.ndarray,
        bases: np.ndarray,
        directions: np.ndarray,
        limit: np.ndarray,
        steps: int = _EDGE_STEPS,
    ) -> tuple[np.ndarray, np.ndarray]:
        """Reach of light of microlenses `owner` (p,) along directions (p, d, 2), and what blocks it, (p, d)."""
        low, high = np.zeros(which.shape), np.repeat(limit[:, None].astype(float), which.shape[1], axis=1)
        blocker = np.empty(which.shape, np.int64)
        # Of one layout, and writable, lest the kernel is compiled once more.
        which, bases, directions = (np.require(given, requirements=("C", "W")) for given in (which, bases, directions))
        own, points = self.pencils, np.ascontiguousarray(self.pencils.points[:, :, 0])
        through = Pencils(own.microlens[owner], own.kind[owner], points)
        pinhole_kernels.edges(self.camera, through, Bisections(which, bases, directions, low, high, blocker), steps)
        pinhole_kernels.edges.count(blocker.size * (steps + 2), len(self.camera.table))
        return (low + high) / 2, blocker

    def _around(
        self, owner: np.ndarray, which: np.ndarray, bases: np.ndarray, turn: np.ndarray, limit: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Edges of single pencils (p,) along angles (p, d)."""
        shape = turn.shape
        points, starts = np.broadcast_to(which[:, None], shape), np.broadcast_to(bases[:, None], (*shape, 2))
        return self.edges(owner, points, starts, _circle(turn), limit)

    def _passes(self, owner: np.ndarray, which: np.ndarray, positions: np.ndarray) -> np.ndarray:
        """Whether rays from sensor positions (p, d, 2) through points (p, d) pass."""
        nowhere = np.zeros(positions.shape)
        which = np.broadcast_to(which, positions.shape[:2])
        return self.edges(owner, which, positions, nowhere, np.zeros(len(owner)), 0)[1] == PASSES

    def _settle(self, owner: np.ndarray, which: np.ndarray, bases: np.ndarray, limit: np.ndarray) -> np.ndarray:
        """Whether light passes each point at all, (p,); bases that are dark move to a position that is not."""
        n, m = len(self.pencils.microlens), len(self.shares)
        lit = self._passes(np.arange(n), which.reshape(n, m), bases.reshape(n, m, 2)).ravel()
        dark = np.flatnonzero(~lit)
        number = np.arange(_SPREAD)
        spiral = np.sqrt(number / _SPREAD)[:, None] * _circle(number * _GOLDEN_RAD)
        tried = bases[dark, None] + limit[owner[dark], None, None] * spiral
        passes = self._passes(owner[dark], which[dark, None], tried)
        for row, around, ok in zip(dark, tried, passes, strict=True):
            if ok.any():
                some = around[ok]
                bases[row] = some[np.argmin(np.hypot(*(some - some.mean(axis=0)).T))]
                lit[row] = True
        return lit

    def _between_corners(
        self, owner: np.ndarray, which: np.ndarray, bases: np.ndarray, limit: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Angles (p, d) for a quadrature around pencils that are not round, and what they stand for; 0 fills up."""
        turn = np.tile(_even(), (len(owner), 1))
        _, blocker = self._around(owner, which, bases, turn, limit)
        changes = blocker != np.roll(blocker, -1, axis=1)
        # As many columns as the pencil with the most corners; of the others some columns mean nothing.
        order = np.argsort(~changes, axis=1, kind="stable")[:, : max(1, int(changes.sum(axis=1).max()))]
        left, before = turn[0][order], np.take_along_axis(blocker, order, axis=1)
        width = 2 * np.pi / DIRECTIONS
        for _ in range(_CORNER_STEPS):
            width /= 2
            _, here = self._around(owner, which, bases, left + width, limit)
            left = np.where(here == before, left + width, left)
        number = changes.sum(axis=1)
        arcs = [_on_arcs(row[:count] + width / 2) for row, count in zip(left, number, strict=True)]
        size = max(len(angles) for angles, _ in arcs)
        padded = np.zeros((2, len(arcs), size))
        for row, (angles, shares) in enumerate(arcs):
            padded[0, row, : len(angles)], padded[1, row, : len(angles)] = angles, shares
        return padded[0], padded[1]


def _sectors(
    owner: np.ndarray, which: np.ndarray, bases: np.ndarray, turn: np.ndarray, radius: np.ndarray, angle: np.ndarray
) -> Sectors:
    """Sectors of pencils (p,) with edges (p, d)."""
    count, turn = radius.shape[1], np.broadcast_to(turn, radius.shape)
    tips = np.repeat(owner, count), np.repeat(which, count), np.repeat(bases, count, axis=0)
    return Sectors(*tips, _circle(turn.ravel()), radius.ravel(), angle.ravel())


def _even() -> np.ndarray:
    return 2 * np.pi * np.arange(DIRECTIONS) / DIRECTIONS


def _circle(angle: np.ndarray) -> np.ndarray:
    """Unit vectors, (..., 2)."""
    return np.stack([np.cos(angle), np.sin(angle)], axis=-1)


def _middles(radius: np.ndarray, blocker: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Middles of regions (p, directions) from their bases, and whether one thing blocks all around near a middle."""
    area = np.maximum(1.5 * (radius**2).sum(axis=1), np.finfo(float).tiny)
    off = (radius**3) @ _circle(_even()) / area[:, None]
    same = (blocker == blocker[:, :1]).all(axis=1)
    return off, same & (np.hypot(*off.T) < _OFF_CENTRE * radius.mean(axis=1))


def _on_arcs(corners: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Nodes of Gauss and Legendre on the arcs between corners, and their weights; even ones where there are none."""
    if not len(corners):
        return _even(), np.full(DIRECTIONS, 2 * np.pi / DIRECTIONS)
    angles, shares = [], []
    for start, end in zip(corners, [*corners[1:], corners[0] + 2 * np.pi], strict=True):
        node, weight = _gauss(max(_LEAST_PER_ARC, int(np.ceil(_AROUND * (end - start) / (2 * np.pi)))))
        angles.append(start + (end - start) * node)
        shares.append((end - start) * weight)
    return np.concatenate(angles), np.concatenate(shares)


@functools.cache
def _gauss(count: int) -> tuple[np.ndarray, np.ndarray]:
    node, weight = np.polynomial.legendre.leggauss(count)
    return (node + 1) / 2, weight / 2
