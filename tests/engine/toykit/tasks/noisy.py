"""Gives other bytes every time."""

import uuid


def run(params, inputs, out):
    """Write noise."""
    (out / "noise.txt").write_text(uuid.uuid4().hex)
