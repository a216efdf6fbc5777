"""Do the work of one task anywhere: small plain data in, small plain data out; bulk data moves through the store.

This module and what it imports is all that a worker loads of the engine.
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
"""Lines of an error that a failure carries."""
_REPORT = "this is a bug of ours: please report it with the log and your stage"


def perform(spec: Plain, store: Store, packages: tuple[str, ...]) -> Plain:
    """Look the key up, else compute it; running twice is harmless.

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
    except (Exception, SystemExit):  # one of them, or their company: each alone says which, and why
        first, *others = (_alone(one, store, packages) for one in specs)
    return {**first, "company": others}


def _alone(spec: Plain, store: Store, packages: tuple[str, ...]) -> Plain:
    key, start = spec["key"], time.perf_counter()
    log = store.file_for("log", key)
    try:
        with store.single_flight(key, f"makes {spec['name']}"):
            record = _found(spec, store)  # somebody may have made it meanwhile
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
    """Replies of tasks with the same inputs that share work; an error says nothing about which of them is to blame."""
    start, replies = time.perf_counter(), dict[str, Plain]()
    with contextlib.ExitStack() as locks:
        for spec in sorted(specs, key=lambda spec: str(spec["key"])):  # in one order, lest two builders wait for ever
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
    """Whether bytes that the task reads are gone or altered, also if they went while it ran."""
    try:
        for blobs in spec["components"]["inputs"].values():
            for digest in blobs.values():
                store.blob(digest)
    except DamagedBlob:
        return True
    return False


def failed(name: str, key: str, how: str, store: Store, seconds: float = 0.0) -> dict[str, Any]:
    """The reply for a task that was ended from outside: its worker died, or its time was up."""
    log = store.file_for("log", key)
    _append(log, f"{how}\n")
    reply: dict[str, Any] = {"name": name, "state": "failed", "error": how, "log": str(log)}
    return {**reply, "seconds": round(seconds, 4), "machine": False, "damaged": False, "memory": False}


def lost(name: str, how: str, *, memory: bool = False) -> dict[str, Any]:
    """The reply for a task whose worker died; the driver decides whether it gets another one."""
    return {"name": name, "state": "lost", "seconds": 0.0, "error": how, "memory": memory}


def _compute(specs: list[Plain], store: Store, packages: tuple[str, ...]) -> list[tuple[Plain, list[str]]]:
    """Run tasks of one kind with the same inputs, and keep what they made: record, and outputs that differ, of each."""
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
        # A copy, by the order of names: a task sees no order that its key does not know, and changes nobody's params.
        plain = [json.loads(json.dumps(spec["components"]["params"], sort_keys=True)) for spec in specs]
        module = importlib.import_module(kind)
        params = [from_plain(module.Params, one) if hasattr(module, "Params") else one for one in plain]
        if count > 1:
            module.run_together(params, inputs, outs)
        else:
            module.run(params[0], inputs, outs[0])
        _refuse_edited_code(kind)
        store.confirm(read.values())  # what the task has read since is what was verified before
        made_by: Plain = {"seconds": round((time.perf_counter() - start) / count, 4), "peak_bytes": meter.read_bytes()}
        made_by["cpu_seconds"] = round((time.process_time() - cpu_s) / count, 4)
        made_by |= work().since(before).to_plain(1 / count)
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
    """Refuse to run anything but what the key says: code, libraries and machine.

    The source may have been edited since the driver read it, and a worker on another machine may have another version
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
    """The source may also have been edited since this process imported it, or while it did."""
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
    """A folder on the store's file system, gone afterwards; a disk that fills up says how much it lacked."""
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
    """Files below a folder by their relative names, sorted; anything that is not a plain file or folder raises."""
    for path in sorted(out.rglob("*")):
        if path.is_symlink() or not (path.is_file() or path.is_dir()):
            raise ValueError(f"a task may only write plain files, and {path.relative_to(out)} is not one")
        if path.is_file():
            yield path.relative_to(out).as_posix(), path


@contextlib.contextmanager
def _logging(log: Path, store: Store) -> Iterator[None]:
    """Send what the task prints to its log: stdout is data of the command, stderr belongs to the progress."""
    if not _logs.acquire(blocking=False):  # another thread's task owns the streams of this process
        yield
        return
    try:
        log.parent.mkdir(parents=True, exist_ok=True)
        log.open("w").close()
        store.rights.give(log)
        with (
            log.open(
                "a", encoding="utf-8", buffering=1
            ) as stream,  # appending: descriptor 2 of a worker is this file too
            contextlib.redirect_stdout(stream),
            contextlib.redirect_stderr(stream),
        ):
            yield
        with contextlib.suppress(FileNotFoundError):  # where locks do not reach, another machine does the same task
            if log.stat().st_size == 0:
                log.unlink()
    finally:
        _logs.release()


def _append(log: Path, text: str) -> None:
    with contextlib.suppress(OSError):  # the failure itself is reported anyway
        log.parent.mkdir(parents=True, exist_ok=True)
        with log.open("a", encoding="utf-8") as stream:
            stream.write(text)


def _said(error: BaseException) -> str:
    """Words for the user; the traceback is in the log."""
    if isinstance(error, PipelineError):
        return str(error)
    text = "\n".join(f"{type(error).__name__}: {error}".strip(" :\n").splitlines()[-_LINES:])
    is_ours = not isinstance(error, OSError | MemoryError)
    return f"{text}\n    hint: {_REPORT}" if is_ours else text
