"""Rows solved again: those of position images by quadrature, those by quadrature with random rays."""

import math

import numpy as np

from pipeline.camera.integrals import random_integrals
from pipeline.truth.direct import Search, errors_px
from pipeline.truth.judged import Rows
from pipeline.truth.solve import Rig

SHARPER = 3.0
"""A judge is believed whose standard error is so many times smaller than the claim. Of a row judged less sharply the
difference counts with so many standard errors less to refute a claim, and with so many more to confirm it."""

_RANDOM_RAYS = tuple(1 << power for power in range(14, 23, 2))
"""Rays of a row, level by level: more of them only where a row is not yet known to keep the claim, by `SHARPER`
standard errors, and its own is not below half of what is believed."""
_TURNS, _ROUGH_PX = 3, 0.01
_BATCHES = 6
"""Batches of the most rays, in all: for rows that keep the judge from a decision."""


def differences(rig: Rig, rows: Rows, claim_px: float) -> tuple[np.ndarray, np.ndarray]:
    """Shifts of rows by the other rule, and their standard errors, (n, 2) each [px]; NaN where there is no light."""
    apart, sigma = np.full(rows.x_px.shape, np.nan), np.full(rows.x_px.shape, np.nan)
    for kind, judge in ((False, _by_quadrature), (True, _by_random_rays)):
        here = np.flatnonzero(rows.is_direct == kind)
        if len(here):
            apart[here], sigma[here] = judge(rig, rows.only(here), claim_px)
    return apart, sigma


def _search(rig: Rig, rows: Rows) -> tuple[Search, np.ndarray]:
    search = Search(rig.tracer, rig.lens(rows.cell), rows.planes, rows.x_px, rows.x_px, rig.square_px)
    search.look()
    return search, np.flatnonzero(np.isfinite(search.inverse).all(axis=(1, 2)))


def _by_quadrature(rig: Rig, rows: Rows, claim_px: float) -> tuple[np.ndarray, np.ndarray]:
    search, lit = _search(rig, rows)
    search.refine(lit, claim_px / 10)
    apart = np.full(rows.x_px.shape, np.nan)
    apart[lit] = search.x_px[lit] - rows.x_px[lit]
    return apart, search.sigma_px


def _by_random_rays(rig: Rig, rows: Rows, claim_px: float) -> tuple[np.ndarray, np.ndarray]:
    search, lit = _search(rig, rows)
    apart, sigma = np.full(rows.x_px.shape, np.nan), np.full(rows.x_px.shape, np.nan)
    apart[lit] = 0.0

    def judged(here: np.ndarray, rays: int, stream: int = 0) -> tuple[np.ndarray, np.ndarray]:
        """The step that is left from where rows are now, and its standard error."""
        planes, x = np.stack([rows.planes[here]] * 2, axis=1), rows.x_px[here] + apart[here]
        found = random_integrals(rig.tracer, x, rig.lens(rows.cell[here]), planes, rays, rig.square_px, stream)
        inverse = search.inverse[here]
        return -np.einsum("nij,nj->ni", inverse, found.moments[:, :2]), errors_px(inverse, found)

    doubtful = lit
    for rays in _RANDOM_RAYS:
        for _ in range(_TURNS):
            step, sigma[doubtful] = judged(doubtful, rays)
            apart[doubtful] += step
            if not (np.abs(step) > _ROUGH_PX).any():
                break
        length, own = np.hypot(*apart[doubtful].T), np.hypot(*sigma[doubtful].T)
        doubtful = doubtful[(length + SHARPER * own > claim_px) & (own > claim_px / SHARPER / 2)]
        if not len(doubtful):
            break
    batches = np.ones((len(lit), 1))
    for stream in range(1, _BATCHES):
        own, wanted = np.hypot(*sigma[lit].T), claim_px / SHARPER
        if not wanted <= rms(own) < wanted * math.sqrt(_BATCHES / stream):  # sharp enough, or beyond hope
            break
        blunt = np.flatnonzero(own >= wanted)
        step, error = judged(lit[blunt], _RANDOM_RAYS[-1], stream)
        # The mean of independent estimates, each as good as the others.
        before, batches[blunt] = batches[blunt], batches[blunt] + 1
        apart[lit[blunt]] += step / batches[blunt]
        sigma[lit[blunt]] = np.hypot(before * sigma[lit[blunt]], error) / batches[blunt]
    return apart, sigma


def rms(values: np.ndarray) -> float:
    """Root mean square; 0 of nothing."""
    return float(np.sqrt(np.mean(values**2))) if len(values) else 0.0
