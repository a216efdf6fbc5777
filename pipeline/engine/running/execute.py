"""Execution of tasks in any process: small records in and out; bulk data moves through the store.

A worker loads no other part of the engine than this module and its imports.
"""

import contextlib
import copy
import datetime
import importlib
import json
import os
import shutil
import socket
import threading
import time
import traceback
import typing
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from pipeline.engine.files import is_machines_fault, reporting_machine_faults
from pipeline.engine.planning.task_code import cached_parsing, check_kind, code_of, edited, module_of
from pipeline.engine.records import Components, Record, Reply, Run, Spec, as_json
from pipeline.engine.store.store import DamagedBlob, Store
from pipeline.errors import EnvironmentFault, PipelineError
from pipeline.jit.work import work
from pipeline.machine.facts import peak_bytes, reset_peak
from pipeline.machine.processor import settings
from pipeline.records.plain import from_plain

_logs = threading.Lock()
"""Held by the task whose output goes to its log: threads of a process share its streams."""
_LINES = 12
"""Most lines of an error message in the reply of a failed task."""
_REPORT = "this is a bug of ours: please report it with the log and your stage"


def perform(
    specs: Sequence[Spec], store: Store, packages: tuple[str, ...], begin: Callable[[], None] = lambda: None
) -> list[Reply]:
    """Look up the results of tasks, or compute them; computing them twice is harmless.

    Several tasks at once are of one kind and have the same inputs: they share work. `begin` is called once no other
    builder computes them.
    """
    start = time.perf_counter()
    try:
        return _results(specs, store, packages, begin)
    except (Exception, SystemExit) as error:
        if len(specs) > 1:  # unknown which of them failed: each runs alone, and reports its own error
            return [reply for spec in specs for reply in perform([spec], store, packages, begin)]
        return [_failure(specs[0], error, store, start)]


def failed(spec: Spec, reason: str, store: Store, seconds: float = 0.0, *, machine: bool = False) -> Reply:
    """The reply for a task that was ended from outside: its worker died or its time limit was reached."""
    log = _append(store.file_for("log", spec.key), f"{reason}\n")
    return Reply(name=spec.name, state="failed", error=reason, log=log, seconds=round(seconds, 4), machine=machine)


def lost(spec: Spec, reason: str, *, memory: bool = False) -> Reply:
    """The reply for a task whose worker died; the driver decides whether it gets another one."""
    return Reply(name=spec.name, state="lost", error=reason, memory=memory)


def _results(specs: Sequence[Spec], store: Store, packages: tuple[str, ...], begin: Callable[[], None]) -> list[Reply]:
    """Replies of tasks: from the store, or computed while their keys are locked. Tasks with the same key share one
    result.
    """
    start = time.perf_counter()
    replies = dict[str, Reply]()
    firsts = {spec.key: spec for spec in reversed(specs)}  # equal frames have one key
    with contextlib.ExitStack() as locks:
        # Always in the same order, so that two builders cannot wait for each other for ever.
        for key, spec in sorted(firsts.items()):
            locks.enter_context(store.single_flight(key, f"makes {spec.name}"))
        begin()
        for key, spec in firsts.items():  # another builder may have computed it meanwhile
            if not spec.force and (record := store.record(key)) is not None:
                replies[key] = Reply(name=spec.name, state="cached", record=record)
        todo = [spec for spec in specs if firsts[spec.key] is spec and spec.key not in replies]
        if todo:
            with _logging(store.file_for("log", todo[0].key), store):
                computed = _compute(todo, store, packages)
            seconds = round((time.perf_counter() - start) / len(todo), 4)
            replies |= {spec.key: replace(reply, seconds=seconds) for spec, reply in zip(todo, computed, strict=True)}
    return [
        replies[spec.key]
        if firsts[spec.key] is spec
        else Reply(name=spec.name, state="cached", record=replies[spec.key].record)
        for spec in specs
    ]


def _failure(spec: Spec, error: BaseException, store: Store, start: float) -> Reply:
    """The reply for a task that raised an error, which goes to its log."""
    is_expected = isinstance(error, EnvironmentFault | DamagedBlob)
    text = f"{error}\n" if is_expected else "".join(traceback.format_exception(error))
    return Reply(
        name=spec.name,
        state="failed",
        error=_message(error),
        log=_append(store.file_for("log", spec.key), text),
        machine=is_expected or is_machines_fault(error),
        damaged=isinstance(error, DamagedBlob) or _lacks_inputs(spec, store),
        memory=isinstance(error, MemoryError),
        seconds=round(time.perf_counter() - start, 4),
    )


def _lacks_inputs(spec: Spec, store: Store) -> bool:
    """Whether input bytes of the task are missing or altered, even if that happened while it ran."""
    try:
        for digest in [] if spec.folder else spec.components.digests():
            store.blob(digest)
    except DamagedBlob:
        return True
    return False


def _compute(specs: Sequence[Spec], store: Store, packages: tuple[str, ...]) -> list[Reply]:
    """Run tasks of one kind with the same inputs, and keep their records."""
    components = specs[0].components
    kind = components.kind
    count = len(specs)
    check_kind(kind, packages)
    _refuse_other_code(components, store)
    folder = specs[0].folder
    blobs = {digest: store.verified(digest) for digest in ([] if folder else components.digests())}
    inputs = {
        role: {name: blobs[digest].path for name, digest in outputs.items()}
        for role, outputs in components.inputs.items()
        if not folder
    }
    with contextlib.ExitStack() as folders:
        outs = [folders.enter_context(_folder_for_outputs(store)) for _ in specs]
        reset_peak()
        start = time.perf_counter()
        start_cpu_s = time.process_time()
        work_before = copy.deepcopy(work())
        # A copy in the order of names: a task sees no order that is not in its key, and cannot change others'
        # parameters.
        plain = [json.loads(as_json(spec.components.params)) for spec in specs]
        work().news = work().warning = ""
        run = getattr(importlib.import_module(module_of(kind)), kind.partition(":")[2] or "run")
        record = run.__annotations__.get("params", Any)
        if typing.get_origin(record) is Sequence:  # it takes tasks in company
            (record,) = typing.get_args(record)
            run([from_plain(record, params) for params in plain], inputs, outs)
        else:
            run(from_plain(record, plain[0]), Path(folder) if folder else inputs, outs[0])
        _refuse_edited_code(kind)
        store.confirm(blobs.values())  # the task has read the verified bytes
        made_by = Run(
            seconds=round((time.perf_counter() - start) / count, 4),
            cpu_seconds=round((time.process_time() - start_cpu_s) / count, 4),
            peak_bytes=peak_bytes(),
            news=work().news,
            warning=work().warning,
            host=socket.gethostname(),
            pid=os.getpid(),
            when=datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds"),
            **work().since(work_before).to_plain(1 / count),
        )
        return [_keep(spec, out, made_by, store) for spec, out in zip(specs, outs, strict=True)]


def _keep(spec: Spec, out: Path, made_by: Run, store: Store) -> Reply:
    """Store the files of a task and its record. If its key has a record already, that one stays, and outputs that
    differ are named.
    """
    outputs = {}
    for path in sorted(out.rglob("*")):
        if path.is_symlink() or not (path.is_file() or path.is_dir()):
            raise ValueError(f"a task may only write plain files, and {path.relative_to(out)} is not one")
        if path.is_file():
            outputs[path.relative_to(out).as_posix()] = store.put_file(path)
    record = Record(key=spec.key, outputs=outputs, components=spec.components, made_by=made_by)
    stored = store.put_record(record)
    names = sorted(outputs.keys() | stored.outputs.keys())
    differs = tuple(name for name in names if outputs.get(name) != stored.outputs.get(name))
    return Reply(name=spec.name, state="executed", record=stored, differs=differs)


def _refuse_other_code(components: Components, store: Store) -> None:
    """Refuse to run a task with other code, libraries or machine than its key states.

    The source may have been edited since the driver read it, and a worker on another machine may have other versions.
    """
    kind = components.kind
    with cached_parsing(store):
        present = code_of(kind)
    for part in ("code", "libraries", "machine"):
        value = getattr(present, part)
        stated = getattr(components, part)
        if value != stated:
            hint = "if the code was edited meanwhile, build again; else give all machines the same versions"
            if part == "machine":
                kernels = settings().get("OPENBLAS_CORETYPE")
                setting = f", started with OPENBLAS_CORETYPE={kernels}" if kernels else ""
                hint = f"last digits would differ: use machines of one level, system and environment{setting}"
            message = f"{kind}: this process cannot make what the key says: {part} is {_changed(stated, value)}"
            raise EnvironmentFault(message, hint=hint)
    _refuse_edited_code(kind)


def _refuse_edited_code(kind: str) -> None:
    """Refuse to run a task whose source was edited during or after its import by this process."""
    if names := edited(kind):
        raise EnvironmentFault(
            f"{kind}: the code was edited after this process had read it: {', '.join(names)}",
            hint="start this program again; on a cluster, the workers",
        )


def _changed(old: Any, new: Any) -> str:
    """Differences of two facts in words: names and versions, or the beginnings of two digests."""
    if isinstance(old, dict) and isinstance(new, dict):
        names = [name for name in sorted(old.keys() | new.keys()) if old.get(name) != new.get(name)]
        return ", ".join(f"{name} {new.get(name)}, not {old.get(name)}" for name in names)
    return f"{str(new)[:12]}, not {str(old)[:12]}"


@contextlib.contextmanager
def _folder_for_outputs(store: Store) -> Iterator[Path]:
    """A temporary folder on the store's file system. If the disk fills up, the error states how much is needed."""
    out: Path | None = None

    def least_bytes() -> int:
        return 1 + sum(path.lstat().st_size for path in out.rglob("*")) if out else 1

    try:
        with reporting_machine_faults("keep results in", store.root, least_bytes=least_bytes):
            out = store.new_path()
            out.mkdir()
            yield out
    finally:
        if out is not None:
            shutil.rmtree(out, ignore_errors=True)


@contextlib.contextmanager
def _logging(log: Path, store: Store) -> Iterator[None]:
    """Send the task's output to its log: stdout is reserved for data of the command, stderr for progress."""
    if not _logs.acquire(blocking=False):  # a task in another thread has redirected the streams of this process
        yield
        return
    try:
        with reporting_machine_faults("keep results in", store.root):
            log.parent.mkdir(parents=True, exist_ok=True)
            log.open("w").close()
        with (
            # Append, because descriptor 2 of a worker is this file, too.
            log.open("a", encoding="utf-8", buffering=1) as stream,
            contextlib.redirect_stdout(stream),
            contextlib.redirect_stderr(stream),
        ):
            yield
        with contextlib.suppress(FileNotFoundError):  # without locks between machines another one may run the same task
            if log.stat().st_size == 0:
                log.unlink()
    finally:
        _logs.release()


def _append(log: Path, text: str) -> str | None:
    """Append to a log and return its path; None if it cannot be written, as in a read-only store."""
    try:
        log.parent.mkdir(parents=True, exist_ok=True)
        with log.open("a", encoding="utf-8") as stream:
            stream.write(text)
    except OSError:  # the failure itself is reported in any case
        return None
    return str(log)


def _message(error: BaseException) -> str:
    """Message of an error for the user; the traceback is in the log."""
    if isinstance(error, PipelineError):
        return str(error)
    text = "\n".join(f"{type(error).__name__}: {error}".strip(" :\n").splitlines()[-_LINES:])
    is_ours = not isinstance(error, OSError | MemoryError)
    return f"{text}\n    hint: {_REPORT}" if is_ours else text
