"""Draw picture.png of an ensemble: where its members see the corners, and what goes together; needs Matplotlib.

python examples/11_as_built/picture.py build/11_as_built.ensemble
"""

import argparse
import json
from pathlib import Path

import numpy as np

import pipeline

ENLARGED = 60
"""Enlargement of the errors of positions: clouds of neighbours then nearly touch."""
INCHES, DPI = (10.5, 3.9), 90


def main() -> None:
    """Draw both panels."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("ensemble", type=Path)
    folder = parser.parse_args().ensemble
    from matplotlib import pyplot

    figure, (left, right) = pyplot.subplots(1, 2, figsize=INCHES, layout="constrained", width_ratios=(1.25, 1))
    corners(folder, left)
    correlations(folder, right)
    figure.savefig(Path(__file__).with_name("picture.png"), dpi=DPI)


def corners(folder: Path, panel) -> None:
    """Draw the corners of the nominal camera, and what those of members are off by besides the shift of all of them."""
    nominal = pipeline.open_output(folder / "nominal").camera.correspondences
    for member in sorted(folder.glob("member_*/")):
        rows = pipeline.open_output(member).camera.correspondences
        off = {axis: rows[axis] - nominal[axis] for axis in ("x_px", "y_px")}
        x_px, y_px = (nominal[axis] + ENLARGED * (by - by.mean()) for axis, by in off.items())
        panel.plot(x_px, y_px, ".", color="C0", ms=2)
    panel.plot(nominal.x_px, nominal.y_px, "+", color="C1", ms=5)
    panel.set(xlim=(-0.5, 639.5), ylim=(479.5, -0.5), aspect="equal", xlabel="x [px]", ylabel="y [px]")
    panel.set_title(f"corners, and their errors without the shift of all, x {ENLARGED}", fontsize=9)


def correlations(folder: Path, panel) -> None:
    """Draw the correlations of the figures that differ."""
    ((_, figures),) = json.loads((folder / "ensemble.json").read_text(encoding="utf-8"))["cameras"].items()
    names = [name for name, figure_of_members in figures.items() if figure_of_members["correlations"][name] is not None]
    values = np.array([[figures[name]["correlations"][other] for other in names] for name in names])
    drawn = panel.imshow(values, cmap="RdBu_r", vmin=-1, vmax=1)
    panel.set_xticks(range(len(names)), names, rotation=90, fontsize=7)
    panel.set_yticks(range(len(names)), names, fontsize=7)
    panel.figure.colorbar(drawn, ax=panel, shrink=0.8)
    panel.set_title("correlations of what a calibration finds", fontsize=9)


if __name__ == "__main__":
    main()
