"""Description of plans: the tasks that run and the reasons, grouped so that a thousand similar frames take one line.

A reason is described by the edits that caused it, if they are recorded, else by the changed parameter.
"""

import re
from collections import Counter
from collections.abc import Iterable, Iterator

from pipeline.edits import Edit
from pipeline.engine.planning.forecast import Forecast
from pipeline.engine.planning.plan import PlannedTask, Reason, ReasonType

_GROUPS_SHOWN = 5
"""Number of groups of similar tasks for which one task is explained."""
_REASONS_SHOWN = 6
"""Number of reasons shown for one task of a plan: a turned board whose edit is not recorded changes a dozen numbers."""
_SAMPLES_SHOWN = 3
"""Number of time samples shown for one attribute."""
_PATHS_SHOWN = 4
"""Number of edited paths shown for tasks that are only counted."""


def describe(planned: Iterable[PlannedTask], to_come: Forecast | None = None) -> Iterator[str]:
    """Lines about a plan: counts, expected work, and the first task of each group with its reasons."""
    tasks = list(planned)
    counts = Counter(task.state for task in tasks)
    yield f"{len(tasks)} tasks: {counts['cached']} cached, {counts['run']} to run, {counts['maybe']} maybe"
    if to_come is not None and to_come.tasks:
        yield f"to come: {_work(to_come)}"
    work = sorted((task for task in tasks if task.state != "cached"), key=lambda task: task.state != "run")
    for number, ((state, kind, cause), alike) in enumerate(_alike(work).items()):
        if number >= _GROUPS_SHOWN:
            yield f"… and {len(alike):,} more {kind} ({state}): {cause}"
            continue
        yield from describe_task(alike[0], _REASONS_SHOWN)
        if len(alike) > 1:
            yield f"… and {len(alike) - 1:,} more {kind} alike"


def _work(to_come: Forecast) -> str:
    work = f"about {duration(to_come.cpu_seconds)} of processor time, {to_come.rays:.2g} rays"
    if to_come.unknown == to_come.tasks:
        return f"{work}: a guess by their number, because no task of these kinds has run here"
    work += f", {to_come.peak_bytes / 1e9:.2g} GB in one process at most, as such tasks took before"
    return work + (f"; {to_come.unknown} of a kind that never ran here are guessed" if to_come.unknown else "")


def duration(seconds: float) -> str:
    """A duration in a readable unit: 1.6 s, 12 min, 3.4 h."""
    unit, size = ("h", 3600.0) if seconds >= 3 * 3600 else ("min", 60.0) if seconds >= 120 else ("s", 1.0)
    return f"{seconds / size:.{0 if seconds >= 10 * size else 1}f} {unit}"


def describe_alike(planned: Iterable[PlannedTask]) -> Iterator[str]:
    """Reasons of all these tasks; tasks with equal reasons are one group, described by its first task and the number of
    the rest.

    Numbers of frames, names and old and new values may differ within such a group.
    """
    for (_, kind, _), tasks in _alike(planned).items():
        yield from describe_task(tasks[0])
        if len(tasks) > 1:
            yield f"… and {len(tasks) - 1:,} more {kind} alike, up to {tasks[-1].name}"


def _alike(planned: Iterable[PlannedTask]) -> dict[tuple[str, str, str], list[PlannedTask]]:
    groups: dict[tuple[str, str, str], list[PlannedTask]] = {}
    for task in planned:
        groups.setdefault((task.state, task.kind, _cause(task)), []).append(task)
    return groups


def describe_task(task: PlannedTask, most: int | None = None) -> Iterator[str]:
    """Lines about one task: its name and state, then at most `most` edits and other reasons."""
    yield f"{task.state:<6} {task.name}" + (f"  [{task.key[:12]}]" if task.key else "")
    shown = _shown(task)
    remaining = [str(reason) for reason in shown if reason.type is not ReasonType.UPSTREAM]
    lines = [*_lines_of_edits(task.edits), *remaining, *_lines_of_sources(shown)]
    yield from (f"         {line}" for line in lines[:most])
    if most is not None and len(lines) > most:
        yield f"         … and {len(lines) - most} more reasons (`pipeline explain` shows all)"


def _lines_of_edits(edits: Iterable[Edit]) -> Iterator[str]:
    """One line per edit; of many time samples of one attribute, the first few and the number of the rest."""
    groups: dict[str, list[Edit]] = {}
    for edit in edits:
        groups.setdefault(edit.subject, []).append(edit)
    for alike in groups.values():
        yield from map(str, alike[:_SAMPLES_SHOWN])
        if len(alike) > _SAMPLES_SHOWN:
            yield f"… and {len(alike) - _SAMPLES_SHOWN:,} more time samples of {alike[0].subject}"


def _lines_of_sources(reasons: Iterable[Reason]) -> Iterator[str]:
    """One line per kind of the tasks that must run before: the first one and the number of the rest."""
    sources: dict[str, list[str]] = {}
    for reason in reasons:
        if reason.type is ReasonType.UPSTREAM and reason.field:
            sources.setdefault(reason.field.split("/")[0], []).append(reason.field)
    for kind, (first, *more) in sources.items():
        yield f"{first} {f'and {len(more):,} more {kind} ' if more else ''}must run first"


def _shown(task: PlannedTask) -> list[Reason]:
    """Reasons that need lines of their own because no edit accounts for them."""
    return [reason for reason in task.reasons if not reason.edits or reason.type is ReasonType.UPSTREAM]


def _cause(task: PlannedTask) -> str:
    """Reasons of a task without the parts that differ from frame to frame."""
    edited = sorted({edit.subject for edit in task.edits})
    more = [f"… {len(edited) - _PATHS_SHOWN} more edits"] if len(edited) > _PATHS_SHOWN else []
    causes = set()
    for reason in _shown(task):
        # Elements of a list are grouped under the list.
        field = re.sub(r"(\[\d+\])+$", "", reason.field or "")
        if reason.type is ReasonType.UPSTREAM:
            field = field.split("/")[0]
        causes.add(f"{reason.type.value} {field}".strip())
    return ", ".join([*edited[:_PATHS_SHOWN], *more, *sorted(causes)])
