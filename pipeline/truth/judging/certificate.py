"""The certificate of a table: a sample of its rows, solved again with the other rule of integration and more rays.

Rows of position images and their moments come from random rays and are judged by quadrature. Rows by `direct` come
from quadrature and are judged by random rays. Both rules share the trace, which is tested against published rays.
"""

import itertools
import math

import numpy as np

from pipeline.camera.rig import Rig
from pipeline.files.jsonfile import Json
from pipeline.truth.judging.judges import SHARPER, Rows, differences, rms
from pipeline.truth.settings import CLAIM_PX

WITHIN = 0.95
"""Share of the rows of a table that must lie within the claim [1]: two standard deviations of normal errors."""
WORST = 5.0
"""Claims by which the worst row may differ [1]: with `WITHIN` alone one row in twenty could be anywhere."""
NOTHING = "nothing to certify: the tables have no row"
"""Reason for a missing verdict if no point is seen."""
KINDS = ("position images", "direct")
"""Kinds of rows; the kind of a row decides the rule that judges it."""

_BINS_PX = (0.0, 1.0, 2.0, 4.0)
"""Distances from the border of a cell or of the image at which bins begin [px]: the search reads values up to two
pixels around a row, so rows nearer to a border have fewer of them.
"""


def certify(rig: Rig, rows: Rows, of: int, claim_px: float | None) -> Json:
    """Solve rows again and state the differences, as plain data for the manifest.

    `of` is the number of rows from which the sample was drawn; without a claim there is no verdict.
    """
    apart, sigma = differences(rig, rows, CLAIM_PX if claim_px is None else claim_px)
    length, sigma_length = np.hypot(*apart.T), np.hypot(*sigma.T)
    document = {
        "claim_px": claim_px,
        "rows": len(length),
        "of": of,
        "by_quadrature": int(np.sum(~rows.is_direct)),
        "by_random_rays": int(np.sum(rows.is_direct)),
        **_figures(length),
        "own_sigma_px": _plain(rms(sigma_length)) if len(sigma_length) else None,
        "differences_px": [_plain(difference) for difference in np.sort(length).tolist()],
        "by_kind": [_of_kind(kind, rows.weights[here], length[here], claim_px) for kind, here in _kinds(rows)],
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
    passed, reason = _verdict(length, sigma_length, rows.weights, claim_px)
    return {**document, "passed": passed, "reason": reason}


def _kinds(rows: Rows) -> list[tuple[str, np.ndarray]]:
    return [(kind, rows.is_direct == is_direct) for kind, is_direct in zip(KINDS, (False, True), strict=True)]


def _of_kind(kind: str, weights: np.ndarray, length: np.ndarray, claim_px: float | None) -> Json:
    within = None if claim_px is None else int(np.sum(length <= claim_px))
    return {"kind": kind, "rows": len(length), "of": round(weights.sum()), "within_claim": within, **_figures(length)}


def _verdict(
    length: np.ndarray, sigma: np.ndarray, weights: np.ndarray, claim_px: float
) -> tuple[bool | None, str | None]:
    """Whether a sample keeps a claim, and the reason if not; None if the judge's own error leaves it undecided.

    `sigma` are standard errors of the differences, `weights` the rows of the table that each stands for.
    """
    if not len(length):
        return None, NOTHING
    if not np.isfinite(length).all():
        return False, f"{int(np.sum(~np.isfinite(length)))} rows have no light where the table puts them"
    blunt = (sigma >= claim_px / SHARPER) & (rms(sigma) >= claim_px / SHARPER)
    slack = np.where(blunt, SHARPER * sigma, 0.0)
    reason = _against(length - slack, weights, claim_px)
    if reason is not None:
        return False, f"{reason}, each granted {SHARPER:g} standard errors of its judge" if slack.any() else reason
    reason = _against(length + slack, weights, claim_px)
    if reason is None:
        return True, None
    return None, f"undecided: its own standard error {rms(sigma):.1e} px is not under a third of the claim"


def _against(length: np.ndarray, weights: np.ndarray, claim_px: float) -> str | None:
    """The reason why a sample contradicts a claim; None if it does not."""
    within = float(np.average(length <= claim_px, weights=weights))
    if within < WITHIN:
        return f"only {within:.1%} of the rows lie within the claim"
    if length.max() > WORST * claim_px:
        return f"a row differs by {length.max():.1e} px, more than {WORST:g} claims"
    return None


def edge_distance_px(rig: Rig, rows: Rows) -> np.ndarray:
    """Distance of rows from the edge of their cell or the border of the image, whichever is nearer, (n,) [px]."""
    sensor, pitch = rig.tracer.camera.sensor, rig.tracer.camera.sensor.pitch_mm
    border = np.array([sensor.width_px, sensor.height_px]) / 2 - np.abs(
        rows.x_px - (np.array([sensor.width_px, sensor.height_px]) - 1) / 2
    )
    if rig.images is None or len(rig.images.centre_mm) < 2:
        return border.min(axis=1)
    centre = rig.images.centre_mm
    x = rig.tracer.positions_mm(*rows.x_px.T)
    nearest = rig.images.nearby.nearest(x, 2)[1]
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
    """A value rounded to a few digits more than anybody reads; None if it is unknown."""
    return float(f"{value:.4g}") if math.isfinite(value) else None
