"""Stages that crash USD itself: they end in a problem with a place, and the process that reads them goes on."""

import subprocess
import sys
import time
import zipfile
from pathlib import Path

import pytest

from pipeline.app import sandbox
from pipeline.app.build import project
from pipeline.app.sandbox import problems_of_untrusted
from pipeline.confine.process import Bounds, Guards
from pipeline.errors import UsageError
from pipeline.scene.load import load, open_dataset
from pipeline.scene.trust import trial
from pipeline.scene.usd.usda_lines import MOST_NESTED

CRASHING = Path(__file__).parents[1] / "data/crash.usdc"
"""A layer of 1,002 bytes with three others than it had: what USD makes of it ends the process."""
TINY = CRASHING.parent / "tiny_conventional/dataset.usda"
HEAD = '#usda 1.0\n(\n    metersPerUnit = 0.001\n    upAxis = "Y"\n)\n'
NESTED = {
    "prims": ('def "A"\n{\n', "", "}\n"),
    "variants": ('def "A"\n{\nvariantSet "v" = {\n"a" {\n', "", "}\n}\n}\n"),
    "dictionaries": ('def "A" (\ncustomData = {\n' + "dictionary a = {\n", "", "}\n"),
    "arrays": ("def 'A' { double[] a = " + "[", "", "]"),
    "tuples": ("def 'A' { double3 a = " + "(", "", ")"),
    "numbers": ("def 'A' { double3[] a = [1, " + "(", "1", ")"),
}


def nested(kind, count):
    """A text with so many brackets in each other."""
    opening, middle, closing = NESTED[kind]
    first, last = opening.rsplit("\n", 2)[0] if kind == "dictionaries" else "", opening
    if kind in ("dictionaries", "arrays", "tuples", "numbers"):
        cut = -1 if kind != "dictionaries" else -len("dictionary a = {\n")
        first, last = opening[:cut], opening[cut:]
    end = "]" if kind == "numbers" else ""
    return HEAD + first + last * count + middle + closing * count + end


@pytest.mark.parametrize("kind", NESTED)
def test_brackets_nested_too_deep_are_refused_at_their_line(kind, tmp_path):
    """100,000 prims in each other were SIGSEGV, and tuples took minutes."""
    (tmp_path / "s.usda").write_text(nested(kind, 100_000))
    (problem,) = load(tmp_path / "s.usda").problems
    assert problem.code == "too-deep"
    text = (tmp_path / "s.usda").read_text().split("\n")
    before = "\n".join(text[: problem.line - 1])
    assert before.count("{") - 1 <= MOST_NESTED


def test_the_line_is_that_of_the_first_bracket_too_many(tmp_path):
    (tmp_path / "s.usda").write_text(nested("prims", 300))
    (problem,) = load(tmp_path / "s.usda").problems
    assert problem.line == len(HEAD.splitlines()) + 2 * (MOST_NESTED + 1)


def test_as_many_brackets_as_are_allowed_are_read_and_written(tmp_path):
    (tmp_path / "s.usda").write_text(nested("prims", MOST_NESTED))
    loaded = load(tmp_path / "s.usda")
    assert loaded.errors == []
    assert loaded.flattened.count('def "A"') == MOST_NESTED


def test_brackets_in_strings_comments_and_paths_do_not_count(tmp_path):
    many = "{([" * 1000
    text = f'# {many}\n/* {many} */\ndef "A" (\n    doc = """{many}"""\n    displayName = "{many}"\n)\n{{\n}}\n'
    (tmp_path / "s.usda").write_text(HEAD + text)
    assert load(tmp_path / "s.usda").errors == []


def test_a_member_of_a_package_is_looked_at_too(tmp_path):
    with zipfile.ZipFile(tmp_path / "p.usdz", "w") as archive:
        archive.writestr("in.usda", nested("prims", 100_000))
    (problem,) = load(tmp_path / "p.usdz").problems
    assert (problem.code, problem.line) == ("too-deep", 1)
    assert "in.usda" in problem.message


def test_unclosed_marks_do_not_take_the_square_of_their_number(tmp_path):
    """Each of them once looked for its end through all of the rest, half a minute for these."""
    for mark in ("/*", "<"):
        (tmp_path / "s.usda").write_text(HEAD + mark * 150_000)
        start = time.process_time()
        assert load(tmp_path / "s.usda").errors
        assert time.process_time() - start < 5


def test_a_binary_layer_that_crashes_usd_ends_in_a_problem(tmp_path):
    (tmp_path / "s.usda").write_text(HEAD + 'def "A" (\n    references = @./crash.usdc@\n)\n{\n}\n')
    (tmp_path / "crash.usdc").write_bytes(CRASHING.read_bytes())

    (problem,) = load(tmp_path / "s.usda").problems

    assert (problem.code, problem.line) == ("unreadable", 1)
    assert problem.file == str(tmp_path / "crash.usdc")
    assert "it crashed" in problem.message


def test_the_crash_is_one():
    """Without the process that may crash: the layer takes the reader with it."""
    code = "import sys; from pipeline.scene.load import load; from pipeline.confine.process import Guards; "
    code += "load(sys.argv[1], guards=Guards(landlock=1))"
    done = subprocess.run([sys.executable, "-c", code, str(CRASHING)], capture_output=True, check=False)
    assert done.returncode < 0


def test_an_untrusted_stage_that_crashes_usd_has_a_place_too(monkeypatch):
    rows, guards = problems_of_untrusted(CRASHING, ())
    assert [(row["code"], row["line"]) for row in rows] == [("unreadable", 1)]
    assert rows[0]["file"].endswith("crash.usdc")
    assert guards.seccomp == (sys.platform == "linux")
    with pytest.raises(UsageError, match=r"crash\.usdc:1: error: .*crashed"):
        project(CRASHING, untrusted=True)


def test_a_binary_layer_without_fault_is_read(tmp_path):
    from pxr import Sdf

    Sdf.Layer.FindOrOpen(str(TINY)).Export(str(tmp_path / "dataset.usdc"))
    (tmp_path / "pipeline.toml").touch()
    loaded = load(tmp_path / "dataset.usdc", [TINY.parents[3]])
    assert [one.code for one in loaded.errors] != ["unreadable"]


def test_a_binary_layer_that_takes_too_long_is_refused(tmp_path, monkeypatch):
    monkeypatch.setattr(trial, "BOUNDS", Bounds(wall_s=0.05))
    (problem,) = load(CRASHING).problems
    assert "longer than 0.05 s" in problem.message


def test_packages_of_untrusted_stages_need_landlock(tmp_path):
    """USD opens them by name, and only Landlock keeps a name from leading elsewhere in between."""
    with zipfile.ZipFile(tmp_path / "p.usdz", "w") as archive:
        archive.writestr("in.usda", HEAD)
    assert [one.code for one in load(tmp_path / "p.usdz", guards=Guards()).problems] == ["package"]


@pytest.fixture(scope="module")
def told():
    """What the confined process says of the tiny dataset."""
    return sandbox._ask(TINY, (), check=False)[0]


def test_what_a_kernel_lacks_is_a_warning_and_the_stage_is_read(told, monkeypatch):
    warnings = []
    monkeypatch.setattr(sandbox, "ask", lambda *_: (told, Guards(seccomp=True)))
    assert project(TINY, untrusted=True, warn=warnings.append).graph
    assert "no Landlock, seccomp" in warnings[0]


@pytest.mark.parametrize(
    "nonsense", [{}, [], {"project": {}}, {"project": {"tasks": [[1]]}}, {"error": "a\x1b[31m\x07"}, {"project": None}]
)
def test_a_process_that_was_taken_over_cannot_do_more_than_answer(nonsense, monkeypatch):
    """Nonsense is one error, and escape sequences stay visible."""
    monkeypatch.setattr(sandbox, "ask", lambda *_: (nonsense, Guards()))
    with pytest.raises(UsageError) as caught:
        project(TINY, untrusted=True)
    assert str(caught.value).replace("\n", "").isprintable()


def test_a_process_that_was_taken_over_does_not_choose_where_files_go(told, tmp_path, monkeypatch):
    forged = {"project": {**told["project"], "out": "/elsewhere", "stage_id": "/another"}}
    monkeypatch.setattr(sandbox, "ask", lambda *_: (forged, Guards()))
    found = project(TINY, tmp_path / "out", untrusted=True)
    assert (found.out, found.stage_id) == (tmp_path / "out", str(TINY.resolve()))

    forged["project"]["files"] = {**told["project"]["files"], "../outside": {"base64": ""}}
    with pytest.raises(UsageError, match="outside of the output folder"):
        project(TINY, untrusted=True)


def test_open_dataset_raises_the_problem_too(tmp_path):
    (tmp_path / "s.usda").write_text(nested("prims", 100_000))
    with pytest.raises(UsageError, match="too-deep"):
        open_dataset(tmp_path / "s.usda")
