"""Trial reading of binary layers in a process that may crash: USD trusts the offsets in them, and wrong ones can be
fatal.

Text layers are safe once `layer_files` has counted their brackets; so only stages with a usdc or usdz need this.
"""

import sys
from collections.abc import Iterator
from pathlib import Path

from pipeline.confine.process import Bounds, Ended, ask
from pipeline.roots import readable_for
from pipeline.scene.usd.problems import Problem, shown_path

_READING = "reading: "
BOUNDS = Bounds(cpu_s=20, wall_s=60)
"""Time limits for a stage with binary layers: `check` should end within seconds; a busy machine takes longer by the
clock.
"""


def trial(root: Path, roots: list[Path]) -> Iterator[Problem]:
    """The errors found by the process that read the stage, or the problem that it crashed."""
    question = {"path": str(root), "roots": [str(one) for one in roots]}
    try:
        found, _ = ask("pipeline.scene.load:attempt", question, readable_for(roots), BOUNDS)
        yield from (Problem(**row) for row in found)
    except Ended as error:
        yield unreadable(error, root)


def announce(layer: str) -> None:
    """Note the layer that USD is about to read, in the log of a confined process: it may be the last entry."""
    print(f"{_READING}{layer}", file=sys.stderr, flush=True)


def unreadable(error: Ended, root: Path) -> Problem:
    """The crash of a process as a problem of the layer that it read last."""
    read = [line.removeprefix(_READING) for line in error.words.splitlines() if line.startswith(_READING)]
    message = f"reading it does not end well: {error.why}"
    hint = "it is damaged, or far too large; write it anew, as text if that is possible"
    return Problem(code="unreadable", message=message, file=shown_path((read or [str(root)])[-1]), line=1, hint=hint)
