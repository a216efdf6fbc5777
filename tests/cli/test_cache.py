"""`pipeline cache`: what a user asks of the store."""

import json
import os

import pytest
from engine import toy

from pipeline.engine.store.store import Store


@pytest.fixture
def pipeline(cache, in_this_process):
    return in_this_process


@pytest.fixture
def record(store):
    """One result of 9 bytes."""
    return store.put_record(toy.record("ab" * 32, a=toy.put(store, b"nine byte")))


def test_path_and_info(pipeline, cache, record):
    assert pipeline("cache", "path")[:2] == (0, f"{cache}\n")
    code, output, _ = pipeline("cache", "info")
    assert code == 0 and "1 tasks, 1 files, 9 bytes" in output
    facts = json.loads(pipeline("cache", "info", "--json")[1])
    assert (facts["records"], facts["blobs"], facts["bytes"], facts["pinned_bytes"]) == (1, 1, 9, 0)


def test_gc_says_first_and_then_does(pipeline, record):
    assert pipeline("cache", "gc", "--dry-run", "--size", "5")[1].startswith("would drop 1 tasks and 1 files, 9 bytes")
    assert pipeline("cache", "gc", "--size", "5")[1].startswith("dropped 1 tasks")
    assert json.loads(pipeline("cache", "info", "--json")[1])["bytes"] == 0
    assert pipeline("cache", "gc", "--size", "lots")[0] == 2


def test_gc_of_a_read_only_store_says_so_and_looks_for_no_build(pipeline, store, record, monkeypatch):
    monkeypatch.setattr(os, "access", lambda path, mode: False)  # permissions do not stop root
    code, _, log = pipeline("cache", "gc", "--size", "5")
    assert code == 5 and f"{store.root} is read-only" in log and "a build uses" not in log
    assert pipeline("cache", "gc", "--dry-run", "--size", "5")[1].startswith("would drop 1 tasks")


def test_gc_waits_for_no_build(pipeline, store, record, monkeypatch):
    monkeypatch.setattr("pipeline.engine.maintenance.locked", _impatient(monkeypatch))
    with store.in_use():
        code, _, log = pipeline("cache", "gc", "--size", "5")
    assert code == 5 and "a build uses" in log and Store(store.root).record("ab" * 32)


def _impatient(monkeypatch):
    from pipeline.engine.locks import locked

    return lambda path, timeout_s, doing: locked(path, timeout_s=0.1)
