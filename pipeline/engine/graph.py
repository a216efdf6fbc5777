"""The graph of tasks."""

import heapq
import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from fnmatch import fnmatchcase
from typing import Any

from pipeline.engine.code import check_kind
from pipeline.engine.digest import canonical
from pipeline.errors import UsageError
from pipeline.spelling import nearest

TASKS = ("pipeline.tasks",)


@dataclass(frozen=True, slots=True, kw_only=True)
class Task:
    """One piece of work.

    Attributes
    ----------
    name : str
        Unique in its graph, for people: `truth/Rig.Camera/0003`. It is not part of the key.
    kind : str
        Module whose function `run(params, inputs, out)` does the work.
    params : dict
        Plain values, part of the key; `canonical` are their bytes.
    reads : dict
        Role -> name of the task whose outputs are read. Roles are part of the key, names are not.
    together : str or None
        Tasks of one kind that name the same have the same inputs and may run in company, where they share work; no part
        of the key, because the outputs are the same. Their module has `run_together(params, inputs, outs)`, too.
    """

    name: str
    kind: str
    params: dict[str, Any]
    canonical: bytes
    reads: dict[str, str]
    together: str | None = None

    @property
    def short_kind(self) -> str:
        """Last part of the module name."""
        return self.kind.rpartition(".")[2]


class TaskGraph:
    """Tasks and what they read; acyclic by construction, because a task can only read tasks added before it.

    Parameters
    ----------
    packages : tuple of str
        Packages below which task kinds are accepted.
    """

    def __init__(self, packages: tuple[str, ...] = TASKS) -> None:
        self.packages = packages
        self._tasks: dict[str, Task] = {}
        self._readers: dict[str, set[str]] = {}
        self._order: list[str] = []  # of an older graph as long as it is shorter

    def add(
        self,
        name: str,
        kind: str,
        params: dict[str, Any],
        reads: dict[str, str] | None = None,
        together: str | None = None,
    ) -> str:
        """Add a task and give its name back. Its parameters must not be changed afterwards.

        Raises
        ------
        ValueError
            The name is taken, a task that it reads is not there (yet), or `kind` is outside the accepted packages.
        TypeError
            A parameter is not a plain value.
        """
        reads = dict(reads or {})
        check_kind(kind, self.packages)
        if name in self._tasks:
            raise ValueError(f"two tasks named {name!r}")
        for role, source in reads.items():
            if source not in self._tasks:
                raise ValueError(f"task {name!r} reads {source!r} as {role!r}, which does not exist")
        self._put(
            Task(name=name, kind=kind, params=params, canonical=canonical(params), reads=reads, together=together)
        )
        return name

    def _put(self, task: Task) -> None:
        self._tasks[task.name], self._readers[task.name] = task, set()
        for source in task.reads.values():
            self._readers[source].add(task.name)

    def __len__(self) -> int:
        return len(self._tasks)

    def __contains__(self, name: object) -> bool:
        return name in self._tasks

    def __getitem__(self, name: str) -> Task:
        return self._tasks[name]

    def __iter__(self) -> Iterator[str]:
        """Names in an order in which every task comes after all that it reads; the same on every machine."""
        if len(self._order) < len(self._tasks):
            self._order = list(self._sorted())
        return iter(self._order)

    def _sorted(self) -> Iterator[str]:
        """Of the tasks whose sources were named, always the first by name."""
        waiting = {name: len(set(task.reads.values())) for name, task in self._tasks.items()}
        ready = [name for name, sources in waiting.items() if not sources]
        heapq.heapify(ready)
        while ready:
            name = heapq.heappop(ready)
            yield name
            for reader in self._readers[name]:
                waiting[reader] -= 1
                if not waiting[reader]:
                    heapq.heappush(ready, reader)

    def sources(self, name: str) -> list[str]:
        """Tasks that `name` reads."""
        return sorted(set(self._tasks[name].reads.values()))

    def readers(self, name: str) -> list[str]:
        """Tasks that read `name`."""
        return sorted(self._readers[name])

    def priorities(self) -> dict[str, int]:
        """Tasks on the longest path from each task to an end of the graph: the critical path goes first."""
        lengths: dict[str, int] = {}
        for name in reversed(list(self)):
            lengths[name] = 1 + max((lengths[reader] for reader in self._readers[name]), default=0)
        return lengths

    def up_to(self, names: Iterable[str]) -> "TaskGraph":
        """The part of the graph that the named tasks need, themselves included."""
        wanted, todo = set[str](), list(names)
        while todo:
            name = todo.pop()
            if name not in wanted:
                wanted.add(name)
                todo += self._tasks[name].reads.values()
        part = TaskGraph(self.packages)
        for name, task in self._tasks.items():
            if name in wanted:
                part._put(task)
        return part

    def select(self, pattern: str) -> list[str]:
        """Tasks meant by a name, by a wildcard pattern, or by the beginning of names up to a slash.

        Zeros before a number may be left out: `image/2` means `image/0002`.

        Raises
        ------
        UsageError
            Nothing is meant.
        """
        found = [n for n in self if n == pattern or n.startswith(f"{pattern}/") or fnmatchcase(n, pattern)]
        if not found:
            found = [name for name in self if f"{unpadded(name)}/".startswith(f"{unpadded(pattern)}/")]
        if not found:
            near = nearest(pattern, {*self, *_beginnings(self)})
            hint = f"did you mean {near!r}?" if near else "`pipeline status` lists the tasks"
            raise UsageError(f"no task is named {pattern!r}", hint=hint)
        return found


def unpadded(name: str) -> str:
    """A name or path without the zeros before its numbers, so that `truth/2` and `truth/0002` are the same."""
    return re.sub(r"(?<![^/])0+(?=\d+(/|$))", "", name)


def _beginnings(names: Iterable[str]) -> Iterator[str]:
    """Beginnings of names of tasks, up to a slash."""
    for name in names:
        while name := name.rpartition("/")[0]:
            yield name
