"""The output folder: complete or without manifest, repaired without running, other people's files left alone."""

import dataclasses
import hashlib
import json
import os
import shutil
import socket
import threading
import time
from pathlib import Path

import pytest
from engine import toy

from pipeline.engine.options import ALONE, Caller
from pipeline.engine.output import our_files
from pipeline.engine.output.deliver import Folder
from pipeline.engine.running.session import build, status_of
from pipeline.engine.store.store import Store
from pipeline.errors import UsageError


@pytest.fixture
def out(tmp_path):
    build(toy.project(tmp_path / "out"), ALONE)
    return tmp_path / "out"


def test_the_manifest_lists_every_file_but_itself(out):
    manifest = json.loads((out / "manifest.json").read_text())
    assert set(manifest["files"]) == set(toy.contents(out)) - {"manifest.json"}
    assert set(manifest["tasks"]) == set(toy.project(out).graph)
    assert manifest["format"] == 1 and manifest["certificate"] is None


def test_files_are_copies_and_not_links(out):
    assert all(path.stat().st_nlink == 1 for path in out.rglob("*") if path.is_file())


@pytest.mark.parametrize("name", ["frames/0000/cam/image.txt", "dataset.usda", "manifest.json"])
def test_missing_files_come_back_and_altered_ones_are_kept_aside(out, name):
    right, said = toy.contents(out), []
    (out / name).unlink()
    assert build(toy.project(out), ALONE).executed == 0
    assert toy.contents(out) == right
    altered = bytearray(right[name])
    altered[0] ^= 1
    times = (out / name).stat()
    (out / name).write_bytes(altered)
    os.utime(out / name, ns=(times.st_atime_ns, times.st_mtime_ns))  # as if nothing had happened
    assert build(toy.project(out), ALONE, caller=Caller(on_event=said.append)).executed == 0
    assert toy.contents(out) == {**right, f"{name}.kept1": bytes(altered)}
    assert any(f"{name} is not as a build delivered it; it is now" in getattr(event, "text", "") for event in said)


def test_a_touched_file_with_the_same_bytes_stays(out):
    os.utime(out / "dataset.usda", ns=(1, 1))
    before = toy.snapshot(out)
    assert build(toy.project(out), ALONE).delivery.written == ()
    assert toy.snapshot(out) == before


def test_foreign_files_stay_with_a_warning(out):
    (out / "notes.txt").write_text("mine")
    (out / "frames" / "0001" / "mine.txt").write_text("mine")
    events = []
    build(toy.project(out, poses=toy.POSES[:1]), ALONE, caller=Caller(on_event=events.append))
    assert (out / "frames" / "0001" / "mine.txt").read_text() == (out / "notes.txt").read_text() == "mine"
    assert any("notes.txt" in getattr(event, "text", "") for event in events)
    assert "notes.txt" not in json.loads((out / "manifest.json").read_text())["files"]


def test_foreign_things_in_the_way_are_kept_under_another_name(tmp_path):
    out = tmp_path / "out"
    (out / "dataset.usda").mkdir(parents=True)
    (out / "dataset.usda" / "thesis.tex").write_text("years of work")
    (out / "report").write_text("mine")
    assert build(toy.project(out), ALONE).exit_code == 0
    assert (out / "dataset.usda").is_file()
    assert (out / "dataset.usda.kept1" / "thesis.tex").read_text() == "years of work"
    assert (out / "report.kept1").read_text() == "mine"


def test_files_of_an_interrupted_delivery_are_removed_later(out, monkeypatch):
    def killed(folder, path):
        raise KeyboardInterrupt

    with monkeypatch.context() as patch, pytest.raises(KeyboardInterrupt):
        patch.setattr(Folder, "remove", killed)
        build(toy.project(out, poses=toy.POSES[:1]), ALONE)
    assert not (out / "manifest.json").exists()
    build(toy.project(out, poses=toy.POSES[:1]), ALONE)
    assert not (out / "frames" / "0001").exists()


def test_status_says_built_stale_and_missing(out):
    assert set(status_of(toy.project(out)).files.values()) == {"built"}
    edited = toy.project(out, poses=[toy.POSES[0], [[3.0, 0.0], [0.0, 1.0]], toy.POSES[1]])
    image = "frames/{:04d}/cam/image.txt".format
    states = status_of(edited).files
    assert [states[image(number)] for number in range(3)] == ["built", "stale", "missing"]
    (out / image(0)).unlink()
    assert status_of(edited).files[image(0)] == "missing"


@pytest.mark.parametrize("path", ["../x", "/etc/x", "a//b", "a/./b", "manifest.json", "a\\b", "a\0b", ""])
def test_no_file_lands_outside_the_folder(tmp_path, path):
    project = toy.project(tmp_path / "out")
    project.files[path] = b"x"
    with pytest.raises(ValueError, match="cannot deliver"):
        build(project, ALONE)


def aside_of(host):
    return f".pipeline-{host}-{'a' * 32}"


def test_what_dead_builders_left_goes_and_what_other_machines_write_stays_for_a_day(out):
    here = socket.gethostname()
    busy = {aside_of("elsewhere"), aside_of(f"{here}-gpu")}
    for name in {aside_of(here), aside_of("dead"), *busy}:
        (out / name).mkdir()
    os.utime(out / aside_of("dead"), (0, 0))
    assert build(toy.project(out), ALONE).delivery.written == ()
    assert {path.name for path in out.glob(".pipeline-*")} == busy


def test_a_damaged_manifest_is_kept_aside_if_the_note_in_the_store_is_damaged_too(out, cache):
    right = toy.contents(out)
    for path in [out / "manifest.json", *(cache / "index").iterdir()]:
        whole = path.read_bytes()
        path.unlink()
        path.write_bytes(whole[1:])
    assert build(toy.project(out), ALONE).exit_code == 0
    assert toy.contents(out) == {**right, "manifest.json.kept1": right["manifest.json"][1:]}


def test_a_folder_that_was_moved_away_and_linked_back_is_filled_again(out, tmp_path):
    right = toy.contents(out)
    shutil.move(out / "frames", tmp_path / "bigdisk")
    (out / "frames").symlink_to(tmp_path / "bigdisk")
    poses = [*toy.POSES[:1], [[5.0, 0.0], [0.0, 1.0]]]
    build(toy.project(out, poses=poses), ALONE)
    assert {name for name in right if not (out / name).is_file()} == set()
    assert (out / "frames.kept1").is_symlink() and not (out / "frames").is_symlink()
    assert (tmp_path / "bigdisk" / "0001" / "cam" / "image.txt").read_bytes() == right["frames/0001/cam/image.txt"]


def test_files_that_nobody_touched_are_not_read_again(out, monkeypatch):
    build(toy.project(out), ALONE)
    time.sleep(0.05)  # what was just written cannot be told from what is written now, and is read once more
    build(toy.project(out), ALONE)
    with monkeypatch.context() as patch:
        patch.setattr(our_files, "digest_of", lambda path: pytest.fail(f"{path} was read"))
        assert build(toy.project(out), ALONE).delivery.written == ()
    name = "frames/0001/cam/image.txt"
    facts = (out / name).stat()
    (out / name).write_bytes(b"X" + (out / name).read_bytes()[1:])
    os.utime(out / name, ns=(facts.st_atime_ns, facts.st_mtime_ns))
    assert build(toy.project(out), ALONE).delivery.written == (name,)


def test_a_builder_with_another_store_waits_until_the_folder_is_free(tmp_path, monkeypatch):
    out, codes = tmp_path / "out", []
    builds = [(toy.project(out, power=power), Store(tmp_path / f"store{power}")) for power in (4.0, 9.0)]
    build(builds[1][0], ALONE, store=builds[1][1])  # so that the other build only delivers files
    (project, store), other = builds
    second = threading.Thread(target=lambda: codes.append(build(other[0], ALONE, store=other[1]).exit_code))
    move_in = Folder.move_in

    def slow(*arguments, **options):
        if not second.ident:
            second.start()
            second.join(0.3)
        move_in(*arguments, **options)

    monkeypatch.setattr(Folder, "move_in", slow)
    codes.append(build(project, ALONE, store=store).exit_code)
    second.join()
    fresh = build(toy.project(tmp_path / "fresh", power=9.0), ALONE)
    ours = {name: data for name, data in toy.contents(out).items() if ".kept" not in name}  # the other store's files
    assert codes == [0, 0] and ours == toy.contents(fresh.out)


def test_a_manifest_from_elsewhere_makes_nothing_ours(tmp_path):
    """Anybody can write one, or a downloaded folder brings it along."""
    out = tmp_path / "out"
    out.mkdir()
    data = b"years of work"
    (out / "thesis.txt").write_bytes(data)
    facts = {"sha256": hashlib.sha256(data).hexdigest(), "size": len(data)}
    listed = json.dumps({"format": 1, "stage": None, "tasks": {}, "files": {"thesis.txt": facts}})
    (out / "manifest.json").write_text(listed)
    result = build(toy.project(out), ALONE)
    assert result.delivery.foreign == ("thesis.txt",) and result.delivery.removed == ()
    assert (out / "thesis.txt").read_bytes() == data and (out / "manifest.json.kept1").read_text() == listed


@pytest.mark.parametrize("how", ["moved", "copied"])
def test_a_folder_that_was_moved_or_copied_is_ours_still(out, tmp_path, how):
    """The store wrote that very manifest: nothing in it needs to be kept aside."""
    there = tmp_path / "elsewhere"
    out.rename(there) if how == "moved" else shutil.copytree(out, there)
    result = build(toy.project(there, power=9.0, poses=toy.POSES[:1]), ALONE)
    assert result.delivery.removed == ("frames/0001/cam/image.txt",)
    assert not list(there.rglob("*.kept*")) and result.delivery.foreign == ()


def test_two_datasets_of_one_name_do_not_share_an_output_folder(tmp_path):
    """A copied example: file and prim have the same names, and so has the default output folder."""
    out, stages = tmp_path / "build", [tmp_path / name / "dataset.usda" for name in "ab"]
    for stage in stages:
        stage.parent.mkdir()
        stage.touch()
    first, second = (dataclasses.replace(toy.project(out), stage_id=str(stage)) for stage in stages)
    build(first, ALONE)
    before = toy.snapshot(out)
    with pytest.raises(UsageError, match=r"another stage: .*/a/dataset.usda, not .*/b/dataset.usda"):
        build(second, ALONE)
    assert toy.snapshot(out) == before
    stages[0].unlink()  # moved, then: the same dataset in another place
    assert build(second, ALONE).exit_code == 0


@pytest.mark.parametrize("out", [".", "..", "layers"])
def test_an_output_folder_that_the_stage_lies_in_is_refused(tmp_path, monkeypatch, out):
    """A build delivers a `dataset.usda`, too; the source would get another name, and then be overwritten."""
    home = tmp_path / "project"
    (home / "layers").mkdir(parents=True)
    reads = (home / "dataset.usda", home / "layers/lens.usda")
    for path in reads:
        path.write_text("mine")
    monkeypatch.chdir(home)
    for place, allowed in ((out, False), (f"{out}/build", True)):
        project = dataclasses.replace(toy.project(Path(place)), reads=reads)
        if allowed:
            assert build(project, ALONE).exit_code == 0
            continue
        with pytest.raises(UsageError, match="files that the stage is made of"):
            build(project, ALONE)
    assert {path.read_text() for path in reads} == {"mine"} and not list(tmp_path.rglob("*.kept*"))


@pytest.mark.parametrize("out", ["store", "store/tmp", "store/new/out", "link"])
def test_an_output_folder_in_a_store_is_refused(tmp_path, out):
    """What a store tidies up would be what a build delivered, and the reverse."""
    Store(tmp_path / "store")
    (tmp_path / "link").symlink_to("store/cas")
    before = sorted(tmp_path.rglob("*"))
    with pytest.raises(UsageError, match="lies in a store of results"):
        build(dataclasses.replace(toy.project(tmp_path), out=tmp_path / out), ALONE)
    assert sorted(tmp_path.rglob("*")) == before
