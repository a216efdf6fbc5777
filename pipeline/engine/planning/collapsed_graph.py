"""A condensed graph of tasks: tasks whose names differ only in a number (frame, tile) are one node."""

import re
from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field

from pipeline.engine.planning.graph import TaskGraph
from pipeline.engine.planning.plan import PlannedTask
from pipeline.records.plain import Json

_COLOURS = {"cached": "#d9ead3", "run": "#f9cb9c", "maybe": "#fff2cc"}


@dataclass(slots=True)
class Node:
    """One or more tasks, such as `image/Rig.Camera/*` for all frames, counted by state; it reads other nodes."""

    name: str
    states: Counter[str] = field(default_factory=Counter)
    reads: list[str] = field(default_factory=list)

    @property
    def count(self) -> int:
        return self.states.total()

    @property
    def label(self) -> tuple[str, str]:
        """Label of the node: its name, and the number of its tasks in each state."""
        states = ", ".join(f"{count:,} {state}" for state, count in sorted(self.states.items()))
        return self.name, states

    @property
    def colour(self) -> str:
        """Colour of the node: that of its least finished task."""
        return _COLOURS[next(state for state in ("run", "maybe", "cached") if self.states[state])]

    def to_dict(self) -> Json:
        """Plain data, as in `graph --json`."""
        return {"name": self.name, "tasks": self.count, "states": dict(self.states), "reads": self.reads}


def overview(graph: TaskGraph, planned: Iterable[PlannedTask], *, collapse: bool = True) -> list[Node]:
    """The nodes, sources before their readers."""
    groups: dict[str, Node] = {}
    for task in planned:  # sources first
        name = _collapsed(task.name) if collapse else task.name
        group = groups.setdefault(name, Node(name))
        group.states[task.state] += 1
        for source in graph.sources(task.name):
            read = _collapsed(source) if collapse else source
            if read not in group.reads and read != name:
                group.reads.append(read)
    return list(groups.values())


def as_mermaid(groups: list[Node]) -> Iterator[str]:
    """Lines of a Mermaid flow chart, which Markdown viewers draw."""
    number = {group.name: f"n{index}" for index, group in enumerate(groups)}
    yield "flowchart LR"
    for group in groups:
        name, states = (part.replace('"', "#quot;") for part in group.label)
        yield f'    {number[group.name]}["{name}<br/>{states}"]'
        yield f"    style {number[group.name]} fill:{group.colour}"
    for group in groups:
        yield from (f"    {number[read]} --> {number[group.name]}" for read in group.reads)


def _collapsed(name: str) -> str:
    return re.sub(r"/\d+(?=/|$)", "/*", name)
