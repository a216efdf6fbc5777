"""The core without any plug-in: it builds, and says what is not there."""

import os
import shutil
import subprocess
import sys
import tomllib

import pytest
from places import ROOT

LIT = {
    "04_stereo_colour": "dataset.usda:122: error: </StereoColour/Softbox> is a lamp, RectLight",
    "05_scene": "still_life.usda:14: error: </Scene/Background/Window> is a lamp, RectLight",
}
"""Examples with lamps, and where the first of them is."""


@pytest.mark.heavy
def test_the_core_builds_every_example_but_those_with_lamps_without_the_folder_of_plug_ins(tmp_path):
    """A copy whose package has its own metadata, without the entry points of plug-ins, and compiles its own kernels."""
    for folder in ("pipeline", "schemas", "stages", "examples"):
        shutil.copytree(ROOT / folder, tmp_path / folder, ignore=shutil.ignore_patterns("__pycache__", "plugins"))
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    place = tmp_path / f"plenoptic_pipeline-{project['version']}.dist-info"
    place.mkdir()
    (place / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {project['name']}\nVersion: {project['version']}\n")
    settings = {"PYTHONPATH": str(tmp_path), "PIPELINE_CACHE": str(tmp_path / "store"), "PIPELINE_REPORT": ""}

    def run(*words):
        command = [sys.executable, "-m", "pipeline", *words]
        return subprocess.run(command, cwd=tmp_path, env={**os.environ, **settings}, capture_output=True, text=True)

    assert not (tmp_path / "pipeline/plugins").exists()
    assert run("--help").returncode == 0
    stages = sorted((tmp_path / "examples").glob("*/dataset.usda"))
    assert len(stages) >= 12
    for stage in stages:
        built = run("build", stage, "-o", stage.parent / "out")
        if stage.parent.name in LIT:
            assert built.returncode == 2 and LIT[stage.parent.name] in built.stderr, built.stderr
            assert built.stderr.count("[plug-in-missing]") == built.stderr.count("error: ")
        else:
            assert built.returncode == 0, built.stderr
    built = run("build", "examples/01_conventional/dataset.usda", "-o", "out")
    assert built.returncode == 0, built.stderr
    assert (tmp_path / "out/manifest.json").is_file()
    assert 'no report is written: no plug-in that is installed has the report "html"' in built.stderr
    unwritten = run("export", "out", "opencv")
    assert unwritten.returncode == 2 and "opencv" in unwritten.stderr
    for words in ("report out", "design plenoptic a.usda", "inform out --report", "import lens a.dat"):
        refused = run(*words.split())
        assert refused.returncode == 2 and "no plug-in that is installed has the" in refused.stderr
    refused = run("build", "examples/01_conventional/dataset.usda", "-o", "out", "--engine", "dask:here")
    assert refused.returncode == 2 and 'has the engine "dask"' in refused.stderr
