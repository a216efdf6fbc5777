"""Options and arguments of the verbs that read a stage with its output folder."""

from collections.abc import Iterable
from pathlib import Path
from typing import Annotated, Any

import typer

from pipeline.app.verbs.terminal import CHECKING, OUTPUT, RUNNING
from pipeline.errors import PipelineError

Force = Annotated[
    list[str] | None,
    typer.Option(
        "--force",
        "-f",
        metavar="TASK",
        rich_help_panel=RUNNING,
        help="Run this task again, even if its result exists.",
    ),
]
Until = Annotated[
    list[str] | None,
    typer.Option(
        "--until", metavar="TASK", rich_help_panel=RUNNING, help="Run up to this task and fill only the store."
    ),
]
Specs = Annotated[
    Path | None,
    typer.Option(
        "--specs",
        metavar="DIR",
        rich_help_panel=OUTPUT,
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
    Path | None,
    typer.Option(
        "--events", metavar="FILE", rich_help_panel=OUTPUT, help="Write all events to this file, as JSON lines."
    ),
]
Verbose = Annotated[
    int,
    typer.Option(
        "--verbose",
        "-v",
        count=True,
        show_default=False,
        rich_help_panel=OUTPUT,
        help="Print a line also when a task starts.",
    ),
]
Quiet = Annotated[
    int,
    typer.Option(
        "--quiet", "-q", count=True, show_default=False, rich_help_panel=OUTPUT, help="Only failures and warnings."
    ),
]
Profile = Annotated[
    bool,
    typer.Option("--profile", rich_help_panel=OUTPUT, help="Print where the time went, by kind of task and kernel."),
]
DryRun = Annotated[bool, typer.Option("--dry-run", "-n", rich_help_panel=RUNNING, help="Only print what would run.")]
KeepGoing = Annotated[
    bool,
    typer.Option(
        "--keep-going", "-k", rich_help_panel=RUNNING, help="After a failure, go on with the tasks that can still run."
    ),
]
Retries = Annotated[
    int,
    typer.Option(
        "--retries",
        metavar="N",
        min=0,
        rich_help_panel=RUNNING,
        help="Number of times that a failed task is tried again.",
    ),
]
Timeout = Annotated[
    float | None,
    typer.Option(
        "--timeout",
        metavar="SECONDS",
        min=0.001,
        rich_help_panel=RUNNING,
        help="A task that takes longer is ended and counts as failed.",
    ),
]
Engine = Annotated[
    str | None,
    typer.Option(
        "--engine",
        metavar="dask:WHERE",
        rich_help_panel=RUNNING,
        help="Run tasks on a Dask cluster: the address of its scheduler, or its file.",
    ),
]
Device = Annotated[
    str | None,
    typer.Option(
        "--device",
        metavar="cuda",
        rich_help_panel=RUNNING,
        help="Trace images, in float32, and position images on a CUDA device. By default everything runs on the CPU.",
    ),
]
Preview = Annotated[
    bool,
    typer.Option(
        "--preview",
        rich_help_panel=OUTPUT,
        help="Make pictures only, a quarter of the size and with few samples, in another output folder.",
    ),
]
NoReport = Annotated[
    bool,
    typer.Option("--no-report", rich_help_panel=OUTPUT, help="Write no report, the page in OUT.report."),
]
CheckDeterminism = Annotated[
    float,
    typer.Option(
        "--check-determinism",
        metavar="PERCENT",
        min=0,
        max=100,
        rich_help_panel=CHECKING,
        help="Compute this share of the tasks twice and compare the bytes of their results.",
    ),
]


def project_of(stage: Path, out: Path | None, allow_root: Iterable[str | Path] | None) -> Any:
    """The project of a stage."""
    from pipeline.app.build import project

    return project(stage, out, tuple(allow_root or ()))
