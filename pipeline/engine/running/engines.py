"""Engines that run tasks: in this process, or in worker processes, which may die."""

import collections
import contextlib
import faulthandler
import functools
import json
import os
import queue
import selectors
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Protocol

from pipeline.engine.records import Reply, Spec, as_json
from pipeline.engine.running.execute import failed, lost, perform
from pipeline.engine.store.store import Store
from pipeline.machine.facts import command
from pipeline.machine.processor import settings
from pipeline.records.plain import from_plain

Job = tuple[Spec, ...]
"""One task, or several that share work and run together."""


class Engine(Protocol):
    """An executor of jobs. `free` is the number of jobs that it can take now.

    `wait` returns replies of tasks, those of one job together. Where the engine can tell, a job that begins to wait for
    another builder replies with state waiting, and with begun when it goes on.
    """

    @property
    def free(self) -> int: ...
    def submit(self, job: Job) -> None: ...
    def wait(self, timeout_s: float) -> list[Reply]: ...
    def close(self) -> None: ...


class Inline:
    """Engine that runs tasks one after the other in this process."""

    def __init__(self, store: Store, packages: tuple[str, ...]) -> None:
        self._store, self._packages = store, packages
        self._waiting: collections.deque[Job] = collections.deque()

    @property
    def free(self) -> int:
        """1, or 0 if a task has been submitted."""
        return 1 - len(self._waiting)

    def submit(self, job: Job) -> None:
        self._waiting.append(job)

    def wait(self, timeout_s: float) -> list[Reply]:
        """Run the submitted jobs and return the replies."""
        replies = [reply for job in self._waiting for reply in perform(job, self._store, self._packages)]
        self._waiting.clear()
        return replies

    def close(self) -> None:
        """Do nothing: there is no worker to end."""


@dataclass(slots=True, eq=False)
class _Worker:
    """A worker process and its job."""

    process: "subprocess.Popen[bytes]"
    job: Job = ()
    since: float | None = None  # when its task began; None while another builder has the task
    received: bytearray = field(default_factory=bytearray)


class Processes:
    """Engine with worker processes, which import only the modules of their tasks. A dying worker costs only its task.

    A task that takes longer than `timeout_s` fails and is ended with its worker. Time spent waiting for another builder
    does not count.
    """

    def __init__(self, store: Store, packages: tuple[str, ...], jobs: int, *, timeout_s: float | None = None) -> None:
        self._store = store
        self._packages = packages
        self._jobs = jobs
        self._timeout_s = timeout_s
        self._workers: list[_Worker] = []
        self._ready = selectors.DefaultSelector()

    @property
    def free(self) -> int:
        """Number of workers without a task, including those not started yet."""
        return self._jobs - sum(bool(worker.job) for worker in self._workers)

    def submit(self, job: Job) -> None:
        """Give a job to an idle worker, or to a new one."""
        worker = next((worker for worker in self._workers if not worker.job), None) or self._start()
        worker.job = job
        worker.since = None
        self._send(worker, job)

    def wait(self, timeout_s: float) -> list[Reply]:
        """Replies that arrived within the timeout, possibly none."""
        replies: list[Reply] = []
        for ready, _ in self._ready.select(timeout_s):
            worker: _Worker = ready.data
            data = os.read(ready.fd, 1 << 16)
            worker.received += data
            *lines, worker.received = worker.received.split(b"\n")
            for line in lines:
                of_job = [from_plain(Reply, plain) for plain in json.loads(line)]
                replies += of_job
                if of_job[0].state == "begun":
                    worker.since = time.monotonic()
                elif of_job[0].state != "waiting":
                    worker.job = ()
            if not data:
                replies += self._worker_died(worker)
        return replies + self._overdue()

    def _overdue(self) -> list[Reply]:
        """End workers whose job exceeds the time limit; returns their replies."""
        replies = []
        for worker in list(self._workers):
            if not worker.job or worker.since is None:
                continue
            seconds = time.monotonic() - worker.since
            if self._timeout_s is not None and seconds > self._timeout_s:
                worker.process.kill()
                self._forget(worker)
                text = f"it took longer than {self._timeout_s:g} s and was ended (--timeout)"
                replies += [failed(spec, text, self._store, seconds) for spec in worker.job]
        return replies

    def close(self) -> None:
        """End all workers at once; unfinished tasks leave nothing behind."""
        for worker in self._workers:
            worker.process.kill()
        for worker in list(self._workers):
            self._forget(worker)

    def _start(self) -> _Worker:
        """Start a worker and tell it the store and the packages."""
        process = subprocess.Popen(
            command("pipeline.engine.running.engines:serve"),
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            env={**os.environ, **settings()},
            process_group=0,  # Ctrl-C reaches the driver only, which decides about running tasks
        )
        worker = _Worker(process)
        # A signal may interrupt between any two lines: a worker is registered at once, so that `close` ends it.
        self._ready.register(process.stdout, selectors.EVENT_READ, worker)  # type: ignore[arg-type]
        self._workers.append(worker)
        setup = {"store": str(self._store.root), "packages": self._packages}
        self._send(worker, setup)
        return worker

    def _send(self, worker: _Worker, message: Any) -> None:
        assert worker.process.stdin is not None
        # A broken pipe means a dead worker: `wait` reads the end of its replies and starts the task again.
        with contextlib.suppress(BrokenPipeError):
            worker.process.stdin.write(as_json(message) + b"\n")
            worker.process.stdin.flush()

    def _worker_died(self, worker: _Worker) -> list[Reply]:
        """Replies for the tasks of a worker that has ended."""
        status = worker.process.wait()
        self._forget(worker)
        cause = signal.Signals(-status).name if status < 0 else f"exit code {status}"
        is_killed = status == -signal.SIGKILL  # as the system does when memory is short
        return [lost(spec, f"its worker process died by {cause}", memory=is_killed) for spec in worker.job]

    def _forget(self, worker: _Worker) -> None:
        """Remove a worker that was killed or has ended."""
        assert worker.process.stdin is not None and worker.process.stdout is not None
        self._workers.remove(worker)
        self._ready.unregister(worker.process.stdout)
        worker.process.stdout.close()
        with contextlib.suppress(BrokenPipeError):
            worker.process.stdin.close()
        worker.process.wait()


def serve() -> None:
    """Work as a worker process until the driver closes our standard input: jobs arrive and replies leave as JSON lines.

    A pool of the standard library would import the driver's main module again (with typer and the rest), send pickles,
    and fail all waiting tasks when one worker dies.
    """
    requests = os.dup(0)
    replies = os.dup(1)
    os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
    os.dup2(2, 1)  # output to descriptor 1 must not mix with the replies
    faulthandler.enable()
    lines: queue.SimpleQueue[bytes] = queue.SimpleQueue()
    threading.Thread(target=_listen, args=(requests, lines), daemon=True).start()
    setup = json.loads(lines.get())
    warnings: list[str] = []
    store = Store(setup["store"], warn=warnings.append)
    packages = tuple(setup["packages"])
    while True:
        job = [from_plain(Spec, plain) for plain in json.loads(lines.get())]

        def announce(state: str, *texts: str, task: str = job[0].name) -> None:
            _send(replies, [Reply(name=task, state=state, warnings=texts)])

        store.say_waiting = functools.partial(announce, "waiting")
        with _descriptors_in(store.file_for("log", job[0].key)):
            # Time spent by another builder is not time of the task.
            first, *rest = perform(job, store, packages, functools.partial(announce, "begun"))
        _send(replies, [replace(first, warnings=tuple(warnings)), *rest])
        warnings.clear()


def _send(handle: int, replies: list[Reply]) -> None:
    view = memoryview(as_json(replies) + b"\n")
    while view:
        view = view[os.write(handle, view) :]


def _listen(handle: int, lines: "queue.SimpleQueue[bytes]") -> None:
    """Put the lines of the driver into a queue, and end this process when there are no more."""
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
