"""Forecast of a plan's work, from earlier runs of its tasks or of tasks of the same kind. It changes no result."""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import asdict, dataclass
from statistics import fmean, median

from pipeline.engine.planning.graph import Task, TaskGraph
from pipeline.engine.planning.plan import PlannedTask
from pipeline.engine.records import Params, Run
from pipeline.engine.store.store import Store
from pipeline.records.plain import Json

Size = Callable[[Task, Params], float]
"""Function from a task and params that it has or had to a number to which its work is proportional; 0 if unknown."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Cost:
    """Cost of a task, or mean over several; rays are those started, memory the peak of one process."""

    cpu_seconds: float
    rays: float
    peak_bytes: int


Assumed = Callable[[TaskGraph, str], Cost]
"""Function from a graph and the name of a task in it to a rough cost."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Forecast:
    """Total cost of all tasks that run or may have to; memory is the maximum. Kinds that never ran are assumed."""

    tasks: int
    unknown: int
    cpu_seconds: float
    rays: float
    peak_bytes: int

    def to_dict(self) -> Json:
        """Plain data, as in `plan --json`."""
        return {**asdict(self), "cpu_seconds": round(self.cpu_seconds, 3), "rays": round(self.rays)}


@dataclass(frozen=True, slots=True, kw_only=True)
class Past:
    """Costs of earlier runs: of the task itself if it ran before, by its last key, else the mean of its kind."""

    store: Store
    last_keys: Mapping[str, str]
    kinds: Mapping[str, Cost]
    size: Size

    def cost_of(self, task: Task) -> Cost | None:
        """Estimated cost of a task; None if neither it nor its kind has ever run."""
        kind = self.kinds.get(task.short_kind)
        last = self.store.peek(self.last_keys[task.name]) if task.name in self.last_keys else None
        if last is None or last.made_by.cpu_seconds is None:
            return kind
        run = last.made_by
        # Time per ray is the mean of the kind: that of a single run depends on what else the machine did.
        seconds = kind.cpu_seconds / kind.rays * run.rays if kind and kind.rays else _seconds([run])
        size_before = self.size(task, last.components.params)
        size_now = self.size(task, task.params)
        factor = size_now / size_before if size_before > 0 and size_now > 0 else 1.0
        # Memory stays the same, because tiles limit it.
        return Cost(cpu_seconds=seconds * factor, rays=run.rays * factor, peak_bytes=run.peak_bytes)


def forecast(planned: Iterable[PlannedTask], graph: TaskGraph, past: Past, assumed: Assumed) -> Forecast:
    """Sum the costs of all tasks of a plan that are not cached; kinds that never ran count by `assumed`."""
    todo = [task for task in planned if task.state != "cached"]
    estimates = [past.cost_of(graph[task.name]) for task in todo]
    costs = [cost or assumed(graph, task.name) for task, cost in zip(todo, estimates, strict=True)]
    return Forecast(
        tasks=len(todo),
        unknown=estimates.count(None),
        cpu_seconds=sum(cost.cpu_seconds for cost in costs),
        rays=sum(cost.rays for cost in costs),
        peak_bytes=max((cost.peak_bytes for cost in costs), default=0),
    )


def means_by_kind(runs: Iterable[tuple[str, Run]]) -> dict[str, Cost]:
    """Mean cost of each kind, from kinds and runs of tasks; for memory the maximum."""
    runs_by_kind: dict[str, list[Run]] = {}
    for kind, run in runs:
        runs_by_kind.setdefault(kind, []).append(run)
    return {
        kind: Cost(
            cpu_seconds=_seconds(its_runs),
            rays=sum(run.rays for run in its_runs) / len(its_runs),
            peak_bytes=max(run.peak_bytes for run in its_runs),
        )
        for kind, its_runs in runs_by_kind.items()
    }


def _seconds(runs: list[Run]) -> float:
    """Mean processor time of runs, without loading of code; where all runs count rays, by the median time of a ray."""
    # A busy machine takes up to three times as long for a ray, most often only for a part of a build.
    seconds = [max(0.0, (run.cpu_seconds or 0.0) - run.loading_seconds) for run in runs]
    if all(run.rays for run in runs):
        per_ray = median(time / run.rays for time, run in zip(seconds, runs, strict=True))
        seconds = [run.rays * per_ray for run in runs]
    return fmean(seconds)
