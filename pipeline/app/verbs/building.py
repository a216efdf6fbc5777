"""`pipeline build`: make the output folder of a stage."""

import os
import shlex
from pathlib import Path
from typing import Any

import typer

from pipeline.app.verbs.options import (
    CheckDeterminism,
    Device,
    DryRun,
    Engine,
    Events,
    Force,
    KeepGoing,
    NoReport,
    Preview,
    Profile,
    Quiet,
    Retries,
    Targets,
    Timeout,
    Until,
    Verbose,
)
from pipeline.app.verbs.planning import print_plan
from pipeline.app.verbs.terminal import (
    Jobs,
    Json,
    Out,
    Roots,
    Stage,
    note,
    say,
    say_json,
)
from pipeline.errors import Exit, PipelineError, UsageError


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
    from pipeline.engine.options import BuildOptions
    from pipeline.report.page.diary import Diary

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
            raise UsageError("--device does not go with --dry-run", hint="results of a device have keys of their own")
        print_plan(stage, out, options, as_json=as_json)
        return
    diary = Diary()
    try:
        result = _run(stage, out, options, verbose - quiet, events, diary)
    except PipelineError as error:
        if as_json:  # also after a failure one JSON object ends the output
            say_json({**_NOTHING, "stage": str(stage), "error": str(error)})
        raise
    _say_result(result, as_json=as_json, profile=profile)
    if quiet <= verbose:
        _say_points(result.points)
    if not no_report:
        _write_report(result, options, diary, is_told=quiet <= verbose)
    is_refuted = _failed_certificate(result.certificate, quiet=quiet > verbose)
    raise typer.Exit(result.exit_code or (Exit.NOT_CONFIRMED if is_refuted else Exit.DONE))


def _say_result(result: Any, *, as_json: bool, profile: bool) -> None:
    """Print the output folder or the files that were asked for, or one JSON object, and the profile if it is wanted."""
    if as_json:
        say_json({**result.to_dict(), **({"profile": _profile(result)} if profile else {})})
        return
    if result.delivery is not None:
        for file in ("",) if result.asked is None else result.asked:
            say(str(result.out / file))
    if profile:
        _say_profile(result)


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
    """Print the certificates to stderr; whether one of the cameras fails to show its accuracy."""
    from pipeline.report.certificate import failed, lines

    for line in lines(cameras or {}) if failed(cameras) or not quiet else ():
        note(line)
    return failed(cameras)


def _say_points(cameras: Any) -> None:
    """Print to stderr how many points are seen in each frame."""
    from pipeline.report.points import lines

    for line in lines(cameras or {}):
        note(line)


def _profile(result: Any) -> dict[str, Any]:
    """The profile of the tasks that ran now; if none ran, the recorded one of all tasks."""
    from pipeline.engine.records import fields_of
    from pipeline.report.profile import profile

    known = [task for task in result.tasks if task.made_by and task.made_by.cpu_seconds is not None]
    ran = [task for task in known if task.state == "executed"]
    return {"now": bool(ran), **profile((task.kind, fields_of(task.made_by)) for task in ran or known)}


def _say_profile(result: Any) -> None:
    """Print the profile to stderr."""
    from pipeline.optics.kernels import crossings_per_second
    from pipeline.report.profile import lines

    profile = _profile(result)
    if not profile["now"]:
        note("nothing had to run; this is what the tasks took when they ran:")
    for line in lines(profile, crossings_per_second()):
        note(line)


def _write_report(result: Any, options: Any, diary: Any, *, is_told: bool) -> None:
    """Write the report of a whole build, and print where it is."""
    is_whole = result.delivery is not None and result.delivery.asked is None
    if not is_whole or options.preview or os.environ.get("PIPELINE_REPORT") == "no":
        return
    from pipeline.app.reporting import report_of_build

    page = report_of_build(result.out, diary, warn=note)
    if page is not None and is_told:
        note(f"report: {page}")


def _run(stage: Path, out: Path | None, options: Any, verbosity: int, events: Path | None, diary: Any) -> Any:
    from pipeline.app.build import build_with
    from pipeline.app.progress import Ending, display
    from pipeline.engine.events import EventFile, fan_out

    roots = (f"--allow-root={root}" for root in options.allow_roots)
    again = shlex.join([str(stage), *(["-o", str(out)] if out else []), *roots])
    file = EventFile(events) if events else None
    ending = Ending(verbosity, again)
    try:
        with display(verbosity) as shown:
            return build_with(stage, out, options, fan_out([*filter(None, [shown, ending, file, diary])]))
    finally:
        if file:
            file.close()
        ending.show()
