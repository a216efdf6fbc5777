"""Print the tables of an arena from its results.json.

python examples/06_arena/tables.py [--brief] [examples/06_arena/results.json]
"""

import argparse
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

Results = dict[str, Any]
Cell = Callable[[Results], str]
NOTHING = "-"


def markdown(head: list[str], rows: list[list[str]]) -> list[str]:
    """Lines of a table, columns padded."""
    width = [max(len(row[i]) for row in (head, *rows)) for i in range(len(head))]
    lines = [f"| {' | '.join(cell.ljust(w) for cell, w in zip(row, width, strict=True))} |" for row in (head, *rows)]
    return [lines[0], f"|{'|'.join('-' * (w + 2) for w in width)}|", *lines[1:]]


def by_condition(results: Results, cell: Cell) -> tuple[list[str], list[list[str]]]:
    """Head and rows of a table of detectors by conditions."""
    names = list(results["conditions"])
    names = [name for name in names if any(name in one["conditions"] for one in results["detectors"].values())]
    rows = [[who, *(cell(one["conditions"][name]) for name in names)] for who, one in results["detectors"].items()]
    return ["detector", *names], rows


def against(truth: str, value: Callable[[Results], str]) -> Cell:
    """What a cell says of one truth; nothing where too few points were found."""
    return lambda judged: value(judged["against"][truth]) if truth in judged["against"] else NOTHING


def lasting(judged: Results) -> str:
    """Root mean square length of what averaging does not remove [px]."""
    return f"{judged['lasting_px']:.3f}"


def bias(judged: Results) -> str:
    """Mean error along x and y [px]."""
    return "{:+.3f} {:+.3f}".format(*judged["bias_px"])


def spread(judged: Results) -> str:
    """Standard deviations along x and y of a point's lasting error, and their correlation."""
    return _ellipse(np.array(judged["spread_px2"]))


def noise(judged: Results) -> str:
    """Standard deviations along x and y over repeats, and their correlation."""
    return _ellipse(np.array(judged["noise_px2"]))


def _ellipse(covariance: np.ndarray) -> str:
    x, y = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    # A spread is what is left after noise is taken away. Noise is known roughly, so what is left may be no ellipse.
    is_ellipse = x * y > 0 and abs(covariance[0, 1]) <= x * y
    return f"{x:.3f} {y:.3f} " + (f"{covariance[0, 1] / (x * y):+.1f}" if is_ellipse else NOTHING)


def found(judged: Results) -> str:
    """Share of the points found, and further corners per image that are none of the board's."""
    more = judged["false_per_image"]
    return f"{100 * judged['found']:.0f} %" + (f" +{more:.1f}" if more >= 0.05 else "")


DETECTORS: dict[str, Cell] = {
    "Points found, and false ones per image": found,
    "Lasting error against J: rms length of bias and spread [px]": against("J", lasting),
    "Lasting error against the saddle [px]": against("saddle", lasting),
    "Lasting error against the chief ray [px]": against("chief", lasting),
    "Bias against J: mean error along x and y [px]": against("J", bias),
    "Spread over points against J: sigma x, sigma y [px], correlation": against("J", spread),
    "Noise over repeats: sigma x, sigma y [px], correlation": against("J", noise),
}


def calibrations(results: Results) -> list[tuple[str, list[str], list[list[str]]]]:
    """Title, head and rows of the tables of calibrators."""
    cases = ("exact", "noise", "few", "detected", "open", "tilted")
    made = []
    for title, cell in (
        ("Projection error over the field at 300, 500, 1000 and 5000 mm, rms length [px]", _rms),
        (
            "Largest projection error at these distances, in parentheses outside of what the boards covered [px]",
            _largest,
        ),
        ("Error of the entrance pupil: x, y, z [mm]", _pupil),
    ):
        rows = [
            [who, *(cell(one["cases"][name]) if name in one["cases"] else NOTHING for name in cases)]
            for who, one in results["calibrators"].items()
        ]
        made.append((title, ["calibrator", *cases], rows))
    return [*made, _own(results), _honesty(results)]


def _rms(case: Results) -> str:
    return "failed" if "failed" in case else " ".join(f"{value:.3f}" for value in case["rms_px"])


def _largest(case: Results) -> str:
    if "failed" in case:
        return "failed"
    outside = case.get("outside_px")
    return f"{case['largest_px']:.2f}" + (f" ({outside:.2f})" if outside is not None else "")


def _pupil(case: Results) -> str:
    return "{:+.2f} {:+.2f} {:+.2f}".format(*case["pupil_mm"]) if "pupil_mm" in case else NOTHING


def _own(results: Results) -> tuple[str, list[str], list[list[str]]]:
    rows = []
    for who, one in results["calibrators"].items():
        for name in ("exact", "detected"):
            case = one["cases"].get(name, {})
            if "own_rms_px" in case:
                real = float(np.sqrt(np.mean(np.square(case["rms_px"]))))
                rows.append([who, name, f"{case['own_rms_px']:.4f}", f"{real:.4f}"])
    return (
        "The residual that a program prints, and its error over the field [px]",
        ["calibrator", "case", "own rms", "over the field"],
        rows,
    )


def _honesty(results: Results) -> tuple[str, list[str], list[list[str]]]:
    rows = []
    for who, one in results["calibrators"].items():
        said = one.get("honesty")
        if said:
            truth = f"{100 * said['inside_of_truth']:.0f} %" if "inside_of_truth" in said else NOTHING
            rows.append(
                [who, said["of"], f"{said['stated_over_real']:.2f}", f"{100 * said['inside_of_noise']:.0f} %", truth]
            )
    for who, one in results["detectors"].items():
        for name, judged in one["conditions"].items():
            if "stated" in judged and "J" in judged["against"]:
                real = np.sqrt(np.trace(np.array(judged["against"]["J"]["noise_px2"])) / 2)
                said = judged["stated"]
                ratio = f"{said['sigma_px'] / real:.2f}" if real > 0 else NOTHING
                inside = [f"{100 * said[key]:.0f} %" for key in ("inside_of_noise", "inside_of_truth")]
                rows.append([who, f"corners, {name}", ratio, *inside])
    head = ["who states it", "of what", "stated / real sigma", "noise within 1 sigma", "error within 1 sigma"]
    return "Honesty: 68 % is what one sigma promises", head, rows


BRIEF = (
    "Points found",
    "Lasting error against J",
    "Lasting error against the saddle",
    "Projection error",
    "The residual",
)
"""Beginnings of the titles of the tables that say most."""


def tables(results: Results, brief: bool = False) -> str:
    """All tables as text, or those that say most."""
    wanted = BRIEF if brief else ("",)
    about = results["about"]
    lines = [
        f"{about['date']}: {about['cpu_s']} s of processor time, {about['wall_s']} s by the clock; "
        f"{about['repeats']} images of each view, "
        f"{about['noisy']} calibrations with noise",
        "",
    ]
    for name, what in results["conditions"].items():
        blur = [
            one["conditions"][name]["blur_px"] for one in results["detectors"].values() if name in one["conditions"]
        ]
        lines.append(f"{name}: {what}" + (f"; blur {blur[0]:.2f} px rms" if blur else ""))
    if results["detectors"]:
        for title, cell in DETECTORS.items():
            lines += ["", title, "", *markdown(*by_condition(results, cell))] if title.startswith(wanted) else []
    if results["calibrators"]:
        for title, head, rows in calibrations(results):
            lines += ["", title, "", *markdown(head, rows)] if rows and title.startswith(wanted) else []
    lines += ["", *(f"missing: {name}: {reason}" for name, reason in results["missing"].items())]
    return "\n".join(lines).rstrip("\n") + "\n"


def main() -> None:
    """Run the command."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    kept = Path(__file__).resolve().parent / "results.json"
    parser.add_argument("results", nargs="?", type=Path, default=kept, help="what arena.py wrote")
    parser.add_argument("--brief", action="store_true", help="only the tables that say most")
    asked = parser.parse_args()
    print(tables(json.loads(asked.results.read_text(encoding="utf-8")), asked.brief), end="")


if __name__ == "__main__":
    main()
