"""Options of a build, passed from the command or a notebook to the driver."""

import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TypedDict

from pipeline.engine.events import Emit, silent
from pipeline.engine.interrupts import Interrupts
from pipeline.errors import UsageError
from pipeline.records.declared import integer, number, settle

_MOST = 10_000
"""Most workers, and most tries of a task: a larger number is surely a typing error."""
_SHORTEST_S = 1e-3
"""Shortest time limit of a task [s]: no task is faster, and 0 must not be taken for "no limit"."""


@dataclass(frozen=True, slots=True, kw_only=True)
class BuildOptions:
    """Options of a build; UsageError if a value has the wrong type or is out of range.

    `jobs`: number of worker processes; None: one per core. With 1, tasks run in this process, unless there is a timeout
    or NumPy was loaded before `pipeline`: then there is one worker.
    `keep_going`: continue after a failure with tasks that do not need the failed one.
    `force`, `until`: tasks (names, patterns, or paths of files in the output folder) that always run, and tasks after
    which the build stops. If only a part of the dataset is computed, the output folder is not touched.
    `targets`: names as above, or files that no task makes: only the tasks that they need run, and only their files are
    delivered.
    `retries`: number of times that a failed task is tried again. A task whose worker died is always retried a few
    times.
    `timeout_s`: time limit of a task [s]; a task that takes longer fails.
    `check_percent`: share of the tasks that run a second time to compare their bytes [%].
    `engine`: `dask:tcp://host:8786` or `dask:FILE`: run tasks on a Dask cluster, whose workers share only the store.
    `device`: `cuda`: trace images and position images on a CUDA device, whose name enters their keys; see
    `products.variants`.
    `allow_roots`: further folders that the stage may reference.
    `preview`: make only pictures, a quarter of the size and with few samples, in `OUT.preview`.
    `pictures`: make images and maps of the cameras besides tables and records.
    """

    jobs: int | None = None
    keep_going: bool = False
    force: tuple[str, ...] = ()
    until: tuple[str, ...] = ()
    targets: tuple[str, ...] = ()
    retries: int = 0
    timeout_s: float | None = None
    check_percent: float = 0.0
    engine: str | None = None
    device: str | None = None
    allow_roots: tuple[str | Path, ...] = ()
    preview: bool = False
    pictures: bool = True

    def __post_init__(self) -> None:
        settle(self, UsageError)
        integer("jobs", 1 if self.jobs is None else self.jobs, UsageError, 1, _MOST)
        integer("retries", self.retries, UsageError, 0, _MOST)
        number("timeout_s", 1.0 if self.timeout_s is None else self.timeout_s, UsageError, _SHORTEST_S)
        number("check_percent", self.check_percent, UsageError, 0.0, 100.0)

    @property
    def workers(self) -> int:
        """Number of workers: as requested, or one per core that this process may use."""
        if self.jobs is not None:
            return self.jobs
        # Not every system tells which cores a process may use.
        return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


class BuildKeywords(TypedDict, total=False):
    """Fields of `BuildOptions` as keyword arguments, for type checkers and completion."""

    jobs: int | None
    keep_going: bool
    force: Sequence[str]
    until: Sequence[str]
    targets: Sequence[str]
    retries: int
    timeout_s: float | None
    check_percent: float
    engine: str | None
    device: str | None
    allow_roots: Sequence[str | Path]
    preview: bool
    pictures: bool


USUAL = BuildOptions()
"""The defaults."""
ALONE = BuildOptions(jobs=1)
"""Run everything in this process."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Caller:
    """The caller's part of a run.

    `on_event` is its listener. `prepare` is called once in this process before the first task runs, and not if no task
    runs; signals stop it at once. `interrupts` is an open context of the caller, whose later work Ctrl-C may end, too.
    `peaks` is the peak memory of earlier tasks by kind [bytes]: only tasks that fit together run together. `places` are
    those of the project. `folder` is its output folder, for tasks that read it.
    """

    on_event: Emit = silent
    prepare: Callable[[], None] | None = None
    interrupts: Interrupts | None = None
    peaks: dict[str, int] = field(default_factory=dict)
    places: dict[str, str] = field(default_factory=dict)
    folder: Path | None = None


NOBODY = Caller()
"""A caller that listens to nothing and prepares nothing."""
