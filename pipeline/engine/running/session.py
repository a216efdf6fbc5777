"""A build session: run the graph of a project, deliver its files, report the result; or run one task from a file."""

import contextlib
import dataclasses
import hashlib
import json
import math
import os
import random
import time
from collections import ChainMap
from collections.abc import Callable, Iterable
from dataclasses import replace
from functools import cache
from pathlib import Path

from pipeline.engine.digest import DIGEST
from pipeline.engine.events import Begun, warner
from pipeline.engine.interrupts import Interrupts
from pipeline.engine.maintenance import collect, limit_from_environment
from pipeline.engine.options import NOBODY, USUAL, BuildOptions, Caller
from pipeline.engine.output import manifest
from pipeline.engine.output.deliver import Contents, Delivery, Source, deliver
from pipeline.engine.output.our_files import OurFiles
from pipeline.engine.planning.forecast import Assumed, Forecast, Past, Size, forecast
from pipeline.engine.planning.graph import TaskGraph
from pipeline.engine.planning.plan import PlannedTask, Specs, plan
from pipeline.engine.project import Project, files_of, maker_of, selection
from pipeline.engine.records import Record, Reply, Spec, TaskResult, as_json
from pipeline.engine.running.driver import Outcome, run
from pipeline.engine.running.engines import Engine
from pipeline.engine.running.execute import perform
from pipeline.engine.running.notes import costs_of_others, history_of, keep_history
from pipeline.engine.running.result import Ended, Result
from pipeline.engine.store.store import DamagedBlob, Store
from pipeline.engine.store.store_folder import store_around
from pipeline.errors import EnvironmentFault, PipelineError, UsageError
from pipeline.folders import path_flaw
from pipeline.jit.files import cache_folder
from pipeline.records.plain import from_plain


def build(
    project: Project,
    options: BuildOptions = USUAL,
    *,
    store: Store | None = None,
    engine: Callable[[Store, tuple[str, ...]], Engine] | None = None,
    caller: Caller = NOBODY,
) -> Result:
    """Run the missing tasks and fill the output folder.

    Options about reading the stage are ignored here, and so are the interrupts of the caller: a build has its own.
    `engine` makes an engine from a store and the packages of task kinds, in place of that of the options.
    """
    start = time.perf_counter()
    _require_place(project)
    emit = caller.on_event
    limit_bytes = limit_from_environment()
    warn = warner(emit)
    store = store or Store(warn=warn)
    OurFiles(project.out, store, project.stage_id).require_same_stage()
    store.sweep()
    graph, forced = selection(project, options)
    with Interrupts(warn) as interrupts:
        listener = Caller(on_event=emit, prepare=caller.prepare, interrupts=interrupts)
        work = _Build(project=project, options=options, store=store, graph=graph, caller=listener, engine=engine)
        emit(Begun(tasks={name: graph[name].short_kind for name in graph}, jobs=options.workers))
        with contextlib.ExitStack() as use:
            with interrupts.stopping():
                use.enter_context(store.in_use())
            work.compute(forced)
            with interrupts.stopping():
                work.deliver()
            work.finish(forced)
        work.outcome.interrupted = interrupts.arrived
        store.sweep()  # ended workers could not tidy up
        result = work.result(time.perf_counter() - start, _within_limit(store, limit_bytes, warn))
        emit(Ended(result=result))
        return result


@dataclasses.dataclass(kw_only=True)
class _Build:
    """A running build: its tasks, their results and the delivery.

    The graph consists of the tasks `before` delivery, and of those `after` it, which read the output folder. The first
    delivery has the files of the former, and those of the latter whose results are in the store (`existing`); a second
    one adds the files of the rest. `head` are the facts of the manifest.
    """

    project: Project
    options: BuildOptions
    store: Store
    graph: TaskGraph
    caller: Caller
    engine: Callable[[Store, tuple[str, ...]], Engine] | None
    delivery: Delivery | None = None
    error: PipelineError | None = None

    def __post_init__(self) -> None:
        self.warn = cache(warner(self.caller.on_event))
        self.history = history_of(self.project, self.store)
        self.head = self.project.head
        self.before = self.graph.before_delivery
        self.after = [name for name in self.graph if name not in self.before]
        self.is_complete = len(self.graph) == len(self.project.graph)
        self.existing = dict[str, Record]()
        if self.caller.prepare is not None:
            self.caller = replace(self.caller, prepare=cache(self.caller.prepare))

    def compute(self, forced: Iterable[str]) -> None:
        """Run the tasks before delivery, those of a sample twice, and note their costs."""
        self.outcome = self._run(forced)
        if self.options.check_percent and not self.outcome.interrupted:
            done = sorted(self.outcome.records)
            count = min(len(done), max(1, math.ceil(len(done) * self.options.check_percent / 100)))
            second = self._run(random.SystemRandom().sample(done, count))  # another sample every time
            self.outcome.checked = tuple(sorted(second.ran))
            self.outcome.interrupted = second.interrupted
            bad = {name: task for name, task in second.ran.items() if task.state == "failed" or task.differs}
            self.outcome.results |= bad
        keep_history(self.project, self.store, self.outcome, self.history, complete=self.is_complete)
        if len(self.outcome.records) == len(self.before):
            specs = Specs(self.store)
            keys = {name: specs.of(self.graph[name], self.outcome.records).key for name in self.after}
            records = {name: self.store.record(key) for name, key in keys.items() if name not in forced}
            self.existing = {name: record for name, record in records.items() if record is not None}

    def deliver(self) -> None:
        """Fill the output folder; results that vanished meanwhile are made again."""
        try:
            try:
                self._fill()
            except DamagedBlob:
                self.warn("results vanished from the store before delivery; they are made again")
                second = self._run()
                self.outcome.results |= second.ran  # the report still counts the work of the first run
                self.outcome.records = self.outcome.records | second.records
                self.outcome.interrupted = second.interrupted
                self._fill()
        except DamagedBlob:
            message = "results vanished from the store before delivery, twice"
            self.error = EnvironmentFault(message, hint="build again")
        except PipelineError as error:
            self.error = error

    def finish(self, forced: Iterable[str]) -> None:
        """Run the tasks after delivery, and deliver what is new of their files."""
        first = self.delivery
        if first is None or not self.after:
            kinds = {name: self.graph[name].short_kind for name in self.after}
            ends = {name: TaskResult(name=name, kind=kind, state="skipped") for name, kind in kinds.items()}
            self.outcome.results |= ends
            return
        self.outcome = self._run(forced, self.outcome)
        keep_history(self.project, self.store, self.outcome, self.history, complete=True)
        new = self.outcome.records.keys() - self.existing.keys() - set(self.before)
        assert self.caller.interrupts is not None
        if new:
            with self.caller.interrupts.stopping():
                self.deliver()
            last = self.delivery
            assert last is not None
            written = {*first.written, *last.written}
            removed = {*first.removed, *last.removed} - written
            self.delivery = replace(last, written=tuple(sorted(written)), removed=tuple(sorted(removed)))

    def result(self, seconds: float, store_bytes: int) -> Result:
        return Result(
            stage=self.project.head.get("stage"),
            out=self.project.out.absolute(),
            seconds=seconds,
            certificate=self.head.get("certificate"),
            points=self.head.get("points"),
            tasks=tuple(self.outcome.results[name] for name in self.graph),
            store=self.store.root,
            store_bytes=store_bytes,
            delivery=self.delivery,
            interrupted=self.outcome.interrupted,
            error=self.error,
            checked=self.outcome.checked,
        )

    def _run(self, force: Iterable[str] = (), before: Outcome | None = None) -> Outcome:
        """Run the tasks before delivery. With the outcome `before`, run those after delivery; they run on this machine,
        which has the folder.
        """
        peaks = {kind: cost.peak_bytes for kind, cost in self.history.costs.items()}
        out = self.project.out.absolute()
        return run(
            self.graph if before else self.before,
            self.store,
            dataclasses.replace(
                self.options, force=tuple(force), keep_going=self.options.keep_going or before is not None
            ),
            engine=self.engine(self.store, self.graph.packages) if self.engine and not before else None,
            caller=dataclasses.replace(self.caller, peaks=peaks, places=self.project.places, folder=out),
            before=before,
        )

    def _fill(self) -> None:
        """Deliver the requested files if all of them exist."""
        project = self.project
        outcome = self.outcome
        records = {**outcome.records, **self.existing}
        if not set(self.before) <= records.keys() or outcome.interrupted:
            return
        missing = set(self.after) - records.keys()
        complete = bool(self.after) or not self.options.targets
        if not complete:
            files = {path: project.files[path] for name in self.options.targets for path in files_of(project, name)}
        elif self.is_complete:
            files = {path: source for path, source in project.files.items() if maker_of(project, path) not in missing}
            for fact, outputs in project.findings.items():
                blobs = {name: outcome.records[task].outputs[output] for name, (task, output) in outputs.items()}
                contents = {name: json.loads(self.store.read(blob.sha256)) for name, blob in blobs.items()}
                self.head = {**self.head, fact: contents}
        else:
            return
        goal = Contents(files=files, head=self.head, records=records, stage_id=project.stage_id, complete=complete)
        self.delivery = deliver(project.out, goal, self.store, self.warn) if files else None


def _require_place(project: Project) -> None:
    """Refuse an output folder that no build of this stage can fill; for `plan` and `status` as for `build`."""
    if flaw := path_flaw(project.out, project.files):
        raise UsageError(f"the path of the output folder {flaw}", hint="choose another folder with -o")
    manifest.read_of(project.out, project.head.get("stage"))
    out = Path(os.path.realpath(project.out))
    kernels = Path(os.path.realpath(cache_folder()))
    inside = [path for path in project.reads if Path(os.path.realpath(path)).is_relative_to(out)]
    if root := store_around(out):
        flaw = f"lies in a store of results, {root}"
    elif out == kernels.parent or out.is_relative_to(kernels):
        flaw = "is that of compiled kernels"
    elif inside:
        flaw = f"holds files that the stage is made of: {inside[0]}"
    if flaw:
        hint = "choose another folder with -o, for example -o build"
        raise UsageError(f"the output folder {project.out} {flaw}", hint=hint)


def plan_of(project: Project, options: BuildOptions = USUAL, *, store: Store | None = None) -> list[PlannedTask]:
    """Plan of `build` with the same options; it raises the errors that `build` would, also about the folder."""
    _require_place(project)
    store = store or Store()
    OurFiles(project.out, store, project.stage_id).require_same_stage()
    graph, forced = selection(project, options)
    return plan(graph, store, history_of(project, store).keys, force=forced)


def forecast_of(
    project: Project, planned: Iterable[PlannedTask], size: Size, assumed: Assumed, *, store: Store | None = None
) -> Forecast:
    """Forecast of a plan's work, from earlier builds of this project and of others in the store, else assumed."""
    store = store or Store()
    history = history_of(project, store)
    kinds = ChainMap(history.costs, *costs_of_others(project, store))
    past = Past(store=store, last_keys=history.keys, kinds=kinds, size=size)
    return forecast(planned, project.graph, past, assumed)


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True)
class Status:
    """State of each file by path, and whether a manifest exists.

    A file is built, missing, stale (other bytes are there), or maybe (stale, unless a task to come gives the same
    bytes).
    """

    files: dict[str, str]
    has_manifest: bool


def status_of(project: Project) -> Status:
    """States of the files of the output folder: `built` if a build of the present stage would leave them as they are,
    `maybe` if that depends on results that are still to come.
    """
    store = Store()
    tasks = {task.name: task for task in plan_of(project, store=store)}
    records = {name: store.peek(task.key) for name, task in tasks.items() if task.key and task.state == "cached"}
    last_manifest = manifest.read(project.out)
    our_files = OurFiles(project.out, store, project.stage_id)

    def digest_after_build(path: str, source: Source) -> str | None:
        if isinstance(source, bytes):
            return hashlib.sha256(source).hexdigest()
        task, output = source
        if record := records.get(task):
            return record.outputs[output].sha256
        # The store may have lost what the folder still has. "", for a task that the manifest lacks, equals neither a
        # digest nor None, the key of a task that depends on tasks to come.
        is_same_task = last_manifest.tasks.get(task, "") == tasks[task].key
        return last_manifest.files[path].sha256 if is_same_task and path in last_manifest.files else None

    def state(path: str, source: Source) -> str:
        digest = our_files.digest(path)
        if digest is None:
            return "missing"
        if digest == digest_after_build(path, source):
            return "built"
        is_uncertain = not isinstance(source, bytes) and tasks[source[0]].state == "maybe"
        return "maybe" if is_uncertain else "stale"

    states = {path: state(path, source) for path, source in sorted(project.files.items())}
    return Status(files=states, has_manifest=last_manifest.data is not None)


def _within_limit(store: Store, limit: int, warn: Callable[[str], None]) -> int:
    """Remove the least recently used results if the store exceeds its limit; returns its size [bytes]."""
    size = store.size()
    if size <= limit:
        return size
    try:
        size = collect(store, limit).bytes_left
    except PipelineError as error:  # a read-only store or an unreadable record: nothing can be removed
        warn(f"the store holds {size:,} bytes, over its limit of {limit:,}: {error.message}")
        return size
    if size > limit:
        warn(f"the store holds {size:,} bytes, over its limit of {limit:,}: results of finished builds stay")
    return size


def write_specs(planned: list[PlannedTask], folder: Path) -> list[Path]:
    """Write 0.json, 1.json, … for all tasks that can run now, in place of older ones; UsageError if one is no spec."""
    folder.mkdir(parents=True, exist_ok=True)
    old = [path for path in folder.glob("*.json") if path.stem.isdecimal()]
    for path in old:
        _read(path)
    for path in old:
        path.unlink()
    specs = [task.spec for task in planned if task.state == "run" and task.spec is not None]
    paths = [folder / f"{number}.json" for number in range(len(specs))]
    for path, spec in zip(paths, specs, strict=True):
        path.write_bytes(as_json(spec) + b"\n")
    return paths


def run_task(path: Path, store: Store, packages: tuple[str, ...], *, force: bool = False) -> Reply:
    """Bring the result of one task into the store; UsageError if the file is not a spec, or was altered."""
    spec = _read(path)
    with store.in_use():
        (reply,) = perform([replace(spec, force=force)], store, packages)
    return reply


def _read(path: Path) -> Spec:
    """The spec in a file; UsageError if it is none, or its key does not match its content."""
    hint = "`pipeline plan STAGE --specs FOLDER` writes such files, and so does a task that fails"
    try:
        spec = from_plain(Spec, json.loads(path.read_text(encoding="utf-8")))
        key = spec.components.key
        names = [spec.name, spec.components.kind]
        is_spec = {*map(type, names)} == {str} and all(map(DIGEST.fullmatch, [spec.key, *spec.components.digests()]))
    except OSError as error:
        raise UsageError(f"cannot read {path}: {error.strerror}", hint=hint) from error
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError):
        is_spec = False
    if not is_spec:
        raise UsageError(f"{path} is not the spec of a task", hint=hint)
    if key != spec.key:
        raise UsageError(f"{path} was altered: its key does not match its content", hint=hint)
    return spec
