"""What explains the trends: the printed mapping, the filters' answer to noise, and the search without any."""

import itertools

import numpy as np
from bars import lengths, mean_and_error
from results import Results
from sampling import SAMPLINGS
from windows import ACCEPTED

NOISE_STEPS = 0.03
"""Noise per value of J, in steps of the fine grid, that lambda_d = 0.15 lets pass nearly always."""
LAMBDA_D, LAMBDA_ALPHA_DEG = 0.15, 10.0


OUTLIER_PX = 0.02
"""Distance from the truth beyond which a position is an outlier [px]: ten times the mean of most bars."""


def found_and_outliers(results: Results, samples: int) -> tuple[int, int]:
    """Positions that `image` finds from independent rays, of all K together, and outliers among them."""
    error = lengths(results.x_px[SAMPLINGS.index("independent"), 0, :, samples], results.truth_px)
    return int(np.sum(~np.isnan(error))), int(np.sum(error > OUTLIER_PX))


def printed_trend_px(ks: np.ndarray) -> np.ndarray:
    """What x = x_K / K alone makes of exact solutions, against the largest K: sqrt(2) times a difference of halves.

    The printed form is off by (K - 1) / (2 K) px on both axes.
    """
    off = (ks - 1) / (2 * ks)
    return np.sqrt(2) * np.abs(off - off[-1])


def ideal_grid_share(noise_steps: np.ndarray) -> np.ndarray:
    """Share of square grids that pass both filters with Gaussian noise of so many steps per axis, (n,)."""
    random, shares = np.random.default_rng(3), []
    for noise in noise_steps:
        grid = np.stack(np.meshgrid(np.arange(4.0), np.arange(4.0)), axis=-1) + random.normal(0, noise, (4000, 4, 4, 2))
        u, v = np.diff(grid, axis=2), np.diff(grid, axis=1)
        passes = np.ones(len(grid), bool)
        for step in (u, v):
            length = np.hypot(*np.moveaxis(step.reshape(len(grid), -1, 2), -1, 0))
            passes &= (np.abs(1 - length / length.mean(axis=1, keepdims=True)) < LAMBDA_D).all(axis=1)
        along, down = u[:, :3], v[:, :, :3]
        angle = np.abs(
            np.arctan2(along[..., 0] * down[..., 1] - along[..., 1] * down[..., 0], np.sum(along * down, -1))
        )
        angle = angle.reshape(len(grid), -1)
        passes &= (np.abs(angle - angle.mean(axis=1, keepdims=True)) < np.deg2rad(LAMBDA_ALPHA_DEG)).all(axis=1)
        shares.append(passes.mean())
    return np.array(shares)


def noise_law(results: Results) -> list[tuple[float, float, int, float, float]]:
    """Share of corners that pass the filters, by rays over (K sigma / 0.03)^2: from, to, cases, share, an ideal grid's.

    Independent rays; corners whose bundle the stop does not cut and which pass without noise.
    """
    noises = np.array([0.002, 0.01, 0.02, 0.025, 0.03, 0.035, 0.04, 0.05, 0.06, 0.08, 0.12, 0.5])
    ideal = ideal_grid_share(noises)
    s, cases = SAMPLINGS.index("independent"), []
    # Without microlenses a share is relative to the axis, and a circle of rays is never cut.
    uncut = (results.hit_fraction > 0.999) | results.is_conventional
    for (i, k), (j, n) in itertools.product(enumerate(results.ks), enumerate(results.samples)):
        fit = uncut & np.isfinite(results.sharp_px[0, i, :, 0])
        # The start on the fine pixel spreads the bundle, too: 1/12 of a step squared.
        steps = np.sqrt((k * results.blur_px[fit]) ** 2 + 1 / 12)
        passed = results.status[s, 0, i, j, fit] == ACCEPTED
        cases.append(np.stack([n / (steps / NOISE_STEPS) ** 2, passed]))
    ratio, passed = np.concatenate(cases, axis=1)
    edges = (0.0, 0.125, 0.25, 0.5, 1.0, 2.0, np.inf)
    bins = [(low, high, (ratio >= low) & (ratio < high)) for low, high in itertools.pairwise(edges)]
    law = np.interp(NOISE_STEPS / np.sqrt(ratio), noises, ideal)
    filled = [(low, high, within) for low, high, within in bins if within.any()]
    return [
        (low, high, int(within.sum()), float(passed[within].mean()), float(law[within].mean()))
        for low, high, within in filled
    ]


def without_noise(results: Results) -> list[tuple[int, float, float, float, float]]:
    """Method `image` without noise and width of pixels: K, share detected, median, mean, standard error of the mean."""
    rows = []
    for i, k in enumerate(results.ks):
        error = lengths(results.sharp_px[0, i], results.truth_px)
        rows.append((int(k), float(np.mean(~np.isnan(error))), float(np.nanmedian(error)), *mean_and_error(error)))
    return rows
