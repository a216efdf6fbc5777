"""Status of a dataset: which of its files are finished in the output folder.

It is read from the folder and the store only, so no task is ever shown as running.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

from pipeline.engine.output import manifest
from pipeline.engine.output.deliver import Source
from pipeline.engine.planning.plan import PlannedTask


@dataclass(frozen=True, slots=True, kw_only=True)
class TaskStatus:
    """A task and its state: built, stale (another version of it was delivered) or missing."""

    name: str
    kind: str
    state: str

    def to_dict(self) -> dict[str, str]:
        """Plain data, as in `status --json`."""
        return {"name": self.name, "kind": self.kind, "state": self.state}


def status(planned: Iterable[PlannedTask], files: Mapping[str, Source], out: Path) -> list[TaskStatus]:
    """State of every task of a plan, from the manifest of `out` and the files that exist."""
    there = manifest.read(out)
    incomplete = {
        source[0] for path, source in files.items() if not isinstance(source, bytes) and not _is_there(path, there, out)
    }
    return [
        TaskStatus(name=task.name, kind=task.kind, state=_state(task, there, task.name in incomplete))
        for task in planned
    ]


def _state(task: PlannedTask, there: manifest.Manifest, incomplete: bool) -> str:
    if task.name not in there.tasks or (incomplete and there.tasks[task.name] == task.key):
        return "missing"
    return "built" if there.tasks[task.name] == task.key else "stale"


def _is_there(path: str, there: manifest.Manifest, out: Path) -> bool:
    try:
        return path in there.files and (out / path).lstat().st_size == there.files[path]["size"]
    except OSError:
        return False
