"""Claim: a certificate says passed or failed only where its own error lets it, and knows both kinds of rows."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from laws import rigs
from laws.solving import judged_rows, rig_of, solved
from shorter import few_cases

from pipeline.camera.rig import Rig
from pipeline.camera.tracer import Tracer
from pipeline.targets.patterns.checkerboard import Checkerboard
from pipeline.truth import judging
from pipeline.truth.judging import Differences, Rows, certify, verdict
from pipeline.truth.planes import Exposed, tangent_planes
from pipeline.truth.settings import ROWS, SHARPER, rows_of_build

CLAIM_PX = 1e-4


def by_direct(inner_mm: float = 0.0, columns: int = 2, rows: int = 1) -> tuple[Rig, Rows]:
    camera = rigs.conventional(17.1)
    stop = {"inner_semi_diameter_mm": inner_mm} if inner_mm else {}
    rig = rig_of(rigs.reshaped(camera, {camera.prescription.stop_index: stop}))
    board, pose = Checkerboard(columns=columns, rows=rows, square_mm=1.4), rigs.facing(450.0, 20.0)
    return rig, judged_rows(solved(rig, board, pose, CLAIM_PX).solutions, tangent_planes(pose, board.points_mm()), True)


def moved(rows: Rows, x_px: float, y_px: float) -> Rows:
    return replace(rows, x_px=rows.x_px + np.array([x_px, y_px]))


def test_a_judge_that_is_too_blunt_refutes_nothing_and_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    """Few random rays cannot tell 1e-4 px; they can tell a tenth of a pixel."""
    monkeypatch.setattr(judging, "JUDGES_RAYS", (1 << 12,))
    rig, rows = by_direct()
    open_ = certify(rig, rows, 2, CLAIM_PX)
    assert open_["own_sigma_px"] > CLAIM_PX / 3
    assert open_["passed"] is None and "undecided: its own standard error" in open_["reason"]
    far = certify(rig, moved(rows, 0.1, 0.0), 2, CLAIM_PX)
    assert far["passed"] is False and "2 of 2 rows lie beyond" in far["reason"]


def test_fresh_rays_sharpen_a_judge_until_it_decides(monkeypatch: pytest.MonkeyPatch) -> None:
    """A claim that the first rays are a little too blunt for: six batches more make it known."""
    rig, rows = by_direct()
    monkeypatch.setattr(judging, "JUDGES_RAYS", (1 << 14,))
    monkeypatch.setattr(judging, "_BATCHES", 1)
    blunt = certify(rig, rows, 2, 1e-9)["own_sigma_px"]
    assert certify(rig, rows, 2, 1.5 * blunt)["passed"] is None
    monkeypatch.setattr(judging, "_BATCHES", 6)
    sharp = certify(rig, rows, 2, 1.5 * blunt)
    assert sharp["passed"] is True and sharp["own_sigma_px"] < 0.6 * blunt


def test_the_error_that_a_judge_by_random_rays_states_is_the_one_it_makes(monkeypatch: pytest.MonkeyPatch) -> None:
    """Over forty seeds, of rows at the border of two pixels, where other random numbers begin."""
    rig, rows = by_direct()
    assert np.allclose(rows.x_px[:, 1] % 1.0, 0.5, atol=1e-6)
    monkeypatch.setattr(judging, "JUDGES_RAYS", (1 << 10, 1 << 12))
    first, again = [], []
    for seed in range(40):
        judge = judging._RandomRays(replace(rig, tracer=Tracer(rig.tracer.camera, seed)), rows)
        judge.approach(6e-3)
        first.append((judge.apart_px / judge.sigma_px).copy())
        judge.judge_doubtful_again(6e-3)
        again.append((judge.apart_px / judge.sigma_px)[judge.freedom == 18])
    first, again = np.concatenate(first), np.concatenate(again)
    assert len(again) > 0.8 * len(first)
    for errors in (first, again):
        assert 0.7 < np.sqrt(np.mean(np.square(errors))) < 1.3
        assert np.abs(errors).max() < 5


@pytest.mark.parametrize(("moved_px", "passed"), few_cases([(4e-4, True), (1.6e-3, False)], (0.0, True), (3e-2, False)))
def test_an_error_of_more_than_the_claim_is_seen_although_rows_begin_with_few_rays(
    moved_px: float, passed: bool
) -> None:
    rig, rows = by_direct()
    found = certify(rig, moved(rows, 0.6 * moved_px, -0.8 * moved_px), 2, 1e-3)
    assert found["passed"] is passed
    assert abs(found["mean_px"] - moved_px) < 3e-4 + found["own_sigma_px"]


def test_twice_the_claim_in_one_row_of_twenty_is_found() -> None:
    """Where all others keep it by far: two of forty rows were "within 95 %"."""
    rig, rows = by_direct(columns=8, rows=5)
    assert certify(rig, rows, 40, 1e-3)["passed"] is True
    rows.x_px[[7, 31]] += 2e-3 * np.array([[1.0, 0.0], [-0.6, 0.8]])
    found = certify(rig, rows, 40, 1e-3)
    assert found["passed"] is False and found["reason"].startswith("2 of 40 rows lie beyond")
    assert [found[name] for name in ("within_claim", "beyond_claim")] == [38, 2]


def test_rows_that_surely_keep_the_claim_get_no_more_rays(monkeypatch: pytest.MonkeyPatch) -> None:
    rig, rows = by_direct()
    traced, trace = [], judging.random_integrals

    def counted(*arguments: Any, **others: Any) -> Any:
        traced.append(arguments[2])
        return trace(*arguments, **others)

    monkeypatch.setattr(judging, "random_integrals", counted)
    certify(rig, rows, 2, 1.0)
    assert traced == [1 << 14]
    for claim_px in (5e-4, 3e-3):
        found = judging.differences(rig, rows, claim_px)
        length, own = found.length_px, found.error_px
        assert ((length + SHARPER * own <= claim_px) | (own <= claim_px / SHARPER / 2)).all()
    assert max(traced) > 1 << 14


@pytest.mark.parametrize(("of", "rows"), [(0, 45), (12, 45), (168, 45), (512, 64), (3295, 135)])
def test_a_build_judges_one_row_in_eight(of: int, rows: int) -> None:
    assert rows_of_build(of) == rows
    x_px = np.arange(2.0 * of).reshape(of, 2)
    drawn = Rows(Exposed.still(np.zeros((of, 4, 3))), np.arange(of), x_px, True).drawn(3, rows)
    assert len(drawn.cell) == min(of, rows) and (np.diff(drawn.cell) > 0).all()
    np.testing.assert_array_equal(drawn.x_px, x_px[drawn.cell])


def rows_and(length: list[float], own: list[float], freedom: float, is_direct: bool) -> tuple[Differences, Rows]:
    n = len(length)
    found = np.array([length, [0.0] * n]).T, np.array([own, [0.0] * n]).T
    rows = Rows(Exposed.still(np.zeros((n, 4, 3))), np.zeros(n, int), np.zeros((n, 2)), is_direct)
    return Differences(*found, np.full(n, freedom)), rows


FEW, MANY = 3.0, 18.0


@pytest.mark.parametrize(
    ("length", "own", "freedom", "is_direct", "expected"),
    [
        ([0.5] * 20, [0.1] * 20, FEW, True, True),
        (
            [0.5] * 19 + [2.0],
            [0.1] * 20,
            MANY,
            True,
            False,
        ),  # 2 - 10 * 0.1: nine errors beyond the claim in one row of 20
        ([0.5] * 19 + [2.0], [0.1] * 20, FEW, True, True),  # the same of four replicas is chance, once in 1,000 rows
        ([0.5] * 19 + [1.3], [0.2] * 20, MANY, True, True),  # so is this
        ([1.6] * 20, [0.2] * 20, MANY, True, False),  # but not twenty times
        ([1.3] * 20, [0.2] * 20, MANY, True, None),  # twenty times this may be
        ([0.5] * 20, [0.6] * 20, MANY, True, None),  # none is beyond twice the claim, but could be
        ([0.1] * 19 + [2.0], [0.1] * 19 + [9.0], MANY, True, True),  # one may lie anywhere; the other 19 are known
        ([0.1] * 18 + [2.0] * 2, [0.1] * 18 + [9.0] * 2, MANY, True, None),
        ([0.5] * 18 + [1.5] * 2, [0.0] * 20, MANY, False, None),  # position images: a tenth, but 5 % is fewer than two
        ([0.5] * 10 + [1.5] * 10, [0.0] * 20, MANY, False, False),
        ([0.5] * 19 + [6.0], [0.0] * 20, MANY, False, False),  # one lies beyond five claims
        ([np.nan] + [0.1] * 19, [0.1] * 20, MANY, True, False),
        ([], [], MANY, True, None),
    ],
)
def test_verdicts(
    length: list[float], own: list[float], freedom: float, is_direct: bool, expected: bool | None
) -> None:
    """Differences and standard errors in claims."""
    passed, reason = verdict(*rows_and(length, own, freedom, is_direct), 1.0)
    assert passed is expected and (reason is None) == (expected is True)


class Synthetic(judging._RandomRays):
    """A judge whose replicas err as stated: of each row and number of rays by a law of their own, in two directions."""

    def __init__(self, true_px: np.ndarray, rows: Rows, seed: int, blunt_px: float) -> None:
        self.rows, self.lit, self.random, n = rows, np.arange(len(rows.cell)), np.random.default_rng(seed), len(true_px)
        self.true_px, self.apart_px, self.sigma_px = true_px, np.zeros((n, 2)), np.full((n, 2), np.nan)
        self.rays, self.freedom, self._error_before_mm = np.zeros(n, int), np.full(n, 3.0), np.full((n, 2), np.nan)
        self._error_mm = self._error_before_mm.copy()
        # From row to row blunt or sharp, and along one line or in all directions.
        self.blunt_px = blunt_px * 10 ** self.random.normal(0.0, 0.5, (n, 1)) * self.random.uniform(0.0, 1.0, (n, 2))

    def _step(self, here: np.ndarray, rays: int, stream: int = 0) -> tuple[np.ndarray, np.ndarray]:
        each = self.blunt_px[here] * (rays / (1 << 14)) ** -0.75 * self.random.normal(size=(4, len(here), 2))
        error = each.std(axis=0, ddof=1) / 2
        known = ~np.isnan(self._error_before_mm[here])
        pooled = np.where(
            known, np.sqrt((error**2 + np.where(known, self._error_before_mm[here], 0) ** 2 / 4) / 2), error
        )
        self._error_mm[here] = error
        return self.true_px[here] + each.mean(axis=0) - self.apart_px[here], pooled


def synthetic(true_px: np.ndarray, seed: int, blunt_px: float) -> tuple[bool | None, Differences]:
    """The verdict on rows by `direct` with true errors (n,) in claims, by a judge so blunt with 2^14 rays."""
    n, angle = len(true_px), np.random.default_rng(-seed % 2**32).uniform(0, 2 * np.pi, len(true_px))
    rows = Rows(Exposed.still(np.zeros((n, 4, 3))), np.zeros(n, int), np.zeros((n, 2)), True)
    judge = Synthetic(true_px[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1), rows, seed, blunt_px)
    judge.approach(1.0)
    judge.judge_doubtful_again(1.0)
    return verdict(judge.differences, rows, 1.0)[0], judge.differences


@pytest.mark.parametrize(("rows", "blunt_px"), few_cases([(16, 30.0)], (135, 1.0), (16, 1.0), (135, 30.0), (45, 300.0)))
@pytest.mark.parametrize("error_px", [1.0, 0.1])
def test_of_right_datasets_one_in_a_thousand_is_refuted_at_most(rows: int, blunt_px: float, error_px: float) -> None:
    """1,000 datasets, in the worst case with every row at its claim: none, where 2e-5 of them may be."""
    for seed in range(1000):
        passed, _ = synthetic(np.full(rows, error_px), seed, blunt_px)
        assert passed is not False, seed


@pytest.mark.heavy
@pytest.mark.parametrize("inner_mm", [15.0, 0.0])
def test_two_hundred_judges_of_a_real_table_refute_none(inner_mm: float, monkeypatch: pytest.MonkeyPatch) -> None:
    """Judges with so few rays that they err by up to ten claims, and rows that all err by one. Three standard errors of
    four replicas refuted two of the tables behind an obstruction.
    """
    monkeypatch.setattr(judging, "JUDGES_RAYS", (1 << 10, 1 << 12))
    claim_px, (rig, rows) = 3e-3, by_direct(inner_mm)
    rows = moved(rows, 0.6 * claim_px, -0.8 * claim_px)
    for seed in range(200):
        of_seed = replace(rig, tracer=Tracer(rig.tracer.camera, seed))
        assert verdict(judging.differences(of_seed, rows, claim_px), rows, claim_px)[0] is not False, seed


def test_errors_of_twice_the_claim_in_a_twentieth_of_the_rows_are_found() -> None:
    """Of a sample of the size that `verify` draws; judges as they are before real lenses, some 0.1 to 1 claims."""
    for seed in range(200):
        errors = np.full(ROWS, 0.1)
        errors[np.random.default_rng(seed).permutation(ROWS)[: ROWS // 20]] = 2.0
        assert synthetic(errors, seed, 1.0)[0] is False
    assert 0.95**ROWS < 1e-3
