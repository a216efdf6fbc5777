"""A new user's first hour, by the script that everybody can run: every step gives what it should."""

import subprocess
import sys
from pathlib import Path

import chromium
import pytest
import stones

ROOT = Path(__file__).resolve().parents[2]


def test_every_mistake_of_the_walk_is_a_mistake_in_a_stage_without_one():
    """The cheap sibling: each changes the stage, or is a command of its own."""
    assert stones.STAGE.count("{") == stones.STAGE.count("}")
    for stone in stones.STONES[1:]:
        changed = stone.right and stones.STAGE.replace(stone.right, stone.wrong) != stones.STAGE
        assert changed or stone.command != stones.STONES[0].command, stone.name


@pytest.mark.heavy
def test_the_first_hour_goes_well():
    """In a clone of the last commit, with the libraries of this environment; two minutes of processor time."""
    run = [sys.executable, "docs/first_hour.py", "--venv", str(Path(sys.prefix))]
    done = subprocess.run(run, capture_output=True, text=True, cwd=ROOT)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "NOT TRIED" not in done.stdout or chromium.found() is None
