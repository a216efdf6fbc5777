"""Shares work: says who ran together. May fail, or kill its process, because of one of them, or only in company."""

import os
import signal
import uuid
from collections.abc import Sequence
from pathlib import Path


def run(params: Sequence[dict], inputs, outs):
    """One or several at once."""
    names = [one["name"] for one in params]
    Path(params[0]["folder"], f"ran-{'+'.join(sorted(names))}-{uuid.uuid4().hex}").touch()
    for one, out in zip(params, outs, strict=True):
        print(f"{one['name']} is made")
        if one.get("fails"):
            raise ValueError(f"{one['name']} cannot be made")
        if one.get("kills") and (len(params) > 1 or one["kills"] == "always"):
            os.kill(os.getpid(), signal.SIGKILL)
        (out / "shared.txt").write_text(f"{one['name']} {one['value']}")
