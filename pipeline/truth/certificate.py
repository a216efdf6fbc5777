"""How wrong are rows of a table? A sample of them, solved again with the other rule of integration and more rays.

Rows of position images and their moments come from random rays: quadrature judges them. Rows by `direct` come from
quadrature: random rays judge them. Both rules share the trace, which published rays judge.
"""

import itertools
import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from pipeline.camera.integrals import random_integrals
from pipeline.truth.direct import Search, errors_px
from pipeline.truth.solve import Rig

ROWS = 64
"""Rows that are solved again for each camera."""
WITHIN = 0.95
"""Share of them that must lie within the claim."""
WORST = 5.0
"""No row may differ by more than so many claims."""
SHARPER = 3.0
"""The certificate's own standard error must be so many times smaller than the claim."""
NOTHING = "nothing to certify: the tables have no row"
"""Why there is no verdict where no point was seen."""
NO_CLAIM_PX = 1e-3
"""What is aimed at where nothing is claimed."""

_RANDOM_RAYS = tuple(1 << power for power in range(16, 23, 2))
_TURNS, _ROUGH_PX = 3, 0.01
_BINS_PX = (0.0, 1.0, 2.0, 4.0)


@dataclass(frozen=True, slots=True)
class Rows:
    """Rows of a table that shall be judged.

    Attributes
    ----------
    planes : (n, 4, 3) float64
        Tangent planes at their target points.
    cell : (n,) int64
        Row of their microlens; 0 for a conventional camera.
    x_px : (n, 2) float64
    is_direct : (n,) bool
        Whether they were found by quadrature.
    """

    planes: np.ndarray
    cell: np.ndarray
    x_px: np.ndarray
    is_direct: np.ndarray

    def only(self, kept: np.ndarray) -> "Rows":
        """The rows that `kept` says or numbers."""
        return Rows(self.planes[kept], self.cell[kept], self.x_px[kept], self.is_direct[kept])


def sample(count: int, seed: int) -> np.ndarray:
    """Numbers of up to ROWS rows, drawn without repetition, ascending."""
    return np.sort(np.random.default_rng(seed).permutation(count)[:ROWS])


def certify(rig: Rig, rows: Rows, of: int, claim_px: float | None) -> dict[str, Any]:
    """Solve rows again and state the differences; plain data for the manifest.

    Parameters
    ----------
    of : int
        Rows that the sample was drawn from.
    claim_px : float or None
        None: no claim, no verdict.
    """
    apart, sigma = differences(rig, rows, NO_CLAIM_PX if claim_px is None else claim_px)
    length, own = np.hypot(*apart.T), float(np.sqrt(np.mean(np.sum(sigma**2, axis=1)))) if len(sigma) else 0.0
    document = {
        "claim_px": claim_px,
        "rows": len(length),
        "of": of,
        "by_quadrature": int(np.sum(~rows.is_direct)),
        "by_random_rays": int(np.sum(rows.is_direct)),
        **_figures(length),
        "own_sigma_px": _plain(own),
        "by_distance_from_cell_edge": [
            {
                "from_px": low,
                "to_px": high,
                "rows": int(here.sum()),
                **_figures(length[here]),
            }
            for low, high, here in _bins(edge_distance_px(rig, rows))
        ],
    }
    if not of:
        return {**document, "passed": None, "reason": NOTHING}
    if claim_px is None:
        return {**document, "passed": None, "reason": "the method makes no claim"}
    reason = _against(length, own, claim_px)
    return {**document, "passed": reason is None, "reason": reason}


def _against(length: np.ndarray, own: float, claim_px: float) -> str | None:
    """Why a sample does not prove a claim."""
    if not np.isfinite(length).all():
        return f"{int(np.sum(~np.isfinite(length)))} rows have no light where the table puts them"
    if not own < claim_px / SHARPER:
        return f"its own standard error {own:.1e} px is not under a third of the claim"
    within = float(np.mean(length <= claim_px)) if len(length) else 1.0
    if within < WITHIN:
        return f"only {within:.1%} of the rows lie within the claim"
    if length.max(initial=0.0) > WORST * claim_px:
        return f"a row differs by {length.max():.1e} px, more than {WORST:g} claims"
    return None


def differences(rig: Rig, rows: Rows, claim_px: float) -> tuple[np.ndarray, np.ndarray]:
    """What the other rule moves rows by, and its standard error, (n, 2) each [px]; NaN where there is no light."""
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
    apart[lit], planes = 0.0, np.stack([rows.planes, rows.planes], axis=1)
    for rays in _RANDOM_RAYS:
        for _ in range(_TURNS):
            x = rows.x_px[lit] + apart[lit]
            found = random_integrals(rig.tracer, x, rig.lens(rows.cell[lit]), planes[lit], rays, rig.square_px)
            step = -np.einsum("nij,nj->ni", search.inverse[lit], found.moments[:, :2])
            apart[lit] += step
            sigma[lit] = errors_px(search.inverse[lit], found)
            if not (np.abs(step) > _ROUGH_PX).any():
                break
        lit = lit[np.hypot(*sigma[lit].T) > claim_px / SHARPER / 2]
        if not len(lit):
            break
    return apart, sigma


def edge_distance_px(rig: Rig, rows: Rows) -> np.ndarray:
    """Distance of rows from the edge of their cell, or from the border of the image, (n,)."""
    sensor, pitch = rig.tracer.camera.sensor, rig.tracer.camera.sensor.pitch_mm
    border = np.array([sensor.width_px, sensor.height_px]) / 2 - np.abs(
        rows.x_px - (np.array([sensor.width_px, sensor.height_px]) - 1) / 2
    )
    if rig.images is None or len(rig.images.centre_mm) < 2:
        return border.min(axis=1)
    centre = rig.images.centre_mm
    x = rig.tracer.positions_mm(*rows.x_px.T)
    nearest = rig.images.tree.query(x, k=2)[1]
    other = np.where(nearest[:, 0] == rows.cell, nearest[:, 1], nearest[:, 0])
    between = centre[other] - centre[rows.cell]
    middle = (centre[other] + centre[rows.cell]) / 2
    inward = np.einsum("ni,ni->n", middle - x, between) / np.linalg.norm(between, axis=1)
    return np.minimum(inward / pitch, border.min(axis=1))


def _bins(distance_px: np.ndarray) -> list[tuple[float, float | None, np.ndarray]]:
    pairs = itertools.pairwise((*_BINS_PX, math.inf))
    return [(low, _finite(high), (distance_px >= low) & (distance_px < high)) for low, high in pairs]


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None


def _figures(length: np.ndarray) -> dict[str, float | None]:
    if not len(length):
        return {"mean_px": None, "rms_px": None, "max_px": None}
    values = length.mean(), np.sqrt(np.mean(length**2)), length.max()
    return dict(zip(("mean_px", "rms_px", "max_px"), map(_plain, values), strict=True))


def _plain(value: float) -> float | None:
    """Two significant digits more than anybody reads; None for what is not known."""
    return float(f"{value:.4g}") if math.isfinite(value) else None
