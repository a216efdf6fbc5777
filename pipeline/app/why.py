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
    histories = {key: _EditsSince(source, project, path, tasks) for key, source in distinct.items()}
    done: dict[str, PlannedTask] = {}
    for task in tasks:  # inputs come first: a task that waits for others takes over the edits that make those run
        history = histories[id(sources.get(task.name, sources[""]))]
        reasons = [
            replace(reason, edits=done[reason.field].edits if reason.field in done else history.behind(task, reason))
            for reason in task.reasons
        ]
        done[task.name] = replace(task, reasons=tuple(reasons))
    return list(done.values())


class _EditsSince:
    """The edits of a stage since an earlier state of it, from which some tasks were built.

    A part of a dataset is named as its readers name it, `cameras/Camera`, `poses/targets/Board` or `dataset`.
    """

    def __init__(self, source: Any, project: Project, path: Path, tasks: Iterable[PlannedTask]) -> None:
        edits = edits_between(source["written"], project.source["written"], path)
        paths_before = source["read"]
        paths_now = project.source["read"]
        self._graph = project.graph
        targets = [part for part in paths_now if part.startswith("targets/")]
        self._target_by_number = {f"targets/{number}": part for number, part in enumerate(targets)}
        self._edits_of_part = {
            part: [edit for edit in edits if _is_read(edit.at, {*paths_before.get(part, ()), *paths_now.get(part, ())})]
            for part in paths_before | paths_now
        }
        self._edits = cache(self._edits_of_parts)  # thousands of reasons are about the same parts
        self._origin = cache(self._frame_and_parts)
        reasons = [(task, reason) for task in tasks for reason in task.reasons if _is_open(reason)]
        self._shown_by_values = {id(edit) for task, reason in reasons for edit in self._with_values_of(task, reason)}

    def behind(self, task: PlannedTask, reason: Reason) -> tuple[Edit, ...]:
        """The edits behind a reason; none if it is not about the stage."""
        if not _is_open(reason):
            return ()
        frame, _ = self._origin(task.name, reason.field or "")
        edits = next(filter(None, self._candidates(task, reason)), None) or self._edits("", frame=frame)
        derived = [edit for edit in edits if id(edit) not in self._shown_by_values]
        return tuple(self._with_values_of(task, reason) or derived or edits)

    def _with_values_of(self, task: PlannedTask, reason: Reason) -> list[Edit]:
        """Edits with the old and the new value of a reason, or with the one of the two that is written."""
        if reason.type is not ReasonType.CHANGED:
            return []
        matches = (
            [edit for edit in edits if _shows((edit.old, edit.new), (reason.old, reason.new))]
            for edits in self._candidates(task, reason)
        )
        return next(filter(None, matches), [])

    def _candidates(self, task: PlannedTask, reason: Reason) -> Iterator[list[Edit]]:
        """Groups of edits that may be behind a reason, the most likely first.

        They are those of the parts of which its parameter, or the task, is made, and those of the dataset itself.
        """
        frame, notes = self._origin(task.name, reason.field or "")
        is_motion = "motions" in notes
        parts = sorted(notes - {"poses", "motions"})
        owners = list[str]()
        prefix = "poses/" if is_motion or "poses" in notes else ""
        if prefix or not parts:
            owner = (*task.name.split("@")[0].split("/"), "")[1]
            owners = [part for part in (f"cameras/{owner}", f"targets/{owner}") if part in self._edits_of_part]
            parts += owners or ["cameras"]
        yield self._edits(*(prefix + part for part in parts), frame=None if is_motion else frame)
        if is_motion:  # it is made of poses of other frames, too, and of the camera's shutter
            yield self._edits(*owners, frame=None)
        if not prefix:
            yield self._edits(f"{task.kind}s", "dataset", frame=frame)

    def _frame_and_parts(self, name: str, field: str) -> tuple[int | None, set[str]]:
        """The frame to which a task, or a field of its parameters, belongs, and the parts of which it is made.

        `field` is a path such as `params.view.targets[0].target`; the annotations of the records along it name parts.
        """
        task = self._graph[name]
        start, *steps = re.findall(r"\w+", field) or [""]
        number = name.split("/")[2 : None if task.short_kind == task.product else -1]  # a tile has its own at the end
        frame = int(number[0]) if number and number[0].isdigit() else None
        notes = set[str]()
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
        return frame, {self._target_by_number.get(note, note) for note in notes}

    def _edits_of_parts(self, *parts: str, frame: int | None) -> list[Edit]:
        """Edits of parts, and of parts below these, at a frame; "" stands for all parts, None for all frames."""
        groups = [
            edits
            for part, edits in self._edits_of_part.items()
            if any(is_below(part, above or part) for above in parts)
        ]
        distinct = {id(edit): edit for edits in groups for edit in edits}
        return [edit for edit in distinct.values() if frame is None or edit.time in (None, frame)]


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


def _shows(edited: tuple[Any, Any], reason: tuple[Any, Any]) -> bool:
    """Whether the old and new value of an edit, or of one of its entries, are those of a reason; None: not written."""
    old, new = edited
    if isinstance(old, list) and isinstance(new, list) and len(old) == len(new) and edited != reason:
        return any(_shows(pair, reason) for pair in zip(old, new, strict=True) if pair[0] != pair[1])
    return edited != (None, None) and all(value in (None, other) for value, other in zip(edited, reason, strict=True))
