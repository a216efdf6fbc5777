"""Detectors of the arena: images of every condition out, positions in, judged against every truth."""

from pathlib import Path
from typing import Any

import numpy as np
from conditions import Condition
from environments import Contestant, Missing, place_of, run_all
from judge import detection, inside_ellipse, matched
from scenes import View, views, write_images

Results = dict[str, Any]


def render(conditions: tuple[Condition, ...], kinds: set[str], folder: Path, repeats: int) -> dict[str, list[View]]:
    """Build all conditions, and write their images to images/BOARD/CONDITION; the views by that place."""
    seen = {}
    for condition in conditions:
        for board in sorted(kinds):
            place = f"{board}/{condition.name.replace(' ', '_')}"
            print(f"  {place}: {condition.what}", flush=True)
            seen[place] = views(condition, board, folder / "stages")
            write_images(seen[place], condition, board, folder / "images" / place, repeats)
    return seen


def compete(
    rows: list[Contestant], conditions: tuple[Condition, ...], folder: Path, repeats: int
) -> tuple[Results, list[Missing]]:
    """Let all detectors see all images; results by detector and condition, and who is missing."""
    seen = render(conditions, {row.board for row in rows}, folder, repeats)
    given = {row.name: folder / "images" / row.board for row in rows}
    ended = run_all(rows, folder / "environments", given, folder / "answers")
    results: Results = {}
    for row in rows:
        took, answers = ended[row.name], folder / "answers" / place_of(row)
        if isinstance(took, Missing):
            continue
        results[row.name] = {"cpu_s": took, "board": row.board, "conditions": {}}
        for condition in conditions:
            name = condition.name.replace(" ", "_")
            judged = judge(seen[f"{row.board}/{name}"], answers / name, repeats)
            results[row.name]["conditions"][condition.name] = judged
    return results, [gone for gone in ended.values() if isinstance(gone, Missing)]


def judge(seen: list[View], answers: Path, repeats: int) -> Results:
    """Judge what a detector wrote about the images of one condition."""
    found = [
        [_answer(answers / f"{number}_{repeat:02d}.npz") for repeat in range(repeats)] for number in range(len(seen))
    ]
    truths = [name for name in ("J", "saddle", "chief") if all(name in view.truth_px for view in seen)]
    rows = [[matched(view.truth_px["J"], xy) for xy, _ in of_view] for view, of_view in zip(seen, found, strict=True)]
    result: Results = {"blur_px": float(np.mean([view.blur_px for view in seen])), "against": {}}
    reported = sum(len(xy) for of_view in found for xy, _ in of_view)
    hits = sum(int((row >= 0).sum()) for of_view in rows for row in of_view)
    points = sum(len(view.truth_px["J"]) for view in seen)
    result |= {"found": hits / (points * repeats), "false_per_image": (reported - hits) / (repeats * len(seen))}
    for truth in truths:
        error = np.concatenate([_errors(seen[i].truth_px[truth], found[i], rows[i]) for i in range(len(seen))], axis=1)
        judged = detection(error)
        if judged is not None:
            result["against"][truth] = {
                "bias_px": judged.bias_px.tolist(),
                "spread_px2": judged.spread_px2.tolist(),
                "noise_px2": judged.noise_px2.tolist(),
                "lasting_px": judged.lasting_px,
            }
    stated = _stated(seen, found, rows)
    return result | ({"stated": stated} if stated else {})


def _answer(path: Path) -> tuple[np.ndarray, np.ndarray | None]:
    if not path.exists():
        return np.empty((0, 2)), None
    with np.load(path) as file:
        return file["xy"].reshape(-1, 2), file["covariance"] if "covariance" in file.files else None


def _errors(
    truth_px: np.ndarray, found: list[tuple[np.ndarray, np.ndarray | None]], rows: list[np.ndarray]
) -> np.ndarray:
    """Errors (repeats, points, 2), NaN where a point was not found."""
    result = np.full((len(found), len(truth_px), 2), np.nan)
    for repeat, ((xy, _), row) in enumerate(zip(found, rows, strict=True)):
        result[repeat, row >= 0] = xy[row[row >= 0]] - truth_px[row >= 0]
    return result


def _stated(
    seen: list[View], found: list[list[tuple[np.ndarray, np.ndarray | None]]], rows: list[list[np.ndarray]]
) -> Results | None:
    """Honesty of stated covariances: share of errors inside them, about the truth and about the detector's own mean."""
    errors, deviations, covariances = [], [], []
    for view, of_view, row in zip(seen, found, rows, strict=True):
        if any(covariance is None for _, covariance in of_view):
            return None
        error, stated = (
            _errors(view.truth_px["J"], of_view, row),
            np.full((len(of_view), len(view.truth_px["J"]), 2, 2), np.nan),
        )
        for repeat, (_, covariance) in enumerate(of_view):
            assert covariance is not None
            stated[repeat, row[repeat] >= 0] = covariance[row[repeat][row[repeat] >= 0]]
        errors.append(error), covariances.append(stated)
        # A deviation from the mean of n repeats is smaller than one from the expectation.
        n = np.isfinite(error[..., :1]).sum(axis=0)
        with np.errstate(invalid="ignore", divide="ignore"):
            deviations.append((error - np.nansum(error, axis=0) / n) * np.sqrt(n / (n - 1.0)))
    error, deviation, stated = (
        np.concatenate([part.reshape(-1, *part.shape[2:]) for part in parts])
        for parts in (errors, deviations, covariances)
    )
    if not np.isfinite(stated).any():
        return None
    return {
        "inside_of_truth": inside_ellipse(error, stated),
        "inside_of_noise": inside_ellipse(deviation, stated),
        "sigma_px": float(np.sqrt(np.nanmedian(np.trace(stated, axis1=1, axis2=2) / 2))),
    }
