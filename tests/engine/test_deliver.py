"""The output folder: complete or without manifest, repaired without running, other people's files left alone."""

import json
import os
import shutil
import socket

import pytest
from engine import toy

from pipeline.engine import deliver as module
from pipeline.engine import manifest
from pipeline.engine.session import build, status_of
from pipeline.errors import UsageError


@pytest.fixture
def out(tmp_path):
    """A finished build of the toy project."""
    build(toy.project(tmp_path / "out"), jobs=1)
    return tmp_path / "out"


def test_the_manifest_lists_every_file_but_itself(out):
    manifest = json.loads((out / "manifest.json").read_text())
    assert set(manifest["files"]) == set(toy.contents(out)) - {"manifest.json"}
    assert set(manifest["tasks"]) == set(toy.project(out).graph)
    assert manifest["format"] == 1 and manifest["certificate"] is None


def test_the_manifest_is_sorted_json_with_a_line_per_task_and_per_file():
    head = {"stage": 'a "b"\n.usda', "seeds": {"dataset": 1}, "empty": {}}
    files = {"b/ü": {"sha256": "1" * 64, "size": 5}, "a": {"sha256": "0" * 64, "size": 0}}
    tasks = {"t/2": "3" * 64, "t/10": "2" * 64}
    text = manifest.render(head, tasks, files).decode()
    assert json.loads(text) == {"format": 1, **head, "tasks": tasks, "files": files}
    whole = json.dumps(json.loads(text), indent=1, sort_keys=True, ensure_ascii=False)
    assert "".join(text.split()) == "".join(whole.split())
    assert [line.split('"')[1] for line in text.splitlines() if "sha256" in line] == ["a", "b/ü"]


def test_files_are_copies_and_not_links(out):
    assert all(path.stat().st_nlink == 1 for path in out.rglob("*") if path.is_file())


@pytest.mark.parametrize("name", ["frames/0000/cam/image.txt", "dataset.usda", "manifest.json"])
def test_missing_and_altered_files_come_back_without_running(out, name):
    right = toy.contents(out)
    (out / name).unlink()
    assert build(toy.project(out), jobs=1).executed == 0
    assert toy.contents(out) == right
    altered = bytearray(right[name])
    altered[0] ^= 1
    times = (out / name).stat()
    (out / name).write_bytes(altered)
    os.utime(out / name, ns=(times.st_atime_ns, times.st_mtime_ns))  # as if nothing had happened
    assert build(toy.project(out), jobs=1).executed == 0
    assert toy.contents(out) == right


def test_a_touched_file_with_the_same_bytes_stays(out):
    os.utime(out / "dataset.usda", ns=(1, 1))
    before = toy.snapshot(out)
    assert build(toy.project(out), jobs=1).delivery.written == ()
    assert toy.snapshot(out) == before


def test_files_no_longer_made_go_and_their_folders_too(out):
    result = build(toy.project(out, poses=toy.POSES[:1]), jobs=1)
    assert result.delivery.removed == ("frames/0001/cam/image.txt",)
    assert not (out / "frames" / "0001").exists() and (out / "frames" / "0000").exists()


def test_foreign_files_stay_with_a_warning(out):
    (out / "notes.txt").write_text("mine")
    (out / "frames" / "0001" / "mine.txt").write_text("mine")
    events = []
    build(toy.project(out, poses=toy.POSES[:1]), jobs=1, on_event=events.append)
    assert (out / "frames" / "0001" / "mine.txt").read_text() == (out / "notes.txt").read_text() == "mine"
    assert any("notes.txt" in event.get("text", "") for event in events)
    assert "notes.txt" not in json.loads((out / "manifest.json").read_text())["files"]


def test_foreign_things_in_the_way_are_kept_under_another_name(tmp_path):
    out = tmp_path / "out"
    (out / "dataset.usda").mkdir(parents=True)
    (out / "dataset.usda" / "thesis.tex").write_text("years of work")
    (out / "report").write_text("mine")
    assert build(toy.project(out), jobs=1).exit_code == 0
    assert (out / "dataset.usda").is_file()
    assert (out / "dataset.usda.kept1" / "thesis.tex").read_text() == "years of work"
    assert (out / "report.kept1").read_text() == "mine"


def test_a_link_in_the_folder_is_not_written_through(out, tmp_path):
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    shutil.rmtree(out / "report")
    (out / "report").symlink_to(elsewhere)
    build(toy.project(out), jobs=1)
    assert not list(elsewhere.iterdir())
    assert (out / "report" / "index.html").is_file() and not (out / "report").is_symlink()


def test_a_folder_of_another_stage_is_refused_before_anything_runs(out, cache):
    before = toy.snapshot(out)
    with pytest.raises(UsageError, match="another stage"):
        build(toy.project(out, stage="other", power=9.0), jobs=1)
    assert toy.snapshot(out) == before


@pytest.mark.parametrize("place", ["copy", "place"])
def test_an_interrupted_delivery_leaves_no_manifest_or_the_whole_previous_build(out, monkeypatch, place):
    before = toy.contents(out)
    edited = toy.project(out, poses=[*toy.POSES[:1], [[5.0, 0.0], [0.0, 1.0]]])

    class Killed(BaseException):
        pass

    def killed(*arguments):
        raise Killed

    with monkeypatch.context() as patch:
        if place == "copy":
            patch.setattr(module, "copy", killed)
        else:
            patch.setattr(module._Folder, "_place", killed)
        with pytest.raises(Killed):
            build(edited, jobs=1)
    assert toy.contents(out) == before if place == "copy" else not (out / "manifest.json").exists()
    assert build(edited, jobs=1).executed == 0
    fresh = build(toy.project(out.parent / "fresh", poses=[*toy.POSES[:1], [[5.0, 0.0], [0.0, 1.0]]]), jobs=1)
    assert toy.contents(out) == toy.contents(fresh.out)


def test_files_of_an_interrupted_delivery_are_removed_later(out, monkeypatch):
    def killed(folder, path):
        raise KeyboardInterrupt

    with monkeypatch.context() as patch, pytest.raises(KeyboardInterrupt):
        patch.setattr(module._Folder, "_remove", killed)
        build(toy.project(out, poses=toy.POSES[:1]), jobs=1)
    assert not (out / "manifest.json").exists()
    build(toy.project(out, poses=toy.POSES[:1]), jobs=1)
    assert not (out / "frames" / "0001").exists()


def test_a_full_disk_leaves_the_previous_build_whole(out, monkeypatch):
    before = toy.snapshot(out)

    def full(source, target):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(module, "copy", full)
    result = build(toy.project(out, power=9.0), jobs=1)
    assert result.exit_code == 5 and "bytes free" in str(result.error)
    assert toy.snapshot(out) == before


def test_status_says_built_stale_and_missing(out):
    assert {s.state for s in status_of(toy.project(out))} == {"built"}
    edited = toy.project(out, poses=[toy.POSES[0], [[3.0, 0.0], [0.0, 1.0]], toy.POSES[1]])
    states = {s.name: s.state for s in status_of(edited)}
    assert states["image/cam/0000"] == "built"
    assert states["image/cam/0001"] == "stale"
    assert states["image/cam/0002"] == "missing"
    (out / "frames/0000/cam/image.txt").unlink()
    assert {s.name: s.state for s in status_of(edited)}["image/cam/0000"] == "missing"


@pytest.mark.parametrize("path", ["../x", "/etc/x", "a//b", "a/./b", "manifest.json", "a\\b"])
def test_no_file_lands_outside_the_folder(tmp_path, path):
    project = toy.project(tmp_path / "out")
    project.files[path] = b"x"
    with pytest.raises(ValueError, match="cannot deliver"):
        build(project, jobs=1)


def test_a_file_with_the_very_same_bytes_is_taken_over(out, cache, tmp_path):
    """As from another machine that builds the same into this folder, with a store of its own."""
    before = {path.name for path in out.rglob("*")}
    (out / "manifest.json").unlink()
    shutil.rmtree(cache)
    assert build(toy.project(out), jobs=1).exit_code == 0
    assert {path.name for path in out.rglob("*")} == before


def test_what_dead_builders_left_goes_and_what_other_machines_write_stays_for_a_day(out):
    names = {f".pipeline-{socket.gethostname()}-dead", ".pipeline-elsewhere-busy", ".pipeline-elsewhere-dead"}
    for name in names:
        (out / name).mkdir()
    os.utime(out / ".pipeline-elsewhere-dead", (0, 0))
    assert build(toy.project(out), jobs=1).delivery.written == ()
    assert [path.name for path in out.glob(".pipeline-*")] == [".pipeline-elsewhere-busy"]


def test_a_folder_that_changes_meanwhile_is_no_bug_of_ours(out, monkeypatch):
    (out / "dataset.usda").unlink()
    real = module._Folder._place

    def place(self, aside, path):
        aside.unlink()
        real(self, aside, path)

    monkeypatch.setattr(module._Folder, "_place", place)
    result = build(toy.project(out), jobs=1)
    assert result.exit_code == 5 and "changed while files were put there" in str(result.error)
