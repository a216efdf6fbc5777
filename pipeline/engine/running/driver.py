"""The driver loop, shared by all engines: look up results, submit the missing tasks, collect the replies."""

import contextlib
import heapq
import math
from collections import Counter
from dataclasses import dataclass, field, replace

from pipeline.engine.events import Done, Retried, Started, Warned, warner
from pipeline.engine.interrupts import Interrupts
from pipeline.engine.options import ALONE, NOBODY, BuildOptions, Caller
from pipeline.engine.planning.graph import TaskGraph
from pipeline.engine.planning.plan import Specs
from pipeline.engine.records import Record, Reply, Spec, TaskResult
from pipeline.engine.running.engines import Engine, Inline, Job, Processes
from pipeline.engine.running.execute import failed
from pipeline.engine.store.store import Store
from pipeline.machine.facts import available_bytes
from pipeline.machine.processor import pin

MAX_DEATHS = 3
"""Number of workers that may die in one task before it counts as failed."""
MAX_COMPANY = 8
"""Most tasks that run together to share work: with eight, the shared part is cheap, and a dying worker costs all of
them.
"""
_TICK_S = 0.25
"""Longest time until the loop notices a signal [s]."""


@dataclass(slots=True, kw_only=True)
class Outcome:
    """Results and records by task, and the tasks that ran twice; whether Ctrl-C ended the run."""

    results: dict[str, TaskResult] = field(default_factory=dict)
    records: dict[str, Record] = field(default_factory=dict)
    interrupted: bool = False
    checked: tuple[str, ...] = ()

    @property
    def ran(self) -> dict[str, TaskResult]:
        """Results of the tasks that were not in the store."""
        return {name: task for name, task in self.results.items() if task.state in ("executed", "failed")}


def run(
    graph: TaskGraph,
    store: Store,
    options: BuildOptions = ALONE,
    *,
    engine: Engine | None = None,
    caller: Caller = NOBODY,
    before: Outcome | None = None,
) -> Outcome:
    """Bring the results of all tasks of a graph into the store.

    Of the options, workers, treatment of failures, and forced tasks (by name) are used. An `engine` replaces that of
    the options, and is closed at the end. `before` has the tasks of the graph that an earlier run has settled.
    """
    if engine is None:
        inline = options.workers <= 1 and options.timeout_s is None and pin()
        workers = Processes(store, graph.packages, options.workers, timeout_s=options.timeout_s)
        engine = Inline(store, graph.packages) if inline else workers
    driver = _Driver(graph, store, engine, options, caller)
    if before is not None:
        driver.outcome = replace(before, results=dict(before.results), records=dict(before.records))
    with contextlib.ExitStack() as stack:
        interrupts = caller.interrupts or stack.enter_context(Interrupts(warner(caller.on_event)))
        stack.callback(engine.close)
        with interrupts.stopping():
            driver.loop(interrupts)
    driver.outcome.interrupted = interrupts.arrived
    return driver.finish()


class _Driver:
    """The state of a run: tasks that are ready, running, and done."""

    def __init__(self, graph: TaskGraph, store: Store, engine: Engine, options: BuildOptions, caller: Caller) -> None:
        self.graph = graph
        self.store = store
        self.engine = engine
        self.options = options
        self.on_event = caller.on_event
        self.prepare = caller.prepare
        self.folder = caller.folder
        self.places = caller.places
        self.peaks = dict(caller.peaks)
        self.available_bytes = available_bytes()
        self.outcome = Outcome()
        self._forced = set(options.force)
        self._specs = Specs(store)
        self._running: dict[str, Job] = {}  # with the company of each task
        self._waiting: set[str] = set()  # first tasks of jobs that wait for another builder
        self._rebuilt: set[str] = set()
        self._failures: Counter[str] = Counter()
        self._deaths: Counter[str] = Counter()
        self._alone: set[str] = set()  # tasks that lacked memory: nothing runs beside them
        self._separately: set[str] = set()  # tasks whose worker died while they ran together with others
        self._missing = dict[str, int]()  # number of sources that have no record yet
        self._priority = graph.priorities()
        self._ready: list[tuple[int, str]] = []
        self._has_failed = False
        self._broken = False  # the machine is at fault: more tasks would fail the same way

    def loop(self, interrupts: Interrupts) -> None:
        """Start ready tasks, the longest path first, and collect replies until nothing is left to run."""
        finished = self.outcome.records.keys()
        self._missing = {name: len(set(self.graph.sources(name)) - finished) for name in self.graph}
        for name in self.graph:
            self._queue_if_ready(name)
        while True:
            goes_on = not (interrupts.arrived or self._broken or (self._has_failed and not self.options.keep_going))
            while goes_on and self._ready and self.engine.free and self._may_start(self._ready[0][1]):
                self._take(heapq.heappop(self._ready)[1])
            interrupts.is_patient = bool(self._running)
            if not self._running and not (goes_on and self._ready):
                return
            for reply in self.engine.wait(_TICK_S):
                self._collect(reply)
            if interrupts.arrived:
                self._running = {name: job for name, job in self._running.items() if job[0].name not in self._waiting}

    def _may_start(self, name: str) -> bool:
        """Whether a task may run beside the running ones: their peak memory has to fit, and tasks that lacked memory
        run alone.
        """
        if self._alone & self._running.keys() or (name in self._alone and self._running):
            return False
        # A kind that was never measured counts as 0.
        needed = sum(self.peaks.get(self.graph[other].short_kind, 0) for other in (name, *self._running))
        return not self._running or self.available_bytes is None or needed <= self.available_bytes

    def finish(self) -> Outcome:
        """The outcome, in which tasks that did not run are skipped."""
        for name in self.graph:
            if name not in self.outcome.results:
                self._settle(TaskResult(name=name, kind=self.graph[name].short_kind, state="skipped"))
        return self.outcome

    def _queue_if_ready(self, name: str) -> None:
        if self._is_ready(name):
            heapq.heappush(self._ready, (-self._priority[name], name))

    def _is_ready(self, name: str) -> bool:
        is_open = name not in self.outcome.results and name not in self._running
        return is_open and not self._missing[name]

    def _take(self, name: str) -> None:
        """Hand a ready task to the engine, with tasks that share its work; nothing happens if its result exists."""
        spec = self._spec_to_run(name)
        if spec is None:
            return
        if self.prepare is not None:
            self.prepare()
            self.prepare = None
        companions = [other for other in map(self._spec_to_run, self._companions(name)) if other is not None]
        job = (spec, *(other for other in companions if other.components.inputs == spec.components.inputs))
        for member in job:
            self._running[member.name] = job
            self.on_event(Started(task=member.name, kind=self.graph[member.name].short_kind, key=member.key))
        self.engine.submit(job)

    def _companions(self, name: str) -> list[str]:
        """Tasks that share work with this one, but not so many that a free worker is left without a task."""
        together = self.graph[name].together
        is_timed = self.options.timeout_s is not None  # the time of each could not be measured
        if together is None or is_timed or name in self._separately:
            return []
        ready = {other for _, other in self._ready if self._is_ready(other)} - {name}
        candidates = sorted(other for other in ready - self._separately if self.graph[other].together == together)
        # Workers that the other ready tasks leave free share this task and its candidates evenly.
        idle = max(1, self.engine.free - (len(ready) - len(candidates)))
        return candidates[: min(MAX_COMPANY, math.ceil((1 + len(candidates)) / idle)) - 1]

    def _spec_to_run(self, name: str) -> Spec | None:
        """The spec of a task that has to run; None if its result exists, and the task is then settled."""
        if not self._is_ready(name):  # queued twice, or an input was lost meanwhile: `_rebuild_inputs` queues it again
            return None
        task = self.graph[name]
        spec = self._specs.of(task, self.outcome.records)
        record = None if name in self._forced else self.store.record(spec.key)
        if record is not None:
            self._settle(TaskResult(name=name, kind=task.short_kind, state="cached", key=spec.key), record)
            return None
        folder = str(self.folder) if task.after_delivery else None
        return replace(spec, folder=folder, force=name in self._forced)

    def _collect(self, reply: Reply) -> None:
        """Act on a reply: note its state, retry the task, or record its end."""
        for text in reply.warnings:
            self.on_event(Warned(text=text))
        name = reply.name
        if name not in self._running:  # it waited for another builder when Ctrl-C was pressed
            return
        job = self._running[name]
        if reply.state == "waiting":
            self._waiting.add(name)
            return
        if reply.state == "begun":
            self._waiting.discard(name)
            return
        del self._running[name]
        spec = next(spec for spec in job if spec.name == name)
        if reply.damaged and name not in self._rebuilt:
            self._rebuild_inputs(name)
        elif reply.state == "lost" and len(job) > 1:  # any of the company may be the cause
            self._separately.add(name)
            self._retry(name, f"{reply.error}; it runs alone now")
        elif reply.state == "lost":
            self._worker_died(spec, reply)
        elif reply.state == "failed" and self._has_tries_left(reply):
            self._retry(name, reply.error)
        else:
            self._finish(spec, reply)

    def _retry(self, name: str, error: str) -> None:
        self.on_event(Retried(task=name, error=error))
        self._queue_if_ready(name)

    def _finish(self, spec: Spec, reply: Reply) -> None:
        """Record the end of a task that ran or failed for good."""
        self._broken = self._broken or reply.machine
        result = TaskResult(
            name=spec.name,
            kind=self.graph[spec.name].short_kind,
            state=reply.state,
            seconds=reply.seconds,
            key=spec.key,
            differs=reply.differs,
        )
        if reply.state == "failed":
            _, _, subject = spec.name.partition("/")
            # A fault of the machine has no location in the stage.
            location = None if reply.machine else self.places.get(subject.split("/")[0])
            repeat = self.store.keep_spec(replace(spec, force=False))
            result = replace(result, error=reply.error, log=reply.log, machine=reply.machine)
            result = replace(result, place=location, spec=repeat)
        elif reply.state == "executed" and reply.record is not None:
            self.peaks[result.kind] = max(self.peaks.get(result.kind, 0), reply.record.made_by.peak_bytes)
        self._settle(result, reply.record)

    def _worker_died(self, spec: Spec, reply: Reply) -> None:
        """Try again: either the task kills workers, or it lacked memory beside other tasks."""
        self._deaths[spec.name] += 1
        if self._deaths[spec.name] < MAX_DEATHS:
            if reply.memory:
                self._alone.add(spec.name)
            self._retry(spec.name, reply.error)
            return
        hint = "; out of memory looks like this, and it ran alone the last time" if reply.memory else ""
        self._finish(spec, failed(spec, f"{reply.error}, {MAX_DEATHS} times{hint}", self.store))

    def _has_tries_left(self, reply: Reply) -> bool:
        """Whether a failed task is to be tried again; the call counts as one try."""
        if reply.memory and reply.name not in self._alone:
            self._alone.add(reply.name)
            return True
        self._failures[reply.name] += 1
        return self._failures[reply.name] <= self.options.retries and not reply.machine

    def _settle(self, result: TaskResult, record: Record | None = None) -> None:
        """Record the result of a task, and queue the tasks that waited for it alone."""
        if record is not None:
            result = replace(result, made_by=record.made_by)
        self._has_failed = self._has_failed or result.state == "failed"
        self.outcome.results[result.name] = result
        self.on_event(Done(result=result))
        if record is not None:
            if record.made_by.warning:
                self.on_event(Warned(text=f"{result.name}: {record.made_by.warning}"))
            self.outcome.records[result.name] = record
            for reader in self.graph.readers(result.name):
                self._missing[reader] -= 1
                self._queue_if_ready(reader)

    def _rebuild_inputs(self, name: str) -> None:
        """Remake inputs that were damaged between lookup and use, then try the task once more."""
        self._rebuilt.add(name)
        for source in self.graph.sources(name):
            record = self.outcome.records.get(source)  # none: another reader has had it made again
            if record is not None and self.store.record(record.key) is None:
                del self.outcome.records[source], self.outcome.results[source]
                for reader in self.graph.readers(source):
                    self._missing[reader] += 1
                self._queue_if_ready(source)
        self._queue_if_ready(name)
