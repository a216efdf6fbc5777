"""A check that an edge holds all that passes: rays all over the bound of a bundle must agree with it."""

from dataclasses import dataclass

import numpy as np

from pipeline.camera.integrating.edge_kernels import PASSES
from pipeline.camera.integrating.ways import Ways
from pipeline.records.shapes import Float64, Int64

PROBES = 3
"""Rays over the whole bound per direction of a quadrature."""
_STEPS = 12
"""Bisections of the edge in the direction of a ray that disagrees: to 1/4096 of the way to the polygon, and what
disagrees by less agrees."""
_CHANCE, _ERRORS = 3.0, 4.0
"""So many rays, and standard errors of their number, may pass beyond the chords of an edge for nothing."""


def holds_all(
    ways: Ways,
    owner: Int64[np.ndarray, "m"],
    angle: Float64[np.ndarray, "m"],
    radius: Float64[np.ndarray, "m"],
    share: Float64[np.ndarray, "m"],
    count: int,
) -> tuple[np.ndarray, int]:
    """Whether `count` rays all over the bound of each position pass where an edge says so, (n,) bool; and rays traced.

    Between neighbouring directions the edge is taken for a chord. Where a ray says otherwise, the edge is sought in
    that ray's own direction and must agree with it: else what passes is in pieces, has a hole, or is not star-shaped.
    No more rays may pass beyond the chords than the area there accounts for: else the edge is drawn too short.

    Parameters
    ----------
    owner, angle, radius, share : (m,) int64, (m,) float64, (m,) float64, (m,) float64
        Directions of a quadrature, sorted by owner; the distance of the edge, and the angle that each stands for.
    """
    n = len(ways.positions)
    live = np.flatnonzero(np.bincount(owner, minlength=n))
    if not len(live):
        return np.ones(n, bool), 0
    chords = _chords(owner, angle, radius)
    who, points = np.repeat(live, count), ways.spread(live, count).reshape(-1, 2)
    passed = ways.probe(who, points) == PASSES
    away = points - ways.centres[who]
    towards, far = np.arctan2(away[:, 1], away[:, 0]), np.hypot(*away.T)
    surprise = np.flatnonzero(passed != (far < chords.at(who, towards)))
    edge, _, limit, rays = ways.find(who[surprise], towards[surprise], _STEPS)
    off = np.where(passed[surprise], far[surprise] - edge, edge - far[surprise])
    whole = np.ones(n, bool)
    whole[who[surprise][off > limit * 0.5**_STEPS]] = False

    outside = np.bincount(owner, 0.5 * share * radius**2, n) - chords.area(n)
    expected = count * np.maximum(outside[live], 0.0) / _areas(ways, live)
    beyond = np.bincount(who[surprise][passed[surprise]], minlength=n)[live]
    whole[live[beyond > expected + _CHANCE + _ERRORS * np.sqrt(expected)]] = False
    return whole, len(who) + rays


@dataclass(frozen=True, slots=True)
class _Chords:
    """Polygons through the ends of directions: owner, angle from 0 to 2 pi and radius, sorted; the direction that
    follows each, and the angle to it."""

    owner: np.ndarray
    angle: np.ndarray
    radius: np.ndarray
    following: np.ndarray
    turn: np.ndarray

    def at(self, owner: np.ndarray, angle: np.ndarray) -> np.ndarray:
        """Distance of the chord in some directions, (k,)."""
        angle = angle % (2 * np.pi)
        left = np.searchsorted(_key(self.owner, self.angle), _key(owner, angle), side="right") - 1
        bounds = np.searchsorted(self.owner, np.arange(int(self.owner[-1]) + 2))
        left = np.where(left < bounds[owner], bounds[owner + 1] - 1, left)
        after = (angle - self.angle[left]) % (2 * np.pi)
        a, b, turn = self.radius[left], self.radius[self.following[left]], self.turn[left]
        return a * b * np.sin(turn) / (a * np.sin(after) + b * np.sin(turn - after))

    def area(self, n: int) -> np.ndarray:
        """Area that the chords enclose, (n,)."""
        return np.bincount(self.owner, 0.5 * self.radius * self.radius[self.following] * np.sin(self.turn), n)


def _chords(owner: np.ndarray, angle: np.ndarray, radius: np.ndarray) -> _Chords:
    angle = angle % (2 * np.pi)
    order = np.lexsort((angle, owner))
    owner, angle, radius = owner[order], angle[order], radius[order]
    following = np.arange(1, len(owner) + 1)
    last = np.append(owner[1:] != owner[:-1], True)
    following[last] = np.searchsorted(owner, owner[last])
    return _Chords(owner, angle, radius, following, (angle[following] - angle) % (2 * np.pi))


def _key(owner: np.ndarray, angle: np.ndarray) -> np.ndarray:
    """One number to sort by."""
    return owner * 8.0 + angle


def _areas(ways: Ways, rows: np.ndarray) -> np.ndarray:
    """Areas of the polygons that bound some positions."""
    x, y = np.moveaxis(ways.polygons[rows], -1, 0)
    number = np.arange(x.shape[1])
    following = np.where(number + 1 < ways.counts[rows, None], number + 1, 0)
    cross = x * np.take_along_axis(y, following, axis=1) - y * np.take_along_axis(x, following, axis=1)
    return 0.5 * np.sum(np.where(number < ways.counts[rows, None], cross, 0.0), axis=1)
