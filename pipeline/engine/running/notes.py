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
    of: dict[str, int] = field(default_factory=dict)


def history_of(project: Project, store: Store) -> History:
    """History of the builds of this stage into this folder; empty if there is none."""
    kept = store.read_record(History, "history", _name(project))
    return kept or History(out=os.path.realpath(project.out), stage=project.stage_id)


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
    return {name: note.sources[number] for name, number in note.of.items()}


def _keep_source(project: Project, store: Store, finished: Iterable[str]) -> None:
    """Keep the source of the project for the finished tasks, and older sources while tasks refer to them."""
    before = sources_of(project, store=store)
    of = {name: source for name, source in before.items() if name in project.graph}
    of |= dict.fromkeys([*finished, ""], project.source)
    if of == before:
        return
    sources = list[Any]()
    numbers = dict[int, int]()
    for source in {id(source): source for source in of.values()}.values():  # thousands of tasks have the same one
        sources += [] if source in sources else [source]
        numbers[id(source)] = sources.index(source)
    note = _Sources(sources=tuple(sources), of={name: numbers[id(source)] for name, source in of.items()})
    store.write_note("sources", _name(project), note)


def logs_of(project: Project, target: str) -> list[TaskResult]:
    """Ends of the last runs of the tasks that match a target, with the log if it has any text, and the run recorded."""
    store, ends = Store(), list[TaskResult]()
    keys, ended = history_of(project, store).keys, _ended(project, store)
    for name in tasks_of(project, target):
        state = "built" if name in keys else "never built"
        unrecorded = TaskResult(name=name, kind=project.graph[name].short_kind, state=state, key=keys.get(name))
        end = ended.get(name, unrecorded)
        record, log = (store.peek(end.key), store.path("log", end.key)) if end.key else (None, None)
        has_text = log is not None and log.is_file()
        ends.append(replace(end, log=str(log) if has_text else None, made_by=record.made_by if record else None))
    return ends


def _ended(project: Project, store: Store) -> dict[str, TaskResult]:
    """Ends of the last runs of tasks, by name."""
    return store.read_record(dict[str, TaskResult], "events", _name(project)) or {}


def _name(project: Project) -> str:
    # realpath, because one folder may have two names
    return key_of("history/v1", [os.path.realpath(project.out), project.stage_id])
