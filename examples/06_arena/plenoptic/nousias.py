"""Nousias et al. 2017, linear and nonlinear calibration from corners in micro-images, in GNU Octave with optim.

sotnousias/plenoptic-camera-calibration d41208d. It reads the export `bok`: pattern_size.txt, image_center.txt and every
correspondencesAll_<frame>.mat. Pixels count from 1; returned are ours. Its model: corner - centre is
(f X - Z (centre - c)) / (K1 Z + K2), poses of the board as OpenCV has it, in mm. Thin lenses say f = (D + d) / pixel,
K1 = -(D + d) (D - F) / (d F), K2 = (D + d) D / d. The linear start fails if boards stand on both sides of the
plane that the main lens images onto the array, where K1 Z + K2 is 0.
"""

import json
import shutil
from pathlib import Path

import numpy as np
from snapshots import clone, octave, replaced

_COMMIT = "d41208d"
_ITERATIONS = 300
"""Limit of iterations: Octave's lsqnonlin went on for more than eight minutes; norms of residuals have a kink at 0."""


def build(snapshots: Path, folder: Path) -> None:
    """Check the source out; patch memory of the SVD, and the number of iterations."""
    place = folder / "nousias"
    if clone(snapshots, "sotnousias+plenoptic-camera-calibration", _COMMIT, place):
        source = place / "src/cornerLinearSolutionManyImages.m"
        replaced(source, "svd(A)", "svd(A, 0)")  # all of U is a square of the number of rows
        replaced(source, "'MaxIter',10000", f"'MaxIter',{_ITERATIONS}")


def run(folder: Path, task: Path) -> dict[str, object]:
    """Calibrate from the exported corners of all frames in one go, all types of microlenses together; so with noise."""
    camera = json.loads((task / "task.json").read_text(encoding="utf-8"))["camera"]
    noisy = [_calibrated(folder, place / "bok" / camera) for place in sorted(task.glob("noise_*"))]
    return {"exact": _calibrated(folder, task / "exports/bok" / camera), "noise": noisy}


def _calibrated(folder: Path, export: Path) -> dict[str, object]:
    work = folder / "runs/nousias"
    shutil.rmtree(work, ignore_errors=True)
    shutil.copytree(export, work)
    source = folder / "nousias"
    said = octave(
        "pkg load optim; cornerLinearSolutionManyImages; residuals = plenopticReprojectionErrorMultipleImages(param,"
        " corr_all, num_cor, pattern_size); found.linear = param_init(1:8); found.parameters = param(1:8);"
        " found.rms = sqrt(mean(residuals.^2)); found.counts = num_cor; found.names = file1;"
        " for n = 1:ImageNum, found.poses{n} = SetAxis(param(6 * n + 3:6 * n + 8)); end;"
        " printf('FOUND%s', jsonencode(found))",
        [source / "src", source / "thirdParty/Geometric_Calibration_Lightfield"],
        work,
        typed="45",  # any number but 1, 2, 3 asks for all types
    )
    found = json.loads(said.partition("FOUND")[2])
    names = ["K1", "K2_mm", "fx_px", "fy_px", "cx_px", "cy_px"]
    values = dict(zip(names, found["parameters"], strict=False))
    return {
        "parameters": values | {"cx_px": values["cx_px"] - 1, "cy_px": values["cy_px"] - 1},
        "linear": found["linear"],
        "camera_from_target": {
            name.split("_")[1].removesuffix(".mat"): np.reshape(pose, (4, 4))
            for name, pose in zip(found["names"], found["poses"], strict=True)
        },
        "rms_px": found["rms"],
    }
