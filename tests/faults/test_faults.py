"""A few of the faults that `make faults` does at every place: nothing wrong, nothing damaged."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

SLOW = ["--only", "1", "3", "8", "11", "16", "18", "19", "20"]
"""Rows that take seconds each, and tests/engine does most of them with toy tasks: power failures, flipped bits,
locks that do not reach, killed collectors, no memory, links in the place of folders, bits that flip at the last moment,
and other libraries.
"""


@pytest.mark.heavy
@pytest.mark.parametrize(("rows", "least"), [([], 250), (SLOW, 80)])
def test_faults_leave_no_wrong_result_and_no_damaged_store(rows, least):
    """In a process of its own, because it forks."""
    command = [sys.executable, str(Path(__file__).with_name("run.py")), "--short", *rows]
    done = subprocess.run(command, capture_output=True, text=True, timeout=900)
    assert done.returncode == 0, done.stdout + done.stderr
    tried = int(re.search(r"^(\d+) faults: 0 wrong results, 0 damaged stores$", done.stdout, re.MULTILINE)[1])
    assert tried > least, done.stdout
