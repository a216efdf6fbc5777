"""Bok et al. 2017, centres of micro-images, in GNU Octave with image.

Its MATLAB code lies in sotnousias/plenoptic-camera-calibration d41208d, thirdParty/Geometric_Calibration_Lightfield. Of
its four steps this is the first, which reads white.png alone; its lines in micro-images, the third, were not seen to
end. Pixels count from 1; returned centres are ours. Its radius is a whole number of pixels near half a pitch.
"""

import shutil
from pathlib import Path
from typing import Any

import numpy as np
from snapshots import clone, octave, replaced

_STEP = "LightFieldCalib_Step1_MicroLensCenter"
_SOURCE = "bok/thirdParty/Geometric_Calibration_Lightfield"


def build(snapshots: Path, programs: Path) -> None:
    """Check the source out; its radius becomes that of the task, its pictures are not drawn."""
    if clone(snapshots, "sotnousias/plenoptic-camera-calibration", programs / "bok"):
        step = programs / _SOURCE / f"{_STEP}.m"
        replaced(step, "radius = 7;\n", "radius = round(str2double(getenv('ARENA_INPUT')) / 2);\n")
        replaced(step, "figure; imshow(", "% figure; imshow(")


def run(programs: Path, task: Path, facts: dict[str, Any]) -> dict[str, Any]:
    """Let it find the centres of a white image."""
    work = programs / "runs/bok"
    shutil.rmtree(work, ignore_errors=True)
    work.mkdir(parents=True)
    shutil.copy(task / "white.png", work)
    found = octave(f"pkg load image; {_STEP};", "center_list", [programs / _SOURCE], work, facts["pitch_px"])
    return {"centres_px": np.array(found).T - 1}
