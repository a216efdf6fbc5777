"""Do the work of one task anywhere: small plain data in, small plain data out; bulk data moves through the store.

This module and what it imports is all that a worker loads of the engine.
"""

import contextlib
import datetime
import importlib
import os
import shutil
import socket
import time
import traceback
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from pipeline.engine.code import check_kind, code_of
from pipeline.engine.files import is_machines_fault
from pipeline.engine.store import DamagedBlob, Store

ONE_THREAD = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"), "1")
"""Numeric libraries must not split sums over threads: their results would depend on the number of cores."""

_TAIL = 12  # lines of a log that a failure carries
_imported: dict[str, str] = {}  # kind -> fingerprint of its code when this process imported it


def perform(spec: dict[str, Any], store: Store, packages: tuple[str, ...]) -> dict[str, Any]:
    """Look the key up, else compute it; running twice is harmless.

    Parameters
    ----------
    spec : dict
        `Spec.to_plain()`, and `force`: compute even if there is a record.

    Returns
    -------
    dict
        `name`, `state` (executed, cached or failed), `seconds` and either `record` or `error`, `log`, `machine`
        (whether the machine and not the task is to blame), `damaged` (whether an input was found damaged).
    """
    key, start = spec["key"], time.perf_counter()
    log = store.path("log", key)
    try:
        with store.single_flight(key):
            record = None if spec.get("force") else store.record(key)  # somebody may have made it meanwhile
            if record is not None:
                return {"name": spec["name"], "state": "cached", "seconds": 0.0, "record": record}
            with _logging(log):
                record = _compute(spec, store, packages)
    except (Exception, SystemExit) as error:
        text = "".join(traceback.format_exception(error))
        _append(log, text)
        reply = {"name": spec["name"], "state": "failed", "error": _tail(text), "log": str(log)}
        blame = {"machine": is_machines_fault(error), "damaged": isinstance(error, DamagedBlob)}
        return {**reply, **blame, "seconds": round(time.perf_counter() - start, 4)}
    seconds = round(time.perf_counter() - start, 4)
    return {"name": spec["name"], "state": "executed", "seconds": seconds, "record": record}


def died(name: str, key: str, how: str, store: Store) -> dict[str, Any]:
    """The reply for a task whose worker is dead."""
    log = store.path("log", key)
    _append(log, f"{how}\n")
    reply = {"name": name, "state": "failed", "seconds": 0.0, "error": how, "log": str(log)}
    return {**reply, "machine": False, "damaged": False}


def _compute(spec: dict[str, Any], store: Store, packages: tuple[str, ...]) -> dict[str, Any]:
    components = spec["components"]
    kind = components["kind"]
    check_kind(kind, packages)
    # What runs must be what the key says: the source may have been edited since the driver read it, or since this
    # process imported it.
    if {code_of(kind)["code"], _imported.get(kind, components["code"])} != {components["code"]}:
        raise RuntimeError(f"the code of {kind} was edited while this process ran; build again in a new one")
    inputs = {
        role: {name: store.blob(digest) for name, digest in blobs.items()}
        for role, blobs in components["inputs"].items()
    }
    out = store.new_path()
    out.mkdir()
    try:
        start = time.perf_counter()
        run = importlib.import_module(kind).run
        _imported.setdefault(kind, components["code"])
        run(components["params"], inputs, out)
        seconds = round(time.perf_counter() - start, 4)
        outputs = {name: store.put_file(path) for name, path in _outputs(out)}
    finally:
        shutil.rmtree(out, ignore_errors=True)
    when = datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds")
    made_by = {"seconds": seconds, "host": socket.gethostname(), "pid": os.getpid(), "when": when}
    return store.put_record(spec["key"], {"outputs": outputs, "components": components, "made_by": made_by})


def _outputs(out: Path) -> Iterator[tuple[str, Path]]:
    """Files below a folder by their relative names, sorted; anything that is not a plain file or folder raises."""
    for path in sorted(out.rglob("*")):
        if path.is_symlink() or not (path.is_file() or path.is_dir()):
            raise ValueError(f"a task may only write plain files, and {path.relative_to(out)} is not one")
        if path.is_file():
            yield path.relative_to(out).as_posix(), path


@contextlib.contextmanager
def _logging(log: Path) -> Iterator[None]:
    """Send what the task prints to its log: stdout is data of the command, stderr belongs to the progress."""
    log.parent.mkdir(parents=True, exist_ok=True)
    log.open("w").close()
    with (
        log.open("a", encoding="utf-8", buffering=1) as stream,  # appending: descriptor 2 of a worker is this file too
        contextlib.redirect_stdout(stream),
        contextlib.redirect_stderr(stream),
    ):
        yield
    if log.stat().st_size == 0:
        log.unlink()


def _append(log: Path, text: str) -> None:
    with contextlib.suppress(OSError):  # the failure itself is reported anyway
        log.parent.mkdir(parents=True, exist_ok=True)
        with log.open("a", encoding="utf-8") as stream:
            stream.write(text)


def _tail(text: str) -> str:
    return "\n".join(text.strip().splitlines()[-_TAIL:])
