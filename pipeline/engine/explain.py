"""Plans in words: what runs and why, grouped so that a thousand frames that changed alike are one line."""

import re
from collections import Counter
from collections.abc import Iterable, Iterator

from pipeline.engine.plan import PlannedTask, ReasonType

_SHOWN = 5  # tasks that are explained one by one
_REASONS_SHOWN = 6  # of one task in a plan: a turned board changes a dozen numbers


def describe(planned: Iterable[PlannedTask]) -> Iterator[str]:
    """Lines about a plan: counts, the first tasks with all their reasons, the others by what changed."""
    tasks = list(planned)
    counts = Counter(task.state for task in tasks)
    yield f"{len(tasks)} tasks: {counts['cached']} cached, {counts['run']} to run, {counts['maybe']} maybe"
    work = sorted((task for task in tasks if task.state != "cached"), key=lambda task: task.state != "run")
    for task in work[:_SHOWN]:
        yield from describe_task(task, _REASONS_SHOWN)
    groups = Counter((task.state, task.kind, _cause(task)) for task in work[_SHOWN:])
    for (state, kind, cause), count in groups.items():
        yield f"… and {count:,} more {kind} ({state}): {cause}"


def describe_alike(planned: Iterable[PlannedTask]) -> Iterator[str]:
    """All reasons of tasks, one after the other; of tasks with the same reasons the first, and how many more there are.

    Numbers of frames, names and old and new values may differ within such a group.
    """
    groups: dict[tuple[str, str, str], list[PlannedTask]] = {}
    for task in planned:
        groups.setdefault((task.state, task.kind, _cause(task)), []).append(task)
    for (_, kind, _), tasks in groups.items():
        yield from describe_task(tasks[0])
        if len(tasks) > 1:
            yield f"… and {len(tasks) - 1:,} more {kind} alike, up to {tasks[-1].name}"


def describe_task(task: PlannedTask, most: int | None = None) -> Iterator[str]:
    """A task, its state, and a line per reason, of which at most `most` are shown."""
    yield f"{task.state:<6} {task.name}" + (f"  [{task.key[:12]}]" if task.key else "")
    yield from (f"         {reason}" for reason in task.reasons[:most])
    if most is not None and len(task.reasons) > most:
        yield f"         … and {len(task.reasons) - most} more values (`pipeline explain` shows all)"


def _cause(task: PlannedTask) -> str:
    """Reasons without what differs from frame to frame."""
    causes = set()
    for reason in task.reasons:
        # Elements of a list count as the list.
        field = re.sub(r"(\[\d+\])+$", "", reason.field or "")
        if reason.type is ReasonType.UPSTREAM:
            field = field.split("/")[0]
        causes.add(f"{reason.type.value} {field}".strip())
    return ", ".join(sorted(causes))
