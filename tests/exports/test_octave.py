"""GNU Octave itself, where its Debian package is installed: it reads our files of MATLAB as SciPy does, and runs the
function of LFToolbox that reads ours. LFTOOLBOX is the folder of a clone of github.com/doda42/LFToolbox, 0.5 or later.
"""

import json
import os
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest
from exports import plenoptic_readers
from exports.pretended_plenoptic import PlenopticScene, write_plenoptic_build

from pipeline.built.output import open_output
from pipeline.exports.export import export

pytestmark = [
    pytest.mark.heavy,
    pytest.mark.skipif(shutil.which("octave-cli") is None, reason="GNU Octave is not installed"),
]


def said(program: str) -> dict[str, list]:
    """Variables that a program of Octave leaves in `found`, by JSON."""
    command = ["octave-cli", "--norc", "--quiet", "--eval", f"{program}; printf('%s', jsonencode(found))"]
    found: dict[str, list] = json.loads(subprocess.run(command, capture_output=True, text=True, check=True).stdout)
    return found


def load(path: Path) -> dict[str, np.ndarray]:
    """Variables of a file as Octave has loaded them: matrices with more than one row and column."""
    return {name: np.array(value) for name, value in said(f"found = load('{path}')").items()}


def test_octave_reads_centres_types_and_correspondences_of_bok(tmp_path, monkeypatch):
    scene = PlenopticScene(layout="hexagonal")
    (folder,) = export(open_output(write_plenoptic_build(tmp_path / "out", scene)), ["bok"], tmp_path)
    monkeypatch.setattr(plenoptic_readers, "loadmat", load)
    plenoptic_readers.check_bok(folder, scene)


@pytest.mark.skipif("LFTOOLBOX" not in os.environ, reason="LFTOOLBOX names no clone of LFToolbox")
def test_lftoolbox_builds_the_exact_centres_of_a_turned_array_from_our_grid(tmp_path):
    scene, tools = PlenopticScene(layout="hexagonal"), Path(os.environ["LFTOOLBOX"]) / "SupportFunctions"
    (folder,) = export(open_output(write_plenoptic_build(tmp_path / "out", scene)), ["lftoolbox"], tmp_path)
    _, head, body = (tools / "LFBuildLensletGridModel.m").read_text().partition("function [GridCoords] =")
    (tmp_path / "LFBuildHexGrid.m").write_text(head + body)  # a private function, as it stands
    model = f"jsondecode(fileread('{folder}/{plenoptic_readers.NAME}.grid.json')).LensletGridModel"
    found = said(f"addpath('{tools}', '{tmp_path}'); found.grid = LFBuildHexGrid({model})")
    plenoptic_readers.require_all_centres(np.reshape(found["grid"], (-1, 2)) - 1, scene)
