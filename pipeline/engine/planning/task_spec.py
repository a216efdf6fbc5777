"""Specs of tasks: a task, the records of its inputs and its key, complete without the graph."""

from collections.abc import Mapping
from dataclasses import replace

from pipeline.engine.digest import canonical, canonical_dict, key_of_bytes
from pipeline.engine.planning.graph import Task
from pipeline.engine.planning.task_code import Modules, code_of, remembering
from pipeline.engine.records import KEY_DOMAIN, Components, Record, Spec, fields_of
from pipeline.engine.store.store import Store
from pipeline.machine.facts import facts_of_workers


class Specs:
    """Maker of specs, which reads and encodes the code of every kind once."""

    def __init__(self, store: Store) -> None:
        self._store = store
        self._modules: Modules = {}
        self._code: dict[str, tuple[Components, dict[str, bytes]]] = {}

    def of(self, task: Task, records: Mapping[str, Record]) -> Spec:
        """Spec of a task whose sources all have records."""
        if task.kind not in self._code:
            with remembering(self._store):
                code = code_of(task.kind, self._modules, facts_of_workers)
            self._code[task.kind] = code, {name: canonical(value) for name, value in fields_of(code).items()}
        code, encoded = self._code[task.kind]
        inputs = {
            role: {output: blob.sha256 for output, blob in records[source].outputs.items()}
            for role, source in task.reads.items()
        }
        whole = canonical_dict({**encoded, "params": task.canonical, "inputs": canonical(inputs)})
        components = replace(code, params=task.params, inputs=inputs)
        return Spec(name=task.name, key=key_of_bytes(KEY_DOMAIN, whole), components=components)
