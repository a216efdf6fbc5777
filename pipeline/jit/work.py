"""Tally of the work of kernels, per thread: calls, processor time, rays. It changes no byte of a result.

A thread does one task at a time, so that the difference of two readings is the work of the task between them.
"""

import threading
import time
from collections import defaultdict
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from typing import Any

_local = threading.local()


@dataclass(slots=True, kw_only=True)
class KernelWork:
    """Work of one kernel.

    Attributes
    ----------
    calls : int
    seconds : float
        Processor time in compiled code [s].
    rays : int
        Rays that it started, blocked ones included; 0 for kernels that trace none.
    crossings : int
        These rays times the surfaces of the lens.
    """

    calls: int = 0
    seconds: float = 0.0
    rays: int = 0
    crossings: int = 0

    def add(self, other: "KernelWork", sign: int = 1) -> None:
        """Add the work of another, or take it away."""
        self.calls += sign * other.calls
        self.seconds += sign * other.seconds
        self.rays += sign * other.rays
        self.crossings += sign * other.crossings


class Work:
    """Work of a thread since it began, or of a stretch of it.

    Attributes
    ----------
    kernels : dict
        `KernelWork` by name of the kernel.
    loading_s : float
        Processor time for loading compiled code, or for compiling [s].
    news : str
        A few words of the task to whoever watches the build.
    """

    def __init__(self) -> None:
        self.kernels: defaultdict[str, KernelWork] = defaultdict(KernelWork)
        self.loading_s = 0.0
        self.news = ""

    def copy(self) -> "Work":
        """The work so far, as it stays while more is done."""
        result = Work()
        result.loading_s = self.loading_s
        for name, done in self.kernels.items():
            result.kernels[name].add(done)
        return result

    def since(self, before: "Work") -> "Work":
        """The work that an earlier copy does not hold."""
        result = self.copy()
        result.loading_s -= before.loading_s
        for name, done in before.kernels.items():
            result.kernels[name].add(done, -1)
        return result

    def to_plain(self, share: float = 1.0) -> dict[str, Any]:
        """Plain values for a record, of all or of a share of it: `kernels` that were called, and `loading_seconds`.

        Fields that are 0 are left out: half of them are, and a plan reads the records of all tasks.
        """
        kernels = {
            name: {field: part for field, value in asdict(done).items() if (part := round(share * value, 4))}
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
        one = done.kernels[name]
        one.calls += 1
        one.seconds += time.thread_time() - start - (done.loading_s - loading_s)


@contextmanager
def loading() -> Iterator[None]:
    """Count the time for compiled code to be there; inner stretches count once."""
    done = work()
    start, before_s = time.thread_time(), done.loading_s
    try:
        yield
    finally:
        done.loading_s = before_s + time.thread_time() - start
