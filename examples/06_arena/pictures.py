"""Draw detectors.png and fields.png from the results of an arena; needs Matplotlib.

python examples/06_arena/pictures.py build/arena
"""

import argparse
import json
from pathlib import Path
from typing import Any

import numpy as np

PANEL_INCHES, DPI = (2.5, 2.15), 80
SHOWN_MM = {0: "300 mm", 1: "500 mm", 2: "1000 mm", 3: "5000 mm"}
MOST_PX, LEAST_PX = 1.0, 1e-3
"""Ends of the scale of error fields [px]: from what nobody can measure to what everybody sees."""


def detectors(results: dict[str, Any], path: Path, plt: Any) -> None:
    """Draw lasting error and noise of every detector under every condition."""
    names = list(results["conditions"])
    figure, axes = plt.subplots(2, 1, figsize=(10, 6.4), sharex=True, layout="constrained")
    for panel, title, value in (
        (axes[0], "lasting error against J: bias and spread, rms length [px]", lambda j: j["lasting_px"]),
        (axes[1], "noise, rms length [px]", lambda j: float(np.sqrt(np.trace(np.array(j["noise_px2"]))))),
    ):
        for number, (who, one) in enumerate(results["detectors"].items()):
            points = [
                (i + 0.07 * (number - 4), value(one["conditions"][name]["against"]["J"]))
                for i, name in enumerate(names)
                if "J" in one["conditions"].get(name, {}).get("against", {})
            ]
            if points:
                panel.plot(*zip(*points, strict=True), "os^Dv<>Ph"[number % 9], ms=6, label=who, color=f"C{number}")
        panel.set_yscale("log"), panel.set_title(title, loc="left", fontsize=10), panel.grid(axis="y", alpha=0.3)
    axes[1].set_xticks(range(len(names)), names)
    for panel in axes:
        for i in range(len(names) - 1):
            panel.axvline(i + 0.5, color="0.85", lw=0.8, zorder=0)
    axes[0].legend(ncols=5, fontsize=8, loc="upper center", bbox_to_anchor=(0.5, 1.32), frameon=False)
    figure.savefig(path, dpi=DPI)


def fields(found: dict[str, Any], path: Path, plt: Any) -> None:
    """Draw the error field of every calibrator from exact data, at every distance."""
    shown = {who: np.array(field) for who, field in found.items() if field is not None}
    if not shown:
        return
    from matplotlib.colors import LogNorm

    across = PANEL_INCHES[0] * len(SHOWN_MM) + 1.6, PANEL_INCHES[1] * 0.74 * len(shown) + 0.5
    figure, axes = plt.subplots(len(shown), len(SHOWN_MM), figsize=across, layout="constrained", squeeze=False)
    for first, row, (who, field) in zip(range(len(shown)), axes, shown.items(), strict=True):
        for panel, (number, name) in zip(row, SHOWN_MM.items(), strict=True):
            drawn = panel.imshow(
                np.maximum(field[number], LEAST_PX), norm=LogNorm(LEAST_PX, MOST_PX), cmap="viridis",
                extent=(-0.5, 639.5, 479.5, -0.5), interpolation="nearest",
            )  # fmt: skip
            panel.set_xticks([]), panel.set_yticks([])
            if first == 0:
                panel.set_title(name, fontsize=9)
        row[0].set_ylabel(who.replace(" ", "\n", 1), fontsize=8)
    figure.colorbar(drawn, ax=axes, shrink=0.5, label="projection error, exact data [px]", extend="both")
    figure.savefig(path, dpi=DPI)


def main() -> None:
    """Run the command."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", type=Path, help="folder that arena.py wrote")
    out = parser.parse_args().out
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    results = json.loads((out / "results.json").read_text(encoding="utf-8"))
    if results["detectors"]:
        detectors(results, out / "detectors.png", plt)
    fields(json.loads((out / "fields.json").read_text(encoding="utf-8")), out / "fields.png", plt)


if __name__ == "__main__":
    main()
