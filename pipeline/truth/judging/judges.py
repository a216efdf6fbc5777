"""Samples of tables, and their judging: rows of position images are solved again by quadrature, those by quadrature
with random rays.
"""

import math
from dataclasses import dataclass, replace

import numpy as np

from pipeline.camera.integrals import Bundles, pooled, random_integrals
from pipeline.camera.rig import Rig
from pipeline.records.shapes import Bool, Float64, Int64
from pipeline.truth.direct.newton import Search, errors_px

ROWS = 64
"""Most rows that are solved again for each camera, so that the cost does not grow with the build."""
_FEWEST, _ONE_IN = 16, 8
"""Rows that a build solves again: at least so many, else one in so many. More would cost more than the build itself."""
SHARPER = 3.0
"""Ratio of claim to the judge's standard error above which a judgement is taken as exact. For a less exact one, the
difference minus so many standard errors must refute a claim, and the difference plus so many must confirm it.
"""

_RANDOM_RAYS = tuple(1 << power for power in range(14, 23, 2))
"""Numbers of rays of a row, level by level. More rays are used only while the row is not known, by `SHARPER`
standard errors, to keep the claim, and its own standard error is above half of the accepted one.
"""
_TURNS = 3
"""Most steps of Newton's method with the same number of rays: the first leaves little, and more rays follow."""
_ROUGH_PX = 0.01
"""Length of a step after which no further one with so many rays is needed [px]: the remaining error is far smaller."""
_BATCHES = 6
"""Total number of batches with the largest number of rays, for rows that prevent a decision."""


@dataclass(frozen=True, slots=True)
class Rows:
    """Rows of a table that are to be judged.

    `planes`: tangent planes at their target points.
    `cell`: index of their microlens; 0 for a conventional camera.
    `is_direct`: whether they were found by quadrature.
    `stands_for`: number of rows of the table that each one represents; None: one each.
    """

    planes: Float64[np.ndarray, "n 4 3"]
    cell: Int64[np.ndarray, "n"]
    x_px: Float64[np.ndarray, "n 2"]
    is_direct: Bool[np.ndarray, "n"]
    stands_for: Float64[np.ndarray, "n"] | None = None

    def only(self, kept: Int64[np.ndarray, "n"]) -> "Rows":
        return Rows(self.planes[kept], self.cell[kept], self.x_px[kept], self.is_direct[kept], self.weights[kept])

    @property
    def weights(self) -> np.ndarray:
        """Number of rows of the table that each one represents, (n,)."""
        return np.ones(len(self.cell)) if self.stands_for is None else self.stands_for

    def drawn(self, seed: int, rows: int = ROWS) -> "Rows":
        """A sample of these rows with so many rows, which represents all of them."""
        chosen = sample(self.is_direct, seed, rows)
        of, drawn = np.bincount(self.is_direct, minlength=2), np.bincount(self.is_direct[chosen], minlength=2)
        kind = self.is_direct[chosen].astype(int)
        return replace(self.only(chosen), stands_for=of[kind] / drawn[kind])


def rows_of_build(of: int) -> int:
    """Number of rows that the certificate of a build solves again if the tables have `of` rows."""
    return min(ROWS, max(_FEWEST, of // _ONE_IN))


def sample(is_direct: Bool[np.ndarray, "n"], seed: int, rows: int = ROWS) -> np.ndarray:
    """Indices of up to so many rows, drawn without repetition, ascending; half of either kind if possible."""
    order = np.random.default_rng(seed).permutation(len(is_direct))
    others, direct = order[~is_direct[order]], order[is_direct[order]]
    others = others[: max(rows // 2, rows - len(direct))]
    return np.sort(np.concatenate([others, direct[: rows - len(others)]]))


def differences(rig: Rig, rows: Rows, claim_px: float) -> tuple[np.ndarray, np.ndarray]:
    """Shifts of rows by the other rule, and their standard errors, (n, 2) each [px]; NaN without light."""
    apart, sigma = np.full(rows.x_px.shape, np.nan), np.full(rows.x_px.shape, np.nan)
    for kind, judge in ((False, _by_quadrature), (True, _by_random_rays)):
        here = np.flatnonzero(rows.is_direct == kind)
        if len(here):
            apart[here], sigma[here] = judge(rig, rows.only(here), claim_px)
    return apart, sigma


def _search(rig: Rig, rows: Rows) -> tuple[Search, np.ndarray]:
    search = Search(rig.tracer, rig.microlens(rows.cell), rows.planes, rows.x_px, rows.x_px, rig.square_px)
    search.look()
    return search, np.flatnonzero(np.isfinite(search.inverse).all(axis=(1, 2)))


def _by_quadrature(rig: Rig, rows: Rows, claim_px: float) -> tuple[np.ndarray, np.ndarray]:
    search, lit = _search(rig, rows)
    search.refine(lit, claim_px / 10)
    apart = np.full(rows.x_px.shape, np.nan)
    apart[lit] = search.x_px[lit] - rows.x_px[lit]
    return apart, search.sigma_px


def _by_random_rays(rig: Rig, rows: Rows, claim_px: float) -> tuple[np.ndarray, np.ndarray]:
    judge = _RandomRays(rig, rows)
    judge.approach(claim_px)
    judge.average(claim_px / SHARPER)
    return judge.apart_px, judge.sigma_px


class _RandomRays:
    """Rows that move to the positions where J is right according to random rays.

    `apart_px`, `sigma_px`: shift of each row and its standard error; NaN without light.
    """

    def __init__(self, rig: Rig, rows: Rows) -> None:
        self.rig, self.rows = rig, rows
        search, self.lit = _search(rig, rows)
        self.inverse = search.inverse
        self.apart_px, self.sigma_px = np.full(rows.x_px.shape, np.nan), np.full(rows.x_px.shape, np.nan)
        self.apart_px[self.lit] = 0.0
        self._error_mm, self._coarser_mm = np.full_like(self.apart_px, np.nan), np.full_like(self.apart_px, np.nan)

    def approach(self, claim_px: float) -> None:
        """Newton's method with more and more rays, until the errors of all rows are small enough."""
        doubtful = self.lit
        for rays in _RANDOM_RAYS:
            self._coarser_mm[doubtful] = self._error_mm[doubtful]
            for _ in range(_TURNS):
                step, self.sigma_px[doubtful] = self._step(doubtful, rays)
                self.apart_px[doubtful] += step
                if not (np.abs(step) > _ROUGH_PX).any():
                    break
            length, sigma = np.hypot(*self.apart_px[doubtful].T), np.hypot(*self.sigma_px[doubtful].T)
            doubtful = doubtful[(length + SHARPER * sigma > claim_px) & (sigma > claim_px / SHARPER / 2)]
            if not len(doubtful):
                break

    def average(self, wanted_px: float) -> None:
        """Average independent batches of the largest number of rays, for rows that prevent a decision."""
        batches = np.ones((len(self.lit), 1))
        for stream in range(1, _BATCHES):
            sigma = np.hypot(*self.sigma_px[self.lit].T)
            # Accurate enough, or too far from it
            if not wanted_px <= rms(sigma) < wanted_px * math.sqrt(_BATCHES / stream):
                break
            blunt = np.flatnonzero(sigma >= wanted_px)
            here = self.lit[blunt]
            step, error = self._step(here, _RANDOM_RAYS[-1], stream)
            # The mean of independent, equally accurate estimates.
            before, batches[blunt] = batches[blunt], batches[blunt] + 1
            self.apart_px[here] += step / batches[blunt]
            self.sigma_px[here] = np.hypot(before * self.sigma_px[here], error) / batches[blunt]

    def _step(self, here: np.ndarray, rays: int, stream: int = 0) -> tuple[np.ndarray, np.ndarray]:
        """The remaining step from the present positions, and its standard error.

        Random numbers are those of the row's pixel, even if it moves: at a border others would make J jump.
        """
        planes, x = np.stack([self.rows.planes[here]] * 2, axis=1), self.rows.x_px[here] + self.apart_px[here]
        microlens = self.rig.microlens(self.rows.cell[here])
        bundles = Bundles(x, microlens, planes, self.rig.square_px, self.rows.x_px[here])
        integral = random_integrals(self.rig.tracer, bundles, rays, stream)
        self._error_mm[here] = integral.error_mm
        sigma = errors_px(self.inverse[here], pooled(integral, self._coarser_mm[here]))
        return -np.einsum("nij,nj->ni", self.inverse[here], integral.moments[:, :2]), sigma


def rms(values: Float64[np.ndarray, "n"]) -> float:
    """Root mean square; 0 for an empty array."""
    return float(np.sqrt(np.mean(values**2))) if len(values) else 0.0
