"""Search for the edits of a stage behind the reasons of a plan, which name parameters of tasks.

An edit is the cause of a changed parameter if undoing the edit changes the parameter. So each edit since the last build
is undone in turn and the graph of tasks is made again. If the stage cannot be read without one edit alone, as columns
without their rows, it is undone together with others. A reason gets edits only if the kept stage yields the old value
that the reason states; else it names the parameter only.
"""

import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from pipeline.edits import Edit
from pipeline.engine.planning.graph import TaskGraph
from pipeline.engine.planning.plan import PlannedTask, Reason, ReasonType, differences
from pipeline.engine.project import Project
from pipeline.graph.dataset_graph import graph_of
from pipeline.graph.frame_tasks import frame_of
from pipeline.scene.dataset import Dataset
from pipeline.scene.edits.edits import EditsOfStage, EditUnit, edits_of_stage, together

MOST_ALONE = 20
"""Number of edits that are undone one by one; all further ones are undone together."""


def with_edits(tasks: Sequence[PlannedTask], project: Project, sources: Sequence[Any], path: Path) -> list[PlannedTask]:
    """The same tasks, with the edits of the stage added to their reasons.

    Parameters
    ----------
    sources : sequence
        Sources of the project at its last builds, latest first, see `session.sources_of`.
    path : Path
        The stage in its present state.
    """
    named = list(tasks)
    for source in sources:
        if not any(_is_open(reason) for task in named for reason in task.reasons):
            break
        stage = edits_of_stage(path, source, project.source)
        if stage is None:
            continue
        search = _Search(project.graph, stage)
        named = [replace(task, reasons=tuple(search.named(task.name, one) for one in task.reasons)) for task in named]
    return _passed_on(named)


def _is_open(reason: Reason) -> bool:
    """Whether an edit of the stage may be the cause of a reason that has none yet."""
    if reason.edits or reason.type not in (ReasonType.NEW, ReasonType.CHANGED):
        return False
    return reason.type is ReasonType.NEW or str(reason.field).startswith(("params", "inputs"))


def _passed_on(tasks: list[PlannedTask]) -> list[PlannedTask]:
    """The tasks, sources first; one that waits for others takes over the edits that make those run."""
    done: dict[str, PlannedTask] = {}
    for task in tasks:
        reasons = [
            replace(one, edits=done[one.field].edits) if one.type is ReasonType.UPSTREAM and one.field in done else one
            for one in task.reasons
        ]
        done[task.name] = replace(task, reasons=tuple(reasons))
    return list(done.values())


@dataclass(frozen=True, slots=True)
class _Trial:
    """An edit, and two graphs that differ by this edit alone."""

    unit: EditUnit
    with_it: TaskGraph
    without: TaskGraph


class _Search:
    """Search for the edits that caused reasons.

    Parameters
    ----------
    graph : TaskGraph
        All tasks of the present stage.
    stage : EditsOfStage
        Differences between the present stage and the kept one.
    """

    def __init__(self, graph: TaskGraph, stage: EditsOfStage) -> None:
        self.stage, units = stage, stage.units()
        alone, rest = units[:MOST_ALONE], units[MOST_ALONE:]
        self.units = [*alone, together(rest)] if rest else alone
        self._graphs: dict[frozenset[int], TaskGraph | None] = {frozenset(): graph}
        self.graph, self.old = graph, self._without(range(len(self.units)))
        self.trials = [self._trial(index) for index in range(len(self.units))] if self.old else []
        self._edits: dict[tuple[int, int | None], tuple[Edit, ...]] = {}
        self._changed: dict[tuple[int, int, str], _Changed] = {}

    def named(self, task: str, reason: Reason) -> Reason:
        """A reason with its edits, if there are any and they are certain."""
        if not self.units or not _is_open(reason) or not self._is_certain(task, reason):
            return reason
        found = [one.unit for one in self.trials if self._is_changed(one.with_it, one.without, task, reason)]
        frame = frame_of(self.graph[task], reason.field)
        return replace(
            reason, edits=tuple(edit for unit in found or self.units for edit in self._at_frame(unit, frame))
        )

    def _trial(self, index: int) -> _Trial:
        """The trial of one edit: undone alone, else with another edit, with all edits of its prim, or with all
        edits.
        """
        others = [other for other in range(len(self.units)) if other != index]
        near = [other for other in others if self.units[other].prim == self.units[index].prim]
        pairs = [[other] for other in (*near, *(other for other in others if other not in near))]
        for company in ([], *pairs, near, others):
            without = self._without([index, *company])
            if without is not None:
                with_it = self._without(company)
                # An inner diameter without its shape, say: no effect alone, but a part of the effect of the others.
                if with_it is None or _is_same(with_it, without):
                    with_it = self.graph
                return _Trial(self.units[index], with_it, without)
        raise AssertionError("all edits taken back are the stage as it was")

    def _without(self, taken_back: Iterable[int]) -> TaskGraph | None:
        """The graph without some edits; None if no graph can be made of the remaining stage."""
        key = frozenset(taken_back)
        if key not in self._graphs:
            self._graphs[key] = _graph_of(self.stage.dataset_without([self.units[index] for index in key]))
        return self._graphs[key]

    def _is_certain(self, task: str, reason: Reason) -> bool:
        """Whether the kept stage is the one that this task was last built from."""
        if self.old is None or not self._is_changed(self.graph, self.old, task, reason):
            return False
        if reason.type is ReasonType.NEW or _role(reason) is not None:
            return True
        was = self._differences(self.graph, self.old, task).values
        return reason.field in was and bool(was[reason.field] == reason.old)

    def _is_changed(self, one: TaskGraph, other: TaskGraph, task: str, reason: Reason) -> bool:
        """Whether two graphs differ in the parameter or input that a reason names."""
        if reason.type is ReasonType.NEW or task not in one or task not in other:
            return reason.type is ReasonType.NEW and (task in one) != (task in other)
        role = _role(reason)
        if role is not None:
            return (role in one[task].reads) != (role in other[task].reads)
        return self._differences(one, other, task).touch(str(reason.field))

    def _differences(self, one: TaskGraph, other: TaskGraph, task: str) -> "_Changed":
        key = id(one), id(other), task
        if key not in self._changed:
            found = differences(other[task].params, one[task].params, "params")
            self._changed[key] = _Changed({str(reason.field): reason.old for reason in found})
        return self._changed[key]

    def _at_frame(self, unit: EditUnit, frame: int | None) -> tuple[Edit, ...]:
        """Edits of a unit that a frame depends on, cached: many tasks and parameters ask for the same frame."""
        key = id(unit), frame
        if key not in self._edits:
            self._edits[key] = unit.at_frame(frame)
        return self._edits[key]


class _Changed:
    """Parameters of a task that differ between two graphs; `values` maps each field to its value in the second
    graph.
    """

    def __init__(self, values: dict[str, Any]) -> None:
        self.values = values
        self._wholes = {whole for field in values for whole in _wholes(field)}

    def touch(self, field: str) -> bool:
        """Whether one of them is this field, a part of it, or contains it."""
        return field in self._wholes or any(whole in self.values for whole in _wholes(field))


def _wholes(field: str) -> Iterator[str]:
    """A field and everything that contains it: `a.b[2]`, `a.b`, `a`."""
    yield field
    for match in re.finditer(r"[.\[]", field):
        yield field[: match.start()]


def _graph_of(dataset: Dataset | None) -> TaskGraph | None:
    """The tasks of a dataset; None if undoing a part of the edits leaves a dataset without a valid graph."""
    try:
        return graph_of(dataset)[0] if dataset else None
    except Exception:  # any failure means the same: there is no graph
        return None


def _is_same(one: TaskGraph, other: TaskGraph) -> bool:
    """Whether two graphs have the same tasks with the same parameters."""
    if set(one) != set(other):
        return False
    return all((one[name].params, one[name].reads) == (other[name].params, other[name].reads) for name in one)


def _role(reason: Reason) -> str | None:
    """The role of an input that a reason names; None if it names a parameter."""
    kind, _, rest = str(reason.field).partition(".")
    return rest.partition(".")[0] if kind == "inputs" else None
