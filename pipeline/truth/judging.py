"""The certificate of a table: a sample of its rows, solved again with the other rule of integration and more rays.

Rows of position images come from random rays and are judged by quadrature. Rows by `direct` come from quadrature and
are judged by random rays. Both rules share the trace, which is tested against published rays.

The verdict is a test in two stages. In the first, more and more rays identify the rows that surely keep the claim. In
the second, doubtful rows are judged again by fresh rays alone, so that the choice of the first stage does not bias it.
The excess of a difference over the claim, divided by its standard error, is then at most a Student's t of the judge's
degrees of freedom, two-sided, whichever way errors point (Szekely and Bakirov, Prob. Theory Relat. Fields 126, 2003,
184).
"""

import itertools
import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.special import bdtrc, stdtr, stdtrit

from pipeline.camera.integrals import Bundles, Integral, pooled, random_integrals
from pipeline.camera.parts.camera import REPLICAS
from pipeline.camera.rig import Rig
from pipeline.files.jsonfile import Json
from pipeline.records.shapes import Float64, Int64
from pipeline.truth.direct.newton import Search
from pipeline.truth.direct.residuals import errors_px, mean_hit, over_exposure
from pipeline.truth.planes import Exposed
from pipeline.truth.settings import CLAIM_PX, JUDGES_RAYS, ROWS, SHARPER

FALSE_ALARM = 2e-5
"""Highest probability that a certificate refutes rows that all keep their claim [1]: for a dataset of fifty cameras
once in a thousand times. Half of it is spent on single rows, half on their number."""
_CHANCE = 0.01
"""Probability below which a difference in one row is not chance [1], though it may be in one of many."""
_SUSPECT = 0.2
"""Probability below which a row does not count as right and is judged again, as for errors of twice the claim [1]."""
_STEPS = 3
"""Most Newton steps with one number of rays: the first leaves little, and more rays follow."""
_ROUGH_PX = 0.01
"""Step length below which no further step with these rays is needed [px]: the remaining error is far smaller."""
_BATCHES = 6
"""Batches of fresh rays of a row that is judged again: 18 degrees of freedom and less than half of the standard error
prove an error of twice the claim in one of 135 rows."""


@dataclass(frozen=True, slots=True)
class Rows:
    """Rows of a table to be judged."""

    planes: Exposed  # tangent planes at their target points
    cell: Int64[np.ndarray, "n"]  # index of their microlens; 0 for a conventional camera
    x_px: Float64[np.ndarray, "n 2"]
    is_direct: bool  # whether they were found by quadrature

    def only(self, kept: Int64[np.ndarray, "n"]) -> "Rows":
        """The rows of these indices."""
        return Rows(self.planes.only(kept), self.cell[kept], self.x_px[kept], self.is_direct)

    @staticmethod
    def joined(parts: list["Rows"]) -> "Rows":
        """Rows of several tables, one after the other."""
        planes = Exposed.joined([part.planes for part in parts])
        cell = np.concatenate([np.zeros(0, np.int64), *(part.cell for part in parts)])
        x_px = np.concatenate([np.zeros((0, 2)), *(part.x_px for part in parts)])
        return Rows(planes, cell, x_px, all(part.is_direct for part in parts))

    def drawn(self, seed: int, rows: int = ROWS) -> "Rows":
        """A random sample of at most `rows` of these rows, drawn without repetition, in their order."""
        return self.only(np.sort(np.random.default_rng(seed).permutation(len(self.cell))[:rows]))


_ROUNDING_PX = 1e-12
"""Least error of an image position [px]."""


class Differences(NamedTuple):
    """Shifts of rows by the other rule and their standard errors, (n, 2) each [px], and degrees of freedom, (n,).

    NaN without light.
    """

    apart_px: np.ndarray
    sigma_px: np.ndarray
    freedom: np.ndarray

    @property
    def length_px(self) -> np.ndarray:
        """Lengths of the differences, (n,)."""
        return np.hypot(*self.apart_px.T)

    @property
    def error_px(self) -> np.ndarray:
        """Upper bounds of the standard errors of the lengths, (n,)."""
        return np.hypot(*self.sigma_px.T)

    def chance(self, claim_px: float | np.ndarray) -> np.ndarray:
        """Highest probability of such a difference if a row errs by its claim, (n,); above 1 within it."""
        return 2 * stdtr(self.freedom, (claim_px - self.length_px) / np.maximum(self.error_px, _ROUNDING_PX))

    def is_decisive(self, claim_px: float) -> np.ndarray:
        """Whether an error of twice the claim would be detected, (n,) bool."""
        return self.length_px + stdtrit(self.freedom, 1 - _CHANCE / 2) * self.error_px <= 2 * claim_px


def differences(rig: Rig, rows: Rows, claim_px: float) -> Differences:
    """Solve rows again by the other rule."""
    if not len(rows.cell):
        return Differences(np.zeros((0, 2)), np.zeros((0, 2)), np.zeros(0))
    return (_by_random_rays if rows.is_direct else _by_quadrature)(rig, rows, claim_px)


def _search(rig: Rig, rows: Rows) -> tuple[Search, np.ndarray]:
    """A search that begins at the rows, with the Jacobians of J there, and the indices of the rows that have one."""
    microlens = rig.microlens(rows.cell)
    search = Search(rig.tracer, microlens, lambda kept, _: rows.planes.only(kept), rows.x_px, rows.x_px, rig.square_px)
    search.linearise()
    return search, np.flatnonzero(np.isfinite(search.inverse).all(axis=(1, 2)))


def _by_quadrature(rig: Rig, rows: Rows, claim_px: float) -> Differences:
    """Differences of rows from their solutions by quadrature, to a tenth of the claim."""
    search, lit = _search(rig, rows)
    search.refine(lit, claim_px / 10)
    apart_px = np.full(rows.x_px.shape, np.nan)
    apart_px[lit] = search.x_px[lit] - rows.x_px[lit]
    return Differences(apart_px, search.sigma_px, np.where(search.is_random, REPLICAS - 1.0, _CERTAIN))


_CERTAIN = 1e9
"""Degrees of freedom of an error that is no random estimate: the difference of two levels of quadrature."""


def _by_random_rays(rig: Rig, rows: Rows, claim_px: float) -> Differences:
    """Differences of rows from their solutions by random rays, in the two stages of the test."""
    judge = _RandomRays(rig, rows)
    judge.approach(claim_px)
    judge.judge_doubtful_again(claim_px)
    return judge.differences


class _RandomRays:
    """Newton's method with random rays for rows of a table, from where the table puts them; NaN without light.

    `lit`: indices of the rows with a Jacobian, ascending. `inverse`: inverse Jacobian of J where the table puts each
    row, (n, 2, 2) [px per mm]; it stays the same from step to step.
    `apart_px`: shift of each row so far, and `sigma_px` its standard error, (n, 2) each.
    `rays`: number of rays of the last integral of each row, and `freedom` the degrees of freedom of its error, (n,).
    `_error_mm`: standard error of the mean hit in the last integral, (n, 2), and `_error_before_mm` that with the
    number of rays before; NaN: there was none.
    """

    def __init__(self, rig: Rig, rows: Rows) -> None:
        self.rig, self.rows = rig, rows
        search, self.lit = _search(rig, rows)
        self.inverse = search.inverse
        n = len(rows.x_px)
        self.apart_px = np.full((n, 2), np.nan)
        self.apart_px[self.lit] = 0.0
        self.sigma_px = np.full((n, 2), np.nan)
        self.rays = np.zeros(n, int)
        self.freedom = np.full(n, REPLICAS - 1.0)
        self._error_mm = np.full((n, 2), np.nan)
        self._error_before_mm = np.full((n, 2), np.nan)

    @property
    def differences(self) -> Differences:
        """The shifts so far, and their errors."""
        return Differences(self.apart_px, self.sigma_px, self.freedom)

    def approach(self, claim_px: float) -> None:
        """Newton's method with more and more rays, until the errors of all rows are small enough."""
        doubtful = self.lit
        for rays in JUDGES_RAYS:
            # Solve with this number of rays; their error is pooled with that of the number before.
            self.rays[doubtful] = rays
            self._error_before_mm[doubtful] = self._error_mm[doubtful]
            for _ in range(_STEPS):
                step, self.sigma_px[doubtful] = self._step(doubtful, rays)
                self.apart_px[doubtful] += step
                if not (np.abs(step) > _ROUGH_PX).any():
                    break
            # Keep the rows that may break the claim, and whose own error is not small enough yet.
            length = np.hypot(*self.apart_px[doubtful].T)
            sigma = np.hypot(*self.sigma_px[doubtful].T)
            doubtful = doubtful[(length + SHARPER * sigma > claim_px) & (sigma > claim_px / SHARPER / 2)]
            if not len(doubtful):
                break

    def judge_doubtful_again(self, claim_px: float) -> None:
        """Judge rows that may not keep their claim by fresh rays alone, and those that more rays can decide."""
        # Select the rows: undecided ones that the errors of all batches would decide, and suspect ones.
        freedom = _BATCHES * (REPLICAS - 1.0)
        expected_sigma_px = self.sigma_px / math.sqrt(_BATCHES)
        with_batches = Differences(0 * self.apart_px, expected_sigma_px, np.full_like(self.freedom, freedom))
        is_doubtful = ~self.differences.is_decisive(claim_px) & with_batches.is_decisive(claim_px)
        is_doubtful |= self.differences.chance(claim_px) < _SUSPECT
        # Take the mean step of all batches, each of as many rays as the row had last; errors add in squares.
        self._error_before_mm[:] = np.nan
        for rays in np.unique(self.rays[is_doubtful]).tolist():
            rows = np.flatnonzero(is_doubtful & (self.rays == rays))
            step, error = np.stack([self._step(rows, rays, stream) for stream in range(1, _BATCHES + 1)], axis=1)
            self.apart_px[rows] += step.mean(axis=0)
            self.sigma_px[rows] = np.sqrt(np.sum(error**2, axis=0)) / _BATCHES
            self.freedom[rows] = freedom

    def _step(self, rows: np.ndarray, rays: int, stream: int = 0) -> tuple[np.ndarray, np.ndarray]:
        """The remaining Newton step from the current positions, and its standard error."""
        # Random numbers stay those of the row's pixel, even if it moves: at a border a change would make J jump.
        x = self.rows.x_px[rows] + self.apart_px[rows]
        microlens = self.rig.microlens(self.rows.cell[rows])

        def integrate(planes: np.ndarray) -> Integral:
            bundles = Bundles(x, microlens, planes, self.rig.square_px, self.rows.x_px[rows])
            return random_integrals(self.rig.tracer, bundles, rays, stream)

        integral = over_exposure(self.rows.planes.only(rows), integrate)
        self._error_mm[rows] = integral.error_mm
        sigma = errors_px(self.inverse[rows], pooled(integral, self._error_before_mm[rows]))
        return -np.einsum("nij,nj->ni", self.inverse[rows], mean_hit(integral.moments)), sigma


def rms(values: Float64[np.ndarray, "n"]) -> float:
    """Root mean square; 0 for an empty array."""
    return float(np.sqrt(np.mean(values**2))) if len(values) else 0.0


WITHIN = 0.95
"""Least share of the rows of a table that must be shown to lie within the claim [1]. For position images, whose own
rays are random, the share corresponds to two standard deviations of normal errors."""
WORST = 5.0
"""Claims by which a row of a position image may differ [1]: with `WITHIN` alone one row in twenty could be anywhere."""
NOTHING = "nothing to certify: the tables have no row"
"""Reason for a missing verdict if no point is visible."""
_BINS_PX = (0.0, 1.0, 2.0, 4.0)
"""Distances from the border of a cell or of the image at which bins begin [px]: the search reads values up to two
pixels around a row, so rows nearer to a border have fewer of them."""


def certify(rig: Rig, rows: Rows, table_rows: int, claim_px: float | None) -> Json:
    """Solve rows again and report the differences, as plain data for the manifest.

    `table_rows` is the number of rows from which the sample was drawn; without a claim there is no verdict.
    """
    measured = differences(rig, rows, CLAIM_PX if claim_px is None else claim_px)
    length = measured.length_px
    judge_error = measured.error_px
    from_edge_px = edge_distance_px(rig, rows)
    within, beyond = judged(measured, rows, math.inf if claim_px is None else claim_px)
    document = {
        "claim_px": claim_px,
        "rows": len(length),
        "of": table_rows,
        "kind": "direct" if rows.is_direct else "position images",
        "within_claim": None if claim_px is None else int(np.sum(within)),
        "beyond_claim": None if claim_px is None else int(np.sum(beyond)),
        **_figures(length),
        "own_sigma_px": _plain(rms(judge_error)) if len(judge_error) else None,
        "differences_px": [_plain(difference) for difference in np.sort(length).tolist()],
        "by_distance_from_cell_edge": [
            {
                "from_px": low,
                "to_px": high if math.isfinite(high) else None,
                "rows": int(selected.sum()),
                **_figures(length[selected]),
            }
            for low, high in itertools.pairwise((*_BINS_PX, math.inf))
            for selected in [(from_edge_px >= low) & (from_edge_px < high)]
        ],
    }
    if not table_rows:
        return {**document, "passed": None, "reason": NOTHING}
    if claim_px is None:
        return {**document, "passed": None, "reason": "the method makes no claim"}
    passed, reason = verdict(measured, rows, claim_px)
    return {**document, "passed": passed, "reason": reason}


def judged(measured: Differences, rows: Rows, claim_px: float) -> tuple[np.ndarray, np.ndarray]:
    """Rows shown to lie within their claim, and rows shown to lie beyond, (n,) bool each; the rest is undecided."""
    within = (measured.chance(claim_px) > _SUSPECT) & measured.is_decisive(claim_px)
    # With n rows a single one may be refuted by chance n times as often (Bonferroni).
    limit_px = (1 if rows.is_direct else WORST) * claim_px
    beyond = measured.chance(limit_px) * len(within) < FALSE_ALARM / 2
    return within, beyond


def verdict(measured: Differences, rows: Rows, claim_px: float) -> tuple[bool | None, str | None]:
    """Whether a sample keeps a claim, and the reason if not; None if the judge's own error leaves it undecided."""
    length = measured.length_px
    n = len(rows.cell)
    if not n:
        return None, NOTHING
    if not np.isfinite(length).all():
        return False, f"{int(np.sum(~np.isfinite(length)))} rows have no light where the table puts them"
    within, beyond = judged(measured, rows, claim_px)
    if beyond.any():
        return (
            False,
            f"{int(beyond.sum())} of {n} rows lie beyond the claim, the worst by {length[beyond].max():.1e} px",
        )
    # Some right rows seem to be wrong by chance, and some of position images are. So a binomial test counts them.
    over = int(np.sum(measured.chance(claim_px) < _CHANCE))
    if bdtrc(over - 1, n, _CHANCE + (0 if rows.is_direct else 1 - WITHIN)) < FALSE_ALARM / 2:
        return False, f"{over} of {n} rows seem to lie beyond the claim, too many for chance"
    share = float(np.mean(within))
    if share >= WITHIN:
        return True, None
    own_px = rms(measured.error_px)
    return None, f"undecided: its own standard error is {own_px:.1e} px, {share:.0%} of the rows are known to be right"


def edge_distance_px(rig: Rig, rows: Rows) -> np.ndarray:
    """Distance of rows from the edge of their cell or the border of the image, whichever is nearer, (n,) [px]."""
    sensor = rig.tracer.camera.sensor
    size_px = np.array(sensor.size_px)
    border = size_px / 2 - np.abs(rows.x_px - (size_px - 1) / 2)
    if rig.images is None or len(rig.images.centre_mm) < 2:
        return border.min(axis=1)
    # The edge of a cell is half-way between its own centre and that of the nearest other micro-image.
    centre = rig.images.centre_mm
    x = rig.tracer.positions_mm(*rows.x_px.T)
    nearest = rig.images.nearby.nearest(x, 2)[1]
    neighbour = np.where(nearest[:, 0] == rows.cell, nearest[:, 1], nearest[:, 0])
    towards = centre[neighbour] - centre[rows.cell]
    middle = (centre[neighbour] + centre[rows.cell]) / 2
    inside_mm = np.einsum("ni,ni->n", middle - x, towards) / np.linalg.norm(towards, axis=1)
    return np.minimum(inside_mm / sensor.pitch_mm, border.min(axis=1))


def _figures(length: np.ndarray) -> dict[str, float | None]:
    """Mean, root mean square and largest of the lengths of differences; None without rows."""
    if not len(length):
        return {"mean_px": None, "rms_px": None, "max_px": None}
    return {"mean_px": _plain(length.mean()), "rms_px": _plain(rms(length)), "max_px": _plain(length.max())}


def _plain(value: float) -> float | None:
    """A value rounded to a few digits more than anybody reads; None for NaN."""
    return float(f"{value:.4g}") if math.isfinite(value) else None
