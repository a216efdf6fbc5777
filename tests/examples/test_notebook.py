"""The tutorial notebook runs from its first cell to its last, and prints what it says it prints."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
BOOK = ROOT / "docs/tutorial.ipynb"


def test_the_notebook_is_one_and_was_run_in_order():
    """The cheap sibling of the run: format 4, code that compiles, every cell with its number and what it says."""
    book = json.loads(BOOK.read_text(encoding="utf-8"))
    cells = [cell for cell in book["cells"] if cell["cell_type"] == "code"]
    assert (book["nbformat"], book["nbformat_minor"]) == (4, 5)
    assert [cell["execution_count"] for cell in cells] == list(range(1, len(cells) + 1))
    assert len({cell["id"] for cell in book["cells"]}) == len(book["cells"])
    for cell in cells:
        compile("".join(cell["source"]), cell["id"], "exec")
    kinds = [kind for cell in cells for one in cell["outputs"] for kind in one.get("data", {})]
    assert {"image/png", "image/svg+xml", "text/html"} <= set(kinds) and BOOK.stat().st_size < 300_000


@pytest.mark.heavy
def test_the_notebook_runs_and_prints_what_it_holds(common_store):
    run = [sys.executable, str(ROOT / "docs/notebook.py"), str(BOOK)]
    done = subprocess.run(run, capture_output=True, text=True, env={**os.environ, "PIPELINE_CACHE": str(common_store)})
    assert done.returncode == 0, done.stdout + done.stderr[-2000:]
