"""A plug-in is found by its entry points: its verbs, engines and products, what is broken, and what is not there."""

import sys
from pathlib import Path

import pytest
from places import TINY

from pipeline.app.build import build
from pipeline.app.verbs.terminal import Verbs
from pipeline.errors import UsageError

ENTRIES = """[plenoptic_pipeline.verbs]
greet = stranger_of_ours:verbs
broken = nowhere_to_be_found:verbs

[plenoptic_pipeline.engines]
toy = stranger_of_ours:engine_of
dask = stranger_of_ours:engine_of

[plenoptic_pipeline.products]
sizes = stranger_of_ours:plan_sizes
"""
CODE = """
from dataclasses import dataclass
from pathlib import Path

import typer

verbs = typer.Typer()

@verbs.command("greet")
def greet(name: str) -> None:
    '''Greet somebody.'''
    print("hello,", name)

def engine_of(where, timeout_s):
    raise LookupError(where, timeout_s)

@dataclass(frozen=True, slots=True, kw_only=True)
class Size:
    width_px: int

def plan_sizes(draft):
    for entry in draft.dataset.cameras:
        task = draft.add(f"size/{entry.name}", Size(width_px=entry.asked.sensor.width_px))
        draft.files[f"cameras/{entry.name}/size.txt"] = (task, "size.txt")

def size(params: Size, inputs, out: Path) -> None:
    (out / "size.txt").write_text(f"{params.width_px} px wide")
"""


@pytest.fixture
def stranger(tmp_path, monkeypatch):
    """A package with two verbs, one of which cannot be loaded, an engine and a product."""
    place = tmp_path / "site/stranger-1.dist-info"
    place.mkdir(parents=True)
    (place / "METADATA").write_text("Metadata-Version: 2.1\nName: stranger\nVersion: 1\n")
    (place / "entry_points.txt").write_text(ENTRIES)
    (tmp_path / "site/stranger_of_ours.py").write_text(CODE)
    monkeypatch.syspath_prepend(tmp_path / "site")
    yield
    sys.modules.pop("stranger_of_ours", None)


def test_verbs_of_another_package_are_listed_and_run_and_a_broken_one_says_so(stranger, run, monkeypatch):
    monkeypatch.setenv("COLUMNS", "200")
    code, output, _ = run("--help")
    assert code == 0 and "Greet somebody." in output
    assert run("greet", "you") == (0, "hello, you\n", "")
    code, output, log = run("broken", "--all", "of", "it")
    assert (code, output) == (2, "")
    assert 'the verb "broken" of the package stranger cannot be loaded: ModuleNotFoundError' in log


def test_an_engine_is_asked_for_by_its_name_and_one_that_is_not_there_is_named(stranger, run):
    with pytest.raises(LookupError, match=r"'here', 2\.0"):
        build(TINY, engine="toy:here", timeout_s=2.0)
    with pytest.raises(UsageError, match=r'no plug-in that is installed has the engine "ray"\n.*toy'):
        build(TINY, engine="ray:auto")
    with pytest.raises(UsageError, match='packages plenoptic-pipeline and stranger each have the engine "dask"'):
        build(TINY, engine="dask:here")


def test_a_product_of_another_package_is_made_and_delivered(stranger, tmp_path):
    result = build(TINY, tmp_path / "out", jobs=1, targets=["cameras/Rig.Camera/size.txt"])
    assert (result.executed, result.failed) == (1, 0)
    assert (tmp_path / "out/cameras/Rig.Camera/size.txt").read_text() == "32 px wide"


def test_a_misspelt_verb_of_a_plug_in_is_guessed(stranger, run):
    assert "Did you mean 'greet'" in run("gret", "you")[2]


@pytest.mark.parametrize("verb", Verbs.plug_ins)
def test_without_its_plug_in_a_verb_says_so(verb, run, monkeypatch):
    monkeypatch.setattr("pipeline.entry_points._offered", lambda group, path: {})
    assert run("--help")[0] == 0
    code, output, log = run(verb, "anything", "--json")
    assert (code, output) == (2, "")
    assert log.startswith(f'error: no plug-in that is installed has the verb "{verb}"\n    hint: ')


def test_without_the_plug_in_that_rates_poses_the_best_are_refused_before_any_is_looked_for(run, monkeypatch):
    monkeypatch.setattr("pipeline.entry_points._offered", lambda group, path: {})
    parts = ("--rig", "rigs/conventional_100mm.usda", "--target", "targets/charuco_8x5.usda")
    code, output, log = run("new", "dataset", "d.usda", *parts, "--best", "2")
    assert (code, output) == (2, "") and not Path("d.usda").exists()
    assert log.startswith('error: no plug-in that is installed has the pose "best"\n    hint: ')
