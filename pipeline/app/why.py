"""The edits of a stage behind the reasons of a plan, which name parameters of tasks.

Readers note from which properties they take the values of each part of a dataset, and the name of a parameter says of
which part it is made. The edits of these properties are behind it: the one with just its old and new value if there is
one, else, for a derived number, all of them that no other parameter shows.
"""

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

from pipeline.edits import Edit
from pipeline.engine.planning.plan import PlannedTask, Reason, ReasonType
from pipeline.engine.project import Project
from pipeline.products.graph import frame_of
from pipeline.scene.edits import edits_between, is_below

_PARTS = {
    "targets": {"targets", "target", "colours", "coats", "points", "points_mm"},
    "occluders": {"occluders", "finishes"},
    "lamps": {"lamps"},
}
"""Names in parameters of tasks, by the part of a dataset that they are made of; all others are of cameras."""
_POSE = re.compile(r"\w+_from_\w+|frames\[\d+\]\.targets\.|points_mm|\.motion\b|\.at_lines\.")
"""Parameters that are made of poses."""
_MOTION = re.compile(r"\.(?:motion|at_lines)\b")
"""Those that are made of poses of other frames, too, and of the camera's shutter."""
_TARGET = re.compile(r"\b(?:targets|at_lines)(?:\[(\d+)\]|\.(\w+))")
"""The target of a parameter, by number or by name."""


def with_edits(
    tasks: Sequence[PlannedTask], project: Project, sources: Mapping[str, Any], path: Path
) -> list[PlannedTask]:
    """The tasks with edits in their reasons, since the `sources` at the last build of each; `path` is the stage now."""
    if not sources:
        return list(tasks)
    distinct = {id(source): source for source in sources.values()}
    states = {key: _Since(source, project, path, tasks) for key, source in distinct.items()}
    named: dict[str, PlannedTask] = {}
    for task in tasks:  # inputs come first: a task that waits for others takes over the edits that make those run
        since = states[id(sources.get(task.name, sources[""]))]
        reasons = [
            replace(reason, edits=named[reason.field].edits if reason.field in named else since.behind(task, reason))
            for reason in task.reasons
        ]
        named[task.name] = replace(task, reasons=tuple(reasons))
    return list(named.values())


class _Since:
    """The edits of a stage since an earlier state of it, from which some tasks were built."""

    def __init__(self, source: Any, project: Project, path: Path, tasks: Iterable[PlannedTask]) -> None:
        edits = edits_between(source["written"], project.source["written"], path)
        before, now = source["read"], project.source["read"]
        self._graph = project.graph
        self._targets = [part.removeprefix("targets/") for part in now if part.startswith("targets/")]
        self._edits = {
            part: [edit for edit in edits if _is_read(edit.at, {*before.get(part, ()), *now.get(part, ())})]
            for part in before | now
        }
        reasons = [(task, reason) for task in tasks for reason in task.reasons if _is_open(reason)]
        self._of_parts = cache(self._collected)  # thousands of reasons are about the same parts
        self._shown = {id(edit) for task, reason in reasons for edit in self._showing(task, reason)}

    def behind(self, task: PlannedTask, reason: Reason) -> tuple[Edit, ...]:
        """The edits behind a reason; none if it is not about the stage."""
        if not _is_open(reason):
            return ()
        edits = next(filter(None, self._candidates(task, reason)), None) or self._of_parts(
            "", frame=frame_of(self._graph[task.name], reason.field)
        )
        derived = [edit for edit in edits if id(edit) not in self._shown]
        return tuple(self._showing(task, reason) or derived or edits)

    def _showing(self, task: PlannedTask, reason: Reason) -> list[Edit]:
        """Edits with the old and the new value of a reason, or with the one of the two that is written."""
        showing = (
            [edit for edit in edits if _shows((edit.old, edit.new), (reason.old, reason.new))]
            for edits in self._candidates(task, reason)
            if reason.type is ReasonType.CHANGED
        )
        return next(filter(None, showing), [])

    def _candidates(self, task: PlannedTask, reason: Reason) -> Iterator[list[Edit]]:
        """Edits of what the parameter of a reason, or the task, is made of, and those of the dataset itself."""
        field = reason.field or ""
        frame, words = frame_of(self._graph[task.name], field), set(re.findall(r"[a-z_]+", field))
        parts = [kind for kind, names in _PARTS.items() if words & names]
        pose, owners = "poses/" if _POSE.search(field) else "", list[str]()
        is_motion = bool(_MOTION.search(field))
        if match := _TARGET.search(field):
            number, name = match.groups()
            parts = [f"targets/{name or self._targets[int(number)]}"]
        if pose or not parts:
            owner = (*task.name.split("@")[0].split("/"), "")[1]
            owners = [part for part in (f"cameras/{owner}", f"targets/{owner}") if part in self._edits]
            parts += owners or ["cameras"]
        yield self._of_parts(*(pose + part for part in parts), frame=None if is_motion else frame)
        if is_motion:
            yield self._of_parts(*owners, frame=None)
        if not pose:
            yield self._of_parts(f"{task.kind}s", "dataset", frame=frame)

    def _collected(self, *parts: str, frame: int | None) -> list[Edit]:
        """Edits of some parts at a frame; "" has all of them."""
        within = [edits for part, edits in self._edits.items() if any(is_below(part, whole or part) for whole in parts)]
        edits = {id(edit): edit for some in within for edit in some}
        return [edit for edit in edits.values() if frame is None or edit.time in (None, frame)]


def _is_open(reason: Reason) -> bool:
    """Whether an edit of the stage may be behind a reason: not if code alone changed, or the bytes of an input."""
    field = reason.field or ""
    is_role = field.startswith("inputs") and None in (reason.old, reason.new)
    is_changed = reason.type is ReasonType.CHANGED and (field.startswith("params") or field == "kind" or is_role)
    return is_changed or reason.type is ReasonType.NEW


def _is_read(at: str, paths: set[str]) -> bool:
    """Whether values were taken from an edited property or its whole prim, or from anything in an edited prim."""
    if "." in at:
        return at in paths or at.partition(".")[0] in paths
    return at in paths if at == "/" else any(is_below(path, at) for path in paths)


def _shows(values: tuple[Any, Any], wanted: tuple[Any, Any]) -> bool:
    """Whether an old and a new value, or one of their entries, are the wanted ones; None: it is not written."""
    old, new = values
    if isinstance(old, list) and isinstance(new, list) and len(old) == len(new) and values != wanted:
        return any(_shows(pair, wanted) for pair in zip(old, new, strict=True) if pair[0] != pair[1])
    return values != (None, None) and all(value in (None, other) for value, other in zip(values, wanted, strict=True))
