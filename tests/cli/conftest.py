"""Fixtures of the command with toy tasks: in a process, in this process, and a stage that can be written anew."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
from cli import toy_command
from engine.fixtures import cache, kit, store

__all__ = ["cache", "kit", "store"]


COMMAND = Path(__file__).with_name("toy_command.py")


@pytest.fixture
def command(tmp_path, kit, cache):
    """Start the command in an empty folder with a stage `s.json`."""

    def start(*arguments, **options):
        settings = {**os.environ, "PIPELINE_CACHE": str(cache), "NO_COLOR": "1", "COLUMNS": "200"}
        pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True, **options}
        return subprocess.Popen(
            [sys.executable, str(COMMAND), str(kit.parent), *arguments], cwd=tmp_path, env=settings, **pipes
        )

    return start


@pytest.fixture
def pipeline(tmp_path, kit, monkeypatch, in_this_process):
    """The same with toy tasks, in an empty folder."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "200")
    for name, module in toy_command.fakes().items():
        monkeypatch.setitem(sys.modules, name, module)
    monkeypatch.setattr("pipeline.engine.planning.graph.PACKAGES", toy_command.PACKAGES)
    return in_this_process


@pytest.fixture
def stage(tmp_path):
    """Write the stage; gives its path as the user types it."""

    def write(**facts):
        (tmp_path / "s.json").write_text(json.dumps(facts))
        return "s.json"

    write()
    return write
