"""The verbs about tasks and files: `pipeline plan`, `explain`, `status`, `graph` and `logs`."""

from collections.abc import Iterator
from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Any

import typer

from pipeline.app.verbs.terminal import (
    OUTPUT,
    Force,
    Json,
    Out,
    Roots,
    Stage,
    Until,
    names_of,
    note,
    option,
    project_of,
    say,
    say_json,
)
from pipeline.errors import Exit, UsageError
from pipeline.spelling import frames_in_words, human

Specs = Annotated[
    Path | None,
    option(OUTPUT, metavar="DIR", help="Write files for `run-task`, one per task that can run now: 0.json, 1.json …"),
]
Target = Annotated[
    str, typer.Argument(metavar="TARGET", help="A task, or a file or folder of OUT.", autocompletion=names_of)
]
_STATES = "built", "maybe", "stale", "missing"
"""States of files, best first."""


def plan(
    stage: Stage,
    out: Out = None,
    force: Force = None,
    until: Until = None,
    exit_code: Annotated[bool, option(OUTPUT, "--exit-code", help="Exit with 3 if there is work to do.")] = False,
    specs: Specs = None,
    as_json: Json = False,
    allow_root: Roots = None,
) -> None:
    """Print the tasks that `build` would run, and why."""
    from pipeline.engine.options import BuildOptions

    options = BuildOptions(force=tuple(force or ()), until=tuple(until or ()), allow_roots=tuple(allow_root or ()))
    work = print_plan(stage, out, options, as_json=as_json, specs=specs)
    raise typer.Exit(Exit.WORK if exit_code and work else Exit.DONE)


def explain(
    stage: Stage,
    target: Annotated[
        str | None,
        typer.Argument(
            metavar="TARGET",
            help="A task, or a file or folder of OUT; by default whatever would run.",
            autocompletion=names_of,
        ),
    ] = None,
    out: Out = None,
    as_json: Json = False,
    allow_root: Roots = None,
) -> None:
    """Print why a task, or any task, would run: the edited attribute, frame and line. Similar tasks share one line."""
    from pipeline.engine.planning.explain import describe_alike
    from pipeline.engine.project import tasks_of
    from pipeline.engine.running.session import plan_of

    project = project_of(stage, out, allow_root)
    planned = _with_edits(plan_of(project), project, stage)
    names = {task.name for task in planned if task.state != "cached"} if target is None else tasks_of(project, target)
    tasks = [task for task in planned if task.name in names]
    if as_json:
        say_json({"tasks": [task.to_dict() for task in tasks]})
        return
    say(*(describe_alike(tasks) if tasks else ["nothing would run"]))


def status(stage: Stage, out: Out = None, as_json: Json = False, allow_root: Roots = None) -> None:
    """Print by frame the state of the files of the output folder: built, stale, missing, or maybe stale.

    Built files are as a build of the present stage would leave them. Maybe stale are those that depend on a task that
    has to run.
    """
    from pipeline.engine.running.session import status_of

    project = project_of(stage, out, allow_root)
    state = status_of(project)
    if as_json:
        head = {"stage": project.head.get("stage"), "out": str(project.out.absolute())}
        say_json({**head, "manifest": state.has_manifest, "files": state.files})
        return
    say(*_status_lines(state))


def _status_lines(status: Any) -> Iterator[str]:
    """Counts in one line, then frames, each as bad as its worst file, and other files by state."""
    frames = dict[int, str]()
    other_files = dict[str, str]()
    for path, state in status.files.items():
        if path.startswith("frames/"):
            number = int(path.split("/")[1])
            frames[number] = max(state, frames.get(number, state), key=_STATES.index)
        else:
            other_files[path] = state
    counts = [(word, list(states.values())) for word, states in (("frames", frames), ("other files", other_files))]
    totals = [
        f"{word}: {', '.join(f'{states.count(state)} {state}' for state in _STATES if state in states)}"
        for word, states in counts
    ]
    end = "" if status.has_manifest else "; no manifest: `pipeline build` of the whole stage finishes the folder"
    yield "; ".join(totals) + end
    for listed_state in _STATES:
        if numbers := [number for number, state in frames.items() if state == listed_state]:
            yield f"{listed_state:<8} {frames_in_words(numbers)}"
        if listed_state != "built":
            yield from (f"{listed_state:<8} {path}" for path, state in other_files.items() if state == listed_state)


def _with_edits(tasks: list[Any], project: Any, stage: Path) -> list[Any]:
    """Planned tasks with the edits of the stage in their reasons; unchanged if no earlier stage was kept."""
    if project.source is None or all(task.state == "cached" for task in tasks):
        return tasks
    from pipeline.app.why import with_edits
    from pipeline.engine.running.notes import sources_of

    return with_edits(tasks, project, sources_of(project), stage)


def print_plan(stage: Path, out: Path | None, options: Any, *, as_json: bool, specs: Path | None = None) -> bool:
    """Print the plan of a build with these `BuildOptions`; returns whether there is work to do."""
    from pipeline.app.build import project as project_made_of
    from pipeline.engine.files import chosen_place
    from pipeline.engine.planning.explain import describe
    from pipeline.engine.running.session import forecast_of, plan_of, write_specs
    from pipeline.products.sizes import assumed_cost, size

    project = project_made_of(stage, out, options.allow_roots, preview=options.preview)
    tasks = _with_edits(plan_of(project, options), project, stage)
    if specs is not None and specs.exists() and not specs.is_dir():
        raise UsageError(f"{specs} is not a folder")
    forecast = forecast_of(project, tasks, size, assumed_cost)
    written = None
    if specs is not None:
        with chosen_place("write", specs):
            written = write_specs(tasks, specs)
    if as_json:
        rows = [task.to_dict() for task in tasks]
        head = {"stage": project.head.get("stage"), "out": str(project.out.absolute())}
        counts = {state: sum(task.state == state for task in tasks) for state in ("cached", "run", "maybe")}
        say_json({**head, **counts, "forecast": forecast.to_dict(), "tasks": rows})
    else:
        say(*describe(tasks, forecast))
    if written is not None:
        note(f"{len(written)} specs in {specs}")
    return any(task.state != "cached" for task in tasks)


def graph(
    stage: Stage,
    every: Annotated[
        bool, option(OUTPUT, "--all", help="Show every task, instead of one node for all frames.")
    ] = False,
    as_json: Json = False,
    out: Out = None,
    allow_root: Roots = None,
) -> None:
    """Print the graph of tasks and their states as a flow chart, which Markdown viewers draw."""
    from pipeline.engine.planning.collapsed_graph import as_mermaid, overview
    from pipeline.engine.running.session import plan_of

    project = project_of(stage, out, allow_root)
    groups = overview(project.graph, plan_of(project), collapse=not every)
    if as_json:
        say_json({"groups": [group.to_dict() for group in groups]})
    else:
        say("\n".join(as_mermaid(groups)))


def logs(
    stage: Stage,
    target: Target,
    out: Out = None,
    as_json: Json = False,
    allow_root: Roots = None,
) -> None:
    """Print the log of the last run of a task, its time, its memory and its host."""
    from pipeline.engine.running.notes import logs_of

    project = project_of(stage, out, allow_root)
    tasks = logs_of(project, target)
    if as_json:
        say_json({"tasks": [asdict(task) for task in tasks]})
        return
    for task in tasks:
        facts = [task.state, f"key {task.key[:12]}" if task.key else ""]
        if made := task.made_by:
            facts += [f"{made.seconds:.2f} s on {made.host}, {made.when}", human(made.peak_bytes)]
        say(f"== {task.name}: {', '.join(filter(None, facts))}")
        if task.log:
            say(Path(task.log).read_text(encoding="utf-8", errors="replace").rstrip("\n"))
        elif task.key:
            say("   (it printed nothing)")
        else:
            say(f"   no build into {project.out} has met it; -o names another folder")
        if task.spec:
            say(f"   again: pipeline run-task {task.spec}")
