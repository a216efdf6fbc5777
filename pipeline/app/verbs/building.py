"""The verbs that run tasks: `pipeline build`, `ensemble` and `run-task`."""

import os
import shlex
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from pipeline.app.verbs.planning import print_plan
from pipeline.app.verbs.terminal import (
    CHECKING,
    OUTPUT,
    RUNNING,
    Force,
    Json,
    Out,
    Roots,
    Stage,
    Until,
    names_of,
    note,
    option,
    say,
    say_json,
)
from pipeline.entry_points import plugged_in
from pipeline.errors import Exit, PipelineError, UsageError

if TYPE_CHECKING:
    from pipeline.engine.records import Reply

Targets = Annotated[
    list[str] | None,
    typer.Argument(
        metavar="TARGET",
        help="Files or folders of OUT, or tasks: only these are built. By default the whole dataset.",
        autocompletion=names_of,
    ),
]
Events = Annotated[Path | None, option(OUTPUT, metavar="FILE", help="Write all events to this file, as JSON lines.")]
Verbose = Annotated[
    int, option(OUTPUT, "--verbose", "-v", count=True, show_default=False, help="Print a line also when a task starts.")
]
Quiet = Annotated[
    int, option(OUTPUT, "--quiet", "-q", count=True, show_default=False, help="Only failures and warnings.")
]
Profile = Annotated[bool, option(OUTPUT, "--profile", help="Print where the time went, by kind of task and kernel.")]
DryRun = Annotated[bool, option(RUNNING, "--dry-run", "-n", help="Only print what would run.")]
KeepGoing = Annotated[
    bool, option(RUNNING, "--keep-going", "-k", help="After a failure, go on with the tasks that can still run.")
]
Retries = Annotated[int, option(RUNNING, metavar="N", min=0, help="Number of times that a failed task is tried again.")]
Timeout = Annotated[
    float | None,
    option(RUNNING, metavar="SECONDS", min=0.001, help="A task that takes longer is ended and counts as failed."),
]
Engine = Annotated[
    str | None,
    option(
        RUNNING, metavar="dask:WHERE", help="Run tasks on a Dask cluster: the address of its scheduler, or its file."
    ),
]
Device = Annotated[
    str | None,
    option(
        RUNNING,
        metavar="cuda",
        help="Trace images, in float32, and position images on a CUDA device. By default everything runs on the CPU.",
    ),
]
Preview = Annotated[
    bool,
    option(
        OUTPUT,
        "--preview",
        help="Make pictures only, a quarter of the size and with few samples, in another output folder.",
    ),
]
NoReport = Annotated[bool, option(OUTPUT, "--no-report", help="Write no report, the page in OUT.report.")]
CheckDeterminism = Annotated[
    float,
    option(
        CHECKING,
        metavar="PERCENT",
        min=0,
        max=100,
        help="Compute this share of the tasks twice and compare the bytes of their results.",
    ),
]
Jobs = Annotated[
    int | None, option(RUNNING, "--jobs", "-j", metavar="N", min=1, help="Worker processes; by default one per core.")
]


def build(
    stage: Stage,
    targets: Targets = None,
    out: Out = None,
    as_json: Json = False,
    events: Events = None,
    verbose: Verbose = 0,
    quiet: Quiet = 0,
    profile: Profile = False,
    jobs: Jobs = None,
    dry_run: DryRun = False,
    keep_going: KeepGoing = False,
    force: Force = None,
    until: Until = None,
    retries: Retries = 0,
    timeout: Timeout = None,
    engine: Engine = None,
    device: Device = None,
    preview: Preview = False,
    no_report: NoReport = False,
    check_determinism: CheckDeterminism = 0,
    allow_root: Roots = None,
) -> None:
    """Run the missing tasks and fill the output folder; a second build runs nothing."""
    from pipeline.app.pages.ending import failed
    from pipeline.engine.options import BuildOptions

    options = BuildOptions(
        jobs=jobs,
        keep_going=keep_going,
        force=tuple(force or ()),
        until=tuple(until or ()),
        targets=tuple(targets or ()),
        retries=retries,
        timeout_s=timeout,
        check_percent=check_determinism,
        engine=engine,
        device=device,
        allow_roots=tuple(allow_root or ()),
        preview=preview,
    )
    if dry_run:
        if device:
            raise UsageError("--device does not go with --dry-run", hint="results of a device have separate keys")
        print_plan(stage, out, options, as_json=as_json)
        return
    report = None if no_report or preview or os.environ.get("PIPELINE_REPORT") == "no" else _report()
    try:
        result = _run(stage, out, options, verbose - quiet, events, report)
    except PipelineError as error:
        if as_json:  # also after a failure one JSON object ends the output
            say_json({**_NOTHING, "stage": str(stage), "error": str(error)})
        raise
    _say_result(result, as_json=as_json, profile=profile)
    _note_findings(result, report, is_quiet=quiet > verbose)
    raise typer.Exit(result.exit_code or (Exit.NOT_CONFIRMED if failed(result.certificate) else Exit.DONE))


_NOTHING: dict[str, Any] = {
    "stage": None,
    "out": None,
    **dict.fromkeys(("executed", "cached", "failed", "skipped"), 0),
    "seconds": 0.0,
    "certificate": None,
    "points": None,
    "tasks": [],
}


def _note_findings(result: Any, report: Any, *, is_quiet: bool) -> None:
    """Write the report, if there is one, and print visible points, its page and certificates; if quiet, only those that
    fail.
    """
    from pipeline.app.pages.ending import certificate_lines, failed, point_lines

    if not is_quiet:
        note(*point_lines(result.points or {}))
    if report and result.delivery is not None and result.requested is None:
        page = report.write_after_build(result.out, warn=note)
        if page is not None and not is_quiet:
            note(f"report: {page}")
    if not is_quiet or failed(result.certificate):
        note(*certificate_lines(result.certificate or {}))


def _say_result(result: Any, *, as_json: bool, profile: bool) -> None:
    """Print the output folder or the requested files, or one JSON object, and the profile if requested."""
    if as_json:
        say_json({**result.to_dict(), **({"profile": _profile(result)} if profile else {})})
        return
    if result.delivery is not None:
        say(*(result.out / file for file in (("",) if result.requested is None else result.requested)))
    if profile:
        from pipeline.app.pages.ending import profile_lines
        from pipeline.optics.kernels import crossings_per_second

        times = _profile(result)
        if not times["now"]:
            note("nothing had to run; this is what the tasks took when they ran:")
        note(*profile_lines(times, crossings_per_second()))


def _profile(result: Any) -> dict[str, Any]:
    """The profile of the tasks that ran now; if none ran, the recorded one of all tasks."""
    from pipeline.app.pages.ending import profile
    from pipeline.engine.records import fields_of

    measured = [task for task in result.tasks if task.made_by and task.made_by.cpu_seconds is not None]
    ran = [task for task in measured if task.state == "executed"]
    return {"now": bool(ran), **profile((task.kind, fields_of(task.made_by)) for task in ran or measured)}


def _report() -> Any:
    """A report that listens to the build; None, with a note, if no plug-in writes one."""
    try:
        return plugged_in("report", "html")()
    except UsageError as error:
        note(f"no report is written: {error.message}")
        return None


def _run(stage: Path, out: Path | None, options: Any, verbosity: int, events: Path | None, report: Any) -> Any:
    """Build a stage with progress, an event file if named, and the lines of its ending; returns the result."""
    from pipeline.app.build import build_with
    from pipeline.app.progress import Ending, display
    from pipeline.engine.events import EventFile, fan_out

    roots = (f"--allow-root={root}" for root in options.allow_roots)
    arguments = shlex.join([str(stage), *(["-o", str(out)] if out else []), *roots])
    file = EventFile(events) if events else None
    ending = Ending(verbosity, arguments)
    try:
        with display(verbosity) as progress:
            return build_with(stage, out, options, fan_out([*filter(None, [progress, ending, file, report])]))
    finally:
        if file:
            file.close()
        ending.show()


def ensemble(
    stage: Stage,
    count: Annotated[int, typer.Option(metavar="N", min=2, max=9999, help="Number of cameras to draw.")],
    out: Annotated[
        Path | None,
        option(OUTPUT, "--out", "-o", metavar="OUT", help="Folder; by default build/NAME-OF-THE-STAGE.ensemble."),
    ] = None,
    images: Annotated[bool, option(OUTPUT, "--images", help="Make images besides tables and records.")] = False,
    jobs: Jobs = None,
    allow_root: Roots = None,
) -> None:
    """Build cameras drawn by the tolerances of a dataset, and print their spread; exit with 6 if a certificate fails.

    Each is a layer OUT/member_0001.usda over the dataset, with its build beside it. Errors depend on the member's
    number and the seed, not on the number of members. docs/as_built.md.
    """
    from pipeline.app import ensemble as ensembles
    from pipeline.app.build import run_together
    from pipeline.app.progress import display
    from pipeline.engine.events import silent
    from pipeline.engine.options import BuildOptions

    def run(path: Path, folder: Path, options: BuildOptions) -> Any:
        return _run(path, folder, options, -1, None, None)

    def together(stages: Mapping[Path, Path], options: BuildOptions) -> Any:
        with display(0) as progress:
            result = run_together(stages, options, progress or silent)
        note(f"{len(stages)} builds: {result.executed} tasks executed, {result.count('cached')} cached")
        return result

    options = BuildOptions(jobs=jobs, pictures=images, allow_roots=tuple(allow_root or ()))
    built = ensembles.ensemble(stage, out or ensembles.folder_of(stage), count, options, run, together)
    say(*ensembles.summary(built), built.out)
    note(*(f"error: {line}" for line in built.refuted))
    raise typer.Exit(Exit.NOT_CONFIRMED if built.refuted else Exit.DONE)


def run_task(
    specs: Annotated[
        list[Path], typer.Argument(metavar="SPEC.json", help="Written by `plan --specs`, or after a failure.")
    ],
    force: Annotated[bool, option(RUNNING, "--force", "-f", help="Compute even if the result exists.")] = False,
    as_json: Json = False,
) -> None:
    """Run single tasks from their files in this process, to repeat a failure or as jobs of a batch system."""
    from pipeline.engine.interrupts import Interrupts
    from pipeline.engine.planning.graph import task_packages
    from pipeline.engine.running.session import run_task as run
    from pipeline.engine.store.store import Store

    store = Store(warn=note)
    replies: list[Reply] = []
    with Interrupts() as interrupts, interrupts.stopping():
        replies += (run(path, store, task_packages(), force=force) for path in specs)
    if interrupts.arrived:
        note("interrupted")
        raise typer.Exit(Exit.INTERRUPTED)
    for reply in replies:
        if reply.state == "failed":
            note(f"error: task {reply.name} failed")
            log = Path(reply.log) if reply.log else None
            note(log.read_text(encoding="utf-8", errors="replace") if log and log.is_file() else reply.error)
            if reply.damaged:
                note("    hint: its inputs are no longer in the store: build again, or plan --specs again")
        elif not as_json:
            say(f"{reply.name} {reply.state} {reply.seconds:.1f} s")
        if reply.differs:
            note(f"NON-DETERMINISM: {reply.name} gave other bytes than before: {', '.join(reply.differs)}")
    if as_json:
        say_json({"tasks": [_facts(reply) for reply in replies]})
    code = Exit.OTHER_BYTES if any(reply.differs for reply in replies) else Exit.DONE
    code = Exit.FAILED if any(reply.state == "failed" for reply in replies) else code
    raise typer.Exit(Exit.MACHINE if any(reply.machine for reply in replies) else code)


def _facts(reply: "Reply") -> dict[str, Any]:
    outputs = asdict(reply.record)["outputs"] if reply.record else None
    facts = {"name": reply.name, "state": reply.state, "seconds": reply.seconds, "log": reply.log}
    return {**facts, "error": reply.error or None, "outputs": outputs, "differs": list(reply.differs)}
