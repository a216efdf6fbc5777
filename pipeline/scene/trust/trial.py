"""Binary layers are first read in a process that may crash: USD believes the offsets in them, and some are fatal.

A text is as good as its brackets, which `layer_files` counts; so only a stage with a usdc or usdz pays for this.
"""

import sys
from collections.abc import Iterator
from pathlib import Path

from pipeline.confine.process import Bounds, Ended, ask
from pipeline.roots import readable_for
from pipeline.scene.usd.problems import Problem, shown_path

_READING = "reading: "
BOUNDS = Bounds(cpu_s=20, wall_s=60)
"""Time for a stage with binary layers: `check` is to end within seconds; by the clock a busy machine takes longer."""


def trial(root: Path, roots: list[Path]) -> Iterator[Problem]:
    """The errors that a process found which read the stage; or that it did not survive it."""
    question = {"path": str(root), "roots": [str(one) for one in roots]}
    try:
        found, _ = ask("pipeline.scene.load:attempt", question, readable_for(roots), BOUNDS)
        yield from (Problem(**row) for row in found)
    except Ended as error:
        yield unreadable(error, root)


def announce(layer: str) -> None:
    """Note the layer that USD is about to read, in the log of a confined process: it may be the last word."""
    print(f"{_READING}{layer}", file=sys.stderr, flush=True)


def unreadable(error: Ended, root: Path) -> Problem:
    """A process that was ended by what it read, as a problem of the layer that it read last."""
    read = [line.removeprefix(_READING) for line in error.words.splitlines() if line.startswith(_READING)]
    message = f"reading it does not end well: {error.why}"
    hint = "it is damaged, or far too large; write it anew, as text if that is possible"
    return Problem(code="unreadable", message=message, file=shown_path((read or [str(root)])[-1]), line=1, hint=hint)
