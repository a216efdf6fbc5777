"""A worker process: jobs arrive as lines of JSON; the start of a task and the replies are sent as lines of JSON.

A pool of the standard library is not used: it would import the driver's main module again (with typer and the rest),
send pickles, and fail all waiting tasks when one worker dies.
"""

import contextlib
import faulthandler
import functools
import json
import os
import queue
import sys
import threading
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

from pipeline.engine.records import Reply, Spec, as_json
from pipeline.engine.running.execute import perform
from pipeline.engine.store.store import Store
from pipeline.records.plain import from_plain


def main() -> None:
    """Serve until the driver closes our standard input."""
    requests, replies = os.dup(0), os.dup(1)
    os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
    os.dup2(2, 1)  # output to descriptor 1 must not mix with the replies
    faulthandler.enable()
    lines: queue.SimpleQueue[bytes] = queue.SimpleQueue()
    threading.Thread(target=_listen, args=(requests, lines), daemon=True).start()
    setup = json.loads(lines.get())
    warnings: list[str] = []
    store, packages = Store(setup["store"], warn=warnings.append), tuple(setup["packages"])
    while True:
        job = [from_plain(Spec, plain) for plain in json.loads(lines.get())]

        def announce(state: str, *texts: str, task: str = job[0].name) -> None:
            _send(replies, [Reply(name=task, state=state, warnings=texts)])

        store.say_waiting = functools.partial(announce, "waiting")
        with _descriptors_in(store.file_for("log", job[0].key)):
            # Time spent by another builder is not time of the task.
            first, *others = perform(job, store, packages, functools.partial(announce, "begun"))
        _send(replies, [replace(first, warnings=tuple(warnings)), *others])
        warnings.clear()


def _send(handle: int, replies: list[Reply]) -> None:
    view = memoryview(as_json(replies) + b"\n")
    while view:
        view = view[os.write(handle, view) :]


def _listen(handle: int, lines: "queue.SimpleQueue[bytes]") -> None:
    with os.fdopen(handle, "rb") as stream:
        for line in stream:
            lines.put(line)
    os._exit(0)  # the driver has ended or needs no more; nothing half done is visible in the store


@contextlib.contextmanager
def _descriptors_in(log: Path) -> Iterator[None]:
    """Point descriptors 1 and 2 at the log, for native libraries and for the trace of a crash."""
    saved = os.dup(2)
    try:
        log.parent.mkdir(parents=True, exist_ok=True)
        handle = os.open(log, os.O_WRONLY | os.O_CREAT | os.O_TRUNC | os.O_APPEND | os.O_CLOEXEC, 0o666)
    except OSError:
        handle = os.open(os.devnull, os.O_WRONLY)
    os.dup2(handle, 1)
    os.dup2(handle, 2)
    os.close(handle)
    try:
        yield
    finally:
        sys.stderr.flush()
        os.dup2(saved, 1)
        os.dup2(saved, 2)
        os.close(saved)
        with contextlib.suppress(OSError):
            if log.stat().st_size == 0:
                log.unlink()
