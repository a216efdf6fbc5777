"""Who may import whom, and what a process that only needs little does not load."""

import dataclasses
import importlib
import inspect
import re
import subprocess
import sys
import typing

import pytest
from importlinter.cli import lint_imports
from places import ROOT

from pipeline.app.build import build


def test_rooms_import_only_downwards_and_libraries_enter_by_one_door(monkeypatch):
    monkeypatch.chdir(ROOT)
    assert lint_imports(cache_dir=None) == 0


def test_tests_lie_with_their_plug_in():
    """Without its folder, and that of its tests, all other tests run."""
    imports = re.compile(r"^ *(?:from|import) (?:pipeline\.)?plugins\.(\w+)", re.M)
    for path in (ROOT / "tests").rglob("*.py"):
        named = set(imports.findall(path.read_text(encoding="utf-8")))
        assert named <= {path.relative_to(ROOT / "tests").parts[1]} if named else True, path


def command(*words: str) -> str:
    return f"sys.argv = {['pipeline', *words]}; from pipeline import cli\ntry: cli.main()\nexcept SystemExit: pass"


TASKS = ", ".join(f"pipeline.products.{name}.make" for name in ("rays", "truth", "images", "raw", "colours"))


@pytest.mark.parametrize(
    ("code", "absent"),
    [
        ("import pipeline", "numpy pxr numba typer rich colour networkx"),
        ("import pipeline.cli", "numpy pxr numba colour networkx"),
        (f"import {TASKS}", "pxr typer rich colour networkx"),
        ("import pipeline.camera.parts.camera", "pxr numba networkx OpenEXR"),
        (command("-h"), "numpy pxr networkx numba"),
        (command("export", "--list"), "numba scipy cv2 pxr"),
    ],
)
def test_what_needs_little_does_not_load(code, absent):
    program = f"import sys\n{code}\nprint([name for name in {absent.split()} if name in sys.modules])"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True, cwd=ROOT)
    assert done.stdout.splitlines()[-1] == "[]"


def test_importing_the_package_changes_nothing_in_the_process():
    """A notebook's NumPy keeps its threads."""
    code = "import os, signal; before = dict(os.environ), signal.getsignal(signal.SIGINT); import pipeline;"
    code += "pipeline.Camera, pipeline.open_dataset, pipeline.bundle;"
    code += "print(before == (dict(os.environ), signal.getsignal(signal.SIGINT)))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=ROOT)
    assert done.stdout.strip() == "True"


def test_every_kind_of_task_has_a_record_of_its_params():
    """Frozen, and what its function takes: nobody reads params by strings."""
    products = ROOT / "pipeline/products"
    small = [path for path in products.glob("*.py") if "\ndef plan_" in path.read_text(encoding="utf-8")]
    for path in [*products.glob("*/make.py"), *small]:
        module = importlib.import_module(".".join(path.relative_to(ROOT).with_suffix("").parts))
        own = [each for _, each in inspect.getmembers(module, inspect.isfunction) if each.__module__ == module.__name__]
        records = [each.__annotations__["params"] for each in own if "params" in each.__annotations__]
        assert records, path
        for record in records:
            one = next(iter(typing.get_args(record)), record)  # of what one task takes, if several share work
            assert dataclasses.is_dataclass(one) and one.__dataclass_params__.frozen, (path, record)
        assert 'params["' not in path.read_text(encoding="utf-8")


def test_a_plan_loads_no_compiler_and_no_library_of_the_tasks(tmp_path, monkeypatch):
    """Neither for finished tasks nor for those that would run. (Tags alone need OpenCV: their dictionaries.)"""
    stage, heavy = (
        ROOT / "tests/data/tiny_plenoptic/dataset.usda",
        ("numba", "scipy", "embreex", "OpenEXR", "PIL", "cv2"),
    )
    monkeypatch.setenv("PIPELINE_CACHE", str(tmp_path / "store"))
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("pipeline.app.build.compile_once", lambda *_: None)  # kernels of all other tasks
    assert build(stage, jobs=1, until=("camera",)).executed == 2
    code = (
        "import sys; from pipeline.cli import app;"
        f"app(sys.argv[1:], standalone_mode=False); print([name for name in {heavy!r} if name in sys.modules])"
    )
    command = [sys.executable, "-c", code, "plan", str(stage)]
    planned = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    assert "2 cached" in planned
    assert planned.endswith("[]\n")
