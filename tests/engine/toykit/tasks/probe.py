"""Writes what a worker has imported and how many threads it may use."""

import json
import os
import sys


def run(params, inputs, out):
    """Write the facts."""
    threads = {name: os.environ.get(name) for name in ("OMP_NUM_THREADS", "NUMBA_NUM_THREADS")}
    (out / "probe.json").write_text(json.dumps({"modules": sorted(sys.modules), "threads": threads}))
