"""mrcal as Debian packages it, for Debian's own Python: programs that read JSON and print it."""

import json
import subprocess
from pathlib import Path

import pytest

_PYTHON = Path("/usr/bin/python3")


def by_mrcal(program: str, given: dict) -> list:
    """What a program with `given` and `mrcal` prints last; without mrcal the test is skipped."""
    if not _PYTHON.exists() or subprocess.run([_PYTHON, "-c", "import mrcal"], capture_output=True).returncode:
        pytest.skip("NOT JUDGED: mrcal is not installed (Debian: python3-mrcal)")
    started = "import json, sys, numpy as np, mrcal\ngiven = json.load(sys.stdin)\n" + program
    answer = subprocess.run(
        [_PYTHON, "-c", started], input=json.dumps(given), capture_output=True, text=True, check=True
    )
    return json.loads(answer.stdout.splitlines()[-1])
