"""The store gives the right bytes or a miss, whatever happened to its files."""

import errno
import hashlib
import os
import socket
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pytest
from engine import toy

from pipeline.engine.maintenance import collect
from pipeline.engine.options import ALONE, BuildOptions
from pipeline.engine.output import manifest
from pipeline.engine.records import fields_of, seal
from pipeline.engine.running.session import build
from pipeline.engine.store.store import DamagedBlob, Store
from pipeline.engine.store.store_folder import VERSION
from pipeline.errors import EnvironmentFault

KEY = "ab" * 32


@pytest.fixture
def record(store):
    entry = toy.put(store, b"some bytes")
    return store.put_record(toy.record(KEY, **{"a.txt": entry}))


@pytest.mark.parametrize(
    "made_by",
    [
        [],
        {"seconds": "x"},
        {"kernels": {"k": {"rays": "many"}}},
    ],
)
def test_a_record_of_another_form_is_a_miss_also_with_its_digest(store, record, made_by):
    """It stopped every build with a traceback until somebody removed it by hand."""
    path = store.path("record", KEY)
    path.unlink()
    path.write_bytes(seal({"format": 1, **fields_of(record), "made_by": made_by}))
    assert store.record(KEY) is None
    assert not path.exists()


def test_a_note_of_another_form_keeps_nothing(tmp_path, cache):
    project = replace(toy.project(tmp_path / "out"), source={"written": {}})
    build(project, ALONE)
    paths = [path for folder in ("history", "sources") for path in (cache / folder).iterdir()]
    assert len(paths) == 2
    for note in ({}, [], {"out": 5}, {"out": "\ud800", "keys": {}}, {"out": str(tmp_path / "out"), "keys": [1]}):
        for path in paths:
            path.unlink()
            path.write_bytes(seal(note))
        collect(Store(cache), 10**9)
        assert build(project, ALONE).exit_code == 0


@pytest.mark.parametrize("error", [errno.EMFILE, errno.EACCES, errno.EIO, errno.ESTALE])
@pytest.mark.parametrize("call", ["os.open", "hashlib.file_digest"])
def test_what_cannot_be_read_just_now_is_a_miss_and_stays(cache, record, monkeypatch, call, error):
    store, blob = Store(cache), record.outputs["a.txt"]
    with monkeypatch.context() as patch:
        patch.setattr(f"pipeline.engine.files.{call}", failing(error))
        assert store.record(KEY) is None and not store.is_whole(blob)
        with pytest.raises(DamagedBlob):
            store.blob(blob.sha256)
    assert store.record(KEY) == record


def failing(error):

    def fail(*arguments, **options):
        raise OSError(error, os.strerror(error))

    return fail


def test_a_hard_linked_file_is_copied_and_stays_where_it_was(store, tmp_path):
    users = tmp_path / "users.txt"
    users.write_text("mine")
    linked = store.new_path()
    linked.hardlink_to(users)
    entry = store.put_file(linked)
    assert users.stat().st_ino != store.path("blob", entry.sha256).stat().st_ino
    assert users.read_text() == "mine"


def test_only_folders_of_dead_processes_are_swept(store, cache):
    store.new_path().write_bytes(b"alive")
    code = (
        "import os, sys\nfrom pipeline.engine.store.store import Store\n"
        "store = Store(sys.argv[1])\nstore.new_path().mkdir()\nos._exit(0)"
    )
    subprocess.run([sys.executable, "-c", code, str(cache)], check=True)
    (cache / "tmp" / f"{socket.gethostname()}-backup-2026").mkdir()  # of the user
    assert store.sweep() == 1
    assert len(list((cache / "tmp").iterdir())) == 2


@pytest.mark.parametrize("name", ["../../secret", "A" * 64, "a" * 63, "", "a/" * 32, "a" * 64 + "\n", "\0" * 64])
def test_what_is_no_digest_names_no_place_in_a_store(store, name):
    with pytest.raises(ValueError, match="not a digest"):
        store.path("blob", name)


def test_a_store_that_may_only_be_read_serves_what_it_has(tmp_path, store, monkeypatch):
    build(toy.project(tmp_path / "first"), ALONE)
    before = toy.snapshot(store.root / "ac")
    monkeypatch.setattr(Store, "new_path", failing(errno.EROFS))
    assert build(toy.project(tmp_path / "out"), ALONE).executed == 0
    assert toy.contents(tmp_path / "out") == toy.contents(tmp_path / "first")
    assert build(toy.project(tmp_path / "out", samples=9), ALONE).exit_code == 5
    assert {name: facts[0] for name, facts in before.items()} == toy.contents(store.root / "ac")


def test_a_store_that_cannot_be_written_to_is_named_and_no_place_in_the_stage(tmp_path, store, monkeypatch):
    monkeypatch.setattr(Path, "mkdir", failing(errno.EROFS))
    project = replace(toy.project(tmp_path / "out"), places=dict.fromkeys(("", "cam"), "dataset.usda:3"))
    result = build(project, ALONE)
    (failure,) = result.failures
    assert result.exit_code == 5
    assert failure.error.startswith(f"cannot keep results in {store.root}: Read-only file system\n    hint: ")
    assert failure.place is None and failure.log is None and failure.spec is None


def test_a_folder_that_holds_anything_else_is_no_store(tmp_path):
    """The user's own `tmp/` would be swept."""
    root = tmp_path / "scratch"
    for name in ("tmp/experiment", "thesis", f"tmp/{socket.gethostname()}-backup-2026"):
        (root / name).mkdir(parents=True)
        (root / name / "data").write_text("precious")
    before = toy.snapshot(root)
    with pytest.raises(EnvironmentFault, match="holds thesis, tmp, and no VERSION of ours"):
        Store(root)
    assert toy.snapshot(root) == before


@pytest.mark.parametrize("said", ["1.2.3", "plenoptic-pipeline store 2", ""])
def test_a_version_of_something_else_makes_no_store(tmp_path, said):
    root = tmp_path / "project"
    root.mkdir()
    (root / "VERSION").write_text(said)
    (root / "thesis.tex").touch()
    with pytest.raises(EnvironmentFault):
        Store(root)


@pytest.mark.parametrize("left", [(), ("lost+found",), (f"tmp/machine-1-{32 * 'a'}",)])
def test_an_empty_folder_or_one_that_was_hardly_begun_becomes_a_store(tmp_path, left):
    root = tmp_path / "empty"
    root.mkdir()
    for name in left:
        (root / name).mkdir(parents=True)
    toy.put(Store(root), b"x")
    assert Store(root).size() == 1


@pytest.mark.parametrize("make", [Path.symlink_to, Path.hardlink_to])
def test_a_file_of_the_user_that_a_lock_or_a_log_leads_to_is_not_written_to(tmp_path, cache, make):
    (tmp_path / "thesis.tex").write_text("years of work")
    first = build(toy.project(tmp_path / "out"), ALONE)
    for path in (cache / "ac").rglob("*.json"):
        path.unlink()
    places = [Store(cache).path(table, task.key) for task in first.tasks for table in ("lock", "log")]
    for path in (*places, cache / "gc.lock"):
        path.parent.mkdir(parents=True, exist_ok=True)
        path.unlink(missing_ok=True)
        make(path, tmp_path / "thesis.tex")
    for jobs in (1, 2):
        again = build(toy.project(tmp_path / "out"), BuildOptions(jobs=jobs, force=("image/*",)))
        assert again.exit_code == 0 and again.executed
    assert not collect(Store(cache), 0).busy
    assert (tmp_path / "thesis.tex").read_text() == "years of work"


def test_a_store_that_lost_its_version_is_a_store_still(tmp_path, cache):
    build(toy.project(tmp_path / "out"), ALONE)
    for said in (None, b"", b"\0" * 27, b"1\n"):
        (cache / "VERSION").unlink()
        if said is not None:
            (cache / "VERSION").write_bytes(said)
        assert build(toy.project(tmp_path / "out"), ALONE).executed == 0
        assert (cache / "VERSION").read_bytes() == VERSION


def test_a_record_that_nests_too_deeply_is_a_miss(tmp_path, store, record):
    body = b"[" * 200_000
    path = store.path("record", KEY)
    path.unlink()
    path.write_bytes(body + b"\n#sha256=" + hashlib.sha256(body).hexdigest().encode() + b"\n")
    assert store.record(KEY) is None and not path.exists()
    (tmp_path / "manifest.json").write_bytes(body)
    assert manifest.read(tmp_path).files == {}
