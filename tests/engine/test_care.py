"""Care of the store: what goes, what stays, and that nothing of it can make a result wrong."""

import json
import os
import shutil

import pytest
from engine import toy

from pipeline.engine.maintenance import bytes_of, collect, info, pinned_keys
from pipeline.engine.options import ALONE, Caller
from pipeline.engine.running.session import build
from pipeline.engine.store.store import Store
from pipeline.errors import EnvironmentFault, UsageError


def unreadable(path):
    """Fail as a disk that is not mounted does."""
    raise OSError(f"no such device: {path}")


def filled(store: Store, count: int) -> list[str]:
    """Records with a blob of 1000 bytes each, used in the order of their names."""
    keys = [f"{number:064x}" for number in range(count)]
    for number, key in enumerate(keys):
        entry = toy.put(store, bytes([number]) * 1000)
        store.put_record(toy.record(key, a=entry))
        os.utime(store.path("record", key), (1000 + number, 1000 + number))
    return keys


def test_what_was_unused_longest_goes_first(store):
    keys = filled(store, 5)
    os.utime(store.path("record", keys[1]), (5000, 5000))  # used again
    done = collect(store, 2000)
    assert (done.records, done.bytes, done.bytes_left) == (3, 3000, 2000)
    assert [key for key in keys if store.record(key)] == [keys[1], keys[4]]


def test_looking_a_record_up_is_a_use(store):
    keys = filled(store, 3)
    assert store.record(keys[0])
    collect(store, 1000)
    assert store.record(keys[0]) and not store.record(keys[2])


def test_a_dry_run_says_what_would_go_and_removes_nothing(store):
    filled(store, 5)
    said = collect(store, 2000, dry_run=True)
    assert info(store).records == 5
    assert collect(store, 2000) == said


def test_blobs_that_nothing_refers_to_go_and_shared_ones_stay(store):
    filled(store, 1)
    toy.put(store, b"orphan")
    store.put_record(toy.record("f" * 64, b=toy.put(store, bytes(1000))))
    done = collect(store, 10**9)
    assert (done.records, done.blobs, done.bytes) == (0, 1, len(b"orphan"))
    assert store.record("f" * 64) and store.record("0" * 64)


def test_results_of_an_output_folder_stay_until_it_is_deleted(tmp_path, store):
    build(toy.project(tmp_path / "out"), ALONE)
    build(toy.project(tmp_path / "out", power=9.0), ALONE)  # the first results are of no build any more
    assert len(pinned_keys(store)) == 5
    assert collect(store, 0).records > 0
    assert build(toy.project(tmp_path / "out", power=9.0), ALONE).executed == 0
    shutil.rmtree(tmp_path / "out")
    collect(store, 0)
    assert info(store).bytes == 0
    assert build(toy.project(tmp_path / "out", power=9.0), ALONE).executed == 5


def test_a_build_keeps_the_store_within_its_limit(tmp_path, store, monkeypatch):
    for power in range(4):
        build(toy.project(tmp_path / "out", power=float(power)), ALONE)
    shutil.rmtree(tmp_path / "out")
    monkeypatch.setenv("PIPELINE_CACHE_SIZE", "4k")
    before = store.size()
    result = build(toy.project(tmp_path / "other", power=8.0), ALONE)
    assert before > 4000 >= result.store_bytes == store.size()
    events = []
    monkeypatch.setenv("PIPELINE_CACHE_SIZE", "1k")
    build(toy.project(tmp_path / "other", power=8.0), ALONE, caller=Caller(on_event=events.append))
    assert any("over its limit" in getattr(event, "text", "") for event in events)


def test_nothing_is_collected_under_a_running_build(store):
    keys = filled(store, 3)
    with store.in_use(), store.in_use() as held:
        assert held  # builders do not exclude each other
        assert collect(store, 0).busy
    assert all(store.record(key) for key in keys)


def test_a_build_deletes_what_is_damaged_says_so_once_and_makes_it_again(tmp_path, store):
    build(toy.project(tmp_path / "out"), ALONE)
    right = toy.contents(tmp_path / "out")
    blob = store.path(
        "blob", json.loads((tmp_path / "out/manifest.json").read_text())["files"]["report/index.html"]["sha256"]
    )
    blob.chmod(0o644)
    blob.write_bytes(b"x" + blob.read_bytes()[1:])
    next((store.root / "ac").rglob("*.json")).unlink()
    said = []
    caller = Caller(on_event=lambda event: said.append(getattr(event, "text", "")))
    assert build(toy.project(tmp_path / "out"), ALONE, caller=caller).executed
    assert [text for text in said if str(blob) in text] == [f"damaged entry of the store, deleted: {blob}"]
    assert toy.contents(tmp_path / "out") == right
    assert Store(store.root).blob(blob.name)


@pytest.mark.parametrize("name", ["cas", "logs", "gc.lock", "VERSION"])
def test_files_of_others_in_the_place_of_ours_are_renamed_and_never_deleted(tmp_path, store, name):
    build(toy.project(tmp_path / "out"), ALONE)
    shutil.rmtree(store.root / name) if (store.root / name).is_dir() else (store.root / name).unlink()
    if name in ("cas", "logs"):
        (store.root / name).write_text("precious")
    else:
        (store.root / name).mkdir()
        (store.root / name / "thesis.tex").write_text("precious")
    shutil.rmtree(tmp_path / "out")
    assert build(toy.project(tmp_path / "out"), ALONE).exit_code == 0
    (aside,) = store.root.glob(f"{name}.?*")
    assert next(path for path in (aside, aside / "thesis.tex") if path.is_file()).read_text() == "precious"


def test_what_cannot_be_read_just_now_is_neither_dropped_nor_deleted(store, monkeypatch):
    said, key = [], filled(store, 1)[0]
    store = Store(store.root, warn=said.append)
    with monkeypatch.context() as patch:
        patch.setattr("pipeline.engine.files.open_regular", unreadable)
        with pytest.raises(EnvironmentFault, match="nothing was removed"):
            collect(store, 0)
        assert store.record(key) is None
    assert store.record(key) and not said


@pytest.mark.parametrize(("text", "size"), [("1000", 1000), ("1.5G", 1.5e9), ("500 MB", 5e8), ("2t", 2e12), ("0", 0)])
def test_sizes_are_written_as_people_do(text, size):
    assert bytes_of(text, "--size") == size


@pytest.mark.parametrize("text", ["", "G", "-1", "1.2.3G", "10 apples"])
def test_what_is_no_size_is_refused(text):
    with pytest.raises(UsageError, match="not a size"):
        bytes_of(text, "--size")
