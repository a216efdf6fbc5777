"""Fails the first `times` times."""

from pathlib import Path


def run(params, inputs, out):
    """Raise, or write."""
    tries = len(list(Path(params["folder"]).glob("try*")))
    Path(params["folder"], f"try{tries}").touch()
    if tries < params["times"]:
        raise ValueError("not yet")
    (out / "done.txt").write_text("done")
