"""Calibrators of the arena: the same boards for all, and each model against the true rays of the camera."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from conditions import CONDITIONS
from contestants.exchange import write_pgm
from environments import Contestant, place_of, run, run_all
from judge import (
    ErrorField,
    coverage,
    covered,
    depth_errors_mm,
    error_field,
    inside_ellipse,
    matched,
    numbers_kept,
    pupil_errors,
    stated_covariance,
)
from rows import Rows, joined
from scenes import BASELINE_MM, BOARD, BOARD_COLUMNS, BOARD_ROWS, Boards, boards, built, exposed, view_of

from pipeline.plugins.fits.free_numbers import FreeStage
from stages import HERE

Results = dict[str, Any]
FITTED_MM = (400.0, 700.0, 1200.0)
"""Planes on which a model is laid over the camera [mm from the stop]: the boards stand from 340 to 1430 mm."""
DISTANCES_MM = (300.0, 500.0, 1000.0, 5000.0)
"""Planes on which it is judged [mm from the stop]: before, among and behind the boards."""
NOISE_PX = 0.1
"""Noise of each axis in the cases with noise [px]: of an ordinary detector in an ordinary image."""
FEW = 5
"""Boards of the case with few."""
POSITION = "exact"
"""Kind of all positions, as `pipeline calibrate` names them: J, which is also what OpenCV SB finds."""
STATED_AT = 1
"""Of DISTANCES_MM that for which uncertainties are stated: the distance in focus."""


def whole_views(rows: Rows, among: np.ndarray | None = None) -> np.ndarray:
    """Views that show all points of the board: those that detectors of whole boards would deliver."""
    views, counts = np.unique(rows.view, return_counts=True)
    whole = views[counts == len(BOARD)]
    return whole if among is None else np.intersect1d(whole, among)


def write_cases(folder: Path, noisy: int, detector: tuple[Contestant, Path] | None) -> dict[str, Boards]:
    """Write folder/cases/NAME.npz for all cases, without a detector for few boards, exact and with noise; what each is
    seen by, by name.
    """
    cases, cameras = folder / "cases", {}
    cases.mkdir(parents=True, exist_ok=True)
    for old in cases.glob("*.npz"):
        old.unlink()
    stages = {"f8": "calibration", "f2.8": "calibration_open", "tilted": "calibration_tilted"}
    stages = stages if detector else {"f8": stages["f8"]}
    known = stages | {"tilted": "calibration"}  # nobody knows of a tilt
    seen = {name: boards(HERE / f"{stage}.usda", FITTED_MM, DISTANCES_MM) for name, stage in stages.items()}

    def write(name: str, camera: str, first: Rows, second: Rows) -> None:
        views = whole_views(first)[: None if detector else FEW]
        pairs = whole_views(second, views)
        case = seen[camera].case(first.only(np.isin(first.view, views)), second.only(np.isin(second.view, pairs)))
        drawings = cases / f"{name}.usda"
        write_drawings(HERE / f"{known[camera]}.usda", drawings, name)
        np.savez(cases / f"{name}.npz", **case, drawings=np.array(str(drawings)), position=np.array(POSITION))
        cameras[name] = seen[camera]

    f8 = seen["f8"]
    for name, camera in zip(("exact", "open", "tilted"), seen, strict=False):
        write(name, camera, seen[camera].first, seen[camera].second)
    for number in range(noisy):
        random = np.random.default_rng([6, number])
        write(f"noise_{number:02d}", "f8", f8.first.noisy(NOISE_PX, random), f8.second.noisy(NOISE_PX, random))
    if detector:
        random = np.random.default_rng(66)
        few = [rows.only(rows.view < FEW) for rows in (f8.first, f8.second)]
        write("few", "f8", *(rows.noisy(NOISE_PX, random) for rows in few))
        write("detected", "f8", detected(f8, folder, *detector), f8.second)
    return cameras


def write_drawings(stage: Path, place: Path, name: str) -> None:
    """Write the stage as its owner has it, off by its tolerances; each case has errors of its own."""
    truth, random = FreeStage(stage, ["Made"]), np.random.default_rng([6, *f"drawings{name}".encode()])
    by = random.normal(size=len(truth.numbers)) * [number.deviation for number in truth.numbers]
    place.write_text(truth.layer(place, by, {}, f"Drawings for case {name} of the arena."), encoding="utf-8")


def true_numbers(stage: Path) -> dict[str, float]:
    """Numbers of a camera that its drawings have wrong."""
    return {number.name: number.before for number in FreeStage(stage, ["Made"]).numbers}


def detected(exact: Boards, folder: Path, detector: Contestant, python: Path) -> Rows:
    """The boards as a detector finds them in rendered images with noise."""
    images, answers = folder / "images_calibration", folder / "answers_calibration"
    images.mkdir(parents=True, exist_ok=True)
    about = {"kind": "checkerboard", "columns": BOARD_COLUMNS, "rows": BOARD_ROWS, "square_mm": 1.0}
    (images / "board.json").write_text(json.dumps(about), encoding="utf-8")
    output = built(HERE / "calibration.usda", folder / "stages")
    for number, view in enumerate(output.camera.views):
        image = view_of(view, False).image
        write_pgm(images / f"{number:02d}.pgm", exposed(image, CONDITIONS[0].electrons, "calibration", number))
    run(detector, python, images, answers)
    parts = []
    for number in range(len(exact.poses)):
        path = answers / f"{number:02d}.npz"
        found = np.load(path)["xy"].reshape(-1, 2) if path.exists() else np.empty((0, 2))
        rows = exact.first.only(exact.first.view == number)
        row = matched(rows.image_px, found)
        if (row >= 0).all():
            parts.append(replace(rows, image_px=found[row]))
    return joined(parts)


def compete(
    rows: list[Contestant], folder: Path, noisy: int, detector: tuple[Contestant, Path] | None
) -> tuple[Results, dict[str, str], dict[str, Any]]:
    """Let all calibrators solve all cases; results by calibrator, who is missing, and error fields for pictures."""
    cameras = write_cases(folder, noisy, detector)
    given = {row.name: folder / "cases" for row in rows}
    ended, missing = run_all(rows, folder / "environments", given, folder / "answers")
    results: Results = {}
    fields: dict[str, Any] = {}
    for row in (row for row in rows if row.name in ended):
        answers = folder / "answers" / place_of(row)
        judged = {name: judge(boards_, folder / "cases" / name, answers / name) for name, boards_ in cameras.items()}
        fields[row.name] = judged["exact"].get("field_px")
        for case in judged.values():
            case.pop("field_px", None)
        noise = [judged.pop(f"noise_{number:02d}") for number in range(noisy)]
        results[row.name] = {"cpu_s": ended[row.name], "cases": judged | {"noise": _mean(noise)}}
        results[row.name]["honesty"] = honesty(answers, cameras["exact"], folder / "cases/exact", noisy)
    return results, missing, fields


def judge(truth: Boards, case: Path, answer: Path) -> Results:
    """Judge one calibration."""
    if not answer.with_suffix(".npz").exists():
        text = answer.with_suffix(".txt")
        return {"failed": text.read_text(encoding="utf-8").strip()[:200] if text.exists() else "no answer"}
    given, found = np.load(case.with_suffix(".npz")), np.load(answer.with_suffix(".npz"))
    where = covered(truth.exact.query_px, given["image_px"])
    field = _field(truth, found, where)
    result: Results = {
        "rms_px": field.rms_px(where).tolist(),
        "depth_mm": depth_errors_mm(truth.exact, field, where, BASELINE_MM).tolist(),
        "largest_px": float(np.nanmax(field.length_px[:, where])),
        "outside_px": float(np.nanmax(field.length_px[:, ~where])) if (~where).any() else None,
        "views": len(np.unique(given["view"])),
        "field_px": np.round(field.length_px, 4).tolist(),
    }
    if "poses" in found.files:
        poses = truth.poses[np.unique(given["view"])]
        mean, scatter = pupil_errors(poses, found["poses"], truth.pupil_mm)
        result |= {"pupil_mm": mean.tolist(), "pupil_scatter_mm": scatter.tolist()}
    if "rms_px" in found.files:
        result["own_rms_px"] = float(found["rms_px"])
    return result


def _field(truth: Boards, found: Any, where: np.ndarray) -> ErrorField:
    return error_field(truth.exact, found["slopes"], where, found["offsets_mm"] if "offsets_mm" in found.files else 0.0)


def honesty(answers: Path, truth: Boards, case: Path, noisy: int) -> list[Results]:
    """Stated uncertainties against the errors that repeats with noise really have."""
    paths = [answers / f"noise_{number:02d}.npz" for number in range(noisy)]
    if not (answers / "exact.npz").exists() or not all(path.exists() for path in paths) or noisy < 2:
        return []
    exact, found = np.load(answers / "exact.npz"), [np.load(path) for path in paths]
    kept = []
    if "sigmas" in exact.files:
        values, sigmas = (np.array([one[name] for one in found]) for name in ("values", "sigmas"))
        if "names" in exact.files:  # numbers whose truth is known, each time from other drawings
            true = true_numbers(HERE / "calibration.usda")
            kept.append(numbers_kept([*true], values, sigmas, np.array([*true.values()])))
        else:
            share, ratio = coverage(values, sigmas, exact["values"])
            kept.append({"of": "fx, fy, cx, cy", "inside_of_noise": share, "stated_over_real": ratio})
    where = covered(truth.exact.query_px, np.load(case.with_suffix(".npz"))["image_px"])
    if "stated_px2" in exact.files:
        stated = [one["stated_px2"].reshape(*where.shape, 2, 2) for one in found]
    elif "moved_slopes" in exact.files:
        stated = [stated_covariance(truth.exact, one, where)[STATED_AT] for one in found]
    else:
        return kept
    return [*kept, _projections_kept(truth, exact, found, np.array(stated)[:, where], where)]


def _projections_kept(truth: Boards, exact: Any, found: list[Any], stated: np.ndarray, where: np.ndarray) -> Results:
    errors = [_field(truth, one, where).error_px[STATED_AT] for one in found]
    mean = _field(truth, exact, where).error_px[STATED_AT]
    noise, real = (np.array([error - less for error in errors])[:, where] for less in (mean, 0.0))
    ratio = np.sqrt(np.median(np.trace(stated, axis1=-2, axis2=-1))) / np.sqrt(
        np.median((noise**2).sum(axis=-1).mean(axis=0))
    )
    return {
        "of": "projection at 500 mm",
        "inside_of_noise": inside_ellipse(noise, stated),
        "inside_of_truth": inside_ellipse(real, stated),
        "stated_over_real": float(ratio),
    }


def _mean(judged: list[Results]) -> Results:
    """Root mean square over repeats with noise."""
    good = [one for one in judged if "failed" not in one]
    means = [name for name in ("rms_px", "depth_mm", "pupil_mm") if good and name in good[0]]
    if not good:
        return judged[0] if judged else {"failed": "no repeats"}
    result: Results = {
        **{name: np.sqrt(np.mean([np.square(one[name]) for one in good], axis=0)).tolist() for name in means},
        "largest_px": max(one["largest_px"] for one in good),
        "outside_px": max((one["outside_px"] for one in good if one["outside_px"] is not None), default=None),
        "views": good[0]["views"],
        "repeats": len(good),
    }
    return result
