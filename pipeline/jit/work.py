"""Tally of the work of kernels, per thread: calls, processor time, rays. It changes no byte of a result.

A thread does one task at a time, so that the difference of two readings is the work of the task between them.
"""

import threading
import time
from collections import defaultdict
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field

from pipeline.records.plain import Json

_local = threading.local()


@dataclass(slots=True, kw_only=True)
class KernelWork:
    """Work of one kernel: calls, processor time in compiled code [s], rays that it started, blocked ones included, and
    these rays times the surfaces of the lens.
    """

    calls: int = 0
    seconds: float = 0.0
    rays: int = 0
    crossings: int = 0


@dataclass(kw_only=True)
class Work:
    """Work of a thread since it began, or of a stretch of it: `kernels` by name, processor time for loading compiled
    code or for compiling [s], a few words of the task to whoever watches the build, and what its user should know.
    """

    kernels: defaultdict[str, KernelWork] = field(default_factory=lambda: defaultdict(KernelWork))
    loading_s: float = 0.0
    news: str = ""
    warning: str = ""

    def since(self, before: "Work") -> "Work":
        """The work that an earlier copy does not hold."""
        difference = Work(loading_s=self.loading_s - before.loading_s)
        for name, now in self.kernels.items():
            earlier = asdict(before.kernels.get(name, KernelWork()))
            difference.kernels[name] = KernelWork(**{key: value - earlier[key] for key, value in asdict(now).items()})
        return difference

    def to_plain(self, share: float = 1.0) -> Json:
        """Plain values for a record, of all or of a share of it: `kernels` that were called, and `loading_seconds`.

        Fields that are 0 are left out: half of them are, and a plan reads the records of all tasks.
        """
        kernels = {
            name: {key: part for key, value in asdict(done).items() if (part := round(share * value, 4))}
            for name, done in self.kernels.items()
            if done.calls
        }
        return {"kernels": kernels, "loading_seconds": round(share * self.loading_s, 4)}


def work() -> Work:
    """Work of this thread; it grows."""
    if not hasattr(_local, "work"):
        _local.work = Work()
    done: Work = _local.work
    return done


@contextmanager
def calling(name: str) -> Iterator[None]:
    """Count a call of a kernel; what is loaded or compiled meanwhile does not count as its time."""
    done = work()
    start, loading_s = time.thread_time(), done.loading_s
    try:
        yield
    finally:
        kernel = done.kernels[name]
        kernel.calls += 1
        kernel.seconds += time.thread_time() - start - (done.loading_s - loading_s)


@contextmanager
def loading() -> Iterator[None]:
    """Count the time for compiled code to be there; inner stretches count once."""
    done = work()
    start, before_s = time.thread_time(), done.loading_s
    try:
        yield
    finally:
        done.loading_s = before_s + time.thread_time() - start
