"""Who may import whom, and what a process that only needs little does not load."""

import dataclasses
import importlib
import subprocess
import sys
import typing
from pathlib import Path

import pytest
from importlinter.cli import lint_imports

from pipeline.app.build import build
from pipeline.graph.adding import KINDS

ROOT = Path(__file__).parents[2]


def test_rooms_import_only_downwards_and_libraries_enter_by_one_door(monkeypatch):
    monkeypatch.chdir(ROOT)
    assert lint_imports(cache_dir=None) == 0


@pytest.mark.parametrize(
    ("module", "absent"),
    [
        ("pipeline", ("numpy", "pxr", "numba", "typer", "rich", "colour", "networkx")),
        ("pipeline.cli", ("numpy", "pxr", "numba", "colour", "networkx")),
        ("pipeline.tasks.rays", ("pxr", "typer", "rich", "colour", "networkx")),
        ("pipeline.tasks.truth", ("pxr", "typer", "rich", "colour", "networkx")),
        ("pipeline.tasks.images", ("pxr", "typer", "rich", "colour", "networkx")),
        ("pipeline.tasks.raw_images", ("pxr", "typer", "rich", "colour", "networkx")),
        ("pipeline.tasks.colour_image", ("pxr", "typer", "rich", "colour", "networkx")),
        ("pipeline.files.lenses.read", ("pxr", "numba", "typer", "rich")),
        ("pipeline.camera.parts.camera", ("pxr", "numba", "networkx", "OpenEXR")),
    ],
)
def test_importing_a_module_does_not_load(module, absent):
    code = f"import sys, {module}; print([name for name in {absent!r} if name in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=ROOT)
    assert done.stdout.strip() == "[]"


def test_importing_the_package_changes_nothing_in_the_process():
    """A notebook's NumPy keeps its threads."""
    code = "import os, signal; before = dict(os.environ), signal.getsignal(signal.SIGINT); import pipeline;"
    code += "pipeline.Camera, pipeline.open_dataset, pipeline.bundle;"
    code += "print(before == (dict(os.environ), signal.getsignal(signal.SIGINT)))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=ROOT)
    assert done.stdout.strip() == "True"


def test_every_kind_of_task_has_a_record_of_its_params():
    """Frozen, and what its function takes: nobody reads params by strings. Every module of tasks holds some kind."""
    modules = set()
    for kind in KINDS.values():
        name, _, function = kind.partition(":")
        module = importlib.import_module(name)
        record = typing.get_type_hints(getattr(module, function or "run"))["params"]
        assert dataclasses.is_dataclass(record) and record.__dataclass_params__.frozen, kind
        modules.add(Path(module.__file__))
    assert modules | {ROOT / "pipeline/tasks/__init__.py"} == set((ROOT / "pipeline/tasks").glob("*.py"))
    assert not [path for path in modules if 'params["' in path.read_text(encoding="utf-8")]


def test_a_plan_loads_no_compiler_and_no_library_of_the_tasks(tmp_path, monkeypatch):
    """Neither for finished tasks nor for those that would run. (Tags alone need OpenCV: their dictionaries.)"""
    stage, heavy = (
        ROOT / "tests/data/tiny_plenoptic/dataset.usda",
        ("numba", "scipy", "embreex", "OpenEXR", "PIL", "cv2"),
    )
    monkeypatch.setenv("PIPELINE_CACHE", str(tmp_path / "store"))
    monkeypatch.chdir(tmp_path)
    assert build(stage, jobs=1, until=("focus",)).executed == 1
    code = (
        "import sys; from pipeline.cli import app;"
        f"app(sys.argv[1:], standalone_mode=False); print([name for name in {heavy!r} if name in sys.modules])"
    )
    command = [sys.executable, "-c", code, "plan", str(stage)]
    planned = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    assert "1 cached" in planned
    assert planned.endswith("[]\n")
