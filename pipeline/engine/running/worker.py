"""A worker process: jobs arrive as lines of JSON; the start of a task and the replies are sent as lines of JSON.

A pool of the standard library is not used: it would import the driver's main module again (with typer and the rest),
send pickles, and fail all waiting tasks when one worker dies.
"""

import contextlib
import faulthandler
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


class _Announcing(Store):
    """A store that tells the driver when a task has its lock: time spent by another builder is not time of the task."""

    replies: int
    task: str

    @contextlib.contextmanager
    def single_flight(self, key: str, doing: str) -> Iterator[bool]:
        """Hold the lock of a key as any store does, and announce the start of the task."""
        with super().single_flight(key, doing) as held:
            _send(self.replies, [Reply(name=self.task, state="begun")])
            yield held

    def say_waiting(self, text: str) -> None:
        """Send the message to the driver now, not when the task is done."""
        _send(self.replies, [Reply(name=self.task, state="waiting", warnings=(text,))])


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
    store, packages = _Announcing(setup["store"], warn=warnings.append), tuple(setup["packages"])
    store.replies = replies
    while True:
        job = [from_plain(Spec, plain) for plain in json.loads(lines.get())]
        store.task = job[0].name
        with _descriptors_in(store.file_for("log", job[0].key)):
            first, *others = perform(job, store, packages)
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
