"""Processes of ours find our modules, whatever lies in the working directory."""

import subprocess
from pathlib import Path

import pytest

import pipeline
from pipeline.confine.process import Bounds, ask
from pipeline.machine.another_python import command


@pytest.fixture
def hostile_folder(tmp_path, monkeypatch):
    """The working directory: a folder that somebody else has filled with modules of the names that we import."""
    for name in ("json", "os", "runpy", "subprocess", "numpy", "pipeline"):
        (tmp_path / f"{name}.py").write_text(f"open({str(tmp_path / 'taken_over')!r}, 'w'); raise SystemExit(99)")
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("PYTHONSAFEPATH", raising=False)
    return tmp_path


def test_no_module_of_the_working_directory_is_imported(hostile_folder):
    done = subprocess.run(command("pipeline.machine.facts:tell"), capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")
    assert not (hostile_folder / "taken_over").exists()


def test_nothing_of_it_runs_before_a_process_is_confined(hostile_folder):
    outcomes, _ = ask("confine.acts:read_and_compute", {"inside": str(hostile_folder)}, [hostile_folder], Bounds())
    assert outcomes["thread"] == "done"
    assert not (hostile_folder / "taken_over").exists()


def test_all_processes_of_ours_are_started_so():
    """Whoever names the interpreter starts it, and forgets `-P` one day."""
    folder = Path(pipeline.__file__).parent
    users = [path.name for path in sorted(folder.rglob("*.py")) if "sys.executable" in path.read_text(encoding="utf-8")]
    assert users == ["another_python.py"]
