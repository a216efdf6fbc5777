"""The lowest versions of libraries that pyproject.toml allows make the truth and the images that the newest make."""

import os
import subprocess
import sys
import tomllib

import numpy as np
import pytest
from places import ROOT

from pipeline.files.exr import read_exr
from pipeline.files.tables import read_table

ROUNDING_PX = 1e-9
"""Other versions of NumPy and SciPy add in another order; Newton's method ends within this of the same place."""
BUILDS = """import sys
from pipeline import cli
for stage, out in zip(sys.argv[1::2], sys.argv[2::2]):
    sys.argv = ["pipeline", "build", stage, "-j1", "-o", out]
    try:
        cli.main()
    except SystemExit as end:
        assert end.code == 0
"""
"""The command on stages and folders: one process loads libraries and kernels."""


def floors() -> list[str]:
    """Each dependency at its lower bound, with whatever that was mended since."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    return [f"{requirement.split(',')[0].replace('>=', '==')}.*" for requirement in project["dependencies"]]


def run(*command: str, **variables: str) -> str:
    done = subprocess.run(command, capture_output=True, text=True, cwd=ROOT, env={**os.environ, **variables})
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def test_a_python_without_its_lock_is_refused_with_a_sentence():
    """USD's wheels install there and crash when they are imported."""
    script = "import sys; sys.abiflags = 't'; import pipeline"
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, cwd=ROOT)
    assert done.returncode == 1 and "free-threaded" in done.stderr.splitlines()[-1]


@pytest.mark.heavy(minutes=1)
@pytest.mark.skipif(sys.version_info[:2] != (3, 11), reason="the oldest versions have wheels for the oldest Python")
def test_the_lowest_versions_of_all_libraries_make_the_same(tmp_path, conventional_build, plenoptic_build):
    python = str(tmp_path / "venv/bin/python")
    run(sys.executable, "-m", "venv", "--without-pip", str(tmp_path / "venv"))
    pip = (sys.executable, "-m", "pip", "--python", python, "install", "-q", "--no-compile", "--only-binary=:all:")
    run(*pip, *floors())
    own = {
        "PYTHONPATH": str(ROOT),
        "PIPELINE_CACHE": str(tmp_path / "store"),
        "PIPELINE_JIT_CACHE": str(tmp_path / "jit"),
    }
    built = {"conventional": conventional_build, "plenoptic": plenoptic_build}
    words = [word for kind in built for word in (f"tests/data/tiny_{kind}/dataset.usda", str(tmp_path / kind))]
    run(python, "-c", BUILDS, *words, **own)
    for kind, newest in built.items():
        lowest = tmp_path / kind
        for path in sorted(newest.rglob("correspondences.csv")):
            here, there = (read_table(folder / path.relative_to(newest)) for folder in (newest, lowest))
            for column in ("x_px", "y_px"):
                assert np.abs(there.numbers(column) - here.numbers(column)).max() < ROUNDING_PX
        for path in sorted(newest.rglob("*.exr")):
            here, there = (read_exr(folder / path.relative_to(newest)) for folder in (newest, lowest))
            for name, part in here.items():
                for channel, pixels in part.channels.items():
                    np.testing.assert_allclose(there[name].channels[channel], pixels, rtol=1e-5, atol=1e-7)
