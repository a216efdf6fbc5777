"""Perform one task in any process: small plain data in and out; bulk data moves through the store.

A worker loads no other part of the engine than this module and its imports.
"""

import contextlib
import datetime
import importlib
import json
import os
import shutil
import socket
import threading
import time
import traceback
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from pipeline.engine.files import is_machines_fault, machine_errors
from pipeline.engine.planning.task_code import check_kind, code_of, edited, remembering
from pipeline.engine.running.memory import PeakMeter
from pipeline.engine.store.store import DamagedBlob, Store
from pipeline.errors import EnvironmentFault, PipelineError
from pipeline.jit.work import work
from pipeline.machine.processor import settings
from pipeline.records.plain import from_plain

Plain = dict[str, Any]

_logs = threading.Lock()
_LINES = 12
"""Most lines of an error message in the reply of a failed task."""
_REPORT = "this is a bug of ours: please report it with the log and your stage"


def perform(spec: Plain, store: Store, packages: tuple[str, ...]) -> Plain:
    """Look up the result of a task, or compute it; running it twice is harmless.

    Parameters
    ----------
    spec : dict
        `Spec.to_plain()`, and `force`: compute even if there is a record; `company`, if there is any: such specs of
        tasks that share work with this one.

    Returns
    -------
    dict
        `name`, `state` (executed, cached or failed), `seconds` and either `record` and `differs` (outputs that are not
        what the store already had for the key) or `error`, `log`, `machine` (whether the machine and not the task is
        to blame), `damaged` (whether an input was found damaged, or was written to while the task used it), `memory`
        (whether there was too little of it). `company`: the same for the others.
    """
    company = spec.get("company")
    if not company:
        return _alone(spec, store, packages)
    specs = [spec, *company]
    try:
        first, *others = _together(specs, store, packages)
    # unknown which of them failed: they run again one by one, and each reports its own error
    except (Exception, SystemExit):
        first, *others = (_alone(one, store, packages) for one in specs)
    return {**first, "company": others}


def _alone(spec: Plain, store: Store, packages: tuple[str, ...]) -> Plain:
    key, start = spec["key"], time.perf_counter()
    log = store.file_for("log", key)
    try:
        with store.single_flight(key, f"makes {spec['name']}"):
            record = _found(spec, store)  # another builder may have made it meanwhile
            if record is not None:
                return _cached(spec, record)
            with _logging(log, store):
                ((record, differs),) = _compute([spec], store, packages)
    except (Exception, SystemExit) as error:
        expected = isinstance(error, EnvironmentFault | DamagedBlob)
        _append(log, f"{error}\n" if expected else "".join(traceback.format_exception(error)))
        reply: Plain = {"name": spec["name"], "state": "failed", "error": _said(error), "log": str(log)}
        blame = {
            "machine": expected or is_machines_fault(error),
            "damaged": isinstance(error, DamagedBlob) or _lacks_inputs(spec, store),
            "memory": isinstance(error, MemoryError),
        }
        return {**reply, **blame, "seconds": round(time.perf_counter() - start, 4)}
    return _executed(spec, time.perf_counter() - start, record, differs)


def _together(specs: list[Plain], store: Store, packages: tuple[str, ...]) -> list[Plain]:
    """Replies of tasks with the same inputs that run together. An error does not show which of them is to blame."""
    start, replies = time.perf_counter(), dict[str, Plain]()
    with contextlib.ExitStack() as locks:
        # always in the same order, so that two builders cannot wait for each other for ever
        for spec in sorted(specs, key=lambda spec: str(spec["key"])):
            locks.enter_context(store.single_flight(spec["key"], f"makes {spec['name']}"))
        todo = []
        for spec in specs:
            record = _found(spec, store)
            if record is None:
                todo.append(spec)
            else:
                replies[spec["name"]] = _cached(spec, record)
        if todo:
            with _logging(store.file_for("log", todo[0]["key"]), store):
                made = _compute(todo, store, packages)
            seconds = (time.perf_counter() - start) / len(todo)
            replies |= {spec["name"]: _executed(spec, seconds, *one) for spec, one in zip(todo, made, strict=True)}
    return [replies[spec["name"]] for spec in specs]


def _found(spec: Plain, store: Store) -> Plain | None:
    return None if spec.get("force") else store.record(spec["key"])


def _cached(spec: Plain, record: Plain) -> Plain:
    return {"name": spec["name"], "state": "cached", "seconds": 0.0, "record": record}


def _executed(spec: Plain, seconds: float, record: Plain, differs: list[str]) -> Plain:
    facts = {"name": spec["name"], "state": "executed", "seconds": round(seconds, 4)}
    return {**facts, "record": record, "differs": differs}


def _lacks_inputs(spec: dict[str, Any], store: Store) -> bool:
    """Whether input bytes of the task are missing or altered, even if that happened while it ran."""
    try:
        for blobs in spec["components"]["inputs"].values():
            for digest in blobs.values():
                store.blob(digest)
    except DamagedBlob:
        return True
    return False


def failed(name: str, key: str, how: str, store: Store, seconds: float = 0.0) -> dict[str, Any]:
    """The reply for a task that was ended from outside: its worker died or its time limit was reached."""
    log = store.file_for("log", key)
    _append(log, f"{how}\n")
    reply: dict[str, Any] = {"name": name, "state": "failed", "error": how, "log": str(log)}
    return {**reply, "seconds": round(seconds, 4), "machine": False, "damaged": False, "memory": False}


def lost(name: str, how: str, *, memory: bool = False) -> dict[str, Any]:
    """The reply for a task whose worker died; the driver decides whether it gets another one."""
    return {"name": name, "state": "lost", "seconds": 0.0, "error": how, "memory": memory}


def _compute(specs: list[Plain], store: Store, packages: tuple[str, ...]) -> list[tuple[Plain, list[str]]]:
    """Run tasks of one kind with the same inputs and store their results. Of each: the record, and the outputs that
    differ from earlier ones.
    """
    components = specs[0]["components"]
    kind, count = components["kind"], len(specs)
    check_kind(kind, packages)
    _refuse_other_code(kind, components, store)
    read = {digest: store.verified(digest) for blobs in components["inputs"].values() for digest in blobs.values()}
    inputs = {
        role: {name: read[digest].path for name, digest in blobs.items()}
        for role, blobs in components["inputs"].items()
    }
    with contextlib.ExitStack() as folders:
        outs = [folders.enter_context(_folder_for_outputs(store)) for _ in specs]
        meter, start, cpu_s, before = PeakMeter(), time.perf_counter(), time.process_time(), work().copy()
        # A copy in the order of names: a task sees no order that is not in its key, and cannot change others'
        # parameters.
        plain = [json.loads(json.dumps(spec["components"]["params"], sort_keys=True)) for spec in specs]
        module = importlib.import_module(kind)
        params = [from_plain(module.Params, one) if hasattr(module, "Params") else one for one in plain]
        work().news = ""
        if count > 1:
            module.run_together(params, inputs, outs)
        else:
            module.run(params[0], inputs, outs[0])
        _refuse_edited_code(kind)
        store.confirm(read.values())  # the task has read the verified bytes
        made_by: Plain = {"seconds": round((time.perf_counter() - start) / count, 4), "peak_bytes": meter.read_bytes()}
        made_by["cpu_seconds"] = round((time.process_time() - cpu_s) / count, 4)
        made_by |= work().since(before).to_plain(1 / count) | ({"news": work().news} if work().news else {})
        return [_keep(spec, out, made_by, store) for spec, out in zip(specs, outs, strict=True)]


def _keep(spec: Plain, out: Path, made_by: Plain, store: Store) -> tuple[Plain, list[str]]:
    outputs = {name: store.put_file(path) for name, path in _outputs(out)}
    when = datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds")
    made_by = {**made_by, "host": socket.gethostname(), "pid": os.getpid(), "when": when}
    record = {"outputs": outputs, "components": spec["components"], "made_by": made_by}
    kept = store.put_record(spec["key"], record)
    names = sorted(outputs.keys() | kept["outputs"].keys())
    return kept, [name for name in names if outputs.get(name) != kept["outputs"].get(name)]


def _refuse_other_code(kind: str, components: dict[str, Any], store: Store) -> None:
    """Refuse to run a task with other code, libraries or machine than its key states.

    The source may have been edited since the driver read it, and a worker on another machine may have other versions
    of anything.
    """
    with remembering(store):
        here = code_of(kind)
    for part, value in here.items():
        if value != components[part]:
            raise EnvironmentFault(
                f"{kind}: this process cannot make what the key says: {part} is {_changed(components[part], value)}",
                hint=_way_out(part),
            )
    _refuse_edited_code(kind)


def _way_out(part: str) -> str:
    if part != "machine":
        return "if the code was edited meanwhile, build again; else give all machines the same versions"
    kernels = settings().get("OPENBLAS_CORETYPE")
    set_before = f", started with OPENBLAS_CORETYPE={kernels}" if kernels else ""
    return f"last digits would differ: use machines of one level, system and environment{set_before}"


def _refuse_edited_code(kind: str) -> None:
    """Refuse to run a task whose source was edited during or after its import by this process."""
    if names := edited(kind):
        raise EnvironmentFault(
            f"{kind}: the code was edited after this process had read it: {', '.join(names)}",
            hint="start this program again; on a cluster, the workers",
        )


def _changed(old: Any, new: Any) -> str:
    if isinstance(old, dict) and isinstance(new, dict):
        names = [name for name in sorted(old.keys() | new.keys()) if old.get(name) != new.get(name)]
        return ", ".join(f"{name} {new.get(name)}, not {old.get(name)}" for name in names)
    return f"{str(new)[:12]}, not {str(old)[:12]}"


@contextlib.contextmanager
def _folder_for_outputs(store: Store) -> Iterator[Path]:
    """A temporary folder on the store's file system. If the disk fills up, the error states how much is needed."""
    with machine_errors("keep results in", store.root) as disk:
        out = store.new_path()
        out.mkdir()
        try:
            yield out
        except OSError:
            disk.needed = 1 + sum(path.lstat().st_size for path in out.rglob("*"))
            raise
        finally:
            shutil.rmtree(out, ignore_errors=True)


def _outputs(out: Path) -> Iterator[tuple[str, Path]]:
    """Relative names and paths of the files below a folder, sorted; anything but plain files and folders raises an
    error.
    """
    for path in sorted(out.rglob("*")):
        if path.is_symlink() or not (path.is_file() or path.is_dir()):
            raise ValueError(f"a task may only write plain files, and {path.relative_to(out)} is not one")
        if path.is_file():
            yield path.relative_to(out).as_posix(), path


@contextlib.contextmanager
def _logging(log: Path, store: Store) -> Iterator[None]:
    """Send what the task prints to its log: stdout is data of the command, stderr belongs to the progress."""
    if not _logs.acquire(blocking=False):  # a task in another thread has redirected the streams of this process
        yield
        return
    try:
        log.parent.mkdir(parents=True, exist_ok=True)
        log.open("w").close()
        with (
            log.open(
                "a", encoding="utf-8", buffering=1
            ) as stream,  # append, because descriptor 2 of a worker is this file, too
            contextlib.redirect_stdout(stream),
            contextlib.redirect_stderr(stream),
        ):
            yield
        with contextlib.suppress(FileNotFoundError):  # without locks between machines another one may run the same task
            if log.stat().st_size == 0:
                log.unlink()
    finally:
        _logs.release()


def _append(log: Path, text: str) -> None:
    with contextlib.suppress(OSError):  # the failure itself is reported in any case
        log.parent.mkdir(parents=True, exist_ok=True)
        with log.open("a", encoding="utf-8") as stream:
            stream.write(text)


def _said(error: BaseException) -> str:
    """Message of an error for the user; the traceback is in the log."""
    if isinstance(error, PipelineError):
        return str(error)
    text = "\n".join(f"{type(error).__name__}: {error}".strip(" :\n").splitlines()[-_LINES:])
    is_ours = not isinstance(error, OSError | MemoryError)
    return f"{text}\n    hint: {_REPORT}" if is_ours else text
