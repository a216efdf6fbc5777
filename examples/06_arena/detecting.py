"""Detectors of the arena: images of every condition out, positions in, judged against every truth."""

from pathlib import Path
from typing import Any

import numpy as np
from conditions import Condition
from environments import Contestant, place_of, run_all
from judge import detection, inside_ellipse, matched
from scenes import View, views, write_images

Results = dict[str, Any]


def compete(
    rows: list[Contestant], conditions: tuple[Condition, ...], folder: Path, repeats: int
) -> tuple[Results, dict[str, str]]:
    """Let all detectors see all images; results by detector and condition, and who is missing."""
    seen, images = {}, folder / "images"
    for condition in conditions:
        for board in sorted({row.board for row in rows}):
            place = f"{board}/{condition.place}"
            print(f"  {place}: {condition.what}", flush=True)
            seen[place] = views(condition, board, folder / "stages")
            write_images(seen[place], condition, board, images / place, repeats)
    given = {row.name: images / row.board for row in rows}
    ended, missing = run_all(rows, folder / "environments", given, folder / "answers")
    results: Results = {}
    for row in (row for row in rows if row.name in ended):
        answers = folder / "answers" / place_of(row)
        judged = {
            condition.name: judge(seen[f"{row.board}/{condition.place}"], answers / condition.place, repeats)
            for condition in conditions
        }
        results[row.name] = {"cpu_s": ended[row.name], "board": row.board, "conditions": judged}
    return results, missing


def judge(seen: list[View], answers: Path, repeats: int) -> Results:
    """Judge what a detector wrote about the images of one condition."""
    parts = [_found(view.truth_px["J"], answers, number, repeats) for number, view in enumerate(seen)]
    place, stated = (np.concatenate([part[i] for part in parts], axis=1) for i in (0, 1))
    hits, images = int(np.isfinite(place[..., 0]).sum()), repeats * len(seen)
    result: Results = {
        "blur_px": float(np.mean([view.blur_px for view in seen])),
        "found": hits / place[..., 0].size,
        "false_per_image": (sum(reported for _, _, reported in parts) - hits) / images,
        "against": {},
    }
    for truth in ("J", "saddle", "chief"):
        if all(truth in view.truth_px for view in seen):
            judged = detection(place - np.concatenate([view.truth_px[truth] for view in seen]))
            if judged is not None:
                result["against"][truth] = {
                    "bias_px": judged.bias_px.tolist(),
                    "spread_px2": judged.spread_px2.tolist(),
                    "noise_px2": judged.noise_px2.tolist(),
                    "lasting_px": judged.lasting_px,
                }
    if np.isfinite(stated).any():
        result["stated"] = _honesty(place - np.concatenate([view.truth_px["J"] for view in seen]), stated)
    return result


def _found(truth_px: np.ndarray, answers: Path, number: int, repeats: int) -> tuple[np.ndarray, np.ndarray, int]:
    """Positions (repeats, points, 2) and stated covariances (repeats, points, 2, 2) of the points of a view, NaN where
    there are none, and how many positions were reported."""
    place, stated = (np.full((repeats, len(truth_px), *shape), np.nan) for shape in ((2,), (2, 2)))
    reported = 0
    for repeat in range(repeats):
        path = answers / f"{number}_{repeat:02d}.npz"
        if path.exists():
            with np.load(path) as file:
                xy, covariance = file["xy"].reshape(-1, 2), file.get("covariance")
            row = matched(truth_px, xy)
            place[repeat, row >= 0] = xy[row[row >= 0]]
            if covariance is not None:
                stated[repeat, row >= 0] = covariance[row[row >= 0]]
            reported += len(xy)
    return place, stated, reported


def _honesty(error: np.ndarray, stated: np.ndarray) -> Results:
    """Honesty of stated covariances: share of errors inside them, about the truth and about the detector's own mean."""
    # A deviation from the mean of n repeats is smaller than one from the expectation.
    n = np.isfinite(error[..., :1]).sum(axis=0)
    with np.errstate(invalid="ignore", divide="ignore"):
        deviation = (error - np.nansum(error, axis=0) / n) * np.sqrt(n / (n - 1.0))
    return {
        "inside_of_truth": inside_ellipse(error, stated),
        "inside_of_noise": inside_ellipse(deviation, stated),
        "sigma_px": float(np.sqrt(np.nanmedian(np.trace(stated, axis1=-2, axis2=-1) / 2))),
    }
