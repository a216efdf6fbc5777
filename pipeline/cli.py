"""The command `pipeline`. stdout is data; stderr is log and progress.

Verbs import what they need when they run, so that `--help` is instant.
"""

import json
import os
import shlex
import sys
import traceback
from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any

import typer

from pipeline.errors import PipelineError, UsageError

app = typer.Typer(
    add_completion=False,
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    help="Calibration images through real lenses and microlens arrays, with exact ground truth, from USD stages.",
)

imports = typer.Typer(no_args_is_help=True, help="Turn files of other programs into stages.")
app.add_typer(imports, name="import")

Stage = Annotated[Path, typer.Argument(metavar="STAGE", help="The dataset: a USD stage.")]
Out = Annotated[Path | None, typer.Option("--out", "-o", metavar="OUT", help="Output folder [build/<name>].")]
Roots = Annotated[
    list[Path] | None, typer.Option("--allow-root", metavar="DIR", help="A further folder that assets may lie in.")
]
Force = Annotated[list[str] | None, typer.Option("--force", "-f", metavar="TASK", help="Run this task in any case.")]
Until = Annotated[list[str] | None, typer.Option("--until", metavar="TASK", help="Run this task and what it needs.")]
Json = Annotated[bool, typer.Option("--json", help="Print one JSON object.")]


class Spacing(StrEnum):
    """Where the thicknesses of a pbrt table lie: before or after the surface of their row."""

    BEFORE = "before"
    AFTER = "after"


class ReaderGone(Exception):
    """Nobody reads our output any more."""


@app.callback(invoke_without_command=True)
def pipeline(
    version: Annotated[bool, typer.Option("--version", help="Versions and plug-in path.", is_eager=True)] = False,
) -> None:
    if version:
        _print_version()
        raise typer.Exit


@app.command()
def build(
    stage: Stage,
    targets: Annotated[
        list[str] | None, typer.Argument(metavar="[TARGET]...", help="Tasks or files; default: all.")
    ] = None,
    out: Out = None,
    jobs: Annotated[int | None, typer.Option("--jobs", "-j", min=1, help="Processes [one per core].")] = None,
    dry_run: Annotated[bool, typer.Option("--dry-run", "-n", help="Only say what would run.")] = False,
    keep_going: Annotated[bool, typer.Option("--keep-going", "-k", help="Go on after a failure.")] = False,
    force: Force = None,
    until: Until = None,
    as_json: Json = False,
    events: Annotated[Path | None, typer.Option("--events", metavar="FILE", help="Write events as JSON lines.")] = None,
    allow_root: Roots = None,
    verbose: Annotated[int, typer.Option("--verbose", "-v", count=True, help="Say more.")] = 0,
    quiet: Annotated[int, typer.Option("--quiet", "-q", count=True, help="Say less.")] = 0,
) -> None:
    """Run what is missing and fill the output folder; the second time nothing runs."""
    last = [*(until or ()), *(targets or ())]
    if dry_run:
        _plan(stage, out, allow_root, force, last, as_json=as_json)
        return
    arguments = {"out": out, "jobs": jobs, "keep_going": keep_going, "force": force or (), "until": last}
    try:
        result = _run_build(stage, {**arguments, "allow_roots": allow_root or ()}, events, verbose - quiet)
    except PipelineError as error:
        if as_json:  # one object at the end, also after a failure
            counts = dict.fromkeys(("executed", "cached", "failed", "skipped"), 0)
            head: dict[str, Any] = {
                "stage": str(stage),
                "out": None,
                **counts,
                "seconds": 0.0,
                "certificate": None,
                "tasks": [],
            }
            say(json.dumps({**head, "error": str(error)}, indent=1))
        raise
    again = [str(stage), *(["-o", str(out)] if out else []), *(f"--allow-root={root}" for root in allow_root or ())]
    _report(result, again, quiet=quiet > verbose)
    if as_json:
        say(json.dumps(result.to_dict(), indent=1))
    elif result.delivery is not None:
        say(str(result.out))
    raise typer.Exit(result.exit_code)


@app.command()
def plan(
    stage: Stage,
    out: Out = None,
    force: Force = None,
    until: Until = None,
    exit_code: Annotated[bool, typer.Option("--exit-code", help="Exit with 3 if there is work to do.")] = False,
    as_json: Json = False,
    allow_root: Roots = None,
) -> None:
    """Say what `build` would run, and why."""
    work = _plan(stage, out, allow_root, force, until, as_json=as_json)
    raise typer.Exit(3 if exit_code and work else 0)


@app.command()
def check(
    stages: Annotated[list[Path], typer.Argument(metavar="STAGE...", help="Stages to check.")],
    as_json: Json = False,
    allow_root: Roots = None,
) -> None:
    """Report all problems of stages, with file and line; exit with 2 if one is an error."""
    from pipeline.scene.load import load

    problems = [(path, problem) for path in stages for problem in load(path, tuple(allow_root or ())).problems]
    errors = sum(problem.severity == "error" for _, problem in problems)
    if as_json:
        rows = [{"stage": str(path), **problem.to_dict()} for path, problem in problems]
        say(json.dumps({"errors": errors, "warnings": len(problems) - errors, "problems": rows}, indent=1))
    else:
        for _, problem in problems:
            say(str(problem))
        note(f"{len(stages)} checked: {errors} errors, {len(problems) - errors} warnings")
    raise typer.Exit(2 if errors else 0)


@app.command()
def explain(
    stage: Stage,
    target: Annotated[str, typer.Argument(metavar="TASK|FILE", help="A task, or a file of the output folder.")],
    out: Out = None,
    as_json: Json = False,
    allow_root: Roots = None,
) -> None:
    """Say why a task would run: the part of its key that changed, old and new."""
    from pipeline.engine.explain import describe_task
    from pipeline.engine.session import plan_of, tasks_of

    project = _project(stage, out, allow_root)
    names = set(tasks_of(project, target))
    tasks = [task for task in plan_of(project) if task.name in names]
    if as_json:
        say(json.dumps({"tasks": [task.to_dict() for task in tasks]}, indent=1))
        return
    for task in tasks:
        for line in describe_task(task):
            say(line)


@app.command()
def status(stage: Stage, out: Out = None, as_json: Json = False, allow_root: Roots = None) -> None:
    """Say what lies finished in the output folder: built, stale or missing, per task."""
    from pipeline.engine.session import status_of

    project = _project(stage, out, allow_root)
    states = status_of(project)
    if as_json:
        rows = [state.to_dict() for state in states]
        say(
            json.dumps(
                {"stage": project.head.get("stage"), "out": str(project.out.absolute()), "tasks": rows}, indent=1
            )
        )
        return
    for state in states:
        say(f"{state.state:<8} {state.name}")


@app.command()
def show(
    stage: Annotated[Path, typer.Argument(metavar="STAGE", help="A dataset, or a rig or a lens alone.")],
    camera: Annotated[str | None, typer.Argument(metavar="[CAMERA]", help="Its name, if there are several.")] = None,
    as_json: Annotated[
        bool, typer.Option("--json", help="Print one JSON object: what camera.json says, and curves.")
    ] = False,
    plot: Annotated[Path | None, typer.Option("--plot", metavar="FILE.svg", help="Draw the lens and its rays.")] = None,
    allow_root: Roots = None,
) -> None:
    """Say what a camera or a lens does: focal lengths, pupils, focus, depth of field, real rays over the field."""
    from pipeline.tasks.show import show as camera_of

    if plot is not None and plot.suffix != ".svg":
        raise UsageError(f"{plot} is no .svg file", hint="drawings are SVG, which browsers and Inkscape open")
    shown = camera_of(stage, camera, tuple(allow_root or ()))
    for warning in shown.warnings:
        note(str(warning))
    say(shown.json().rstrip("\n") if as_json else "\n".join(shown.page()))
    if plot is not None:
        shown.plot(plot)
        note(f"wrote {plot}")


@app.command("plugin-path")
def plugin_path() -> None:
    """Print the USD plug-in folder and the folder of shipped stages, for other programs."""
    from pipeline.share import share

    say(str(share("schemas")))
    say(str(share("stages")))


@imports.command("lens")
def import_lens(
    file: Annotated[Path, typer.Argument(metavar="FILE", help="Zemax .zmx, CODE V .seq, pbrt .dat, Blender .csv.")],
    out: Annotated[
        Path | None, typer.Option("--out", "-o", metavar="OUT.usda", help="Write here; else to stdout.")
    ] = None,
    spacing: Annotated[Spacing | None, typer.Option(help="Where a pbrt table has its thicknesses.")] = None,
) -> None:
    """Write the lens of another program's file as a stage, and say what could not be kept."""
    from pipeline.importing import import_lens

    _deliver(import_lens(file, spacing.value if spacing else None), out)


@imports.command("camera")
def import_camera(
    file: Annotated[Path, typer.Argument(metavar="FILE", help="Blender add-on .csv, libpleno .js.")],
    out: Annotated[
        Path | None, typer.Option("--out", "-o", metavar="OUT.usda", help="Write here; else to stdout.")
    ] = None,
    lens: Annotated[
        Path | None, typer.Option("--lens", metavar="FILE.csv", help="Lens table of a camera of the Blender add-on.")
    ] = None,
) -> None:
    """Write the camera of another program's file as a rig, and say what could not be kept."""
    from pipeline.importing import import_camera

    _deliver(import_camera(file, lens), out)


def _deliver(imported: Any, out: Path | None) -> None:
    """Warnings to stderr; the stage to stdout, or to a new file that is then checked."""
    from pipeline.importing import write_stage

    for line in imported.warnings:
        note(line)
    if out is None:
        say(imported.text.rstrip("\n"))
        return
    problems = write_stage(imported.text, out)
    for problem in problems:
        note(str(problem))
    say(str(out))
    raise typer.Exit(2 if any(problem.is_error for problem in problems) else 0)


def main() -> None:
    """Run the command line and end the process with its exit code."""
    from pipeline.engine.perform import ONE_THREAD

    for name, value in ONE_THREAD.items():  # before anybody imports NumPy
        os.environ.setdefault(name, value)
    code = _exit_code()
    try:
        sys.stdout.flush()
    except BrokenPipeError:
        code = 141
    if code == 141:  # nothing more may be written, also not by the interpreter at its end
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    sys.exit(code)


def say(text: str) -> None:
    """Print data to stdout."""
    try:
        print(text)
    except BrokenPipeError:
        raise ReaderGone from None


def note(text: str) -> None:
    """Print what is not data to stderr."""
    print(text, file=sys.stderr, flush=True)


def _exit_code() -> int:
    try:
        # Not standalone: errors come here, and an Exit gives its code.
        return int(app(standalone_mode=False) or 0)
    except ReaderGone:
        return 141
    except (KeyboardInterrupt, typer.Abort):
        note("interrupted")
        return 130
    except PipelineError as error:
        note(f"error: {error}")
        return error.exit_code
    except Exception as error:
        if hasattr(error, "show") and hasattr(error, "exit_code"):  # wrong usage, found by the option parser
            error.show()
            return int(error.exit_code)
        note("".join(traceback.format_exception(error)))
        note("This is a bug of ours. Please report it with the lines above and your stage.")
        return 70


def _project(stage: Path, out: Path | None, allow_root: list[Path] | None) -> Any:
    from pipeline.tasks.build import project

    return project(stage, out=out, allow_roots=tuple(allow_root or ()))


def _run_build(stage: Path, arguments: dict[str, Any], events: Path | None, verbosity: int) -> Any:
    from pipeline.engine.events import EventFile, fan_out
    from pipeline.progress import display
    from pipeline.tasks.build import build

    file = EventFile(events) if events else None
    with display(verbosity) as shown:
        try:
            return build(stage, on_event=fan_out([shown, file] if file else [shown]), **arguments)
        finally:
            if file:
                file.close()


def _plan(
    stage: Path,
    out: Path | None,
    allow_root: list[Path] | None,
    force: list[str] | None,
    until: list[str] | None,
    *,
    as_json: bool,
) -> bool:
    """Print a plan; whether there is work to do."""
    from pipeline.engine.explain import describe
    from pipeline.engine.session import plan_of

    project = _project(stage, out, allow_root)
    tasks = plan_of(project, force=force or (), until=until or ())
    if as_json:
        rows = [task.to_dict() for task in tasks]
        head = {"stage": project.head.get("stage"), "out": str(project.out.absolute())}
        counts = {state: sum(task.state == state for task in tasks) for state in ("cached", "run", "maybe")}
        say(json.dumps({**head, **counts, "tasks": rows}, indent=1))
    else:
        for line in describe(tasks):
            say(line)
    return any(task.state != "cached" for task in tasks)


def _report(result: Any, again: list[str], *, quiet: bool) -> None:
    """Failures in full, then one line about the build."""
    for task in result.failures:
        note(f"error: task {task.name} failed (key {task.key[:12]})")
        note("".join(f"    {line}\n" for line in task.error.splitlines()) + f"    log: {task.log}")
        note(f"    again: {shlex.join(['pipeline', 'build', *again, '--until', task.name, '-j1'])}")
    if result.error is not None:
        note(f"error: {result.error}")
    if quiet:
        return
    counts = f"{result.executed} executed, {result.cached} cached, {result.failed} failed, {result.skipped} skipped"
    size = _human(result.store_bytes)
    note(f"{counts} in {result.seconds:.1f} s; store {result.store} ({size})")
    if result.delivery is None:
        note(f"{result.out} was not touched")


def _human(size: float) -> str:
    units = ["bytes", "kB", "MB", "GB", "TB"]
    while size >= 1000 and len(units) > 1:
        size /= 1000
        units.pop(0)
    return f"{size:.3g} {units[0]}"


def _print_version() -> None:
    from importlib.metadata import PackageNotFoundError, version

    from pipeline import __version__
    from pipeline.share import share

    try:
        usd = version("usd-core")
    except PackageNotFoundError:
        usd = "not installed"
    say(f"pipeline {__version__}\nusd-core {usd}\nplug-in path {share('schemas')}")
