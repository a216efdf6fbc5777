"""Keys: equal for equal work, different for everything else; and the hint for a name that no task and no file has."""

import json
import math
import subprocess
import sys
import types
from collections import defaultdict
from importlib.metadata import packages_distributions, version
from pathlib import Path

import numpy as np
import pytest
from engine import toy

import pipeline
from pipeline.engine.digest import canonical, key_of
from pipeline.engine.planning.graph import TaskGraph, names_like
from pipeline.engine.planning.plan import Specs
from pipeline.engine.planning.task_code import code_of, is_foreign, versions_of
from pipeline.engine.store.store import Store
from pipeline.records.plain import Shared, to_plain

PRODUCTS = Path(pipeline.__file__).parent / "products"


@pytest.mark.parametrize(
    ("one", "other"),
    [
        (1, 1.0),
        (1, True),
        (0, None),
        ("1", 1),
        (0.0, -0.0),
        (0.1 + 0.2, 0.3),
        ([1, [2]], [[1], 2]),
        (["ab", "c"], ["a", "bc"]),
        ({"a": {"b": 1}}, {"a": 1, "b": 1}),
        ([], {}),
        ("", None),
        (math.inf, -math.inf),
    ],
)
def test_different_values_have_different_keys(one, other):
    assert key_of("test", one) != key_of("test", other)


def test_the_order_of_names_does_not_count():
    assert key_of("test", {"a": 1, "b": 2}) == key_of("test", {"b": 2, "a": 1})


def test_a_shared_part_counts_like_any_other():
    part = {"a": [1.5, {"b": None}], "c": "d"}
    assert canonical([{"x": Shared(part)}, 1]) == canonical([{"x": part}, 1])
    assert json.dumps(Shared(part)) == json.dumps(part)


def test_rows_of_numbers_have_the_bytes_of_their_numbers():
    """Rows have a fast way, and a NaN must not slip through it; an infinite number beside another is no NaN."""
    numbers = [1.5, -0.0, math.inf, -math.inf]
    assert canonical(numbers) == b"l%d:" % (11 * 4) + b"".join(map(canonical, numbers))
    assert canonical([1.0, 2]) != canonical([1.0, 2.0])
    assert str(to_plain((*numbers, 1))) == "[1.5, 0.0, inf, -inf, 1]"
    for make in (canonical, to_plain):
        with pytest.raises(ValueError, match="NaN"):
            make([1.0, math.nan])


@pytest.mark.parametrize("value", [(1, 2), np.float64(1)])
def test_what_would_come_back_as_another_type_is_refused(value):
    """A tuple is a list behind a process border; numbers of NumPy are floats."""
    with pytest.raises(TypeError, match=type(value).__name__):
        canonical({"a": [value]})


def test_purposes_have_separate_keys():
    assert key_of("task/v1", 1) != key_of("out/v1", 1)


def test_comments_layout_and_docstrings_do_not_count(kit):
    before = code_of("toykit.tasks.lens").code
    lens = kit / "tasks" / "lens.py"
    lens.write_text(
        "# A comment.\n" + lens.read_text().replace("Write the power.", "Other words.").replace("(out /", "( out /")
    )
    assert code_of("toykit.tasks.lens").code == before


def test_code_counts_that_is_reached_by_calls_and_by_imports_inside_functions(kit):
    (kit / "tasks" / "inside.py").write_text("def run(params, inputs, out):\n    from ..physics import doubled\n")
    names = ("lens", "inside", "rays")
    before = [code_of(f"toykit.tasks.{name}").code for name in names]
    (kit / "physics.py").write_text("def doubled(x):\n    return x + x\n")
    after = [code_of(f"toykit.tasks.{name}").code for name in names]
    assert [one != other for one, other in zip(before, after, strict=True)] == [True, True, False]


def test_libraries_are_read_without_importing(kit):
    text = 'from toykit import physics\nraise RuntimeError("imported")\n'
    (kit / "tasks" / "lens.py").write_text(text)
    (kit / "physics.py").write_text("def f():\n    import PIL.Image, json\n    from networkx.utils import misc\n")
    code = code_of("toykit.tasks.lens")
    assert code.libraries == {
        "python": f"{sys.version_info.major}.{sys.version_info.minor}",
        "networkx": version("networkx"),
        "pillow": version("pillow"),
    }


def test_libraries_that_a_library_requires_count(kit):
    (kit / "tasks" / "lens.py").write_text("import numba\n")
    assert {"numba", "llvmlite", "numpy"} <= set(code_of("toykit.tasks.lens").libraries)


def test_another_python_library_or_machine_is_another_key(kit, monkeypatch, tmp_path):
    graph = toy.graph_of(("lens", "lens", {"power": 1.0}))
    (kit / "tasks" / "lens.py").write_text("import networkx\n")
    keys = {Specs(Store(tmp_path / "store")).of(graph["lens"], {}).key}
    with monkeypatch.context() as patch:
        patch.setattr("sys.version_info", types.SimpleNamespace(major=3, minor=99))
        keys.add(Specs(Store(tmp_path / "store")).of(graph["lens"], {}).key)
    with monkeypatch.context() as patch:
        patch.setattr("pipeline.engine.planning.task_code.installed_version", lambda name: "0.0.1")
        keys.add(Specs(Store(tmp_path / "store")).of(graph["lens"], {}).key)
    with monkeypatch.context() as patch:
        patch.setattr("pipeline.machine.facts.level", lambda: "z80")
        keys.add(Specs(Store(tmp_path / "store")).of(graph["lens"], {}).key)
    assert len(keys) == 4


FORKING = """
import json, os, sys
def visit(modules, below):
    for name in modules:
        __import__(name)
    print(json.dumps([modules, sorted({name.split(".")[0] for name in sys.modules})]), flush=True)
    for one in below:
        if os.fork() == 0:
            visit(*one)
            os._exit(0)
        assert os.wait()[1] == 0
visit(*json.loads(sys.argv[1]))
"""
"""A program that imports the modules of a tree, [modules, [branches below]]: each branch in a fork of the one above."""


def tree_of(alike):
    """Modules by their libraries as the tree of such a program: below each set are those that hold it and more."""
    root = [[], []]
    nodes = {frozenset(): root} | {libraries: [names, []] for libraries, names in alike.items()}
    for libraries in alike:
        smaller = [other for other in nodes if other < libraries]
        nodes[max(smaller, key=len)][1].append(nodes[libraries])
    return root


def loaded_by(alike):
    """Top names of all that is loaded after the modules that have the same libraries, by the first of them."""
    command = [sys.executable, "-c", FORKING, json.dumps(tree_of(alike))]
    lines = subprocess.run(command, capture_output=True, text=True, check=True).stdout.splitlines()
    return {modules[0]: loaded for modules, loaded in map(json.loads, lines) if modules}


def test_what_a_task_of_the_pipeline_loads_is_in_its_key():
    """Every distribution whose modules are loaded after a task's module was imported, by a process that starts bare.

    It is a fork of one that imported tasks with fewer libraries, all of which it names, too: what a task loads beyond
    its own is seen all the same.
    """
    kinds = [f"pipeline.products.{path.parent.name}.make" for path in sorted(PRODUCTS.glob("*/make.py"))]
    assert len(kinds) >= 8
    alike, modules, known = defaultdict(list), {}, packages_distributions()
    for kind in kinds:
        alike[frozenset(code_of(kind, modules).libraries)].append(kind)
    found = loaded_by(alike)
    assert len(found) == len(alike)
    for libraries, names in alike.items():
        loaded = {name for name in found[names[0]] if is_foreign(name) and not name.startswith("_")}
        # numba reads a .numba_config.yaml if PyYAML happens to be there: settings, no numbers.
        # colour loads SciPy, and pandas and Matplotlib with its Pillow if these happen to be there, for its spectra and
        # plots: no task asks for them.
        loaded -= {"PIL"} if "matplotlib" in loaded else set()
        loaded -= {"pipeline", "sitecustomize", "usercustomize", "yaml", "pandas", "dateutil", "pyarrow", "cloudpickle"}
        loaded -= {"matplotlib", "mpl_toolkits", "cycler", "fontTools", "pyparsing", "kiwisolver", "packaging"}
        loaded -= {"OpenImageIO", "charset_normalizer", "requests", "urllib3", "certifi", "idna"}
        loaded -= {"scipy"} if "colour-science" in libraries else set()
        loaded = {known[name][0].lower() for name in loaded if name in known and name not in ("pip", "setuptools")}
        assert loaded - libraries == set(), names


@pytest.mark.parametrize(
    "kind", ["toykit.tasks.lens", "os", "pipeline.cli", "pipeline.products../os", "pipeline.products"]
)
def test_only_tasks_of_the_pipeline_are_accepted_by_default(kind):
    with pytest.raises(ValueError, match="is not a module below"):
        TaskGraph().add("a", kind, {})


def test_a_task_can_only_read_tasks_that_exist():
    graph = toy.graph_of(("lens", "lens", {}))
    with pytest.raises(ValueError, match="does not exist"):
        graph.add("rays", "toykit.tasks.rays", {}, {"lens": "lenz"})
    with pytest.raises(ValueError, match="two tasks"):
        graph.add("lens", "toykit.tasks.lens", {})


def test_the_longest_path_goes_first(tmp_path):
    priorities = toy.project(tmp_path).graph.priorities()
    assert priorities["lens"] == 4 and priorities["report"] == 1


def test_a_library_that_is_not_installed_is_part_of_a_key_as_such():
    """Extras such as pandas and Matplotlib: code that mentions them runs without."""
    versions = versions_of(["numpy", "no_such_library"])
    assert versions["no_such_library"] == "not installed" and versions["numpy"] == version("numpy")


NAMES = ["focus/Cam", "image/Cam/0001", "image/Cam/0002", "frames/0001/Cam/image.png"]


@pytest.mark.parametrize(
    ("target", "hint"),
    [
        ("image/0009", "there are image/Cam/0001, image/Cam/0002"),
        ("imgae/2", 'did you mean "image"?'),
        ("other/2", "`pipeline graph` shows the tasks; their names begin with focus, frames, image"),
    ],
)
def test_a_hint_names_what_is_near_or_what_there_is(target, hint):
    assert names_like(target, NAMES) == hint


def test_a_hint_of_many_names_is_short():
    assert len(names_like("image", [f"image/Cam{number}" for number in range(1000)])) < 200
