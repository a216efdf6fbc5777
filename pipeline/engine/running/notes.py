"""Notes in the store about the builds of a project into its folder. Losing them changes no result."""

import os
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

from pipeline.engine.digest import key_of
from pipeline.engine.planning.forecast import Cost, means_by_kind
from pipeline.engine.project import Project, tasks_of
from pipeline.engine.records import TaskResult
from pipeline.engine.running.driver import Outcome
from pipeline.engine.store.store import Store


@dataclass(frozen=True, slots=True, kw_only=True)
class History:
    """Earlier builds: keys by task, and costs by kind of task."""

    out: str
    stage: str
    keys: dict[str, str] = field(default_factory=dict)
    costs: dict[str, Cost] = field(default_factory=dict)


@dataclass(frozen=True, slots=True, kw_only=True)
class _Sources:
    """The distinct sources of a project, and for each task the index of the source that it was last built from."""

    sources: tuple[Any, ...] = ()
    index_by_task: dict[str, int] = field(default_factory=dict)


def history_of(project: Project, store: Store) -> History:
    """History of the builds of this stage into this folder; empty if there is none."""
    history = store.read_record(History, "history", _name(project))
    return history or History(out=os.path.realpath(project.out), stage=project.stage_id)


def costs_of_others(project: Project, store: Store) -> list[dict[str, Cost]]:
    """Mean costs by kind of task, from the builds of each other project."""
    histories = (
        store.read_record(History, "history", name) for name in store.notes("history") if name != _name(project)
    )
    return [history.costs for history in histories if history is not None]


def keep_history(project: Project, store: Store, outcome: Outcome, before: History, *, complete: bool) -> None:
    """Keep keys and costs of all finished tasks, so that the next plan can tell what has changed, and the ends of
    tasks, for `pipeline logs`.
    """
    keys = {name: key for name, key in before.keys.items() if name in project.graph or not complete}
    keys |= {name: record.key for name, record in outcome.records.items()}
    runs = [(task.kind, task.made_by) for task in outcome.ran.values() if task.state == "executed" and task.made_by]
    after = History(
        out=before.out,
        stage=before.stage,
        keys=keys,
        costs={**before.costs, **means_by_kind(runs)},
    )
    if after != before:
        store.write_note("history", _name(project), after)
    if outcome.ran:
        store.write_note("events", _name(project), {**_ended(project, store), **outcome.ran})
    if project.source is not None:
        _keep_source(project, store, outcome.records)


def sources_of(project: Project, *, store: Store | None = None) -> Mapping[str, Any]:
    """Source of the project at the last build of each task, by task name; under "" that of the last build."""
    note = (store or Store()).read_record(_Sources, "sources", _name(project)) or _Sources()
    return {name: note.sources[index] for name, index in note.index_by_task.items()}


def _keep_source(project: Project, store: Store, finished: Iterable[str]) -> None:
    """Keep the source of the project for the finished tasks, and older sources while tasks refer to them."""
    before = sources_of(project, store=store)
    by_task = {name: source for name, source in before.items() if name in project.graph}
    by_task |= dict.fromkeys([*finished, ""], project.source)
    if by_task == before:
        return
    sources = list[Any]()
    index_by_id = dict[int, int]()  # thousands of tasks have the same object, which is compared once
    for source in {id(source): source for source in by_task.values()}.values():
        if source not in sources:
            sources.append(source)
        index_by_id[id(source)] = sources.index(source)
    index_by_task = {name: index_by_id[id(source)] for name, source in by_task.items()}
    store.write_note("sources", _name(project), _Sources(sources=tuple(sources), index_by_task=index_by_task))


def logs_of(project: Project, target: str) -> list[TaskResult]:
    """Ends of the last runs of the tasks that match a target, with the log if it has any text, and the run recorded."""
    store = Store()
    keys = history_of(project, store).keys
    ended = _ended(project, store)
    ends = list[TaskResult]()
    for name in tasks_of(project, target):
        state = "built" if name in keys else "never built"
        unrecorded = TaskResult(name=name, kind=project.graph[name].short_kind, state=state, key=keys.get(name))
        end = ended.get(name, unrecorded)
        record = store.peek(end.key) if end.key else None
        log = store.path("log", end.key) if end.key else None
        has_text = log is not None and log.is_file()
        ends.append(replace(end, log=str(log) if has_text else None, made_by=record.made_by if record else None))
    return ends


def _ended(project: Project, store: Store) -> dict[str, TaskResult]:
    """Ends of the last runs of tasks, by name."""
    return store.read_record(dict[str, TaskResult], "events", _name(project)) or {}


def _name(project: Project) -> str:
    """Name of the notes about the builds of a stage into a folder, which may have two paths."""
    return key_of("history/v1", [os.path.realpath(project.out), project.stage_id])
