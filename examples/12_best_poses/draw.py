"""Draw picture.png: what the six best poses and the first six tell of projections over the image, in the same colours.

    pipeline new dataset build/first.usda --rig examples/12_best_poses/rig.usda \\
        --target targets/charuco_8x5.usda --poses 6 --fit
    pipeline build examples/12_best_poses/dataset.usda && pipeline build build/first.usda
    python examples/12_best_poses/draw.py build/12_best_poses build/first
"""

import json
import subprocess
import sys
from pathlib import Path

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.colors import LogNorm

import pipeline

PICTURE = Path(__file__).parent / "picture.png"
SCALE_PX = LogNorm(0.01, 1.0)


def main() -> None:
    figure, panels = plt.subplots(1, 2, figsize=(10, 4), layout="constrained")
    for axes, out, title in zip(panels, sys.argv[1:], ("the six best of 72 poses", "the first six"), strict=True):
        command = [sys.executable, "-m", "pipeline", "inform", out, "--json"]
        information = json.loads(subprocess.run(command, capture_output=True, check=True).stdout)
        middle = information["projections"][1]
        (x, y), deviation = np.array(middle["x_px"]).T, np.array(middle["deviation_px"])
        across, down = np.unique(x), np.unique(y)
        mesh = axes.pcolormesh(across, down, deviation.reshape(len(down), len(across)), norm=SCALE_PX, cmap="Blues")
        corners = pipeline.open_output(out).camera.correspondences
        axes.plot(corners.x_px, corners.y_px, ".", color="black", markersize=2)
        axes.set(title=title, aspect="equal", xlabel="x [px]", ylabel="y [px]", ylim=(down[-1], down[0]))
    figure.colorbar(mesh, ax=panels, shrink=0.8, label=f"deviation of projections at {middle['z_mm']:.0f} mm [px]")
    figure.savefig(PICTURE, dpi=80, metadata={"Software": None})


if __name__ == "__main__":
    main()
