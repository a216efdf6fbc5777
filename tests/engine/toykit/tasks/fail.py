"""Fails until a file appears."""

from pathlib import Path


def run(params, inputs, out):
    """Raise, or write that all is well."""
    print("about to look")
    if not Path(params["flag"]).exists():
        raise ValueError("the flag is not there")
    (out / "fine.txt").write_text("fine")
