"""Claim: `verify` trusts nothing in the folder that it judges, and finds what is not true in every column."""

import json
import os
import random
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from faults.doctored import ENTRIES, LIES, MANIFESTS, ODDITIES, STAGES, signed
from shorter import few
from stage_text import without_method

import pipeline
from pipeline.app.verifying.readable import unreadable
from pipeline.app.verifying.verify import verify
from pipeline.engine.output.foreign import ForeignFolder, Unfit
from pipeline.errors import UsageError

DATA = Path(__file__).parents[1] / "data"
TABLE = "frames/0001/Rig.Camera/correspondences.csv"


def _built(factory, store, name):
    folder = factory.mktemp("hostile")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("PIPELINE_CACHE", str(store))
        assert pipeline.build(DATA / name / "dataset.usda", folder / "out", jobs=1).exit_code == 0
    return folder / "out"


@pytest.fixture(scope="module")
def conventional_folder(tmp_path_factory, common_store):
    return _built(tmp_path_factory, common_store, "tiny_conventional")


@pytest.fixture(scope="module")
def plenoptic_folder(tmp_path_factory, common_store):
    return _built(tmp_path_factory, common_store, "tiny_plenoptic")


@pytest.fixture
def out(conventional_folder, tmp_path):
    """A copy to doctor."""
    shutil.copytree(conventional_folder, tmp_path / "out")
    return tmp_path / "out"


SHORT = ("sigma_y_px", "blur and rho", "rows dropped")
WITHOUT_LENSES = [what for what in LIES if not what.startswith("microlens") and what not in SHORT]


@pytest.mark.parametrize("what", [*SHORT, *(pytest.param(what, marks=pytest.mark.heavy) for what in WITHOUT_LENSES)])
def test_what_is_not_true_is_found_though_every_digest_fits(what, out):
    """Column by column: the manifest was doctored, too."""
    LIES[what](out, random.Random(3))
    verdict = verify(out)
    assert not verdict.agrees
    assert not any("not as it was built" in problem for problem in verdict.problems)
    if what in ("sigma_y_px", "hit_fraction", "method"):
        assert any(f"state another {what}" in problem for problem in verdict.problems)


@pytest.mark.heavy
@pytest.mark.parametrize("what", LIES)
def test_the_same_behind_microlenses(what, plenoptic_folder, tmp_path):
    shutil.copytree(plenoptic_folder, tmp_path / "out")
    LIES[what](tmp_path / "out", random.Random(3))
    verdict = verify(tmp_path / "out")
    assert not verdict.agrees
    if what.startswith("microlens"):
        assert any("microlens_type" in problem for problem in verdict.problems)


@pytest.mark.heavy
def test_a_build_behind_microlenses_agrees_in_all_columns_whatever_is_drawn(plenoptic_folder):
    """Rows, derived again one by one, differ by nothing that a column may not."""
    for seed in (1, 2, 3):
        verdict = verify(plenoptic_folder, seed)
        assert verdict.agrees, verdict.problems
        assert verdict.looks["Rig.Camera"]["rows"] > 50


METHODS = {
    "moments": 'uniform token plen:truth:method = "moments"',
    "image": 'uniform token plen:truth:method = "image"',
    "two-plane": 'uniform token plen:truth:method = "two-plane"',
    "nearest": 'uniform token plen:truth:method = "two-plane"\nuniform token plen:truth:search = "nearest"\n'
    "uniform double plen:truth:nearestThreshold = 2",
    "direct with other positions": 'uniform token plen:truth:method = "direct"\n'
    'uniform token[] plen:truth:columns = ["chief", "saddle"]',
}


@pytest.mark.heavy
@pytest.mark.parametrize("name", ["tiny_conventional", "tiny_plenoptic"])
@pytest.mark.parametrize("method", METHODS)
def test_builds_by_every_method_agree_in_all_columns(method, name, tmp_path, monkeypatch, common_store):
    """Windows around single rows hold the random numbers of the whole position image."""
    monkeypatch.setenv("PIPELINE_CACHE", str(common_store))
    text = (DATA / name / "dataset.usda").read_text(encoding="utf-8").replace("../../../stages/", "")
    head = '        over "Camera"\n        {\n'
    text = without_method(text).replace(head, f"{head}{METHODS[method]}\n")
    (tmp_path / "dataset.usda").write_text(text, encoding="utf-8")
    assert pipeline.build(tmp_path / "dataset.usda", tmp_path / "out", jobs=1).exit_code == 0
    verdict = verify(tmp_path / "out")
    assert verdict.agrees, verdict.problems


@pytest.mark.parametrize("what", ODDITIES)
def test_whatever_lies_in_the_place_of_a_file_is_no_whole_file_and_keeps_nobody_waiting(what, tmp_path):
    (tmp_path / "a").mkdir()
    (tmp_path / "a/f.csv").write_bytes(b"right\n" * 100)
    folder = ForeignFolder(tmp_path)
    digest = "e8d6a8d8e5f4bd4bb6cf6ca71f40a1e4a4bd7b5d1a1b8e9f5a1c8a2b3d4e5f60"
    ODDITIES[what](tmp_path / "a/f.csv")
    with pytest.raises(Unfit):
        folder.require_whole("a/f.csv", 600, digest)


def test_no_link_is_followed_on_the_way_to_a_file(tmp_path):
    (tmp_path / "inside").mkdir()
    (tmp_path / "outside").mkdir()
    (tmp_path / "outside/f").write_text("secret")
    (tmp_path / "inside/a").symlink_to("../outside")
    with pytest.raises(Unfit, match="below a link"):
        ForeignFolder(tmp_path / "inside").read("a/f", 100)
    assert ForeignFolder(tmp_path / "outside").read("f", 100) == b"secret"
    with pytest.raises(Unfit, match="more than the 5"):
        ForeignFolder(tmp_path / "outside").read("f", 5)


def test_a_lost_table_and_a_fifo_in_its_place_are_findings(out):
    """Once a traceback, and a wait for ever."""
    (out / TABLE).unlink()
    assert f"{TABLE} is lost" in verify(out).problems
    os.mkfifo(out / TABLE)
    assert f"{TABLE} is a FIFO instead of a file" in verify(out).problems


@pytest.mark.parametrize("what", MANIFESTS)
def test_a_manifest_that_is_none_is_refused(what, tmp_path):
    (tmp_path / "manifest.json").write_bytes(MANIFESTS[what])
    with pytest.raises(UsageError, match="no finished build"):
        verify(tmp_path)


REFUSED = [
    what for what in ENTRIES if what.startswith(("size", "digest")) or "that leaves" in what or "absolute" in what
]


@pytest.mark.parametrize("what", REFUSED)
def test_a_manifest_with_an_entry_that_no_build_writes_is_refused(what, out):
    _change(out, ENTRIES[what])
    with pytest.raises(UsageError):
        verify(out)


@pytest.mark.parametrize("what", few(["escapes"], "half a character", "points of another type"))
def test_odd_entries_are_findings_that_can_be_printed(what, out):
    _change(out, ENTRIES[what])
    verdict = verify(out)
    assert not verdict.agrees
    assert all(line.isprintable() for problem in verdict.problems for line in problem.split("\n"))


@pytest.mark.parametrize("what", ["nothing", "a file outside"])
def test_a_stage_that_no_build_made_is_a_finding(what, out):
    signed("dataset.usda", lambda data: STAGES[what])(out, random.Random(3))
    verdict = verify(out)
    assert any(
        problem.startswith("dataset.usda is no stage that could have been built") for problem in verdict.problems
    )


@pytest.mark.heavy
def test_a_stage_of_100000_nested_prims_is_a_finding(out):
    """Once a SIGSEGV: it is read in a process of its own."""
    signed("dataset.usda", lambda data: STAGES["100,000 nested prims"])(out, random.Random(3))
    assert not verify(out).agrees


def test_damaged_images_are_found_by_a_process_with_limits(conventional_folder, tmp_path):
    """Cut, flipped, of another kind; whole files beside them are not named."""
    frame = conventional_folder / "frames/0001/Rig.Camera"
    exr, png = (frame / "image.exr").read_bytes(), (frame / "image.png").read_bytes()
    files = {
        "a.exr": exr[:-200],
        "b.exr": exr,
        "c.png": png[:-200],
        "d.png": png,
        "e.json": b"[" * 100_000,
        "f.json": b"{}",
    }
    for name, data in files.items():
        (tmp_path / name).write_bytes(data)
    damaged, unknown = unreadable(tmp_path, files)
    assert set(damaged) == {"a.exr", "c.png", "e.json"} and unknown == {}


def test_a_reader_that_crashes_is_blamed_on_its_file_alone(tmp_path, monkeypatch):
    for name in ("a.json", "b.json", "c.json"):
        (tmp_path / name).write_text("{}")
    boot = (
        "import json, os, sys; sys.path[:] = json.loads(sys.argv.pop(1)); from pipeline.app.verifying import readable;"
        " real = readable._reason;"
        " readable._reason = lambda root, name: os.abort() if name == 'b.json' else real(root, name);"
        " readable.main()"
    )
    monkeypatch.setattr("pipeline.machine.another_python._BOOT", boot)
    damaged, _ = unreadable(tmp_path, ["a.json", "b.json", "c.json"])
    assert damaged == {"b.json": "its reader ended with code -6"}


def test_the_judge_loads_no_usd():
    """Whatever a stage does to USD, it does in the sandbox."""
    code = "import sys, pipeline.app.verifying.verify; print('pxr' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout == "False\n"


def test_more_bytes_than_the_limit_are_refused_with_what_raises_it(out, monkeypatch):
    for limit in ("folder_bytes", "table_bytes"):
        monkeypatch.setenv("PIPELINE_LIMITS", f"{limit}=1000")
        with pytest.raises(UsageError, match="more than the limit of 1,000") as refused:
            verify(out)
        assert f'PIPELINE_LIMITS="{limit}=' in refused.value.hint


def _change(out, change):
    path = out / "manifest.json"
    manifest = json.loads(path.read_text(encoding="utf-8"))
    change(manifest)
    path.write_text(json.dumps(manifest), encoding="utf-8")
