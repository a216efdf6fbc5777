"""A few of the faults that `make faults` does at every place: nothing wrong, nothing damaged."""

import re
import subprocess
import sys
from pathlib import Path


def test_faults_leave_no_wrong_result_and_no_damaged_store():
    """In a process of its own, because it forks."""
    command = [sys.executable, str(Path(__file__).with_name("run.py")), "--short"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=900)
    assert done.returncode == 0, done.stdout + done.stderr
    tried = int(re.search(r"^(\d+) faults: 0 wrong results, 0 damaged stores$", done.stdout, re.MULTILINE)[1])
    assert tried > 250, done.stdout
