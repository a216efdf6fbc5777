"""Says that it started, takes its time, and counts how often it ran."""

import time
import uuid
from pathlib import Path


def run(params, inputs, out):
    """Sleep and write."""
    Path(params["folder"], f"ran-{params['name']}-{uuid.uuid4().hex}").touch()
    time.sleep(params["seconds"])
    (out / "slow.txt").write_text(params["name"])
