"""Wishes of the one who builds, from the command or a notebook to the driver."""

import os
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

from pipeline.engine.events import Emit, silent
from pipeline.engine.interrupts import Interrupts
from pipeline.errors import UsageError
from pipeline.records.declared import number, settle, whole

_MOST = 10_000
"""Workers, and tries of a task: a slip of the finger, not a wish."""
_SHORTEST_S = 1e-3
"""Shortest time limit of a task [s]: no task meets a shorter one, and 0 does not mean that there is none."""


@dataclass(frozen=True, slots=True, kw_only=True)
class BuildOptions:
    """Wishes of the one who builds.

    Attributes
    ----------
    jobs : int or None
        Worker processes; 1 runs everything in this process; None: one per core. With a timeout there is always a
        worker, and in a program that loaded NumPy before `pipeline`.
    keep_going : bool
        After a failure go on with tasks that do not need the failed one.
    force, until : tuple of str
        Tasks (names, patterns, or paths of files in the output folder) that run in any case; the last ones to run.
        As long as only a part of the dataset is made, the output folder is left alone.
    targets : tuple of str
        The same, or files that no task makes: what they need runs, and their files alone go to the output folder.
    retries : int
        How often a task that failed is tried again. A task whose worker died is tried some times in any case.
    timeout_s : float or None
        A task that takes longer has failed [s].
    check_percent : float
        Share of the tasks that run once more afterwards, to see whether they give the same bytes [%].
    engine : str or None
        `dask:tcp://host:8786` or `dask:FILE`: run tasks on a Dask cluster, whose workers share only the store.
    device : str or None
        `cuda`: trace position images on a CUDA device; their keys name it. See `graph.devices`.
    allow_roots : tuple of str or Path
        Further folders that the stage may reference.
    untrusted : bool
        Read the stage in a confined process, and bound memory and time of each task by `limits`.
    preview : bool
        Make pictures of a quarter of the size with few samples, and nothing else, into `OUT.preview`.

    Raises
    ------
    UsageError
        A value is not of its kind, or out of its range.
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
    untrusted: bool = False
    preview: bool = False

    def __post_init__(self) -> None:
        settle(self, UsageError)
        whole("jobs", 1 if self.jobs is None else self.jobs, UsageError, 1, _MOST)
        whole("retries", self.retries, UsageError, 0, _MOST)
        number("timeout_s", 1.0 if self.timeout_s is None else self.timeout_s, UsageError, _SHORTEST_S)
        number("check_percent", self.check_percent, UsageError, 0.0, 100.0)

    @property
    def workers(self) -> int:
        """As many as asked for, or one per core that this process may use; a container often may not use all."""
        if self.jobs is not None:
            return self.jobs
        # Not every system can tell.
        return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


USUAL = BuildOptions()
ALONE = BuildOptions(jobs=1)
"""Everything in this process."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Caller:
    """Whoever has tasks run: who hears of events, what is prepared, and whose signals end the run.

    Attributes
    ----------
    prepare : callable or None
        Called once in this process before the first task runs, and not at all if none has to. Signals stop it at once.
    interrupts : Interrupts or None
        Open ones of a caller who does more that signals may end.
    """

    on_event: Emit = silent
    prepare: Callable[[], None] | None = None
    interrupts: Interrupts | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Known:
    """Facts about tasks before they run.

    Attributes
    ----------
    peaks : dict
        Memory that tasks of each kind took earlier [bytes]: no more of them start together than fit.
    places : dict
        `Project.places`.
    """

    peaks: dict[str, int] = field(default_factory=dict)
    places: dict[str, str] = field(default_factory=dict)


NOBODY, NOTHING = Caller(), Known()
