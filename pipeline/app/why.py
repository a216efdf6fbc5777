"""The edits of a stage behind the reasons of a plan, which name parameters of tasks.

Readers note from which properties they take the values of each part of a dataset, and annotations in the records of
parameters name the part of which a field is made; all others are made of cameras. The edits of these properties are
behind a reason: the one with just its old and new value if there is one, else, for a derived number, all of them that
no other parameter shows.
"""

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import is_dataclass, replace
from functools import cache
from itertools import pairwise
from pathlib import Path
from typing import Any

from pipeline.edits import Edit
from pipeline.engine.planning.plan import PlannedTask, Reason, ReasonType
from pipeline.engine.project import Project
from pipeline.products.certificate.params import JudgedFrame
from pipeline.products.poses.params import PosedFrame, RigFrame
from pipeline.records.declared import attributes_of
from pipeline.records.plain import from_plain
from pipeline.scene.edits import edits_between, is_below


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
        targets = [part for part in now if part.startswith("targets/")]
        self._numbered = {f"targets/{number}": part for number, part in enumerate(targets)}
        self._edits = {
            part: [edit for edit in edits if _is_read(edit.at, {*before.get(part, ()), *now.get(part, ())})]
            for part in before | now
        }
        reasons = [(task, reason) for task in tasks for reason in task.reasons if _is_open(reason)]
        self._of_parts = cache(self._collected)  # thousands of reasons are about the same parts
        self._made_of = cache(self._noted)
        self._shown = {id(edit) for task, reason in reasons for edit in self._showing(task, reason)}

    def behind(self, task: PlannedTask, reason: Reason) -> tuple[Edit, ...]:
        """The edits behind a reason; none if it is not about the stage."""
        if not _is_open(reason):
            return ()
        frame, _ = self._made_of(task.name, reason.field or "")
        edits = next(filter(None, self._candidates(task, reason)), None) or self._of_parts("", frame=frame)
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
        frame, notes = self._made_of(task.name, reason.field or "")
        is_motion, parts, owners = "motions" in notes, sorted(notes - {"poses", "motions"}), list[str]()
        pose = "poses/" if is_motion or "poses" in notes else ""
        if pose or not parts:
            owner = (*task.name.split("@")[0].split("/"), "")[1]
            owners = [part for part in (f"cameras/{owner}", f"targets/{owner}") if part in self._edits]
            parts += owners or ["cameras"]
        yield self._of_parts(*(pose + part for part in parts), frame=None if is_motion else frame)
        if is_motion:  # it is made of poses of other frames, too, and of the camera's shutter
            yield self._of_parts(*owners, frame=None)
        if not pose:
            yield self._of_parts(f"{task.kind}s", "dataset", frame=frame)

    def _noted(self, name: str, field: str) -> tuple[int | None, set[str]]:
        """The frame to which a task, or a field of its parameters, belongs, and the parts of which it is made."""
        task, (start, *steps) = self._graph[name], re.findall(r"\w+", field) or [""]
        number = name.split("/")[2 : None if task.short_kind == task.product else -1]  # a tile has its own at the end
        frame, notes = int(number[0]) if number and number[0].isdigit() else None, set[str]()
        value: Any = from_plain(task.record, task.params) if task.record and start == "params" else None
        for step, following in pairwise([*steps, ""]):
            if is_dataclass(value):
                note = attributes_of(type(value)).get(step, "").replace("*", following)
                # Records of a camera name attributes of the stage.
                notes |= {part.removesuffix("/") for part in note.split() if not part.startswith("plen:")}
                frame = value.number if isinstance(value, JudgedFrame | PosedFrame | RigFrame) else frame
                value = getattr(value, step, None)
            elif isinstance(value, list | tuple):
                value = value[int(step)]
            else:
                value = value.get(step) if isinstance(value, dict) else None
        return frame, {self._numbered.get(note, note) for note in notes}

    def _collected(self, *parts: str, frame: int | None) -> list[Edit]:
        """Edits of some parts at a frame; "" has all of them."""
        within = [
            edits for part, edits in self._edits.items() if any(is_below(part, wanted or part) for wanted in parts)
        ]
        edits = {id(edit): edit for group in within for edit in group}
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
