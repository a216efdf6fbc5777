"""Forecast of the work of a plan, from earlier runs of its tasks or of others of their kind. It changes no result."""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import asdict, dataclass
from typing import Any

from pipeline.engine.planning.graph import TaskGraph
from pipeline.engine.planning.plan import PlannedTask
from pipeline.engine.records import Params, Record
from pipeline.engine.store.store import Store

Size = Callable[[str, Params], float]
"""Function from kind and params of a task to a number to which its work is proportional; 0 if unknown."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Cost:
    """Cost of a task, or mean of several; rays are those started, memory the peak of one process."""

    cpu_seconds: float
    rays: float
    peak_bytes: int

    def times(self, factor: float) -> "Cost":
        """The cost of work that is larger by a factor; memory stays the same, because tiles limit it."""
        return Cost(cpu_seconds=self.cpu_seconds * factor, rays=self.rays * factor, peak_bytes=self.peak_bytes)


Assumed = Callable[[TaskGraph, str], Cost]
"""Function from a graph and the name of a task in it to a coarse cost."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Forecast:
    """Costs of all tasks that run or may have to, summed; memory is the largest. Unknown kinds are assumed."""

    tasks: int
    unknown: int
    cpu_seconds: float
    rays: float
    peak_bytes: int

    def to_dict(self) -> dict[str, Any]:
        """Plain data, as in `plan --json`."""
        return {**asdict(self), "cpu_seconds": round(self.cpu_seconds, 3), "rays": round(self.rays)}


def forecast(planned: Iterable[PlannedTask], graph: TaskGraph, past: "Past", assumed: Assumed) -> Forecast:
    """Sum the costs of all tasks of a plan that are not cached; of kinds that never ran, those that are assumed."""
    todo = [task for task in planned if task.state != "cached"]
    known = [past.cost_of(task, graph[task.name].params) for task in todo]
    costs = [cost or assumed(graph, task.name) for task, cost in zip(todo, known, strict=True)]
    return Forecast(
        tasks=len(todo),
        unknown=known.count(None),
        cpu_seconds=sum(cost.cpu_seconds for cost in costs),
        rays=sum(cost.rays for cost in costs),
        peak_bytes=max((cost.peak_bytes for cost in costs), default=0),
    )


class Past:
    """Costs of earlier runs: of the same task if it ran before, by its last key, else the mean of its kind.

    Of several dicts of costs by kind, the first that knows a kind counts.
    """

    def __init__(self, store: Store, last_keys: Mapping[str, str], kinds: list[Mapping[str, Cost]], size: Size) -> None:
        self._store, self._last_keys, self._kinds, self._size = store, last_keys, kinds, size

    def cost_of(self, task: PlannedTask, params: Params) -> Cost | None:
        """Estimated cost of a task; None if neither it nor its kind has ever run."""
        last = self._store.peek(self._last_keys[task.name]) if task.name in self._last_keys else None
        cost = cost_of_record(last) if last else None
        if last is not None and cost is not None:
            before, now = self._size(task.kind, last.components.params), self._size(task.kind, params)
            return cost.times(now / before if before > 0 and now > 0 else 1.0)
        return next((kinds[task.kind] for kinds in self._kinds if task.kind in kinds), None)


def cost_of_record(record: Record) -> Cost | None:
    """Cost of the task that made a record; None if the record does not state it."""
    run = record.made_by
    if run.cpu_seconds is None:
        return None
    return Cost(cpu_seconds=run.cpu_seconds, rays=run.rays, peak_bytes=run.peak_bytes)


def means_by_kind(made: Iterable[tuple[str, Record]]) -> dict[str, Cost]:
    """Mean cost of each kind, from kinds and records of tasks; for memory the maximum."""
    costs_by_kind: dict[str, list[Cost]] = {}
    for kind, record in made:
        if cost := cost_of_record(record):
            costs_by_kind.setdefault(kind, []).append(cost)
    return {
        kind: Cost(
            cpu_seconds=sum(cost.cpu_seconds for cost in costs) / len(costs),
            rays=sum(cost.rays for cost in costs) / len(costs),
            peak_bytes=max(cost.peak_bytes for cost in costs),
        )
        for kind, costs in costs_by_kind.items()
    }
