"""The driver loop, the same for every engine: look up results, submit the missing tasks, collect the replies."""

import contextlib
import heapq
import math
from collections import Counter
from dataclasses import dataclass, field
from typing import Any

from pipeline.engine.events import warner
from pipeline.engine.interrupts import Interrupts
from pipeline.engine.options import ALONE, NOBODY, NOTHING, BuildOptions, Caller, Known
from pipeline.engine.planning.graph import TaskGraph
from pipeline.engine.planning.task_spec import Record, Spec, Specs
from pipeline.engine.running.engines import Engine, Inline, Processes
from pipeline.engine.running.execute import failed
from pipeline.engine.running.memory import Budget, available_bytes
from pipeline.engine.store.store import Store
from pipeline.machine.processor import pin

MAX_DEATHS = 3
"""Number of workers that may die in one task before it counts as failed."""
MAX_COMPANY = 8
"""Most tasks that run together to share work: with so many the shared part is cheap, and a dying worker costs all of
them.
"""
_TICK_S = 0.25
"""Longest time until the loop notices a signal [s]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class TaskResult:
    """The end of a task.

    Attributes
    ----------
    state : str
        executed, cached (or computed meanwhile by another builder), failed or skipped.
    seconds : float
        Wall time spent now; 0 when cached [s].
    key : str or None
        None if the task was skipped before its inputs were known.
    machine : bool
        Whether it failed because of the machine (disk full, …).
    place : str or None
        Place in the stage of the subject of a failed task, such as its camera.
    spec : str or None
        For a failed task, the file from which `pipeline run-task` repeats it.
    differs : tuple of str
        Outputs that differ from earlier ones with the same key.
    peak_bytes : int or None
        Peak memory of its process, if it ran now.
    made_by : dict or None
        Facts in its record about the run that made it, this one or an earlier one.
    """

    name: str
    kind: str
    state: str
    seconds: float = 0.0
    key: str | None = None
    error: str | None = None
    log: str | None = None
    machine: bool = False
    place: str | None = None
    spec: str | None = None
    differs: tuple[str, ...] = ()
    peak_bytes: int | None = None
    made_by: dict[str, Any] | None = None

    def to_dict(self) -> dict[str, Any]:
        """The result as in the summary of a build."""
        facts = {"name": self.name, "kind": self.kind, "state": self.state, "seconds": self.seconds, "key": self.key}
        if self.state == "failed":
            facts |= {"error": self.error, "log": self.log, "place": self.place, "spec": self.spec}
        return {**facts, "differs": list(self.differs)} if self.differs else facts


@dataclass(slots=True, kw_only=True)
class Outcome:
    """Results and records by task name, and whether Ctrl-C ended the run.

    `peaks` holds the peak memory of each kind of task in this run [bytes]; `checked` lists tasks that ran twice.
    """

    results: dict[str, TaskResult] = field(default_factory=dict)
    records: dict[str, Record] = field(default_factory=dict)
    interrupted: bool = False
    peaks: dict[str, int] = field(default_factory=dict)
    checked: tuple[str, ...] = ()


def run(
    graph: TaskGraph,
    store: Store,
    options: BuildOptions = ALONE,
    *,
    engine: Engine | None = None,
    caller: Caller = NOBODY,
    known: Known = NOTHING,
) -> Outcome:
    """Bring the results of all tasks of a graph into the store.

    Parameters
    ----------
    options : BuildOptions
        Workers, treatment of failures, and forced tasks (by name). The driver ignores the other options.
    engine : Engine, optional
        Engine to use instead of the one that `options` ask for; it is closed at the end.
    """
    if engine is None:
        inline = options.workers <= 1 and options.timeout_s is None and pin()
        workers = Processes(store, graph.packages, options.workers, timeout_s=options.timeout_s)
        engine = Inline(store, graph.packages) if inline else workers
    driver = _Driver(graph, store, engine, options, caller, known)
    with contextlib.ExitStack() as stack:
        interrupts = caller.interrupts or stack.enter_context(Interrupts(warner(caller.on_event)))
        stack.callback(engine.close)
        with interrupts.stopping():
            driver.loop(interrupts)
    driver.outcome.interrupted = interrupts.arrived
    return driver.finish()


class _Driver:
    def __init__(
        self, graph: TaskGraph, store: Store, engine: Engine, options: BuildOptions, caller: Caller, known: Known
    ) -> None:
        self.graph, self.store, self.engine, self.options = graph, store, engine, options
        self.on_event, self.prepare = caller.on_event, caller.prepare
        self.places, self.budget = known.places, Budget(available_bytes(), known.peaks)
        self.outcome = Outcome()
        self._forced = set(options.force)
        self._specs = Specs(store)
        self._running: dict[str, Spec] = {}
        self._healed: set[str] = set()
        self._failures: Counter[str] = Counter()
        self._deaths: Counter[str] = Counter()
        self._alone: set[str] = set()  # tasks that lacked memory: nothing runs beside them
        self._company: dict[str, list[str]] = {}  # tasks that were given to a worker together with another one
        self._apart: set[str] = set()  # tasks whose worker died while they ran together with others
        self._missing = {name: len(graph.sources(name)) for name in graph}  # sources that have no record yet
        self._priority = graph.priorities()
        self._ready: list[tuple[int, str]] = []
        self._broken = False  # the machine is at fault: more tasks would fail the same way
        for name in graph:
            self._queue_if_ready(name)

    def loop(self, interrupts: Interrupts) -> None:
        while True:
            may_go_on = self.options.keep_going or not self._failed()
            going = not (interrupts.arrived or self._broken) and may_go_on
            while going and self._ready and self.engine.free and self._may_start(self._ready[0][1]):
                self._take(heapq.heappop(self._ready)[1])
            interrupts.is_patient = bool(self._running)
            if not self._running and not (going and self._ready):
                return
            for reply in self.engine.wait(_TICK_S):
                self._collect(reply)
            if interrupts.arrived:
                for name in self.engine.drop_waiting():
                    for other in (name, *self._company.pop(name, ())):
                        del self._running[other]

    def _may_start(self, name: str) -> bool:
        if self._alone & self._running.keys() or (name in self._alone and self._running):
            return False
        kinds = (self.graph[other].short_kind for other in self._running)
        return self.budget.fits(self.graph[name].short_kind, kinds)

    def finish(self) -> Outcome:
        self.outcome.peaks = self.budget.peaks
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
        return open_yet and not self._missing[name]

    def _take(self, name: str) -> None:
        spec = self._spec_to_run(name)
        if spec is None:
            return
        if self.prepare is not None:
            self.prepare()
            self.prepare = None
        company = [found for found in map(self._spec_to_run, self._companions(name)) if found is not None]
        company = [other for other in company if other.components["inputs"] == spec.components["inputs"]]
        for one in (spec, *company):
            self._running[one.name] = one
            kind = self.graph[one.name].short_kind
            self.on_event({"event": "started", "task": one.name, "kind": kind, "key": one.key})
        message = self._message(spec)
        if company:
            self._company[name] = [other.name for other in company]
            message["company"] = list(map(self._message, company))
        self.engine.submit(message)

    def _message(self, spec: Spec) -> dict[str, Any]:
        return {**spec.to_plain(), "force": spec.name in self._forced}

    def _companions(self, name: str) -> list[str]:
        """Tasks to run together with one because they share work; not so many that a free worker is left without a
        task.
        """
        together, timed = self.graph[name].together, self.options.timeout_s is not None
        if together is None or timed or name in self._apart:  # the time of each could not be measured
            return []
        ready = {other for _, other in self._ready if self._is_ready(other)} - {name}
        alike = sorted(other for other in ready - self._apart if self.graph[other].together == together)
        idle = max(1, self.engine.free - (len(ready) - len(alike)))
        return alike[: min(MAX_COMPANY, math.ceil((1 + len(alike)) / idle)) - 1]

    def _spec_to_run(self, name: str) -> Spec | None:
        """The spec of a task that has to run. None if its result exists; then the task is settled."""
        if not self._is_ready(name):  # queued twice, or an input was lost meanwhile: `_heal` queues it again
            return None
        task = self.graph[name]
        spec = self._specs.of(task, self.outcome.records)
        record = None if name in self._forced else self.store.record(spec.key)
        if record is not None:
            found = TaskResult(name=name, kind=task.short_kind, state="cached", key=spec.key, made_by=record["made_by"])
            self._settle(found, record)
            return None
        return spec

    def _collect(self, reply: dict[str, Any]) -> None:
        for text in reply.get("warnings", ()):
            self.on_event({"event": "warning", "text": text})
        if reply["state"] == "waiting":
            return
        company = self._company.pop(reply["name"], [])
        if company and "company" not in reply:  # the worker died or could not begin: any of them may be the cause
            self._part([reply["name"], *company], reply)
            return
        for one in (reply, *reply.get("company", ())):
            self._collect_one(one)

    def _part(self, names: list[str], reply: dict[str, Any]) -> None:
        """Queue tasks that failed together again, each alone."""
        self._apart.update(names)
        for name in names:
            del self._running[name]
            self.on_event({"event": "retry", "task": name, "error": f"{reply['error']}; it runs alone now"})
            self._queue_if_ready(name)

    def _collect_one(self, reply: dict[str, Any]) -> None:
        name = reply["name"]
        spec = self._running.pop(name)
        if reply.get("damaged") and name not in self._healed:
            self._heal(name)
        elif reply["state"] == "lost":
            self._bury(name, spec, reply)
        elif reply["state"] == "failed" and self._try_again(name, reply):
            self._queue_if_ready(name)
        else:
            self._finish(name, spec, reply)

    def _finish(self, name: str, spec: Spec, reply: dict[str, Any]) -> None:
        facts: dict[str, Any] = {field: reply[field] for field in ("error", "log", "machine") if field in reply}
        self._broken = self._broken or bool(reply.get("machine"))
        kind, record = self.graph[name].short_kind, reply.get("record")
        if reply["state"] == "failed":
            facts["place"] = self.places.get(name.split("/")[1]) if "/" in name else None
            facts["spec"] = self.store.keep_spec(spec.key, spec.to_plain())
        if record is not None:
            facts["made_by"] = record["made_by"]
        if reply["state"] == "executed" and record is not None:
            facts["peak_bytes"] = record["made_by"].get("peak_bytes", 0)
            self.budget.learn(kind, facts["peak_bytes"])
            facts["differs"] = tuple(reply.get("differs", ()))
        seconds = reply["seconds"] if reply["state"] != "cached" else 0.0
        self._settle(
            TaskResult(name=name, kind=kind, state=reply["state"], seconds=seconds, key=spec.key, **facts), record
        )

    def _bury(self, name: str, spec: Spec, reply: dict[str, Any]) -> None:
        """Handle the death of a worker: either the task kills workers, or it lacked memory beside other tasks."""
        self._deaths[name] += 1
        if self._deaths[name] < MAX_DEATHS:
            if reply["memory"]:
                self._alone.add(name)
            self.on_event({"event": "retry", "task": name, "error": reply["error"]})
            self._queue_if_ready(name)
            return
        hint = "; out of memory looks like this, and it ran alone the last time" if reply["memory"] else ""
        text = f"{reply['error']}, {MAX_DEATHS} times{hint}"
        self._finish(name, spec, failed(name, spec.key, text, self.store))

    def _try_again(self, name: str, reply: dict[str, Any]) -> bool:
        """Queue a failed task again if it has tries left; whether it has."""
        short_of_memory = reply["memory"] and name not in self._alone
        if short_of_memory:
            self._alone.add(name)
        elif self._failures[name] < self.options.retries and not reply["machine"]:
            self._failures[name] += 1
        else:
            return False
        self.on_event({"event": "retry", "task": name, "error": reply["error"]})
        return True

    def _settle(self, result: TaskResult, record: Record | None = None) -> None:
        self.outcome.results[result.name] = result
        usual = record["made_by"].get("seconds") if record else None  # for estimates
        facts = {**result.to_dict(), "usual_seconds": usual, "peak_bytes": result.peak_bytes}
        if record is not None and "news" in record["made_by"]:
            facts["news"] = record["made_by"]["news"]
        self.on_event({"event": "done", "task": result.name, **facts})
        if record is not None:
            self.outcome.records[result.name] = record
            for reader in self.graph.readers(result.name):
                self._missing[reader] -= 1
                self._queue_if_ready(reader)

    def _heal(self, name: str) -> None:
        """Handle an input that was damaged between lookup and use: make it again, then try the task once more."""
        self._healed.add(name)
        for source in self.graph.sources(name):
            result = self.outcome.results[source]
            if result.key is not None and self.store.record(result.key) is None:
                del self.outcome.records[source], self.outcome.results[source]
                for reader in self.graph.readers(source):
                    self._missing[reader] += 1
                self._queue_if_ready(source)
        self._queue_if_ready(name)
