"""From a task and the records of what it reads to its key: plain data, complete, independent of the graph."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from pipeline.engine.code import code_of
from pipeline.engine.digest import key_of
from pipeline.engine.graph import Task

Record = dict[str, Any]

KEY_DOMAIN = "task/v1"


@dataclass(frozen=True, slots=True, kw_only=True)
class Spec:
    """A task ready to run.

    Attributes
    ----------
    components : dict
        Everything the key is made of; kept in the record, so that a rerun can be explained.
    """

    name: str
    key: str
    components: dict[str, Any]

    def to_plain(self) -> dict[str, Any]:
        """What crosses a process border."""
        return {"name": self.name, "key": self.key, "components": self.components}


class Specs:
    """Makes specs, reading the code of every kind once."""

    def __init__(self) -> None:
        self._code: dict[str, dict[str, Any]] = {}

    def of(self, task: Task, records: Mapping[str, Record]) -> Spec:
        """Spec of a task whose sources all have records."""
        if task.kind not in self._code:
            self._code[task.kind] = code_of(task.kind)
        inputs = {
            role: {output: entry["sha256"] for output, entry in records[source]["outputs"].items()}
            for role, source in task.reads.items()
        }
        components = {"kind": task.kind, **self._code[task.kind], "params": task.params, "inputs": inputs}
        return Spec(name=task.name, key=key_of(KEY_DOMAIN, components), components=components)
