"""`build`, `plan`, `explain`, `status`: from a stage to its output folder, and what would happen on the way."""

import shlex
from pathlib import Path
from typing import Annotated, Any

import typer

from pipeline.errors import Exit, PipelineError, UsageError
from pipeline.verbs.terminal import (
    CHECKING,
    OUTPUT,
    RUNNING,
    Jobs,
    Json,
    Out,
    Roots,
    Stage,
    Untrusted,
    note,
    say,
    say_json,
)

Force = Annotated[
    list[str] | None,
    typer.Option(
        "--force",
        "-f",
        metavar="TASK",
        rich_help_panel=RUNNING,
        help="Run this task again although its result is there.",
    ),
]
Until = Annotated[
    list[str] | None,
    typer.Option("--until", metavar="TASK", rich_help_panel=RUNNING, help="Run up to this task, into the store alone."),
]
Specs = Annotated[
    Path | None,
    typer.Option(
        "--specs",
        metavar="DIR",
        rich_help_panel=OUTPUT,
        help="Write a file for `run-task` of every task that can run now: 0.json, 1.json …",
    ),
]


def names_of(ctx: typer.Context, incomplete: str) -> list[str]:
    """Tasks and files of the stage that was typed, for completion in a shell."""
    try:
        stage = project_of(ctx.params["stage"], ctx.params.get("out"), ctx.params.get("allow_root"))
    except (PipelineError, KeyError, TypeError):
        return []  # a shell has no place for messages
    return [name for name in [*stage.graph, *stage.files] if name.startswith(incomplete)]


Target = Annotated[
    str,
    typer.Argument(metavar="TARGET", help="A task, or a file or folder of OUT.", autocompletion=names_of),
]
Targets = Annotated[
    list[str] | None,
    typer.Argument(
        metavar="TARGET",
        help="Files or folders of OUT, or tasks: only these are made and delivered. By default the whole dataset.",
        autocompletion=names_of,
    ),
]


def build(
    stage: Stage,
    targets: Targets = None,
    out: Out = None,
    as_json: Json = False,
    events: Annotated[
        Path | None,
        typer.Option(
            "--events", metavar="FILE", rich_help_panel=OUTPUT, help="Write what happens to this file, as JSON lines."
        ),
    ] = None,
    verbose: Annotated[
        int,
        typer.Option(
            "--verbose",
            "-v",
            count=True,
            show_default=False,
            rich_help_panel=OUTPUT,
            help="Name tasks also when they start.",
        ),
    ] = 0,
    quiet: Annotated[
        int,
        typer.Option(
            "--quiet", "-q", count=True, show_default=False, rich_help_panel=OUTPUT, help="Only failures and warnings."
        ),
    ] = 0,
    jobs: Jobs = None,
    dry_run: Annotated[
        bool, typer.Option("--dry-run", "-n", rich_help_panel=RUNNING, help="Only say what would run.")
    ] = False,
    keep_going: Annotated[
        bool,
        typer.Option("--keep-going", "-k", rich_help_panel=RUNNING, help="After a failure go on with what can go on."),
    ] = False,
    force: Force = None,
    until: Until = None,
    retries: Annotated[
        int,
        typer.Option(
            "--retries",
            metavar="N",
            min=0,
            rich_help_panel=RUNNING,
            help="How often a task that failed is tried again.",
        ),
    ] = 0,
    timeout: Annotated[
        float | None,
        typer.Option(
            "--timeout",
            metavar="SECONDS",
            min=0.001,
            rich_help_panel=RUNNING,
            help="A task that takes longer is ended and has failed.",
        ),
    ] = None,
    engine: Annotated[
        str | None,
        typer.Option(
            "--engine",
            metavar="dask:WHERE",
            rich_help_panel=RUNNING,
            help="Run tasks on a Dask cluster: the address of its scheduler, or its file.",
        ),
    ] = None,
    check_determinism: Annotated[
        float,
        typer.Option(
            "--check-determinism",
            metavar="PERCENT",
            min=0,
            max=100,
            rich_help_panel=CHECKING,
            help="Compute this share of the tasks twice, and compare their bytes.",
        ),
    ] = 0,
    allow_root: Roots = None,
    untrusted: Untrusted = False,
) -> None:
    """Run what is missing and fill the output folder; the second time nothing runs."""
    if dry_run:
        print_plan(stage, out, allow_root, force, until, targets, as_json=as_json, untrusted=untrusted)
        return
    arguments: dict[str, Any] = {"out": out, "jobs": jobs, "keep_going": keep_going, "force": force or ()}
    arguments |= {
        "until": until or (),
        "targets": targets or (),
        "retries": retries,
        "timeout_s": timeout,
        "check_percent": check_determinism,
    }
    arguments |= {"allow_roots": allow_root or (), "untrusted": untrusted, "engine": engine}
    again = [str(stage), *(["-o", str(out)] if out else []), *(f"--allow-root={root}" for root in allow_root or ())]
    try:
        result = _run(stage, arguments, events, verbose - quiet, shlex.join(again))
    except PipelineError as error:
        if as_json:  # one object at the end, also after a failure
            say_json({**_NOTHING, "stage": str(stage), "error": str(error)})
        raise
    if as_json:
        say_json(result.to_dict())
    elif result.delivery is not None:
        for file in ("",) if result.delivery.asked is None else result.delivery.asked:
            say(str(result.out / file))
    is_quiet = quiet > verbose
    if not is_quiet:
        _say_points(result.points)
    is_refuted = _failed_certificate(result.certificate, quiet=is_quiet)
    raise typer.Exit(result.exit_code or (Exit.NOT_CONFIRMED if is_refuted else Exit.DONE))


def plan(
    stage: Stage,
    out: Out = None,
    force: Force = None,
    until: Until = None,
    exit_code: Annotated[
        bool,
        typer.Option("--exit-code", rich_help_panel=OUTPUT, help="Exit with 3 if there is work to do."),
    ] = False,
    specs: Specs = None,
    as_json: Json = False,
    allow_root: Roots = None,
    untrusted: Untrusted = False,
) -> None:
    """Say what `build` would run, and why."""
    work = print_plan(stage, out, allow_root, force, until, as_json=as_json, specs=specs, untrusted=untrusted)
    raise typer.Exit(Exit.WORK if exit_code and work else Exit.DONE)


def explain(
    stage: Stage,
    target: Target,
    out: Out = None,
    as_json: Json = False,
    allow_root: Roots = None,
    untrusted: Untrusted = False,
) -> None:
    """Say why a task would run: the attribute, frame and line that were edited. Many alike are one line."""
    from pipeline.engine.explain import describe_alike
    from pipeline.engine.project import tasks_of
    from pipeline.engine.session import plan_of

    project = project_of(stage, out, allow_root, untrusted)
    names = set(tasks_of(project, target))
    tasks = [task for task in _with_edits(plan_of(project), project, stage) if task.name in names]
    if as_json:
        say_json({"tasks": [task.to_dict() for task in tasks]})
        return
    for line in describe_alike(tasks):
        say(line)


def status(
    stage: Stage, out: Out = None, as_json: Json = False, allow_root: Roots = None, untrusted: Untrusted = False
) -> None:
    """Say what lies finished in the output folder: built, stale or missing, per task."""
    from pipeline.engine.session import status_of

    project = project_of(stage, out, allow_root, untrusted)
    states = status_of(project)
    if as_json:
        head = {"stage": project.head.get("stage"), "out": str(project.out.absolute())}
        say_json({**head, "tasks": [state.to_dict() for state in states]})
        return
    for state in states:
        say(f"{state.state:<8} {state.name}")


def project_of(stage: Path, out: Path | None, allow_root: list[Path] | None, untrusted: bool = False) -> Any:
    """The project of a stage."""
    from pipeline.tasks.build import project

    return project(stage, out=out, allow_roots=tuple(allow_root or ()), untrusted=untrusted)


def _with_edits(tasks: list[Any], project: Any, stage: Path) -> list[Any]:
    """Planned tasks, their reasons with the edits of the stage; as they are where nothing was kept of it."""
    if project.source is None or all(task.state == "cached" for task in tasks):
        return tasks
    from pipeline.engine.session import sources_of
    from pipeline.tasks.why import with_edits

    return with_edits(tasks, project, sources_of(project), stage)


def print_plan(
    stage: Path,
    out: Path | None,
    allow_root: list[Path] | None,
    force: list[str] | None,
    until: list[str] | None,
    targets: list[str] | None = None,
    *,
    as_json: bool,
    specs: Path | None = None,
    untrusted: bool = False,
) -> bool:
    """Print a plan; whether there is work to do."""
    from pipeline.engine.explain import describe
    from pipeline.engine.session import plan_of
    from pipeline.engine.single import write_specs

    project = project_of(stage, out, allow_root, untrusted)
    tasks = _with_edits(plan_of(project, force=force or (), until=until or (), targets=targets or ()), project, stage)
    if specs is not None and specs.exists() and not specs.is_dir():
        raise UsageError(f"{specs} is not a folder")
    if as_json:
        rows = [task.to_dict() for task in tasks]
        head = {"stage": project.head.get("stage"), "out": str(project.out.absolute())}
        counts = {state: sum(task.state == state for task in tasks) for state in ("cached", "run", "maybe")}
        say_json({**head, **counts, "tasks": rows})
    else:
        for line in describe(tasks):
            say(line)
    if specs is not None:
        note(f"{len(write_specs(tasks, specs))} specs in {specs}")
    return any(task.state != "cached" for task in tasks)


_NOTHING: dict[str, Any] = {
    "stage": None,
    "out": None,
    **dict.fromkeys(("executed", "cached", "failed", "skipped"), 0),
    "seconds": 0.0,
    "certificate": None,
    "points": None,
    "tasks": [],
}


def _failed_certificate(cameras: Any, *, quiet: bool) -> bool:
    """Whether a camera cannot show its accuracy; what the certificates say goes to stderr."""
    from pipeline.report.certificate import failed, lines

    for line in lines(cameras or {}) if failed(cameras) or not quiet else ():
        note(line)
    return failed(cameras)


def _say_points(cameras: Any) -> None:
    """Tell the numbers of points that are seen in each frame, to stderr."""
    from pipeline.report.points import lines

    for line in lines(cameras or {}):
        note(line)


def _run(stage: Path, arguments: dict[str, Any], events: Path | None, verbosity: int, again: str) -> Any:
    from pipeline.engine.events import EventFile, fan_out
    from pipeline.progress import Ending, display
    from pipeline.tasks.build import build

    file, ending = EventFile(events) if events else None, Ending(verbosity, again)
    try:
        with display(verbosity) as shown:
            return build(stage, on_event=fan_out(filter(None, [shown, ending, file])), **arguments)
    finally:
        if file:
            file.close()
        ending.show()
