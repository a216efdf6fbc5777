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


def describe(planned: Iterable[PlannedTask], expected: Forecast | None = None) -> Iterator[str]:
    """Lines about a plan: counts, expected work, and the first task of each group with its reasons."""
    tasks = list(planned)
    counts = Counter(task.state for task in tasks)
    yield f"{len(tasks)} tasks: {counts['cached']} cached, {counts['run']} to run, {counts['maybe']} maybe"
    if expected is not None and expected.tasks:
        yield f"to come: {_work(expected)}"
    work = sorted((task for task in tasks if task.state != "cached"), key=lambda task: task.state != "run")
    for number, ((state, kind, cause), group) in enumerate(_groups(work).items()):
        if number >= _GROUPS_SHOWN:
            yield f"… and {len(group):,} more {kind} ({state}): {cause}"
            continue
        yield from describe_task(group[0], _REASONS_SHOWN)
        if len(group) > 1:
            yield f"… and {len(group) - 1:,} more {kind} alike"


def _work(expected: Forecast) -> str:
    """Expected time, rays and memory in words, and how they are known."""
    work = f"about {duration(expected.cpu_seconds)} of processor time, {expected.rays:.2g} rays"
    if expected.unknown == expected.tasks:
        return f"{work}: a guess by their number, because no task of these kinds has run here"
    work += f", {expected.peak_bytes / 1e9:.2g} GB in one process at most, as such tasks took before"
    return work + (f"; {expected.unknown} of a kind that never ran here are guessed" if expected.unknown else "")


def duration(seconds: float) -> str:
    """A duration in a readable unit: 1.6 s, 12 min, 3.4 h."""
    unit, size = ("h", 3600.0) if seconds >= 3 * 3600 else ("min", 60.0) if seconds >= 120 else ("s", 1.0)
    return f"{seconds / size:.{0 if seconds >= 10 * size else 1}f} {unit}"


def describe_alike(planned: Iterable[PlannedTask]) -> Iterator[str]:
    """Reasons of all these tasks; tasks with equal reasons are one group, described by its first task and the number of
    the rest.

    Numbers of frames, names and old and new values may differ within such a group.
    """
    for (_, kind, _), tasks in _groups(planned).items():
        yield from describe_task(tasks[0])
        if len(tasks) > 1:
            yield f"… and {len(tasks) - 1:,} more {kind} alike, up to {tasks[-1].name}"


def _groups(planned: Iterable[PlannedTask]) -> dict[tuple[str, str, str], list[PlannedTask]]:
    """Tasks by state, kind and cause."""
    groups: dict[tuple[str, str, str], list[PlannedTask]] = {}
    for task in planned:
        groups.setdefault((task.state, task.kind, _cause(task)), []).append(task)
    return groups


def describe_task(task: PlannedTask, limit: int | None = None) -> Iterator[str]:
    """Lines about one task: its name and state, then its edits and other reasons, or as many as the limit allows."""
    yield f"{task.state:<6} {task.name}" + (f"  [{task.key[:12]}]" if task.key else "")
    reasons = _without_edits(task)
    texts = [str(reason) for reason in reasons if reason.type is not ReasonType.UPSTREAM]
    lines = [*_lines_of_edits(task.edits), *texts, *_lines_of_sources(reasons)]
    yield from (f"         {line}" for line in lines[:limit])
    if limit is not None and len(lines) > limit:
        yield f"         … and {len(lines) - limit} more reasons (`pipeline explain` shows all)"


def _lines_of_edits(edits: Iterable[Edit]) -> Iterator[str]:
    """One line per edit; of many time samples of one attribute, the first few and the number of the rest."""
    by_subject: dict[str, list[Edit]] = {}
    for edit in edits:
        by_subject.setdefault(edit.subject, []).append(edit)
    for subject, samples in by_subject.items():
        yield from map(str, samples[:_SAMPLES_SHOWN])
        if len(samples) > _SAMPLES_SHOWN:
            yield f"… and {len(samples) - _SAMPLES_SHOWN:,} more time samples of {subject}"


def _lines_of_sources(reasons: Iterable[Reason]) -> Iterator[str]:
    """One line per kind of the tasks that must run before: the first one and the number of the rest."""
    sources: dict[str, list[str]] = {}
    for reason in reasons:
        if reason.type is ReasonType.UPSTREAM and reason.field:
            sources.setdefault(reason.field.split("/")[0], []).append(reason.field)
    for kind, (first, *more) in sources.items():
        yield f"{first} {f'and {len(more):,} more {kind} ' if more else ''}must run first"


def _without_edits(task: PlannedTask) -> list[Reason]:
    """Reasons of a task that no edit accounts for, and the tasks that must run before it."""
    return [reason for reason in task.reasons if not reason.edits or reason.type is ReasonType.UPSTREAM]


def _cause(task: PlannedTask) -> str:
    """Reasons of a task without the parts that differ from frame to frame."""
    edited = sorted({edit.subject for edit in task.edits})
    more = [f"… {len(edited) - _PATHS_SHOWN} more edits"] if len(edited) > _PATHS_SHOWN else []
    causes = set()
    for reason in _without_edits(task):
        # Elements of a list are grouped under the list.
        field = re.sub(r"(\[\d+\])+$", "", reason.field or "")
        if reason.type is ReasonType.UPSTREAM:
            field = field.split("/")[0]
        causes.add(f"{reason.type.value} {field}".strip())
    return ", ".join([*edited[:_PATHS_SHOWN], *more, *sorted(causes)])
