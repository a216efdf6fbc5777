"""The one driver loop, whatever the engine: look up, submit what is missing, collect."""

import heapq
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from typing import Any

from pipeline.engine.engines import Engine, Inline, Processes
from pipeline.engine.events import Emit, silent
from pipeline.engine.graph import TaskGraph
from pipeline.engine.interrupts import Interrupts, Stopped
from pipeline.engine.spec import Record, Spec, Specs
from pipeline.engine.store import Store

_TICK_S = 0.25  # how long a signal may wait for the loop


@dataclass(frozen=True, slots=True, kw_only=True)
class TaskResult:
    """What became of a task.

    Attributes
    ----------
    state : str
        executed, cached (also: computed meanwhile by another builder), failed or skipped.
    seconds : float
        Wall time spent now; 0 when cached [s].
    key : str or None
        None if the task was skipped before its inputs were known.
    machine : bool
        Whether the machine (disk full, …) made it fail.
    """

    name: str
    kind: str
    state: str
    seconds: float = 0.0
    key: str | None = None
    error: str | None = None
    log: str | None = None
    machine: bool = False

    def to_dict(self) -> dict[str, Any]:
        """As in the summary of a build."""
        facts = {"name": self.name, "kind": self.kind, "state": self.state, "seconds": self.seconds, "key": self.key}
        return {**facts, "error": self.error, "log": self.log} if self.state == "failed" else facts


@dataclass(slots=True, kw_only=True)
class Outcome:
    """Results by task name, records of what is there, and the signal that ended the run, if one did."""

    results: dict[str, TaskResult] = field(default_factory=dict)
    records: dict[str, Record] = field(default_factory=dict)
    interrupted: int | None = None


def run(
    graph: TaskGraph,
    store: Store,
    *,
    jobs: int = 1,
    keep_going: bool = False,
    force: Iterable[str] = (),
    on_event: Emit = silent,
    prepare: Callable[[], None] | None = None,
) -> Outcome:
    """Make every task of a graph be in the store.

    Parameters
    ----------
    jobs : int
        1 runs tasks in this process, more in as many worker processes.
    keep_going : bool
        After a failure go on with tasks that do not need the failed one.
    force : iterable of str
        Names of tasks that run even though the store has them.
    prepare : callable, optional
        Called once in this process before the first task runs, and not at all if none has to.
    """
    engine: Engine = Inline(store, graph.packages) if jobs <= 1 else Processes(store, graph.packages, jobs)
    driver = _Driver(graph, store, engine, keep_going=keep_going, force=set(force), on_event=on_event, prepare=prepare)
    with Interrupts(lambda text: on_event({"event": "warning", "text": text})) as interrupts:
        try:
            driver.loop(interrupts)
        except Stopped:
            pass
        finally:
            engine.close()
    driver.outcome.interrupted = interrupts.exit_code
    return driver.finish()


class _Driver:
    def __init__(
        self,
        graph: TaskGraph,
        store: Store,
        engine: Engine,
        *,
        keep_going: bool,
        force: set[str],
        on_event: Emit,
        prepare: Callable[[], None] | None,
    ) -> None:
        self.graph, self.store, self.engine = graph, store, engine
        self.keep_going, self.force, self.on_event, self.prepare = keep_going, force, on_event, prepare
        self.outcome = Outcome()
        self._specs = Specs()
        self._running: dict[str, Spec] = {}
        self._retried: set[str] = set()
        self._priority = graph.priorities()
        self._ready: list[tuple[int, str]] = []
        self._broken = False  # the machine is at fault: more tasks would fail the same way
        for name in graph:
            self._queue_if_ready(name)

    def loop(self, interrupts: Interrupts) -> None:
        while True:
            going = interrupts.signal is None and not self._broken and (self.keep_going or not self._failed())
            while going and self._ready and self.engine.free:
                self._take(heapq.heappop(self._ready)[1])
            if not self._running and not (going and self._ready):
                return
            for reply in self.engine.wait(_TICK_S):
                self._collect(reply)

    def finish(self) -> Outcome:
        for name in self.graph:
            if name not in self.outcome.results:
                self._settle(TaskResult(name=name, kind=self.graph[name].short_kind, state="skipped"))
        return self.outcome

    def _failed(self) -> bool:
        return any(result.state == "failed" for result in self.outcome.results.values())

    def _queue_if_ready(self, name: str) -> None:
        if self._is_ready(name):
            heapq.heappush(self._ready, (-self._priority[name], name))

    def _is_ready(self, name: str) -> bool:
        open_yet = name not in self.outcome.results and name not in self._running
        return open_yet and all(source in self.outcome.records for source in self.graph.sources(name))

    def _take(self, name: str) -> None:
        if not self._is_ready(name):  # queued twice, or an input was lost meanwhile: `_heal` queues it again
            return
        task = self.graph[name]
        spec = self._specs.of(task, self.outcome.records)
        record = None if name in self.force else self.store.record(spec.key)
        if record is not None:
            self._settle(TaskResult(name=name, kind=task.short_kind, state="cached", key=spec.key), record)
            return
        if self.prepare is not None:
            self.prepare()
            self.prepare = None
        self._running[name] = spec
        self.on_event({"event": "started", "task": name, "kind": task.short_kind, "key": spec.key})
        self.engine.submit({**spec.to_plain(), "force": name in self.force})

    def _collect(self, reply: dict[str, Any]) -> None:
        name = reply["name"]
        spec = self._running.pop(name)
        for text in reply.get("warnings", ()):
            self.on_event({"event": "warning", "text": text})
        if reply.get("damaged") and name not in self._retried:
            self._heal(name)
            return
        failure = {field: reply[field] for field in ("error", "log", "machine") if field in reply}
        self._broken = self._broken or bool(reply.get("machine"))
        kind = self.graph[name].short_kind
        seconds = reply["seconds"] if reply["state"] != "cached" else 0.0
        result = TaskResult(name=name, kind=kind, state=reply["state"], seconds=seconds, key=spec.key, **failure)
        self._settle(result, reply.get("record"))

    def _settle(self, result: TaskResult, record: Record | None = None) -> None:
        self.outcome.results[result.name] = result
        usual = record["made_by"]["seconds"] if record else None  # for estimates
        self.on_event({"event": "done", "task": result.name, **result.to_dict(), "usual_seconds": usual})
        if record is not None:
            self.outcome.records[result.name] = record
            for reader in self.graph.readers(result.name):
                self._queue_if_ready(reader)

    def _heal(self, name: str) -> None:
        """An input went bad between lookup and use: make it again, then try the task once more."""
        self._retried.add(name)
        for source in self.graph.sources(name):
            result = self.outcome.results[source]
            if result.key is not None and self.store.record(result.key) is None:
                del self.outcome.records[source], self.outcome.results[source]
                self._queue_if_ready(source)
        self._queue_if_ready(name)
