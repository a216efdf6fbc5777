"""Specs of tasks: a task, the records of its inputs and its key, as complete plain data without the graph."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from pipeline.engine.digest import canonical, canonical_dict, key_of_bytes
from pipeline.engine.planning.graph import Task
from pipeline.engine.planning.task_code import Modules, code_of, remembering
from pipeline.engine.store.store import Store
from pipeline.machine.facts import facts_of_workers

Record = dict[str, Any]

KEY_DOMAIN = "task/v1"


@dataclass(frozen=True, slots=True, kw_only=True)
class Spec:
    """A task ready to run.

    Attributes
    ----------
    key : str
        `key_of(KEY_DOMAIN, components)`.
    components : dict
        All parts of the key; kept in the record, so that a rerun can be explained.
    """

    name: str
    key: str
    components: dict[str, Any]

    def to_plain(self) -> dict[str, Any]:
        """The spec as plain values for another process."""
        return {"name": self.name, "key": self.key, "components": self.components}


class Specs:
    """Maker of specs, which reads and encodes the code of every kind once."""

    def __init__(self, store: Store) -> None:
        self._store = store
        self._modules: Modules = {}
        self._code: dict[str, tuple[dict[str, Any], dict[str, bytes]]] = {}

    def of(self, task: Task, records: Mapping[str, Record]) -> Spec:
        """Spec of a task whose sources all have records."""
        if task.kind not in self._code:
            with remembering(self._store):
                code = {"kind": task.kind, **code_of(task.kind, self._modules, facts_of_workers)}
            self._code[task.kind] = code, {name: canonical(value) for name, value in code.items()}
        code, encoded = self._code[task.kind]
        inputs = {
            role: {output: entry["sha256"] for output, entry in records[source]["outputs"].items()}
            for role, source in task.reads.items()
        }
        whole = canonical_dict({**encoded, "params": task.canonical, "inputs": canonical(inputs)})
        components = {**code, "params": task.params, "inputs": inputs}
        return Spec(name=task.name, key=key_of_bytes(KEY_DOMAIN, whole), components=components)
