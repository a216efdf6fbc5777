"""Status of an output folder: which of its files hold what a build of the stage, as it is now, would put there.

It is read from the folder and the store only, so no task is ever shown as running.
"""

import hashlib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from pipeline.engine.output.deliver import Source
from pipeline.engine.output.manifest import Manifest
from pipeline.engine.output.output_index import Seen
from pipeline.engine.planning.plan import PlannedTask
from pipeline.engine.store.store import Store


@dataclass(frozen=True, slots=True, kw_only=True)
class Status:
    """State of each file by path (built, missing, or stale: other bytes are there), and whether there is a manifest."""

    files: dict[str, str]
    has_manifest: bool


def status(
    planned: Iterable[PlannedTask], files: Mapping[str, Source], there: Manifest, seen: Seen, store: Store
) -> Status:
    """Compare the files of a folder, whose manifest and index are given, with the results that a plan finds."""
    tasks = {task.name: task for task in planned}
    records = {name: store.peek(task.key) for name, task in tasks.items() if task.key and task.state == "cached"}

    def wanted(path: str, source: Source) -> str | None:
        if isinstance(source, bytes):
            return hashlib.sha256(source).hexdigest()
        if record := records.get(source[0]):
            return record.outputs[source[1]].sha256
        # The store may have lost what the folder still has.
        is_same = there.tasks.get(source[0], "") == tasks[source[0]].key
        return there.files[path].sha256 if is_same and path in there.files else None

    def state(path: str, source: Source) -> str:
        found = seen.digest(path)
        return "missing" if found is None else "built" if found == wanted(path, source) else "stale"

    states = {path: state(path, source) for path, source in sorted(files.items())}
    return Status(files=states, has_manifest=there.data is not None)
