"""Fixtures of all tests of the engine: a store of their own and a toy package that may be edited."""

import importlib
import shutil

import pytest
from engine import toy

from pipeline.engine.store.store import Store


@pytest.fixture(autouse=True)
def cache(tmp_path, monkeypatch):
    folder = tmp_path / "store"
    monkeypatch.setenv("PIPELINE_CACHE", str(folder))
    return folder


@pytest.fixture
def store(cache):
    return Store(cache)


@pytest.fixture(autouse=True)
def kit(tmp_path, monkeypatch):
    """A copy of the toy package, first on the path."""
    folder = tmp_path / "code" / "toykit"
    shutil.copytree(toy.KIT, folder, ignore=shutil.ignore_patterns("__pycache__"))
    monkeypatch.syspath_prepend(folder.parent)
    monkeypatch.setattr("sys.dont_write_bytecode", True)
    toy.forget_imports()
    importlib.invalidate_caches()
    yield folder
    toy.forget_imports()
