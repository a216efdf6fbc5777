"""Nousias et al. 2017, linear and nonlinear calibration from corners in micro-images, in GNU Octave with optim.

sotnousias/plenoptic-camera-calibration d41208d. It reads the export `bok`: pattern_size.txt, image_center.txt and every
correspondencesAll_<frame>.mat. Pixels count from 1; returned are ours. Its model is `models.Projective`, with poses of
the board as OpenCV has it, in mm. The linear start fails if boards stand on both sides of the plane that the main lens
images onto the array, where K1 Z + K2 is 0. All types of microlenses are calibrated together.
"""

import shutil
from pathlib import Path
from typing import Any

import numpy as np
from environments import Failed
from snapshots import clone, octave, replaced

_ITERATIONS = 300
"""Limit of iterations: Octave's lsqnonlin went on for more than eight minutes; norms of residuals have a kink at 0."""


def build(snapshots: Path, programs: Path) -> None:
    """Check the source out; patch memory of the SVD, and the number of iterations."""
    if clone(snapshots, "sotnousias/plenoptic-camera-calibration", programs / "nousias"):
        source = programs / "nousias/src/cornerLinearSolutionManyImages.m"
        replaced(source, "svd(A)", "svd(A, 0)")  # all of U is a square of the number of rows
        replaced(source, "'MaxIter',10000", f"'MaxIter',{_ITERATIONS}")


def run(programs: Path, task: Path, facts: dict[str, Any]) -> dict[str, Any]:
    """Calibrate from the exported corners of all frames in one go, and from those with noise."""
    if "bok" not in facts["formats"]:
        raise Failed("the files that it reads know hexagonal rows of microlenses alone")
    exact, *noisy = (
        _calibrated(programs, place / "bok" / facts["camera"])
        for place in (task / "exports", *sorted(task.glob("noise_*")))
    )
    return {"exact": exact, "noise": noisy}


def _calibrated(programs: Path, export: Path) -> dict[str, Any]:
    work = programs / "runs/nousias"
    shutil.rmtree(work, ignore_errors=True)
    shutil.copytree(export, work)
    found = octave(
        "pkg load optim; cornerLinearSolutionManyImages; residuals = plenopticReprojectionErrorMultipleImages(param,"
        " corr_all, num_cor, pattern_size); found.parameters = param(1:8);"
        " found.rms = sqrt(mean(residuals.^2)); found.names = file1;"
        " for n = 1:ImageNum, found.poses{n} = SetAxis(param(6 * n + 3:6 * n + 8)); end;",
        "found",
        [programs / "nousias/src", programs / "nousias/thirdParty/Geometric_Calibration_Lightfield"],
        work,
        45,  # any number but 1, 2, 3 asks for all types
    )
    values = dict(zip(["K1", "K2_mm", "fx_px", "fy_px", "cx_px", "cy_px"], found["parameters"], strict=False))
    return {
        "parameters": values | {"cx_px": values["cx_px"] - 1, "cy_px": values["cy_px"] - 1},
        "frames": [int(name.split("_")[1].removesuffix(".mat")) for name in found["names"]],
        "poses": np.reshape(found["poses"], (-1, 4, 4)),
        "rms_px": found["rms"],
    }
