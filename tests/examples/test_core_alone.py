"""The core without any plug-in: it builds, and says what is not there."""

import os
import re
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
WITHOUT = """import pathlib, sys
import pipeline.folders
class NoPlugIns:
    def find_spec(self, name, path=None, target=None):
        if name.startswith("pipeline.plugins"):
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)
sys.meta_path.insert(0, NoPlugIns())
pipeline.folders.shipped_folder = pathlib.Path(__file__).parent.joinpath
"""
"""What Python runs before all else: there is no package of plug-ins, and the library is the one beside this file."""
BUILDS = """import sys, pipeline
for stage in sys.argv[1:]:
    result = pipeline.build(stage, stage + ".out", targets=["frames/0001"], jobs=1)
    assert result.exit_code == 0, (stage, [task.error for task in result.failures])
"""
"""A program that builds a frame of each stage: one process loads libraries and kernels."""
SAMPLES = re.compile(r"(plen:image:samples =) \d+")
WHOLE_SENSOR = "(2173, 2173)"
"""Resolution of the sensor of example 03 [px], most of whose rays it would take."""


@pytest.mark.heavy(minutes=1)
def test_the_core_builds_every_example_but_those_with_lamps_without_the_folder_of_plug_ins(tmp_path):
    """Where no plug-in can be imported and the package's metadata name none; kernels are those of the whole package.

    Of every example a frame, of example 01 the whole: the plan is that of all of it. Images have few rays: what is
    missing is missed by the first of them.
    """
    for folder in ("schemas", "stages", "examples"):
        shutil.copytree(ROOT / folder, tmp_path / folder)
    for path in (path for folder in ("stages", "examples") for path in (tmp_path / folder).rglob("*.usda")):
        text = path.read_text(encoding="utf-8").replace(WHOLE_SENSOR, "(400, 400)")
        path.write_text(SAMPLES.sub(r"\1 4", text), encoding="utf-8")
    (tmp_path / "sitecustomize.py").write_text(WITHOUT)
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    place = tmp_path / f"plenoptic_pipeline-{project['version']}.dist-info"
    place.mkdir()
    (place / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {project['name']}\nVersion: {project['version']}\n")
    paths = os.pathsep.join(map(str, (tmp_path, ROOT)))
    settings = {"PYTHONPATH": paths, "PIPELINE_CACHE": str(tmp_path / "store"), "PIPELINE_REPORT": ""}

    def python(*words):
        command = [sys.executable, *words]
        return subprocess.run(command, cwd=tmp_path, env={**os.environ, **settings}, capture_output=True, text=True)

    def run(*words):
        return python("-m", "pipeline", *words)

    for code in ("import pipeline.plugins.report.report", "import pipeline.plugins"):
        assert "ModuleNotFoundError" in python("-c", code).stderr
    assert run("--help").returncode == 0
    stages = {stage.parent.name: stage for stage in sorted((tmp_path / "examples").glob("*/dataset.usda"))}
    for name, told in LIT.items():
        refused = run("build", stages.pop(name))
        assert refused.returncode == 2 and told in refused.stderr, refused.stderr
        assert refused.stderr.count("[plug-in-missing]") == refused.stderr.count("error: ")
    assert len(stages) >= 10
    built = python("-c", BUILDS, *stages.values())
    assert built.returncode == 0, built.stdout + built.stderr
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
