"""Counts how many of its kind run at the same time, and may claim that there is no memory beside another one."""

import time
import uuid
from pathlib import Path


def run(params, inputs, out):
    """Note the number of those that run, or raise."""
    mine = Path(params["folder"], f"running-{uuid.uuid4().hex}")
    mine.touch()
    try:
        time.sleep(0.3)
        beside = len(list(Path(params["folder"]).glob("running-*"))) - 1
        if beside and params["greedy"]:
            raise MemoryError
        time.sleep(0.1)
    finally:
        mine.unlink()
    Path(params["folder"], f"beside{beside}-{params['name']}").touch()
    (out / "fed.txt").write_text(params["name"])
