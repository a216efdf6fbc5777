"""The paper's evaluation: error and detected corners of its two methods by K and samples, and of ours.

    python examples/03_paper_evaluation/evaluate.py [--out FOLDER] [--corners N] [--jobs N] [--small]

Writes results.csv, figures like the paper's (picture.png of `image`, figure_two_plane.png) and one of a
camera without microlenses, and prints the tables. Rays are traced in windows around a random sample of the corners of
dataset.usda; each takes about 11 seconds of computing time.
`--keep FOLDER` keeps all positions, lot by lot, `--again FOLDER` makes tables and figures from those.
"""

import argparse
import os
import sys
from pathlib import Path

import numpy as np
from bars import SETTINGS, Bar, bars, write
from corners import draw
from cost import measured
from figures import Panel
from figures import draw as draw_figure
from results import PAPER, SMALL, Results, run
from tables import report

CAMERAS = {"plenoptic": 1.0, "conventional": 0.6}
"""The paper's camera and the one without microlenses, and the share of the corners that each is looked at with."""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=Path("build/03_paper_evaluation"))
    parser.add_argument("--corners", type=int, default=40)
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1)
    parser.add_argument("--small", action="store_true", help="few corners, K and samples: does it run at all?")
    parser.add_argument("--keep", type=Path)
    parser.add_argument("--again", type=Path)
    given = parser.parse_args()
    given.out.mkdir(parents=True, exist_ok=True)
    cameras = {name: _results(given, name) for name in CAMERAS}
    bars_of = {name: bars(results) for name, results in cameras.items()}
    write(given.out / "results.csv", bars_of)
    conventional = _panels(cameras["conventional"], bars_of["conventional"], "image")
    draw_figure(given.out / "figure_conventional.png", conventional[2:], 2)
    results, all_bars = cameras["plenoptic"], bars_of["plenoptic"]
    draw_figure(given.out / "picture.png", _panels(results, all_bars, "image"), 2)
    draw_figure(given.out / "figure_two_plane.png", _panels(results, all_bars, "two-plane"), 2)
    cost = measured(1, 1024) if given.small else measured()
    sys.stdout.write(report(results, cameras["conventional"], cost))


def _results(given: argparse.Namespace, name: str) -> Results:
    file, conventional = f"{name}.npz", name == "conventional"
    if given.again:
        return Results.load(given.again / file)
    keep = given.keep / file if given.keep else None
    if given.small:
        few = draw(6, slice(0, 1), slice(None, None, 9), conventional=conventional)
        return run(few, SMALL, given.jobs, keep)
    return run(draw(round(CAMERAS[name] * given.corners), conventional=conventional), PAPER, given.jobs, keep)


def _panels(results: Results, all_bars: list[Bar], method: str) -> list[Panel]:
    """One per setting: differences from K = 10 as in the paper, and detected corners, or differences of the means."""
    return [_panel(results, all_bars, method, mapping, sampling) for mapping, sampling in SETTINGS]


def _panel(results: Results, all_bars: list[Bar], method: str, mapping: str, sampling: str) -> Panel:
    rays = "independent rays" if sampling == "independent" else "our rays"
    mean, error, share = (_matrix(results, all_bars, name, method, mapping, sampling) for name in _DRAWN)
    apart = np.abs(mean - _matrix(results, all_bars, _DRAWN[0], "image", mapping, sampling))
    first = method == "image"
    return Panel(
        title=f"{method}: {mapping} mapping, {rays}",
        left_label="from K = 10, px",
        right_label="detected" if first else "apart, px",
        groups=tuple(f"K = {k}" for k in results.ks),
        series=tuple(f"{int(np.sqrt(n))} x {int(np.sqrt(n))}" for n in results.samples),
        bars=mean,
        errors=error,
        dots=share if first else apart,
        dot_top=1.0 if first else 0.002,
        square=not first,
        percent=first,
    )


_DRAWN = ("k10_px", "k10_sem_px", "detected")


def _matrix(results: Results, all_bars: list[Bar], name: str, method: str, mapping: str, sampling: str) -> np.ndarray:
    by = {(b.method, b.mapping, b.sampling, b.k, b.samples): getattr(b, name) for b in all_bars}
    key = method, mapping, sampling
    return np.array([[by[(*key, int(k), int(n))] for n in results.samples] for k in results.ks])


if __name__ == "__main__":
    main()
