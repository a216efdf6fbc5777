"""The tables of the arena. Print them from the results that lie beside this file, or some by the beginnings of titles:

python examples/06_arena/tables.py [TITLE ...]
"""

import json
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np

Results = dict[str, Any]
Cell = Callable[[Results], str]
Table = tuple[str, list[str], list[list[str]]]
"""Title, head and rows."""
NOTHING = "-"


def number(value: float | None) -> str:
    """Three digits behind the point, where a number is not large."""
    return NOTHING if value is None or value != value else f"{value:.3f}" if abs(value) < 100 else f"{value:.0f}"


def text(tables: list[Table]) -> str:
    """Tables as Markdown, columns padded; empty ones are left out."""
    return "\n\n".join(f"{title}\n\n{_markdown(head, rows)}" for title, head, rows in tables if rows) + "\n"


def _markdown(head: list[str], rows: list[list[str]]) -> str:
    width = [max(map(len, column)) for column in zip(head, *rows, strict=True)]
    lines = [f"| {' | '.join(cell.ljust(w) for cell, w in zip(row, width, strict=True))} |" for row in (head, *rows)]
    return "\n".join([lines[0], f"|{'|'.join('-' * (w + 2) for w in width)}|", *lines[1:]])


def missing(results: Results) -> Table:
    """Who cannot run, and why."""
    return "Missing", ["contestant", "reason"], [[name, why] for name, why in results["missing"].items()]


def spread(covariance_px2: list[list[float]]) -> str:
    """Standard deviations along x and y, and their correlation."""
    covariance = np.array(covariance_px2)
    x, y = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    # A spread is what is left after noise is taken away. Noise is known roughly, so what is left may be no ellipse.
    is_ellipse = x * y > 0 and abs(covariance[0, 1]) <= x * y
    return f"{x:.3f} {y:.3f} " + (f"{covariance[0, 1] / (x * y):+.1f}" if is_ellipse else NOTHING)


def _found(judged: Results) -> str:
    more = judged["false_per_image"]
    return f"{100 * judged['found']:.0f} %" + (f" +{more:.1f}" if more >= 0.05 else "")


def _lasting(judged: Results) -> str:
    return f"{judged['lasting_px']:.3f}"


def _against(truth: str, cell: Cell) -> Cell:
    """What a cell says of one truth; nothing where too few points were found."""
    return lambda judged: cell(judged["against"][truth]) if truth in judged["against"] else NOTHING


_DETECTORS: dict[str, Cell] = {
    "Points found, and false ones per image": _found,
    "Lasting error against J: rms length of bias and spread [px]": _against("J", _lasting),
    "Lasting error against the saddle [px]": _against("saddle", _lasting),
    "Lasting error against the chief ray [px]": _against("chief", _lasting),
    "Bias against J: mean error along x and y [px]": _against("J", lambda j: "{:+.3f} {:+.3f}".format(*j["bias_px"])),
    "Spread over points against J: sigma x, sigma y [px], correlation": _against(
        "J", lambda j: spread(j["spread_px2"])
    ),
    "Noise over repeats: sigma x, sigma y [px], correlation": _against("J", lambda j: spread(j["noise_px2"])),
}


def _rms(case: Results) -> str:
    return " ".join(f"{value:.3f}" for value in case["rms_px"])


def _depth(case: Results) -> str:
    return " ".join(map(number, case["depth_mm"]))


def _largest(case: Results) -> str:
    outside = case.get("outside_px")
    return f"{case['largest_px']:.2f}" + (f" ({outside:.2f})" if outside is not None else "")


def _pupil(case: Results) -> str:
    return "{:+.2f} {:+.2f} {:+.2f}".format(*case["pupil_mm"]) if "pupil_mm" in case else NOTHING


_CALIBRATORS: dict[str, Cell] = {
    "Projection error over the field at 300, 500, 1000 and 5000 mm, rms length [px]": _rms,
    "Depth of a point by rays from two cameras, 60 mm apart, at these distances, rms error [mm]": _depth,
    "Largest projection error at these distances, in parentheses outside of what the boards covered [px]": _largest,
    "Error of the entrance pupil: x, y, z [mm]": _pupil,
}


def conventional(results: Results) -> list[Table]:
    """The tables of conventional cameras."""
    made = [_conditions(results)]
    for kind, cells, cases in (("detectors", _DETECTORS, "conditions"), ("calibrators", _CALIBRATORS, "cases")):
        names = list(dict.fromkeys(name for one in results[kind].values() for name in one[cases]))
        for title, cell in cells.items():
            rows = [[who, *(_cell(cell, one[cases].get(name)) for name in names)] for who, one in results[kind].items()]
            made.append((title, [kind[:-1], *names], rows))
    return [*made, _own(results), _honesty(results), _numbers(results), missing(results)]


def _cell(cell: Cell, judged: Results | None) -> str:
    return NOTHING if judged is None else "failed" if "failed" in judged else cell(judged)


def _conditions(results: Results) -> Table:
    rows = []
    for name, what in results["conditions"].items():
        seen = [one["conditions"][name] for one in results["detectors"].values() if name in one["conditions"]]
        rows.append([name, what, f"{seen[0]['blur_px']:.2f}" if seen else NOTHING])
    return "Conditions of the detectors", ["condition", "what", "blur px, rms"], rows


def _own(results: Results) -> Table:
    rows = []
    for who, one in results["calibrators"].items():
        for name in ("exact", "detected"):
            case = one["cases"].get(name, {})
            if "own_rms_px" in case:
                real = float(np.sqrt(np.mean(np.square(case["rms_px"]))))
                rows.append([who, name, f"{case['own_rms_px']:.4f}", f"{real:.4f}"])
    title = "The residual that a program prints, and its error over the field [px]"
    return title, ["calibrator", "case", "own rms", "over the field"], rows


def _honesty(results: Results) -> Table:
    """Stated uncertainties of calibrations and of corners: over real ones, and how often they hold."""
    stated = [(who, kept["of"], kept) for who, one in results["calibrators"].items() for kept in one["honesty"]]
    for who, one in results["detectors"].items():
        for name, judged in one["conditions"].items():
            if "stated" in judged and "J" in judged["against"]:
                real = np.sqrt(np.trace(np.array(judged["against"]["J"]["noise_px2"])) / 2)
                ratio = judged["stated"]["sigma_px"] / real if real > 0 else float("nan")
                stated.append((who, f"corners, {name}", judged["stated"] | {"stated_over_real": ratio}))
    rows = [[who, of, *_kept(one)] for who, of, one in stated]
    head = ["who states it", "of what", "stated / real sigma", "noise within 1 sigma", "error within 1 sigma"]
    return "Honesty: 68 % is what one sigma promises", head, rows


def _kept(one: Results) -> list[str]:
    ratio = one["stated_over_real"]
    shares = [f"{100 * one[key]:.0f} %" if key in one else NOTHING for key in ("inside_of_noise", "inside_of_truth")]
    return [f"{ratio:.2f}" if ratio == ratio else NOTHING, *shares]


def _numbers(results: Results) -> Table:
    """Numbers of a lens that calibrations find: deviations that they state, and errors that they have."""
    rows = [[who, *row] for who, one in results["calibrators"].items() for row in _numbers_kept(one)]
    head = ["calibrator", "number", "stated sigma", "rms error"]
    return "Numbers of the lens over the repeats with noise [mm or degrees]", head, rows


def _numbers_kept(judged: Results) -> Iterator[list[str]]:
    for kept in judged.get("honesty", []):
        for name, pair in kept.get("numbers", {}).items():
            yield [_short(name), *(f"{value:.3g}" for value in pair)]


def _short(name: str) -> str:
    """Name of a number below the rig."""
    return name.partition("/Rig/")[2] or name


def plenoptic(results: Results) -> list[Table]:
    """The tables of plenoptic cameras."""
    answers = [
        (camera, name, judged)
        for camera, case in results["cases"].items()
        for name, judged in case["contestants"].items()
    ]
    made: list[Table] = []
    for title, (head, rows) in _ANSWERS.items():
        cells = [[camera, who, *row] for camera, who, judged in answers for row in rows(judged)]
        made.append((title, ["camera", "contestant", *head.split(", ")], cells))
    for camera, case in results["cases"].items():
        if "refocus" in case:
            made.extend(_refocus(camera, case))
    return [*made, missing(results)]


_POSITIONS = {"exact": "exact", "unmirrored": "exact, less mirrored", "noise": "noise", "own": "own corners"}


def _calibrations(judged: Results) -> Iterator[list[str]]:
    """The residual that each prints, and what is true of it."""
    for kind, positions in _POSITIONS.items():
        if kind in judged:
            one = judged[kind]
            field, depth = np.array(one["field_px"]), np.abs(one["depth_mm"])
            cells = [one["own_rms_px"], *_largest_of(field), one["outside_px"], one["chief_px"], one["marginal_px"]]
            yield [positions, *map(number, [*cells, *_largest_of(depth), *one["pose"]])]


def _largest_of(values: np.ndarray) -> tuple[float, float]:
    """Largest at the distances of the boards, and beyond; NaN, where nothing is known, does not count."""
    inner, outer = values[1:-1], values[[0, -1]]
    return np.fmax.reduce(inner), np.fmax.reduce(outer)


def _parameters(judged: Results) -> Iterator[list[str]]:
    """Numbers that calibrations find beside those of first-order optics, or of the stage; with their spread where there
    is noise.
    """
    for key, true in judged.get("true", {}).items():
        spread_ = judged.get("spread", {}).get(key)
        values = [f"{value:.6g}" for value in (true, judged["exact"]["parameters"][key])]
        yield [_short(key), *values, NOTHING if spread_ is None else f"{spread_:.2g}"]


def _types(judged: Results) -> Iterator[list[str]]:
    """Microlenses whose type is right."""
    for kind, share in judged.get("types", {}).items():
        yield [_POSITIONS[kind], f"{100 * share:.0f} %"]


def _centres(judged: Results) -> Iterator[list[str]]:
    """Centres of micro-images against each kind of true centre."""
    if one := judged.get("centres"):
        rms = [number(one[kind]["rms_px"]) for kind in ("centre", "centroid", "exit pupil")]
        yield [f"{one['centre']['found']:.3f}", *rms, _bias(one["centroid"])]


def _corners(judged: Results) -> Iterator[list[str]]:
    """Corners that contestants detect in micro-images, by frame."""
    for frame, kinds in judged.get("corners", {}).items():
        near, moved = kinds["corner"], kinds["with fraction"]
        yield [frame, f"{near['found']:.3f}", _bias(near), number(near["rms_px"]), number(moved["rms_px"])]


def _disparities(judged: Results) -> Iterator[list[str]]:
    """Disparities at the corners of a board in micro-images."""
    if one := judged.get("disparity"):
        numbers = [f"{one['bias_px']:+.3f}", number(one["median_px"]), f"{100 * one['wrong']:.0f} %"]
        yield [str(one["corners"]), *numbers]


def _views(judged: Results) -> Iterator[list[str]]:
    """What cut views are made of, and where they look from."""
    for one in judged.get("views", []):
        pairs = (one["takes_px"], one["spread_px"], one["off_mm"][:2])
        yield [f"{one['view_px']} 0", *(f"{x:+.3f} {y:+.3f}" for x, y in pairs)]


def _failed(judged: Results) -> Iterator[list[str]]:
    if "failed" in judged:
        yield [judged["failed"]]


_ANSWERS: dict[str, tuple[str, Callable[[Results], Iterator[list[str]]]]] = {
    "Calibrations": (
        "positions, prints px, field px, beyond px, outside px, chief px, marginal px, depth mm, beyond mm, turn deg,"
        " place mm",
        _calibrations,
    ),
    "Honesty: 68 % is what one sigma promises": (
        "of what, stated / real sigma, noise within 1 sigma, error within 1 sigma",
        lambda judged: ([kept["of"], *_kept(kept)] for kept in judged.get("honesty", [])),
    ),
    "Numbers of the stage over the repeats with noise [mm or degrees]": (
        "number, stated sigma, rms error",
        _numbers_kept,
    ),
    "Parameters": ("parameter, true or first order, from exact rows, spread by noise", _parameters),
    "Types of microlenses by their focal lengths": ("positions, right", _types),
    "Centres of micro-images": (
        "found, rms px to centre, rms px to centroid, rms px to exit pupil, bias px to centroid",
        _centres,
    ),
    "Corners in micro-images": ("frame, found, bias px, rms px, rms px to J + fraction of the centre", _corners),
    "Disparities at corners": ("corners, median error px, median of lengths px, off by more than 1 px", _disparities),
    "Views": ("view px, takes px, spread px, viewpoint off mm", _views),
    "Failed": ("reason", _failed),
}
"""Tables of what the judge found of a contestant before a camera: more of the head, and its rows."""


def _bias(judged: Results) -> str:
    return f"{judged['bias_x_px']:+.3f} {judged['bias_y_px']:+.3f}"


def _refocus(camera: str, case: Results) -> Iterator[Table]:
    """Distances of refocusing and viewpoints of an unfocused camera; those of plenoptisign beside them."""
    one, theirs = case["refocus"], case["contestants"].get("plenoptisign", {})
    rows = []
    for number_, row in enumerate(one["rows"]):
        cells = [f"{row['view_px']:g}", f"{row['z_mm']:g}", f"{row['shift']:+.4f}"]
        distances = [row["pupil_mm"], row["thin_mm"], *theirs.get("distances_mm", [])[number_ : number_ + 1]]
        rows.append([*cells, *(f"{value:.2f}" for value in distances), *[NOTHING] * (3 - len(distances))])
    head = ["view px", "true distance mm", "shift", "with the exit pupil mm", "without mm", "plenoptisign mm"]
    yield f"Refocusing, {camera}", head, rows
    rows = []
    for number_, row in enumerate(one["viewpoints"]):
        place = theirs["views_mm"][number_] if "views_mm" in theirs else [None, None]
        cells = [f"{row['view_px']:g}", *(f"{value:.3f}" for value in row["place_mm"]), f"{row['rms_mm']:.4f}"]
        rows.append([*cells, *map(number, place)])
    head = ["view px", "x mm", "y mm", "z mm", "rays off mm", "plenoptisign: x mm", "z mm"]
    yield f"Viewpoints, {camera}; entrance pupil at {one['entrance_pupil_z_mm']:.3f} mm", head, rows


def main() -> None:
    """Run the command."""
    here = Path(__file__).resolve().parent
    halves = ((conventional, "results.json"), (plenoptic, "plenoptic/results.json"))
    made = [table for half, name in halves for table in half(json.loads((here / name).read_text(encoding="utf-8")))]
    print(text([table for table in made if table[0].startswith(tuple(sys.argv[1:]) or "")]), end="")


if __name__ == "__main__":
    main()
