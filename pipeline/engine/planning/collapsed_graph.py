"""A condensed graph of tasks: tasks whose names differ only in a number (frame, tile) are one node."""

import re
from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field

from pipeline.engine.planning.graph import TaskGraph
from pipeline.engine.planning.plan import PlannedTask
from pipeline.records.plain import Json

_COLOURS = {"cached": "#d9ead3", "run": "#f9cb9c", "maybe": "#fff2cc"}
"""Colour of a node by the state of its tasks: green, orange, yellow."""


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
    """The nodes, sources before their readers; without `collapse` every task is one."""
    nodes: dict[str, Node] = {}
    for task in planned:  # sources first
        name = _collapsed(task.name) if collapse else task.name
        node = nodes.setdefault(name, Node(name))
        node.states[task.state] += 1
        for source in graph.sources(task.name):
            source_name = _collapsed(source) if collapse else source
            if source_name not in node.reads and source_name != name:
                node.reads.append(source_name)
    return list(nodes.values())


def as_mermaid(nodes: list[Node]) -> Iterator[str]:
    """Lines of a Mermaid flow chart, which Markdown viewers draw."""
    ids = {node.name: f"n{index}" for index, node in enumerate(nodes)}
    yield "flowchart LR"
    for node in nodes:
        name, states = (part.replace('"', "#quot;") for part in node.label)
        yield f'    {ids[node.name]}["{name}<br/>{states}"]'
        yield f"    style {ids[node.name]} fill:{node.colour}"
    for node in nodes:
        yield from (f"    {ids[source]} --> {ids[node.name]}" for source in node.reads)


def _collapsed(name: str) -> str:
    """A name with an asterisk for every part that is a number."""
    return re.sub(r"/\d+(?=/|$)", "/*", name)
