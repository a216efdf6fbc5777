"""The examples of clusters do what they say: a laptop with Dask, and arrays with a stand-in for sbatch."""

import json
import os
import subprocess
import sys

import pytest
from places import ROOT
from stage_text import tiny_text


@pytest.fixture(scope="module")
def stage(tmp_path_factory):
    """Six tasks on three levels: one frame, without position images."""
    text = tiny_text("conventional", ("endTimeCode = 2", "endTimeCode = 1"), ("rays = 1", "rays = false"))
    path = tmp_path_factory.mktemp("stage") / "few.usda"
    path.write_text(text, encoding="utf-8")
    return path


@pytest.fixture(scope="module")
def here(tmp_path_factory, stage):
    """The manifest that processes of this machine make."""
    folder = tmp_path_factory.mktemp("here")
    return run(folder, [sys.executable, "-m", "pipeline.cli", "build", str(stage), "-j2"])


def run(folder, command):
    """Run a command in a folder with a store of its own; gives the manifest of the build."""
    tools = folder / "bin"
    tools.mkdir(exist_ok=True)
    programs = {
        "pipeline": f'exec {sys.executable} -m pipeline.cli "$@"',
        "dask": f'exec {sys.executable} -m dask "$@"',
        "python": f'exec {sys.executable} "$@"',
        # A batch system: every element of an array is one process, and so is a job, which ends when it is cancelled.
        "sbatch": (
            "for last; do case $last in --array=*) array=${last#--array=0-};; esac; done\n"
            'if [ -z "${array:-}" ]; then\n'
            '    setsid bash "$last" >"$last.log" 2>&1 & echo "Submitted batch job $!"; exit\n'
            "fi\n"
            'for n in $(seq 0 "$array"); do SLURM_ARRAY_TASK_ID=$n bash -ec "$last" || exit 1; done'
        ),
        "scancel": 'for job; do kill -- "-$job"; done',
    }
    for name, text in programs.items():
        (tools / name).write_text(f"#!/usr/bin/env bash\n{text}\n")
        (tools / name).chmod(0o755)
    path = os.pathsep.join([str(ROOT), os.environ.get("PYTHONPATH", "")])
    environment = {**os.environ, "PIPELINE_CACHE": str(folder / "store"), "PYTHONPATH": path}
    environment["PATH"] = f"{tools}:{os.environ['PATH']}"
    done = subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr
    return (folder / "build/few/manifest.json").read_bytes()


@pytest.mark.heavy
def test_arrays_give_the_same_manifest(here, stage, tmp_path):
    assert run(tmp_path, [str(ROOT / "examples/cluster/array.sh"), str(stage)]) == here
    assert "truth/Rig.Camera/0001" in json.loads(here)["tasks"]


@pytest.mark.heavy
def test_a_laptop_cluster_gives_the_same_manifest(here, stage, tmp_path):
    pytest.importorskip("distributed", reason="the extra [cluster] is not installed")
    assert run(tmp_path, [str(ROOT / "examples/cluster/laptop.sh"), str(stage)]) == here


@pytest.mark.heavy
def test_jobs_of_a_batch_system_give_the_same_manifest(here, stage, tmp_path):
    """jobqueue.py as it is: dask-jobqueue writes the scripts of its jobs, a stand-in for sbatch runs them here."""
    pytest.importorskip("dask_jobqueue", reason="dask-jobqueue is not installed")
    assert run(tmp_path, [sys.executable, str(ROOT / "examples/cluster/jobqueue.py"), str(stage), "2"]) == here
