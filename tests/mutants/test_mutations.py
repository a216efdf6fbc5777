"""Claim: the mutation run makes each mistake of its catalogue once, where one can be made and nowhere else, finds out
which tests notice it, and takes it back.
"""

import json
import os
import re
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from mutants.imports import Imports
from mutants.mutations import JITTED, mutants, parses
from mutants.run import draw, judged
from mutants.sandbox import ROOMS, ROOT, Sandbox

from pipeline.jit import decorators
from pipeline.jit.cache import used
from pipeline.optics.kernels import trace_rays
from pipeline.optics.prescription import Prescription
from pipeline.optics.table import towards_sensor

TOY = '''"""a + b in words"""
from pipeline.jit.decorators import kernel

LIMIT_MM = 2.0


@kernel
def middle(x_px: float, y_px: float) -> float:
    """x - y"""
    return (x_px - y_px) / 2


def near(points, turn, width=3):
    if width < 0:
        raise ValueError(f"{width - 1} is below 0")
    return turn @ points.T
'''


def changes(source: str) -> set[tuple[int, str]]:
    """Lines with a mistake, numbered."""
    return {(line, after) for line, _, after in (mutant.place for mutant in mutants(source) if parses(mutant))}


def test_every_mistake_of_the_catalogue_is_made_once() -> None:
    found = [mutant.place for mutant in mutants(TOY) if parses(mutant)]
    assert sorted((line, after) for line, _, after in found) == sorted(
        [
            (4, "LIMIT_MM = 2.1"),
            (10, "return ((x_px + y_px)) / 2"),
            (10, "return (x_px) / 2"),
            (10, "return ((x_px - y_px) * 2)"),
            (10, "return (x_px - y_px) / 3"),
            (10, "return (y_px - y_px) / 2"),
            (10, "return (x_px - x_px) / 2"),
            (13, "def near(points, turn, width=4):"),
            (14, "if (width <= 0):"),
            (14, "if (width > 0):"),
            (14, "if width < 1:"),
            (16, "return (points.T @ turn)"),
            (16, "return turn @ points"),
        ]
    )


@pytest.mark.parametrize(
    ("line", "mistakes"),
    [
        ("a = -b", {"a = b"}),
        ("a = not b", {"a = b"}),
        ("a = b and c", {"a = (b or c)"}),
        ("a = b == c", {"a = (b != c)"}),
        ("a = math.cos(b)", {"a = math.sin(b)"}),
        ("a += b", {"a -= b"}),
        ("a = b if c else d", {"a = (d if c else b)"}),
        ("a = True", {"a = False"}),
        ("a = b[1]", {"a = b[0]"}),
        ("a = near", set()),
        ("a = near_mm, far_mm", {"a = far_mm, far_mm", "a = near_mm, near_mm"}),
        ("a = tilt_x_deg + tilt_y_deg", {"a = (tilt_x_deg - tilt_y_deg)", "a = tilt_x_deg"}),
        ("raise ValueError(1)", set()),
        ("assert a < 1", set()),
        ('a = "x + 1"', set()),
    ],
)
def test_lines_have_the_mistakes_that_people_make(line: str, mistakes: set[str]) -> None:
    """Names are confused only with names that the module uses; messages and types are left alone."""
    assert mistakes <= {after for _, after in changes(line)}
    if not mistakes:
        assert not changes(line)


def test_what_numba_compiles_is_told_from_what_it_does_not() -> None:
    """Kernels and constants, which kernels may have compiled in."""
    lines = {mutant.place[0]: mutant.in_kernel for mutant in mutants(TOY)}
    assert lines == {4: True, 10: True, 13: False, 14: False, 16: False}


def test_the_seed_alone_decides_which_mistakes_are_drawn() -> None:
    one, same, other = (draw(["optics"], 20, seed) for seed in (3, 3, 4))
    assert one == same and one != other and len(one) == 20
    assert draw(["optics"], 10, 3) == one[:10]  # a longer run begins with a shorter one


def test_a_run_that_was_cut_off_is_taken_up_where_it_stopped() -> None:
    first, second, third = draw(["optics"], 3, 3)
    lines = [json.dumps([str(site.file), *site.mutant.place, "a test", 1.5]) for site in (first, third, second)]
    done = judged([first, second, third], "\n".join(lines)[:-9])
    assert [verdict.site for verdict in done] == [first, third] and done[0].noticed_by == "a test"


def test_all_tests_of_the_rooms_exist_and_reach_what_they_shall_judge() -> None:
    assert all((ROOT / "tests" / name).exists() for names in ROOMS.values() for name in names)
    away = Imports(ROOT).distances("pipeline.truth.grid.second_order")
    assert away["laws.test_second_order"] == 1 and away["pipeline.tasks.truth"] == 1
    assert "target.test_surfaces" not in away


def test_tests_that_name_the_function_come_first(toy: Sandbox, tmp_path: Path) -> None:
    """Before those that are nearer."""
    for name in ("aside", "named"):
        way = (
            "from pipeline.optics import toy\n"
            if name == "aside"
            else "from optics.test_aside import toy\n\ntoy.half\n"
        )
        (toy.tree / f"tests/optics/test_{name}.py").write_text(way)
    toy.imports = Imports(toy.tree)
    chosen = toy.chosen(draw(["optics"], 1, 1, tmp_path / "toy")[0])
    assert chosen == [f"tests/optics/test_{name}.py" for name in ("toy", "named", "aside")]


def test_a_module_that_no_test_of_its_room_reaches_is_judged_by_any_that_do(toy: Sandbox, tmp_path: Path) -> None:
    """Or by none: pytest without a file would run the tests of all rooms."""
    sites = draw(["optics"], 99, 1, tmp_path / "toy")
    site = next(site for site in sites if site.mutant.place[2] == "return (x * 2) if x < 9 else 0")
    (toy.tree / "tests/files").mkdir()
    (toy.tree / "tests/optics/test_toy.py").rename(toy.tree / "tests/files/test_toy.py")
    toy.imports = Imports(toy.tree)
    assert toy.chosen(site) == ["tests/files/test_toy.py"]
    assert toy.judge(site).noticed_by == "files/test_toy.py::test_it"
    (toy.tree / "tests/files/test_toy.py").write_text("def test_of_something_else():\n    assert False\n")
    toy.imports = Imports(toy.tree)
    assert toy.chosen(site) == [] and toy.judge(site).noticed_by == ""


@pytest.fixture
def toy(tmp_path: Path) -> Sandbox:
    """A program of one function with a test that calls it with one value."""
    root = tmp_path / "toy"
    files = {
        "pipeline/__init__.py": "",
        "pipeline/optics/__init__.py": "",
        "pipeline/jit/decorators.py": "import os\nfrom pathlib import Path\n",
        "pipeline/optics/toy.py": "def half(x):\n    return x / 2 if x < 9 else 0\n",
        "tests/optics/test_toy.py": "from pipeline.optics import toy\n\ndef test_it():\n    assert toy.half(4) == 2\n",
    }
    for name, text in files.items():
        (root / name).parent.mkdir(parents=True, exist_ok=True)
        (root / name).write_text(text)
    subprocess.run(["git", "init", "-q", str(root)], check=True)
    return Sandbox(tmp_path / "sandbox", 4, root)


def test_kernels_that_a_mistake_reaches_are_compiled_again_and_no_others(toy: Sandbox, tmp_path: Path) -> None:
    toy.kernels.mkdir()
    for name in ("pipeline.optics.toy.half-1f", "pipeline.optics.other.half-1f", "tests.optics.test_toy.f-1f"):
        (toy.kernels / name).touch()
    [site, *_] = draw(["optics"], 1, 1, tmp_path / "toy")
    left = {path.name for path in toy._kernels_without(site).iterdir()}
    assert left == {"pipeline.optics.other.half-1f", "tests.optics.test_toy.f-1f"}


def test_kernels_are_kept_under_the_names_of_their_modules(tronnier: Prescription) -> None:
    """By these names the copy of the tree knows which to compile again."""
    rays = np.zeros((1, 3)), np.array([[0.0, 0.0, 1.0]]), np.ones(1)
    trace_rays(towards_sensor(tronnier), *rays)
    assert any(name.startswith("pipeline.optics.kernels.trace_in_place-") for name in used)


def test_a_mistake_is_noticed_or_survives_and_is_taken_back(toy: Sandbox, tmp_path: Path) -> None:
    """Only the test of 4 / 2 exists: a wrong branch for large numbers survives."""
    sites = {site.mutant.place[2]: site for site in draw(["optics"], 99, 1, tmp_path / "toy")}
    fates = {
        "return (x * 2) if x < 9 else 0": "optics/test_toy.py::test_it",
        "return x / 2 if x < 9 else 1": "",
    }
    for after, noticed_by in fates.items():
        assert toy.judge(sites[after]).noticed_by == noticed_by
    assert (toy.tree / "pipeline/optics/toy.py").read_text() == (tmp_path / "toy/pipeline/optics/toy.py").read_text()


@pytest.mark.parametrize("fails_anyway", [False, True])
def test_a_verdict_of_plain_python_counts_if_the_test_passes_without_the_mistake(
    toy: Sandbox, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, fails_anyway: bool
) -> None:
    """The second look is at the tree without it; else no verdict of plain Python would ever count."""
    sites = draw(["optics"], 99, 1, tmp_path / "toy")
    site = next(site for site in sites if site.mutant.place[2] == "return (x * 2) if x < 9 else 0")
    site, test = replace(site, mutant=replace(site.mutant, in_kernel=True)), "optics/test_toy.py::test_it"
    path = toy.tree / "pipeline/optics/toy.py"

    def refuted_by(tests: list[str]) -> str:
        return test if fails_anyway or "x * 2" in path.read_text() else ""

    monkeypatch.setattr(toy, "refuted_by", refuted_by)
    assert toy.refuted_in_plain_python(site) == ("" if fails_anyway else f"{test}, in plain Python")
    glance = toy.glance(site)
    assert (glance and glance.noticed_by) == (None if fails_anyway else f"{test}, in plain Python")
    assert toy.judge(site).noticed_by == test
    assert "x * 2" not in path.read_text()


KERNELS = """import math

from pipeline.jit.decorators import fma, kernel

@kernel
def root(x, a):
    return math.sqrt(fma(x, x, a[0]))
"""
TESTS = """import numpy as np
import pytest
from pipeline.optics import toy

@pytest.fixture
def five():
    return toy.root(4.0, np.array([9.0]))

def test_what_it_needs(five):
    assert five

def test_it():
    assert toy.root(3.0, np.array([16.0])) == 5.0

def test_rounded_once():
    x = 0.7
    assert toy.root(x, np.array([-x * x])) == 1.4901161193847663e-09

def test_nan():
    assert np.isnan(toy.root(0.0, np.array([-1.0])))
"""


@pytest.mark.parametrize(
    ("mistake", "noticed_by"),
    [
        (("x, x", "x, -x"), "optics/test_toy.py::test_it"),
        pytest.param(("sqrt", "cbrt"), "optics/test_toy.py::test_it", marks=pytest.mark.heavy),
        (("fma(x, x, a[0])", "x * x + a[0]"), "optics/test_toy.py::test_rounded_once"),
        (("a[0]", "a[1]"), ""),  # an index beyond an array: Python raises, compiled code does not
        (("", ""), ""),
    ],
)
def test_in_plain_python_a_kernel_is_refuted_by_assertions_alone(tmp_path, mistake, noticed_by) -> None:
    assert toy_of_kernels(tmp_path, KERNELS.replace(*mistake)).refuted_by(["tests/optics/test_toy.py"]) == noticed_by


def test_in_plain_python_an_endless_kernel_ends_no_test_and_no_fixture_and_says_nothing(tmp_path) -> None:
    """What is left, a number below zero under the root, is refuted."""
    endless = KERNELS.replace("    return", "    while a[0] > 0.0:\n        x += 0.0\n    return 1.0 +")
    assert toy_of_kernels(tmp_path, endless).refuted_by(["tests/optics/test_toy.py"]) == (
        "optics/test_toy.py::test_rounded_once"
    )


def toy_of_kernels(folder: Path, kernels: str) -> Sandbox:
    """A tree with a room of one module, where a fixture or test has a fifth of a second."""
    tree = folder / "toy/tree"
    plain = (ROOT / "tests/mutants/plain.py").read_text()
    files = {
        "pipeline/__init__.py": "",
        "pipeline/optics/__init__.py": "",
        "pipeline/jit/decorators.py": "kernel = inline = fma = None\n",
        "pipeline/optics/toy.py": kernels,
        "tests/optics/test_toy.py": TESTS,
        "tests/mutants/plain.py": plain.replace("EACH_S = 40.0, 5.0", "EACH_S = 40.0, 0.2"),
        "tests/mutants/mutations.py": (ROOT / "tests/mutants/mutations.py").read_text(),
    }
    for name, text in files.items():
        (tree / name).parent.mkdir(parents=True, exist_ok=True)
        (tree / name).write_text(text)
    sandbox = object.__new__(Sandbox)
    sandbox.tree, sandbox.kernels = tree, folder / "kernels"
    return sandbox


def test_plain_python_knows_every_decorator_of_kernels() -> None:
    """One that it left out would be compiled, with a mistake of another function or without it."""
    marked = decorators._DECORATED.pattern.decode()
    assert set(re.findall(r"[a-z]+", marked)) == set(JITTED)
    assert all(decorators._DECORATED.match(f"@{name}".encode()) for name in JITTED)


@pytest.mark.heavy
def test_a_quadrature_in_plain_python_is_that_of_compiled_kernels(tmp_path) -> None:
    """Through drivers, units, buffers and the tally of rays; nothing is compiled on the way."""
    told = {name: subprocess.run([sys.executable, "-c", load + BUNDLE], **SILENTLY) for name, load in LOADS.items()}
    assert {name: done.returncode for name, done in told.items()} == dict.fromkeys(LOADS, 0), told
    plain, compiled = (np.array(json.loads(told[name].stdout)) for name in ("plain", "compiled"))
    assert np.isfinite(compiled).all() and np.allclose(plain, compiled, rtol=1e-12, atol=1e-12)


LOADS = {"plain": "import mutants.plain\n", "compiled": ""}
SILENTLY = {
    "capture_output": True,
    "text": True,
    "check": False,
    "env": {**os.environ, "PYTHONPATH": str(ROOT / "tests")},
}
BUNDLE = """
import json, numpy as np
from laws import rigs
from pipeline.camera.pupil import outlines as pupil
pupil.HEIGHTS, pupil._TRACED, pupil._BISECTIONS = 3, 48, 12  # Python takes a minute for all rays of the outlines
from pipeline.camera.integrating.quadrature import edges
from pipeline.camera.tracing.sampling_bounds import NO_MICROLENS
from pipeline.camera.tracer import Tracer, parallel_planes
found = edges(Tracer(rigs.conventional()).arrays, np.array([[1.0, 0.5]]), np.array([NO_MICROLENS]))
moments, status, rays = found.moments(parallel_planes(400.0, 800.0)[None], (2, 4))
print(json.dumps([*moments[0].tolist(), float(status[0]), float(rays)]))
"""
