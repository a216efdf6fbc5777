"""From a project to its output folder: run the graph, deliver the files, say what happened."""

import math
import os
import random
import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pipeline.engine import manifest
from pipeline.engine.care import collect, limit_from_environment
from pipeline.engine.deliver import Delivery, Source, deliver
from pipeline.engine.digest import key_of
from pipeline.engine.engines import Engine
from pipeline.engine.events import Emit, Event, silent
from pipeline.engine.graph import TaskGraph
from pipeline.engine.plan import PlannedTask, plan
from pipeline.engine.run import Outcome, TaskResult, run
from pipeline.engine.status import TaskStatus, status
from pipeline.engine.store import Store
from pipeline.errors import PipelineError, UsageError


@dataclass(frozen=True, slots=True, kw_only=True)
class Project:
    """A graph, and what of its results goes where.

    Attributes
    ----------
    files : dict
        Posix path below `out` -> bytes, or (task name, output name).
    head : dict
        What the manifest says beside format, tasks and files; `head["stage"]` names the stage without a path of
        this machine.
    out : Path
        Output folder.
    stage_id : str
        What `plan` compares with: the last build of the same stage into the same folder.
    reads : tuple of Path
        Files that the project was read from: `watch` looks at them.
    """

    graph: TaskGraph
    files: dict[str, Source]
    head: dict[str, Any]
    out: Path
    stage_id: str
    reads: tuple[Path, ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True)
class Result:
    """What a build did; `to_dict()` is what `build --json` prints.

    Attributes
    ----------
    out : Path
        Output folder, absolute.
    seconds : float
        Wall time of the whole build [s].
    store, store_bytes : Path, int
        Where the results are kept, and the size of all that is kept there.
    delivery : Delivery or None
        Changes in the output folder; None if it was not touched because something failed or only part was built.
    interrupted : int or None
        Exit code of the signal that ended the build, if one did.
    error : PipelineError or None
        Why the output folder could not be filled although all tasks are done.
    checked : tuple of str
        Tasks that ran once more, to see whether they give the same bytes.
    """

    stage: Any
    out: Path
    seconds: float
    certificate: Any
    tasks: tuple[TaskResult, ...]
    store: Path
    store_bytes: int
    delivery: Delivery | None = None
    interrupted: int | None = None
    error: PipelineError | None = None
    checked: tuple[str, ...] = ()

    def count(self, state: str) -> int:
        """Number of tasks that ended in a state."""
        return sum(task.state == state for task in self.tasks)

    @property
    def executed(self) -> int:
        """Tasks that ran now."""
        return self.count("executed")

    @property
    def cached(self) -> int:
        """Tasks whose results were in the store, or that another builder made meanwhile."""
        return self.count("cached")

    @property
    def failed(self) -> int:
        """Tasks that failed now."""
        return self.count("failed")

    @property
    def skipped(self) -> int:
        """Tasks that were not tried."""
        return self.count("skipped")

    @property
    def failures(self) -> tuple[TaskResult, ...]:
        """The tasks that failed."""
        return tuple(task for task in self.tasks if task.state == "failed")

    @property
    def different(self) -> tuple[TaskResult, ...]:
        """Tasks that gave other bytes than before, for the same key."""
        return tuple(task for task in self.tasks if task.differs)

    @property
    def exit_code(self) -> int:
        """0 done, 1 a task failed, 4 other bytes than before, 5 the machine is at fault, 130 or 143 interrupted."""
        if self.interrupted is not None:
            return self.interrupted
        if any(task.machine for task in self.failures):
            return 5
        if self.error is not None:
            return self.error.exit_code
        return 1 if self.failures else 4 if self.different else 0

    def ending(self) -> dict[str, Any]:
        """What the event `end` says beside the summary."""
        touched = self.delivery is not None
        facts = {"store": str(self.store), "store_bytes": self.store_bytes, "delivered": touched}
        return {**facts, "exit_code": self.exit_code, "checked": list(self.checked)}

    def to_dict(self) -> dict[str, Any]:
        """Plain data, as in outputs of `build --json`."""
        counts = {state: self.count(state) for state in ("executed", "cached", "failed", "skipped")}
        head = {"stage": self.stage, "out": str(self.out), **counts, "seconds": round(self.seconds, 3)}
        whole = {**head, "certificate": self.certificate, "tasks": [task.to_dict() for task in self.tasks]}
        return whole if self.error is None else {**whole, "error": str(self.error)}


def build(
    project: Project,
    *,
    store: Store | None = None,
    jobs: int | None = None,
    keep_going: bool = False,
    force: Iterable[str] = (),
    until: Iterable[str] = (),
    retries: int = 0,
    timeout_s: float | None = None,
    check_percent: float = 0.0,
    engine: Callable[[Store, tuple[str, ...]], Engine] | None = None,
    on_event: Emit = silent,
    prepare: Callable[[], None] | None = None,
) -> Result:
    """Run what is missing and fill the output folder.

    Parameters
    ----------
    jobs : int, optional
        Worker processes; 1 runs everything in this process; default one per core.
    force, until : iterable of str
        Tasks (names, patterns, or paths of files in the output folder) that run in any case; the last ones to run.
        As long as only a part of the dataset is made, the output folder is left alone.
    retries, timeout_s :
        See `run.run`.
    check_percent : float
        Share of the tasks that run once more afterwards, to see whether they give the same bytes [%].
    engine : callable, optional
        Makes another place for tasks than processes of this machine, from a store and the packages of task kinds.
    """
    start = time.perf_counter()
    manifest.refuse_other_stage(project.out, project.head.get("stage"))
    emit, keep_events = _recorded(on_event)
    warn = _warner(emit)
    store = store or Store(warn=warn)
    store.sweep()
    graph, forced = _selection(project, force, until)
    emit(_begin(project, graph, _jobs(jobs)))
    history = _history(project, store)
    options: dict[str, Any] = {"jobs": _jobs(jobs), "retries": retries, "timeout_s": timeout_s, "on_event": emit}
    options |= {"keep_going": keep_going, "prepare": prepare, "peaks": history["peaks"]}

    def place() -> Engine | None:
        return engine(store, graph.packages) if engine else None

    delivery, error = None, None
    with store.in_use():
        outcome = run(graph, store, force=forced, engine=place(), **options)
        if check_percent and outcome.interrupted is None:
            _check_again(outcome, run(graph, store, force=_sample(outcome, check_percent), engine=place(), **options))
        _remember(project, store, outcome, history, whole=len(graph) == len(project.graph))
        if len(outcome.records) == len(project.graph) and outcome.interrupted is None:
            try:
                delivery = deliver(
                    project.out, project.files, project.head, records=outcome.records, store=store, warn=warn
                )
            except PipelineError as caught:
                error = caught
    result = Result(
        stage=project.head.get("stage"),
        out=project.out.absolute(),
        seconds=time.perf_counter() - start,
        certificate=project.head.get("certificate"),
        tasks=tuple(outcome.results[name] for name in graph),
        store=store.root,
        store_bytes=_within_limit(store, warn),
        delivery=delivery,
        interrupted=outcome.interrupted,
        error=error,
        checked=outcome.checked,
    )
    emit({"event": "end", "summary": result.to_dict(), **result.ending()})
    keep_events(store, _history_name(project))
    return result


def plan_of(
    project: Project, *, store: Store | None = None, force: Iterable[str] = (), until: Iterable[str] = ()
) -> list[PlannedTask]:
    """What `build` would do with the same arguments."""
    store = store or Store()
    graph, forced = _selection(project, force, until)
    return plan(graph, store, _history(project, store)["keys"], force=forced)


def status_of(project: Project, *, store: Store | None = None) -> list[TaskStatus]:
    """What of the project lies finished in its output folder."""
    return status(plan_of(project, store=store), project.files, project.out)


def tasks_of(project: Project, target: str) -> list[str]:
    """Tasks meant by a task name or pattern, or by the path of a file below (or in) the output folder."""
    path = Path(target)
    if path.is_absolute() and path.is_relative_to(project.out.absolute()):
        target = path.relative_to(project.out.absolute()).as_posix()
    elif path.is_relative_to(project.out):
        target = path.relative_to(project.out).as_posix()
    source = project.files.get(target)
    if isinstance(source, bytes):
        raise UsageError(f"{target} is written from the stage itself, no task makes it")
    return [source[0]] if source is not None else project.graph.select(target)


def logs_of(project: Project, target: str, *, store: Store | None = None) -> list[dict[str, Any]]:
    """What is known of the last run of tasks: name, key, state, log (a path, or None), error, statistics of the run."""
    store = store or Store()
    keys = _history(project, store)["keys"]
    last = store.read_note("events", _history_name(project)) or {}
    found = []
    for name in tasks_of(project, target):
        event = last.get(name, {})
        key = event.get("key") or keys.get(name)
        record = store.peek(key) if key else None
        log = store.path("log", key) if key else None
        facts = {"name": name, "key": key, "state": event.get("state", "never built" if key is None else "built")}
        facts |= {"log": str(log) if log and log.is_file() else None, "error": event.get("error")}
        found.append({**facts, "spec": event.get("spec"), "made_by": record["made_by"] if record else None})
    return found


def _selection(project: Project, force: Iterable[str], until: Iterable[str]) -> tuple[TaskGraph, set[str]]:
    forced = {name for target in force for name in tasks_of(project, target)}
    last = [name for target in until for name in tasks_of(project, target)]
    return (project.graph.up_to(last) if last else project.graph), forced


def _jobs(jobs: int | None) -> int:
    if jobs is not None:
        return max(1, jobs)
    # What this process may use, where the system can tell; a container often may use less than there is.
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def _history_name(project: Project) -> str:
    return key_of("history/v1", [str(project.out.absolute()), project.stage_id])


def _history(project: Project, store: Store) -> dict[str, Any]:
    """What the last builds of this stage into this folder left: `keys` by task and `peaks` of memory by kind."""
    note = store.read_note("history", _history_name(project))
    parts = {name: note.get(name) for name in ("keys", "peaks")} if isinstance(note, dict) else {}
    return {name: parts[name] if isinstance(parts.get(name), dict) else {} for name in ("keys", "peaks")}


def _remember(project: Project, store: Store, outcome: Outcome, before: dict[str, Any], *, whole: bool) -> None:
    """Keep the key of every task that is there now, so that the next plan can say what changed since."""
    keys = {name: key for name, key in before["keys"].items() if name in project.graph or not whole}
    keys |= {name: record["key"] for name, record in outcome.records.items()}
    peaks = {**before["peaks"], **outcome.peaks}
    if {"keys": keys, "peaks": peaks} != before:
        note = {"out": str(project.out.absolute()), "stage": project.stage_id, "keys": keys, "peaks": peaks}
        store.write_note("history", _history_name(project), note)


def _begin(project: Project, graph: TaskGraph, jobs: int) -> Event:
    kinds = {name: graph[name].short_kind for name in graph}
    return {"event": "begin", "tasks": kinds, "jobs": jobs, "reads": [str(path) for path in project.reads]}


def _sample(outcome: Outcome, percent: float) -> list[str]:
    """Some of the tasks that are done, at least one, other ones every time."""
    done = sorted(outcome.records)
    count = min(len(done), max(1, math.ceil(len(done) * percent / 100)))
    return random.SystemRandom().sample(done, count)


def _check_again(outcome: Outcome, again: Outcome) -> None:
    """Take over what a second run of some tasks found out."""
    repeated = {name: task for name, task in again.results.items() if task.state in ("executed", "failed")}
    outcome.checked = tuple(sorted(repeated))
    outcome.interrupted = again.interrupted
    for name, task in repeated.items():
        if task.state == "failed" or task.differs:
            outcome.results[name] = task


def _recorded(on_event: Emit) -> tuple[Emit, Callable[[Store, str], None]]:
    """A listener that passes events on and keeps how tasks ended; and what writes that down, for `pipeline logs`."""
    ended: dict[str, Event] = {}

    def emit(event: Event) -> None:
        if event["event"] == "done" and event["state"] in ("executed", "failed"):
            ended[event["task"]] = event
        on_event(event)

    def keep(store: Store, name: str) -> None:
        if ended:
            store.write_note("events", name, {**(store.read_note("events", name) or {}), **ended})

    return emit, keep


def _within_limit(store: Store, warn: Callable[[str], None]) -> int:
    """Drop what was unused longest if the store has grown beyond its limit; gives its size [bytes]."""
    size, limit = store.size(), limit_from_environment()
    if size <= limit:
        return size
    try:
        size = collect(store, limit).bytes_left
    except PipelineError:  # a read-only store: nothing of it can go
        return size
    if size > limit:
        warn(f"the store holds {size:,} bytes, over its limit of {limit:,}: results of finished builds stay")
    return size


def _warner(on_event: Emit) -> Callable[[str], None]:
    return lambda text: on_event({"event": "warning", "text": text})
