"""Plan of a build: the tasks that would run and the reasons, as data and as text. Nothing is run."""

import enum
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import asdict, dataclass, replace
from typing import Any

from pipeline.edits import Edit
from pipeline.engine.digest import canonical, canonical_dict, key_of_bytes
from pipeline.engine.planning.graph import Task, TaskGraph
from pipeline.engine.planning.task_code import Modules, cached_parsing, code_of
from pipeline.engine.records import KEY_DOMAIN, Components, Record, Spec, fields_of
from pipeline.engine.store.store import Store
from pipeline.machine.facts import facts_of_workers
from pipeline.records.plain import Json

_LONGEST = 72
"""Longest value in a text [characters]: with the words before it, one line of a terminal."""


class ReasonType(enum.StrEnum):
    """Kind of reason for a task to run, or perhaps to run."""

    NEW = "new"
    CHANGED = "changed"
    MISSING = "missing"
    UPSTREAM = "upstream"
    FORCED = "forced"


@dataclass(frozen=True, slots=True, kw_only=True)
class Reason:
    """Reason for a task to run.

    `field`: for `changed`, the component of the key (`params.pose`); for `missing`, the output, or `record`; for
    `upstream`, the task that must run first. `old`, `new`: for `changed`, the component at the last build of this task,
    and now.
    `edits`: the source edits that caused this reason, if they are recorded; see `app.why`.
    """

    type: ReasonType
    field: str | None = None
    old: Any = None
    new: Any = None
    edits: tuple[Edit, ...] = ()

    def __str__(self) -> str:
        match self.type:
            case ReasonType.CHANGED if self.field == "code":
                return "code changed"
            case ReasonType.CHANGED:
                return f"{self.field}: {_short(self.old)} -> {_short(self.new)}"
            case ReasonType.MISSING:
                return f"missing in the store: {self.field}"
            case ReasonType.UPSTREAM:
                return f"{self.field} must run first"
            case ReasonType.NEW:
                return "never built"
        return "forced"


@dataclass(frozen=True, slots=True, kw_only=True)
class PlannedTask:
    """A task of a plan: cached, run, or maybe, if early cutoff may save it; its spec is then undetermined."""

    name: str
    kind: str
    state: str
    reasons: tuple[Reason, ...] = ()
    spec: Spec | None = None

    @property
    def key(self) -> str | None:
        return self.spec.key if self.spec else None

    @property
    def edits(self) -> tuple[Edit, ...]:
        """The edits behind all reasons, each once."""
        return tuple({(edit.subject, edit.time): edit for reason in self.reasons for edit in reason.edits}.values())

    def to_dict(self) -> Json:
        """Plain data, as in `plan --json`."""
        facts = {"name": self.name, "kind": self.kind, "state": self.state, "key": self.key}
        return {**facts, "reasons": [asdict(reason) for reason in self.reasons]}


class Specs:
    """Maker of specs, which reads and encodes the code of every kind once."""

    def __init__(self, store: Store) -> None:
        self._store = store
        self._modules: Modules = {}
        self._code: dict[str, tuple[Components, dict[str, bytes]]] = {}

    def of(self, task: Task, records: Mapping[str, Record]) -> Spec:
        """Spec of a task whose sources all have records."""
        if task.kind not in self._code:
            with cached_parsing(self._store):
                code = code_of(task.kind, self._modules, facts_of_workers)
            encoded = {name: canonical(value) for name, value in fields_of(code).items()}
            self._code[task.kind] = code, encoded
        code, encoded = self._code[task.kind]
        inputs = {
            role: {output: blob.sha256 for output, blob in records[source].outputs.items()}
            for role, source in task.reads.items()
        }
        key_bytes = canonical_dict({**encoded, "params": task.canonical, "inputs": canonical(inputs)})
        components = replace(code, params=task.params, inputs=inputs)
        return Spec(name=task.name, key=key_of_bytes(KEY_DOMAIN, key_bytes), components=components)


def plan(
    graph: TaskGraph, store: Store, last_keys: Mapping[str, str], *, force: Iterable[str] = ()
) -> list[PlannedTask]:
    """State of every task, sources before their readers.

    `last_keys` are those of the last build into the same output folder, `force` names tasks that run in any case. A
    task without a result makes its readers uncertain: it may write the same bytes as before.
    """
    specs = Specs(store)
    forced = set(force)
    records: dict[str, Record] = {}
    planned = []

    def last_record(name: str) -> Record | None:
        return store.peek(last_keys[name]) if name in last_keys else None

    for name in graph:
        task = graph[name]
        must_run = [source for source in graph.sources(name) if source not in records]
        if must_run:
            last = last_record(name)
            reasons = [Reason(type=ReasonType.UPSTREAM, field=source) for source in must_run]
            reasons += differences(last.components.params, task.params, "params") if last else []
            planned.append(_planned(task, "maybe", None, reasons))
            continue
        spec = specs.of(task, records)
        incomplete = store.peek(spec.key)
        record = store.complete(incomplete)
        if record is not None and name not in forced:
            records[name] = record
            planned.append(_planned(task, "cached", spec, []))
            continue
        reasons = [Reason(type=ReasonType.FORCED)] if name in forced else []
        if record is None:
            reasons += _why_missing(spec, name in last_keys, last_record(name), incomplete, store)
        planned.append(_planned(task, "run", spec, reasons))
    return planned


def _planned(task: Task, state: str, spec: Spec | None, reasons: list[Reason]) -> PlannedTask:
    return PlannedTask(name=task.name, kind=task.short_kind, state=state, reasons=tuple(reasons), spec=spec)


def _why_missing(
    spec: Spec, was_built: bool, last: Record | None, incomplete: Record | None, store: Store
) -> list[Reason]:
    """Reasons why the store has no result of a task: its record lacks outputs, it was never built, the record of its
    last build is lost, or parts of its key have changed since.
    """
    if incomplete is not None:
        missing = [name for name, blob in incomplete.outputs.items() if not store.is_whole(blob)]
        return [Reason(type=ReasonType.MISSING, field=name) for name in missing]
    if not was_built:
        return [Reason(type=ReasonType.NEW)]
    if last is None:
        return [Reason(type=ReasonType.MISSING, field="record")]
    old = fields_of(last.components)
    new = fields_of(spec.components)
    if old["kind"] != new["kind"]:  # other code and libraries follow from that
        old, new = ({**parts, "code": "", "libraries": {}, "machine": {}} for parts in (old, new))
    return list(differences(old, new))


def differences(old: Any, new: Any, path: str = "") -> Iterator[Reason]:
    """Differing components of two plain values at a dotted path, each with its own."""
    if old == new:
        return
    if isinstance(old, dict) and isinstance(new, dict):
        for name in sorted(old.keys() | new.keys()):
            yield from differences(old.get(name), new.get(name), f"{path}.{name}" if path else name)
    elif isinstance(old, list) and isinstance(new, list) and len(old) == len(new):
        for index, (old_item, new_item) in enumerate(zip(old, new, strict=True)):
            yield from differences(old_item, new_item, f"{path}[{index}]")
    else:
        yield Reason(type=ReasonType.CHANGED, field=path, old=old, new=new)


def _short(value: Any) -> str:
    """A value as one line shows it: of a digest the beginning, of a long text the first `_LONGEST` characters."""
    text = value[:12] if isinstance(value, str) and len(value) == 64 else repr(value)
    return text if len(text) <= _LONGEST else f"{text[: _LONGEST - 2]} …"
