"""Bok et al. 2017, centres of micro-images and line features of central views, in GNU Octave with image and optim.

Its MATLAB code lies in sotnousias/plenoptic-camera-calibration d41208d, thirdParty/Geometric_Calibration_Lightfield. It
reads white.png, images of boards and pattern_size.txt. Steps: 1 centres, 2 central views with corners, 3 lines in
micro-images, 4 calibration; only 1 and 2 were seen to end. Pixels count from 1; returned centres are ours. The
templates of lines that the snapshot lacks are made by the source itself. Its radius is a whole
number of pixels near half a pitch.
"""

import json
import shutil
from pathlib import Path

import numpy as np
from snapshots import clone, octave, replaced

_COMMIT = "d41208d"
_STEPS = ("1_MicroLensCenter", "2_CenterImage", "3_LineFeature", "4_LinearSolution")


def build(snapshots: Path, folder: Path) -> None:
    """Check the source out; its radius becomes that of the task, its pictures are not drawn."""
    place = folder / "bok"
    if clone(snapshots, "sotnousias+plenoptic-camera-calibration", _COMMIT, place):
        source = place / "thirdParty/Geometric_Calibration_Lightfield"
        step = source / f"LightFieldCalib_Step{_STEPS[0]}.m"
        replaced(step, "radius = 7;\n", "radius = round(str2double(getenv('ARENA_INPUT')) / 2);\n")
        replaced(step, "figure; imshow(", "% figure; imshow(")
        replaced(source / f"LightFieldCalib_Step{_STEPS[3]}.m", "=svd(Q);", "=svd(Q,0);")  # all of U is a large square


def run(folder: Path, task: Path, steps: int = 4) -> dict[str, object]:
    """The first steps; files of each are in runs/bok. A step that fails raises, and what was found before is lost."""
    known = json.loads((task / "task.json").read_text(encoding="utf-8"))
    work = folder / "runs/bok"
    shutil.rmtree(work, ignore_errors=True)
    (work / "white").mkdir(parents=True)
    shutil.copy(task / "white.png", work / "white")
    for frame in known["frames"]:
        shutil.copy(task / f"{frame}.png", work)
    (work / "pattern_size.txt").write_text(f"{known['square_mm']}\n", encoding="utf-8")
    source = folder / "bok/thirdParty/Geometric_Calibration_Lightfield"
    pitch = str(known["pitch_px"])
    first = f"pkg load image; LightFieldCalib_Step{_STEPS[0]}; printf('FOUND%s', jsonencode(center_list))"
    centres = octave(first, [source], work / "white", typed=pitch).partition("FOUND")[2]
    answer: dict[str, object] = {"centres_px": np.array(json.loads(centres)).T - 1}
    shutil.copy(work / "white/microlens_center_list.mat", work)
    for step in _STEPS[1:steps]:
        said = octave(f"pkg load image optim; LightFieldCalib_Step{step}", [source], work, typed=pitch)
        answer[f"said_{step}"] = said
    if steps > 3:
        last = f"load('{work}/IntParamLF.mat'); printf('FOUND%s', jsonencode(IntParamLF))"
        answer["parameters"] = json.loads(octave(last, [source], work).partition("FOUND")[2])
    return answer
