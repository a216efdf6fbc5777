"""The graph of tasks. The only module that knows networkx."""

import functools
import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from fnmatch import fnmatchcase

import networkx as nx

from pipeline.engine.digest import canonical
from pipeline.engine.planning.task_code import check_kind
from pipeline.engine.records import Params
from pipeline.entry_points import offered
from pipeline.errors import UsageError
from pipeline.spelling import did_you_mean

PACKAGES = ("pipeline.products", "pipeline.plugins")
"""Packages of this distribution that have tasks."""
_MOST = 6
"""Number of names in one hint: they fit into one line of a terminal."""


@dataclass(frozen=True, kw_only=True)
class Task:
    """One piece of work.

    `name`: readable, unique in its graph, as `truth/Rig.Camera/0003`; not part of the key.
    `kind`: `module:function`, or a module whose function is called `run`. The function works on params, inputs and a
    folder for outputs. If its params are annotated with a record, it receives that record.
    `params`: plain values, part of the key.
    `reads`: role -> name of the task whose outputs are read. Roles are part of the key, names are not.
    `together`: tasks of one kind with the same value here have the same inputs and may run together to share work. It
    is not part of the key, because the outputs do not depend on it. The function of such tasks annotates its params as
    a `Sequence`, and receives one folder for each.
    `after_delivery`: the task reads the output folder, once the files of all tasks that it `reads` are there. It
    receives that folder instead of their outputs, which still make its key.
    `record`: type of which the params are, for whoever asks what they mean; it is not part of the key.
    """

    name: str
    kind: str
    params: Params
    reads: dict[str, str]
    together: str | None = None
    after_delivery: bool = False
    record: type | None = None

    @functools.cached_property
    def canonical(self) -> bytes:
        """Canonical bytes of the parameters, made on demand: many graphs are only compared."""
        return canonical(self.params)

    @property
    def short_kind(self) -> str:
        """Name of the task's function, or of its module if that has one function."""
        return self.kind.replace(":", ".").rpartition(".")[2]

    @property
    def product(self) -> str:
        """Its short kind; of a part of the work, a tile, strip or first pass, that of the whole."""
        return re.sub("_(tile|strip|first)$", "", self.short_kind)


def task_packages() -> tuple[str, ...]:
    """Packages in which kinds of tasks lie: those of this one, and those whose entry points offer products."""
    modules = {entry.module.partition(".")[0] for entries in offered("product").values() for entry in entries}
    return (*PACKAGES, *sorted(modules - {"pipeline"}))


class TaskGraph:
    """Tasks whose kinds lie in certain packages; acyclic, because a task can only read tasks added before it."""

    def __init__(self, packages: tuple[str, ...] | None = None) -> None:
        self.packages = packages or task_packages()
        self._graph: nx.DiGraph = nx.DiGraph()
        self._order: list[str] = []  # outdated while it is shorter than the graph

    def add(
        self, name: str, kind: str, params: Params, reads: dict[str, str] | None = None, together: str | None = None
    ) -> str:
        """Add a task and return its name. Its parameters must not be changed afterwards.

        ValueError if the name exists already, a task that it reads does not, or `kind` is outside the packages.
        """
        return self.put(Task(name=name, kind=kind, params=params, reads=dict(reads or {}), together=together))

    def put(self, task: Task) -> str:
        """Add a task and return its name. Its parameters must not be changed afterwards.

        ValueError if the name exists already, a task that it reads does not, or its kind is outside the packages.
        """
        check_kind(task.kind, self.packages)
        if task.name in self._graph:
            raise ValueError(f"two tasks named {task.name!r}")
        for role, source in task.reads.items():
            if source not in self._graph:
                raise ValueError(f"task {task.name!r} reads {source!r} as {role!r}, which does not exist")
        self._graph.add_node(task.name, task=task)
        self._graph.add_edges_from((source, task.name) for source in task.reads.values())
        return task.name

    @classmethod
    def joined(cls, graphs: Mapping[str, "TaskGraph"]) -> "TaskGraph":
        """The tasks of several graphs of the same packages, each prefixed by the name of its graph."""
        joined = cls(next(iter(graphs.values())).packages)
        for prefix, graph in graphs.items():
            for task in map(graph.__getitem__, graph):
                reads = {role: f"{prefix}/{source}" for role, source in task.reads.items()}
                together = task.together and f"{prefix}/{task.together}"
                joined.put(replace(task, name=f"{prefix}/{task.name}", reads=reads, together=together))
        return joined

    def __len__(self) -> int:
        return len(self._graph)

    def __contains__(self, name: object) -> bool:
        return name in self._graph

    def __getitem__(self, name: str) -> Task:
        task: Task = self._graph.nodes[name]["task"]
        return task

    def __iter__(self) -> Iterator[str]:
        """Names in topological order, the same on every machine."""
        if len(self._order) < len(self._graph):
            self._order = list(nx.lexicographical_topological_sort(self._graph))
        return iter(self._order)

    def sources(self, name: str) -> list[str]:
        return sorted(self._graph.predecessors(name))

    def readers(self, name: str) -> list[str]:
        return sorted(self._graph.successors(name))

    def priorities(self) -> dict[str, int]:
        """Number of tasks on the longest path from each task to an end, so that the critical path goes first."""
        lengths: dict[str, int] = {}
        for name in reversed(list(self)):
            lengths[name] = 1 + max((lengths[reader] for reader in self._graph.successors(name)), default=0)
        return lengths

    def up_to(self, names: Iterable[str]) -> "TaskGraph":
        """The part of the graph that the named tasks need, themselves included."""
        needed = set(names)
        for name in list(needed):
            needed |= nx.ancestors(self._graph, name)
        part = TaskGraph(self.packages)
        part._graph = self._graph.subgraph(needed).copy()
        return part

    @property
    def before_delivery(self) -> "TaskGraph":
        """The part of the graph whose tasks read no output folder."""
        return self.up_to(name for name in self if not self[name].after_delivery)

    def select(self, pattern: str) -> list[str]:
        """Tasks that match a name, a wildcard pattern, or the beginning of names up to a slash; UsageError if none do.

        Zeros before a number may be left out: `image/2` means `image/0002`.
        """
        start = f"{unpadded(pattern)}/"
        names = [name for name in self if f"{unpadded(name)}/".startswith(start) or fnmatchcase(name, pattern)]
        if not names:
            raise UsageError(f"no task is named {pattern!r}", hint=names_like(pattern, self))
        return names


def unpadded(name: str) -> str:
    """A name or path without leading zeros in its numbers, so that `truth/2` and `truth/0002` are equal."""
    return re.sub(r"(?<![^/])0+(?=\d+(/|$))", "", name)


def names_like(target: str, names: Iterable[str]) -> str:
    """Hint for a name that matches nothing: names that contain its first word, the most similar word, or all."""
    word = target.split("/")[0]
    names = sorted(names)
    words = sorted({name.split("/")[0] for name in names})
    same_word = [name for name in names if word in name.split("/")]
    if same_word:
        listed = ", ".join(same_word[:_MOST]) + (" …" if len(same_word) > _MOST else "")
        return f"there {'is' if len(same_word) == 1 else 'are'} {listed}"
    return did_you_mean(word, words) or f"`pipeline graph` shows the tasks; their names begin with {', '.join(words)}"
