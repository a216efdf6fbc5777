"""Tasks on a Dask cluster. The only module that imports `distributed`, which comes with the extra [cluster].

Dask sees neither the graph nor an array: a job is a few kB and its result a record. Everything else goes through the
store, a folder that every worker reaches under the same path. Finished results survive the death of any process.
"""

import asyncio
import contextlib
import logging
import os
import re
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

from pipeline.engine.records import Reply
from pipeline.engine.running.engines import Job
from pipeline.engine.running.execute import failed, lost, perform
from pipeline.engine.store.store import Store
from pipeline.errors import EnvironmentFault, PipelineError, UsageError

_CONNECT_S = 30
"""Timeout for connecting to a scheduler [s]: the default of Dask."""
_NO_WORKERS_S = 120.0
"""Timeout for a cluster without workers [s]: batch systems start workers when there is room, but a user should hear of
a cluster that has none.
"""
_OF_DASK = re.compile(r"distributed\.")
_SETTINGS = {
    # A worker that holds the interpreter's lock for a long time is not dead.
    "distributed.scheduler.worker-ttl": "30 minutes",
    # The driver counts deaths itself: a dying machine must not fail tasks that only waited there.
    "distributed.scheduler.allowed-failures": 1000,
    "distributed.comm.timeouts.connect": f"{_CONNECT_S}s",
}


def engine_of(scheduler: str, timeout_s: float | None = None) -> Callable[[Store, tuple[str, ...]], "Dask"]:
    """The engine of `--engine dask:WHERE`; UsageError if it names no scheduler, EnvironmentFault without [cluster]."""
    if not scheduler:
        hint = (
            "write dask:tcp://host:8786, or dask:FILE for the file that `dask scheduler --scheduler-file FILE` writes"
        )
        raise UsageError("the engine dask has no scheduler", hint=hint)
    if "://" not in scheduler and not Path(scheduler).is_file():
        raise UsageError(f"there is no scheduler file {scheduler}", hint="an address has the form tcp://host:8786")
    try:
        import distributed  # noqa: F401
    except ImportError:
        raise EnvironmentFault(
            "the engine dask needs the library distributed", hint="pip install 'plenoptic-pipeline[cluster]'"
        ) from None
    return lambda store, packages: Dask(scheduler, store, packages, timeout_s=timeout_s)


class Dask:
    """Engine that runs tasks on the Dask cluster of a scheduler, given by its address or the path of its file.

    A task that takes longer than `timeout_s` fails. Its worker is restarted if it has a nanny, because Dask cannot end
    a running task.
    """

    def __init__(self, where: str, store: Store, packages: tuple[str, ...], *, timeout_s: float | None = None) -> None:
        import dask
        import distributed

        dask.config.set(_SETTINGS)
        for name in ("distributed", *filter(_OF_DASK.match, logging.root.manager.loggerDict)):
            logging.getLogger(name).setLevel(logging.CRITICAL)  # we report what matters ourselves
        self._store = store
        self._packages = packages
        self._timeout_s = timeout_s
        self._running: dict[Any, tuple[Job, float]] = {}
        self._submitted = 0
        self._no_workers_since: float | None = None
        address, file = (where, None) if "://" in where else (None, where)
        try:
            self._client = distributed.Client(address, scheduler_file=file, timeout=_CONNECT_S, set_as_default=False)
        except (OSError, TimeoutError, ValueError) as error:
            raise EnvironmentFault(
                f"cannot reach the Dask scheduler {where}: {error}", hint="is it running, and is this its address?"
            ) from error
        with self._reporting_loss():
            self._require_same_store()

    @property
    def free(self) -> int:
        """Number of tasks that the cluster can take: idle threads, plus one task per worker that waits, unless that
        wait cannot be told from work.
        """
        threads = self._threads()
        return sum(threads) + (len(threads) if self._timeout_s is None else 0) - len(self._running)

    def submit(self, job: Job) -> None:
        """Give a job to the cluster."""
        self._submitted += 1
        with self._reporting_loss():
            future = self._client.submit(
                _perform_on_worker,
                job,
                str(self._store.root),
                list(self._packages),
                # A new key each time: for a known key Dask would return the old result.
                key=f"{job[0].components.kind}-{job[0].key[:32]}-{os.getpid()}-{self._submitted}",
                pure=False,
                priority=-self._submitted,  # keeps the order of the driver, which submits the longest path first
            )
        self._running[future] = job, time.monotonic()

    def wait(self, timeout_s: float) -> list[Reply]:
        """Replies that arrived within the timeout, possibly none."""
        import distributed

        self._require_scheduler()
        if not self._running:  # nothing to wait for in Dask: only a new worker can help
            time.sleep(timeout_s)
            self._require_workers()
            return []
        try:
            with self._client.as_current():
                done = distributed.wait(list(self._running), timeout=timeout_s, return_when="FIRST_COMPLETED").done
        except TimeoutError:
            done = set()
        except (distributed.CancelledError, asyncio.CancelledError, OSError):
            done = {future for future in self._running if future.done()}
        replies = [reply for future in done if future in self._running for reply in self._replies(future)]
        return replies + self._overdue()

    def close(self) -> None:
        """Cancel unfinished tasks; the cluster goes on."""
        with contextlib.suppress(Exception):  # a dead scheduler has nothing to cancel
            self._client.cancel(list(self._running), force=True)
        with contextlib.suppress(Exception):
            self._client.close(timeout=5)

    def _replies(self, future: Any) -> list[Reply]:
        """Replies of a finished job; those of a worker that died are lost or failed."""
        import distributed

        job, _ = self._running.pop(future)
        try:
            replies: list[Reply] = future.result(timeout=_CONNECT_S)
        except distributed.KilledWorker as error:
            return [lost(spec, f"its worker died ({error.last_worker.address})") for spec in job]
        except (distributed.CancelledError, asyncio.CancelledError, TimeoutError, OSError):
            self._require_scheduler()
            return [lost(spec, "its worker was lost") for spec in job]
        except Exception as error:  # it could not begin: another version of this package, a store out of reach
            return [failed(spec, f"{type(error).__name__}: {error}", self._store, machine=True) for spec in job]
        finally:
            future.release()
        return replies

    def _overdue(self) -> list[Reply]:
        """Replies of tasks that took too long; their workers are restarted."""
        replies = []
        for future, (job, since) in list(self._running.items()):
            seconds = time.monotonic() - since
            if self._timeout_s is None or seconds <= self._timeout_s:
                continue
            workers = [worker for worker, keys in self._client.processing().items() if future.key in keys]
            del self._running[future]
            self._client.cancel([future], force=True)
            with contextlib.suppress(ValueError):  # a worker without a nanny goes on until its task ends
                self._client.restart_workers(workers, raise_for_error=False)
            text = f"it took longer than {self._timeout_s:g} s and was ended (--timeout)"
            replies += [failed(spec, text, self._store, seconds) for spec in job]
        self._require_workers()
        return replies

    def _threads(self) -> list[int]:
        try:
            workers = self._client.scheduler_info(n_workers=-1)["workers"]
        except (OSError, KeyError):
            return []
        return [int(worker["nthreads"]) for worker in workers.values()]

    def _require_workers(self) -> None:
        if self._threads():
            self._no_workers_since = None
            return
        self._no_workers_since = self._no_workers_since or time.monotonic()
        if time.monotonic() - self._no_workers_since > _NO_WORKERS_S:
            raise EnvironmentFault(
                f"the Dask cluster has had no worker for {_NO_WORKERS_S:g} s", hint="start workers, and build again"
            )

    def _require_scheduler(self) -> None:
        give_up = time.monotonic() + _CONNECT_S
        while self._client.status == "connecting" and time.monotonic() < give_up:
            time.sleep(0.1)
        if self._client.status != "running":
            raise _no_scheduler()

    @contextlib.contextmanager
    def _reporting_loss(self) -> Iterator[None]:
        """Context for calls to the scheduler. A client that has lost it raises many kinds of errors."""
        try:
            yield
        except PipelineError:
            raise
        except (Exception, asyncio.CancelledError) as error:
            of_dask = type(error).__module__.partition(".")[0] in ("asyncio", "distributed", "tornado")
            if of_dask or isinstance(error, OSError) or self._client.status != "running":
                with contextlib.suppress(Exception):
                    self._client.close(timeout=5)
                raise _no_scheduler() from error
            raise

    def _require_same_store(self) -> None:
        """Check that every worker sees this store under this path: the only thing that workers and driver share."""
        note = f"{os.getpid()}-{time.time_ns()}"
        self._store.write_note("index", f"here-{note}", note)
        try:
            self._client.wait_for_workers(1, timeout=_NO_WORKERS_S)
            views = self._client.run(_sees_note, str(self._store.root), note, on_error="return")
        except TimeoutError:
            raise EnvironmentFault("the Dask cluster has no workers", hint="start some, and build again") from None
        finally:
            (self._store.root / "index" / f"here-{note}.json").unlink(missing_ok=True)
        bad = {address: answer for address, answer in views.items() if answer is not True}
        if bad:
            address, answer = next(iter(bad.items()))
            reason = f"{type(answer).__name__}: {answer}" if isinstance(answer, Exception) else "it is not there"
            raise EnvironmentFault(
                f"the worker {address} does not see the store {self._store.root} ({reason})",
                hint="set PIPELINE_CACHE to a folder that all machines reach, and install the same version everywhere",
            )


def _no_scheduler() -> EnvironmentFault:
    hint = "start it and build again: what was finished is in the store"
    return EnvironmentFault("the Dask scheduler is gone", hint=hint)


def _sees_note(root: str, note: str) -> bool:
    return Store(root).read_note("index", f"here-{note}") == note


def _perform_on_worker(job: Job, root: str, packages: list[str]) -> list[Reply]:
    """Perform a job on a worker."""
    warnings: list[str] = []
    store = Store(root, warn=warnings.append)
    with store.in_use():
        first, *rest = perform(job, store, tuple(packages))
    return [replace(first, warnings=tuple(warnings)), *rest]
