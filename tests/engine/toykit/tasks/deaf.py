"""Says that it started, then calls C that calls Python back: what is raised in there is dropped."""

import ctypes
import time
from pathlib import Path


def run(params, inputs, out):
    """Be called back for some time."""
    callback = ctypes.CFUNCTYPE(None)(lambda: time.sleep(0.3))
    Path(params["folder"], "ran-deaf").touch()
    end = time.monotonic() + params["seconds"]
    while time.monotonic() < end:
        callback()
