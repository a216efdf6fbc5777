"""GNU Octave itself, where its Debian package is installed: it reads our files of MATLAB as SciPy does."""

import json
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


def load(path: Path) -> dict[str, np.ndarray]:
    """Variables of a file as Octave has loaded them: matrices with more than one row and column."""
    program = f"printf('%s', jsonencode(load('{path}')))"
    command = ["octave-cli", "--norc", "--quiet", "--eval", program]
    said = subprocess.run(command, capture_output=True, text=True, check=True)
    return {name: np.array(value) for name, value in json.loads(said.stdout).items()}


def test_octave_reads_centres_types_and_correspondences_of_bok(tmp_path, monkeypatch):
    scene = PlenopticScene(layout="hexagonal")
    (folder,) = export(open_output(write_plenoptic_build(tmp_path / "out", scene)), ["bok"], tmp_path)
    monkeypatch.setattr(plenoptic_readers, "loadmat", load)
    plenoptic_readers.check_bok(folder, scene)
