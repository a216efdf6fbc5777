"""The graph of tasks."""

import functools
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from fnmatch import fnmatchcase
from heapq import heapify, heappop, heappush
from typing import Any

from pipeline.engine.digest import canonical
from pipeline.engine.planning import near
from pipeline.engine.planning.near import unpadded
from pipeline.engine.planning.task_code import check_kind
from pipeline.errors import UsageError

TASKS = ("pipeline.tasks",)


@dataclass(frozen=True, kw_only=True)
class Task:
    """One piece of work.

    Attributes
    ----------
    name : str
        Readable name, unique in its graph: `truth/Rig.Camera/0003`. It is not part of the key.
    kind : str
        Module whose function `run(params, inputs, out)` does the work; `params` is a record, if the module has one with
        the name `Params`.
    params : dict
        Plain values, part of the key.
    reads : dict
        Role -> name of the task whose outputs are read. Roles are part of the key, names are not.
    together : str or None
        Tasks of one kind with the same value here have the same inputs and may run together to share work. It is not
        part of the key, because the outputs are the same. Their module also has `run_together(params, inputs, outs)`.
    """

    name: str
    kind: str
    params: dict[str, Any]
    reads: dict[str, str]
    together: str | None = None

    @functools.cached_property
    def canonical(self) -> bytes:
        """Canonical bytes of the parameters; made when somebody asks, because graphs are also made to be compared.

        Raises
        ------
        TypeError
            A parameter is not a plain value.
        """
        return canonical(self.params)

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
        self._order: list[str] = []  # outdated while it is shorter than the graph

    def add(
        self,
        name: str,
        kind: str,
        params: dict[str, Any],
        reads: dict[str, str] | None = None,
        together: str | None = None,
    ) -> str:
        """Add a task and return its name. Its parameters must not be changed afterwards.

        Raises
        ------
        ValueError
            The name exists already, a task that it reads has not been added, or `kind` is outside the accepted
            packages.
        """
        reads = dict(reads or {})
        check_kind(kind, self.packages)
        if name in self._tasks:
            raise ValueError(f"two tasks named {name!r}")
        for role, source in reads.items():
            if source not in self._tasks:
                raise ValueError(f"task {name!r} reads {source!r} as {role!r}, which does not exist")
        self._put(Task(name=name, kind=kind, params=params, reads=reads, together=together))
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
        """Names in the order of `__iter__`: of all tasks whose sources are done, the first by name comes next."""
        waits_for = {name: len({*task.reads.values()}) for name, task in self._tasks.items()}
        ready = [name for name, count in waits_for.items() if not count]
        heapify(ready)
        while ready:
            name = heappop(ready)
            yield name
            for reader in self._readers[name]:
                waits_for[reader] -= 1
                if not waits_for[reader]:
                    heappush(ready, reader)

    def sources(self, name: str) -> list[str]:
        """Tasks that `name` reads."""
        return sorted({*self._tasks[name].reads.values()})

    def readers(self, name: str) -> list[str]:
        """Tasks that read `name`."""
        return sorted(self._readers[name])

    def priorities(self) -> dict[str, int]:
        """Priority of each task: the number of tasks on the longest path from it to an end of the graph, so that the
        critical path goes first.
        """
        lengths: dict[str, int] = {}
        for name in reversed(list(self)):
            lengths[name] = 1 + max((lengths[reader] for reader in self._readers[name]), default=0)
        return lengths

    def up_to(self, names: Iterable[str]) -> "TaskGraph":
        """The part of the graph that the named tasks need, themselves included."""
        wanted, further = set[str](), list(names)
        while further:
            if (name := further.pop()) not in wanted:
                wanted.add(name)
                further += self._tasks[name].reads.values()
        part = TaskGraph(self.packages)
        for name, task in self._tasks.items():  # sources were added before their readers
            if name in wanted:
                part._put(task)
        return part

    def select(self, pattern: str) -> list[str]:
        """Tasks that match a name, a wildcard pattern, or the beginning of names up to a slash.

        Zeros before a number may be left out: `image/2` means `image/0002`.

        Raises
        ------
        UsageError
            Nothing matches.
        """
        found = [n for n in self if n == pattern or n.startswith(f"{pattern}/") or fnmatchcase(n, pattern)]
        if not found:
            found = [name for name in self if f"{unpadded(name)}/".startswith(f"{unpadded(pattern)}/")]
        if not found:
            raise UsageError(f"no task is named {pattern!r}", hint=near.hint(pattern, self, ()))
        return found
