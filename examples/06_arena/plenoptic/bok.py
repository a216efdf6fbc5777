"""Bok et al. 2017, centres of micro-images, in GNU Octave with image.

Its MATLAB code lies in sotnousias/plenoptic-camera-calibration d41208d, thirdParty/Geometric_Calibration_Lightfield. Of
its four steps this is the first, which reads white.png alone; its lines in micro-images, the third, were not seen to
end. Pixels count from 1; returned centres are ours. Its radius is a whole number of pixels near half a pitch.
"""

import json
import shutil
from pathlib import Path

import numpy as np
from snapshots import clone, octave, replaced

_COMMIT = "d41208d"
_STEP = "LightFieldCalib_Step1_MicroLensCenter"


def build(snapshots: Path, folder: Path) -> None:
    """Check the source out; its radius becomes that of the task, its pictures are not drawn."""
    place = folder / "bok"
    if clone(snapshots, "sotnousias+plenoptic-camera-calibration", _COMMIT, place):
        source = place / "thirdParty/Geometric_Calibration_Lightfield"
        step = source / f"{_STEP}.m"
        replaced(step, "radius = 7;\n", "radius = round(str2double(getenv('ARENA_INPUT')) / 2);\n")
        replaced(step, "figure; imshow(", "% figure; imshow(")


def run(folder: Path, task: Path) -> dict[str, object]:
    """Let it find the centres of a white image."""
    known = json.loads((task / "task.json").read_text(encoding="utf-8"))
    work = folder / "runs/bok"
    shutil.rmtree(work, ignore_errors=True)
    work.mkdir(parents=True)
    shutil.copy(task / "white.png", work)
    source = folder / "bok/thirdParty/Geometric_Calibration_Lightfield"
    program = f"pkg load image; {_STEP}; printf('FOUND%s', jsonencode(center_list))"
    centres = octave(program, [source], work, typed=str(known["pitch_px"])).partition("FOUND")[2]
    return {"centres_px": np.array(json.loads(centres)).T - 1}
