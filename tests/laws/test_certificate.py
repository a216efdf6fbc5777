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
from pipeline.truth.judging import ROWS, Rows, _verdict, certify, rows_of_build, sample
from pipeline.truth.planes import Pairs, tangent_planes

CLAIM_PX = 1e-4


def by_direct() -> tuple[Rig, Rows]:
    rig, board, pose = (
        rig_of(rigs.conventional(17.1)),
        Checkerboard(columns=2, rows=1, square_mm=1.4),
        rigs.facing(450.0, 20.0),
    )
    return rig, judged_rows(solved(rig, board, pose, CLAIM_PX).solutions, tangent_planes(pose, board.points_mm()), True)


def moved(rows: Rows, x_px: float, y_px: float) -> Rows:
    return replace(rows, x_px=rows.x_px + np.array([x_px, y_px]))


def test_a_judge_that_is_too_blunt_refutes_nothing_and_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    """Few random rays cannot tell 1e-4 px; they can tell a tenth of a pixel."""
    monkeypatch.setattr(judging, "_RANDOM_RAYS", (1 << 12,))
    rig, rows = by_direct()
    open_ = certify(rig, rows, 2, CLAIM_PX)
    assert open_["own_sigma_px"] > CLAIM_PX / 3
    assert open_["passed"] is None and "undecided: its own standard error" in open_["reason"]
    far = certify(rig, moved(rows, 0.1, 0.0), 2, CLAIM_PX)
    assert far["passed"] is False and "within the claim" in far["reason"]


def test_more_batches_of_rays_sharpen_a_judge_until_it_decides(monkeypatch: pytest.MonkeyPatch) -> None:
    """A claim that one batch is a little too blunt for: five more halve its error, and the mean stays as true."""
    rig, rows = by_direct()
    monkeypatch.setattr(judging, "_RANDOM_RAYS", (1 << 14,))
    monkeypatch.setattr(judging, "_BATCHES", 1)
    blunt = certify(rig, rows, 2, 1e-9)["own_sigma_px"]
    claim = 3 * blunt / 1.3
    assert certify(rig, rows, 2, claim)["passed"] is None
    monkeypatch.setattr(judging, "_BATCHES", 6)
    sharp = certify(rig, rows, 2, claim)
    assert sharp["passed"] is True and sharp["own_sigma_px"] < claim / 3


def test_the_error_that_a_judge_by_random_rays_states_is_the_one_it_makes(monkeypatch: pytest.MonkeyPatch) -> None:
    """Over forty seeds, of rows at the border of two pixels, where other random numbers begin."""
    rig, rows = by_direct()
    assert np.allclose(rows.x_px[:, 1] % 1.0, 0.5, atol=1e-6)
    monkeypatch.setattr(judging, "_RANDOM_RAYS", (1 << 10, 1 << 12))
    monkeypatch.setattr(judging, "_BATCHES", 1)
    rigs_of_seeds = [replace(rig, tracer=Tracer(rig.tracer.camera, seed)) for seed in range(40)]
    apart, sigma = map(np.array, zip(*(judging.differences(one, rows, 1e-9) for one in rigs_of_seeds), strict=True))
    assert 0.7 < np.sqrt(np.mean((apart / sigma) ** 2)) < 1.3
    assert np.abs(apart / sigma).max() < 5


@pytest.mark.parametrize(("moved_px", "passed"), few_cases([(4e-4, True), (1.6e-3, False)], (0.0, True), (3e-2, False)))
def test_an_error_of_more_than_the_claim_is_seen_although_rows_begin_with_few_rays(
    moved_px: float, passed: bool
) -> None:
    rig, rows = by_direct()
    found = certify(rig, moved(rows, 0.6 * moved_px, -0.8 * moved_px), 2, 1e-3)
    assert found["passed"] is passed
    assert abs(found["mean_px"] - moved_px) < 3e-4 + found["own_sigma_px"]


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
        apart, sigma = judging.differences(rig, rows, claim_px)
        length, own = np.hypot(*apart.T), np.hypot(*sigma.T)
        assert ((length + judging.SHARPER * own <= claim_px) | (own <= claim_px / judging.SHARPER / 2)).all()
    assert max(traced) > 1 << 14


@pytest.mark.parametrize(("of", "rows"), [(0, 16), (12, 16), (168, 21), (512, 64), (3295, 64)])
def test_a_build_judges_one_row_in_eight(of: int, rows: int) -> None:
    assert rows_of_build(of) == rows
    is_direct = np.random.default_rng(2).permutation(np.arange(of) < of // 2)
    drawn = sample(is_direct, 3, rows)
    assert len(drawn) == min(of, rows)
    assert abs(2 * np.sum(is_direct[drawn]) - len(drawn)) <= 1


@pytest.mark.parametrize(
    ("length", "own", "expected"),
    [
        ([0.5] * 20, [0.1] * 20, True),
        ([0.5] * 18 + [1.5] * 2, [0.1] * 20, False),  # a tenth of the rows lies beyond the claim
        ([0.5] * 19 + [6.0], [0.1] * 20, False),  # one lies beyond five
        ([0.5] * 20, [0.4] * 20, None),  # all lie within, but with three errors more they would not
        ([0.1] * 19 + [2.0], [0.1] * 19 + [9.0], None),  # one row is known so badly that it may lie anywhere
        ([0.1] * 19 + [2.0], [0.1] * 19 + [0.9], True),  # it is known well enough: 2 + 3 * 0.9 claims are fewer than 5
        ([3.0] * 20, [0.5] * 20, False),  # a coarse judge, but even three errors less are too many
        ([np.nan] + [0.1] * 19, [0.1] * 20, False),
        ([], [], None),
    ],
)
def test_verdicts(length: list[float], own: list[float], expected: bool | None) -> None:
    """Differences and standard errors in claims."""
    passed, reason = _verdict(np.array(length), np.array(own), np.ones(len(own)), 1.0)
    assert passed is expected and (reason is None) == (expected is True)


def test_rows_of_a_kind_that_is_rare_in_the_table_weigh_little() -> None:
    """32 rows stand for one each, a fifth of them wrong, and 32 for a hundred each; then the other way round."""
    length, own = np.array([2.0] * 6 + [0.1] * 58), np.full(64, 0.01)
    rare = np.array([1.0] * 32 + [100.0] * 32)
    assert _verdict(length, own, rare, 1.0)[0] is True
    assert _verdict(length, own, rare[::-1], 1.0)[0] is False


@pytest.mark.parametrize(("images", "direct", "expected"), [(15, 153, 15), (500, 9, 55), (400, 400, 32), (3, 4, 3)])
def test_a_sample_has_both_kinds_and_stands_for_the_table(images: int, direct: int, expected: int) -> None:
    is_direct = np.random.default_rng(1).permutation(np.arange(images + direct) < direct)
    drawn = sample(is_direct, 5)
    assert len(set(drawn)) == len(drawn) == min(ROWS, images + direct) and (np.diff(drawn) > 0).all()
    assert np.sum(~is_direct[drawn]) == expected
    n = len(is_direct)
    rows = Rows(Pairs.still(np.zeros((n, 4, 3))), np.zeros(n, int), np.zeros((n, 2)), is_direct).drawn(5)
    assert rows.weights[~rows.is_direct].sum() == pytest.approx(images)
    assert rows.weights[rows.is_direct].sum() == pytest.approx(direct)
