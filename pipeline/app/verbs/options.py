"""Options and arguments of the verbs that read a stage with its output folder."""

from collections.abc import Iterable
from pathlib import Path
from typing import Annotated, Any

import typer

from pipeline.app.verbs.terminal import CHECKING, OUTPUT, RUNNING, option
from pipeline.errors import PipelineError

Force = Annotated[
    list[str] | None,
    option(RUNNING, "--force", "-f", metavar="TASK", help="Run this task again, even if its result exists."),
]
Until = Annotated[
    list[str] | None,
    option(RUNNING, "--until", metavar="TASK", help="Run up to this task and fill only the store."),
]
Specs = Annotated[
    Path | None,
    option(
        OUTPUT,
        "--specs",
        metavar="DIR",
        help="Write files for `run-task`, one per task that can run now: 0.json, 1.json …",
    ),
]


def names_of(ctx: typer.Context, incomplete: str) -> list[str]:
    """Tasks and files of the stage that was typed, for completion in a shell."""
    try:
        stage = project_of(ctx.params["stage"], ctx.params.get("out"), ctx.params.get("allow_root"))
    except (PipelineError, KeyError, TypeError):
        return []  # completion cannot show messages
    return [name for name in [*stage.graph, *stage.files] if name.startswith(incomplete)]


Target = Annotated[
    str,
    typer.Argument(metavar="TARGET", help="A task, or a file or folder of OUT.", autocompletion=names_of),
]
Targets = Annotated[
    list[str] | None,
    typer.Argument(
        metavar="TARGET",
        help="Files or folders of OUT, or tasks: only these are built. By default the whole dataset.",
        autocompletion=names_of,
    ),
]
Events = Annotated[
    Path | None, option(OUTPUT, "--events", metavar="FILE", help="Write all events to this file, as JSON lines.")
]
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
Retries = Annotated[
    int, option(RUNNING, "--retries", metavar="N", min=0, help="Number of times that a failed task is tried again.")
]
Timeout = Annotated[
    float | None,
    option(
        RUNNING,
        "--timeout",
        metavar="SECONDS",
        min=0.001,
        help="A task that takes longer is ended and counts as failed.",
    ),
]
Engine = Annotated[
    str | None,
    option(
        RUNNING,
        "--engine",
        metavar="dask:WHERE",
        help="Run tasks on a Dask cluster: the address of its scheduler, or its file.",
    ),
]
Device = Annotated[
    str | None,
    option(
        RUNNING,
        "--device",
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
        "--check-determinism",
        metavar="PERCENT",
        min=0,
        max=100,
        help="Compute this share of the tasks twice and compare the bytes of their results.",
    ),
]


def project_of(stage: Path, out: Path | None, allow_root: Iterable[str | Path] | None) -> Any:
    """The project of a stage."""
    from pipeline.app.build import project

    return project(stage, out, tuple(allow_root or ()))
