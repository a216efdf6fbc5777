"""Tracing and searching everything, lot by lot; threads share the work."""

import sys
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor, as_completed
from pathlib import Path

import numpy as np
from corners import MIN_HIT_FRACTION, Corners
from results import Grid, Results
from sampling import SAMPLINGS
from windows import METHODS, moments, search

from pipeline.truth.direct.direct_rows import Guess, solve
from pipeline.truth.settings import TruthSettings

_LOT = 8
_OTHER_SEED = 77
_TRUSTED_ERRORS = 2.0
"""As in a build: a row of `moments` is kept if so many of its expected errors stay below the claim."""


def run(corners: Corners, grid: Grid, jobs: int, keep: Path | None = None) -> Results:
    """Everything, lot by lot; `keep` is a file that has all lots so far."""
    parts: list[Results] = []
    for first in range(0, len(corners), _LOT):
        parts.append(_run(corners.only(slice(first, first + _LOT)), grid, jobs))
        if keep:
            Results.joined(parts).save(keep)
    return Results.joined(parts)


def _run(corners: Corners, grid: Grid, jobs: int) -> Results:
    """A lot, corner by corner; threads share the work."""
    n, shape = len(corners), (len(SAMPLINGS), len(METHODS), len(grid.ks), len(grid.samples))
    x, status = np.full((*shape, n, 2), np.nan), np.full((*shape, n), -1)
    sharp, wide = (np.full((len(METHODS), len(grid.ks), n, 2), np.nan) for _ in range(2))
    few = tuple(count for count in grid.samples if count <= 128**2)
    other = np.full((len(grid.ks), len(few), n, 2), np.nan)

    def one(number: int) -> None:
        for i, k in enumerate(grid.ks):
            for s, sampling in enumerate(SAMPLINGS):
                x[s, :, i, :, number], status[s, :, i, :, number] = search(corners, number, k, sampling, grid.samples)
            sharp[:, i, number] = search(corners, number, k, "ours", (128**2,), footprint="point")[0][:, 0]
            other[i, :, number] = search(corners, number, k, "independent", few, seed=_OTHER_SEED)[0][1]
            wide[:, i, number] = search(corners, number, k, "independent", grid.samples[:1], margin_px=1.0)[0][:, 0]

    _each(one, n, jobs)
    moments_px, kept = _by_moments(corners, grid, jobs)
    judged, judged_sigma = corners.judged(grid.judged_px)
    return Results(
        ks=np.array(grid.ks),
        samples=np.array(grid.samples),
        moments_samples=np.array(grid.moments_samples),
        accuracies_px=np.array(grid.accuracies_px),
        x_px=x,
        status=status,
        sharp_px=sharp,
        moments_px=moments_px,
        moments_kept=kept,
        direct_px=np.stack([corners.solved(accuracy) for accuracy in grid.accuracies_px]),
        judged_px=judged,
        judged_sigma_px=judged_sigma,
        other_px=other,
        wide_px=wide,
        truth_px=corners.x_px,
        truth_sigma_px=corners.sigma_px,
        blur_px=corners.blur_px,
        hit_fraction=corners.hit_fraction,
        exist=np.array(corners.exist),
    )


def _by_moments(corners: Corners, grid: Grid, jobs: int) -> tuple[np.ndarray, np.ndarray]:
    """Method `moments` as a build does it: what its position images cannot answer is solved directly."""
    n, shape = len(corners), (len(grid.ks), len(grid.moments_samples), len(corners))
    x, jacobian, error = np.full((*shape, 2), np.nan), np.full((*shape, 2, 2), np.nan), np.full(shape, np.nan)

    def one(number: int) -> None:
        for i, k in enumerate(grid.ks):
            for j, samples in enumerate(grid.moments_samples):
                place = i, j, number
                x[place], jacobian[place], error[place] = moments(corners, number, k, samples)

    _each(one, n, jobs)
    claim_px = TruthSettings(method="moments").claim_px
    assert claim_px is not None
    kept = _TRUSTED_ERRORS * error <= claim_px
    alone = corners.solved(claim_px / 4)
    for place in np.ndindex(shape[:2]):
        doubtful = np.flatnonzero(~kept[place] & np.isfinite(x[place][:, 0]))
        guess = Guess(doubtful, corners.cell[doubtful], x[place][doubtful])
        mended = solve(corners.rig, guess, corners.plane, claim_px / 4, MIN_HIT_FRACTION, jacobian[place][doubtful])
        x[place] = np.where(kept[place][:, None], x[place], alone)
        x[place][mended.solutions.point] = np.stack([mended.solutions.x_px, mended.solutions.y_px], axis=1)
    return x, kept


def _each(one: Callable[[int], None], count: int, jobs: int) -> None:
    """Do it for all corners; kernels let other threads run."""
    start = time.perf_counter()
    with ThreadPoolExecutor(jobs) as pool:
        for done, future in enumerate(as_completed([pool.submit(one, number) for number in range(count)]), 1):
            future.result()
            line = f"\r{done} of {count} corners, {time.perf_counter() - start:.0f} s"
            print(line, end="" if done < count else "\n", file=sys.stderr, flush=True)
