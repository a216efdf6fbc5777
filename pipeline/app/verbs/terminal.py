"""Shared parts of all verbs: options and printing. Data go to stdout, messages and progress to stderr."""

import contextlib
import json
import shlex
import sys
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Annotated, Any

import typer
import typer.core
import typer.main

from pipeline.entry_points import offered, plugged_in
from pipeline.errors import EnvironmentFault, PipelineError, UsageError
from pipeline.folders import path_flaw
from pipeline.spelling import for_terminals, printable

WRITE, BUILD, LOOK, USE, CARE = "Before a build", "Build", "What was done, and why", "After a build", "Care"
"""Panels of `pipeline --help`, in this order."""
OUTPUT, RUNNING, CHECKING, READING = "Output", "Running", "Checking results", "Reading the stage"
"""Panels of the `--help` of a verb."""


def valued(metavar: str, text: str, **limits: Any) -> Any:
    """An option with a value, named after its parameter."""
    return typer.Option(metavar=metavar, help=text, **limits)


def option(panel: str, *names: str, **settings: Any) -> Any:
    """An option of a verb, listed in a panel of `--help`."""
    return typer.Option(*names, rich_help_panel=panel, **settings)


Stage = Annotated[Path, typer.Argument(metavar="STAGE", help="The dataset: a USD stage.")]
Out = Annotated[
    Path | None, option(OUTPUT, "--out", "-o", metavar="OUT", help="Output folder; by default build/NAME-OF-THE-STAGE.")
]
Roots = Annotated[
    list[Path] | None, option(READING, metavar="DIR", help="A further folder from which the stage may read files.")
]
Json = Annotated[bool, option(OUTPUT, "--json", help="Print one JSON object.")]
Force = Annotated[
    list[str] | None,
    option(RUNNING, "--force", "-f", metavar="TASK", help="Run this task again, even if its result exists."),
]
Until = Annotated[
    list[str] | None, option(RUNNING, metavar="TASK", help="Run up to this task and fill only the store.")
]


def names_of(ctx: typer.Context, incomplete: str) -> list[str]:
    """Tasks and files of the stage on the command line, for completion in a shell."""
    try:
        stage = project_of(ctx.params["stage"], ctx.params.get("out"), ctx.params.get("allow_root"))
    except (PipelineError, KeyError, TypeError):
        return []  # completion cannot show messages
    return [name for name in [*stage.graph, *stage.files] if name.startswith(incomplete)]


def project_of(stage: Path, out: Path | None, allow_root: Iterable[str | Path] | None) -> Any:
    """The project of a stage on the command line; see `app.build.project`."""
    from pipeline.app.build import project

    return project(stage, out, tuple(allow_root or ()))


def library_file(path: Path | Sequence[Path] | None) -> Any:
    """The path as typed; if there is no such file, that of the shipped library, as `@lenses/...@` finds it. Of several
    paths a list.
    """
    if isinstance(path, Sequence):
        return [library_file(part) for part in path]
    if path is None or path_flaw(path):  # with a flaw in completion alone: otherwise `Verb` has refused the path
        return path
    if path.exists() or path.is_absolute():
        return path
    from pipeline.folders import shipped_folder

    in_library = shipped_folder("stages") / path
    if not in_library.is_file():
        return path
    note(f"{path} of the library: {in_library}")
    return in_library


StageOrPart = Annotated[
    Path,
    typer.Argument(
        metavar="STAGE",
        help="A dataset, a rig, a lens or a target; also one of the library: lenses/NAME.usda.",
        callback=library_file,
    ),
]


class _PlainFlags:
    """Help that shows flags without `<bool>`: they take no value."""

    def get_params(self, ctx: Any) -> list[Any]:
        """Options and arguments, `--help` included."""
        parameters: list[Any] = super().get_params(ctx)  # type: ignore[misc]
        for parameter in parameters:
            if getattr(parameter, "is_flag", False) or getattr(parameter, "count", False):
                parameter.metavar = ""
        return parameters


class Verb(_PlainFlags, typer.core.TyperCommand):
    """A verb of the command. No argument may be empty, which as a path would be the working directory, or unusable."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Parse arguments; returns the remaining ones."""
        if not ctx.resilient_parsing and any(not arg or (arg[:2] == "--" and arg[-1] == "=") for arg in args):
            hint = "a variable that is not set leaves an empty one"
            raise UsageError(f"an argument is empty: {ctx.command_path} {shlex.join(args)}", hint=hint)
        for arg in args if not ctx.resilient_parsing else ():
            flaw = path_flaw(Path(arg.partition("=")[2] if arg.startswith("--") else arg))
            if not flaw and "\n" in arg:  # it would begin a line of ours
                flaw = "holds a line break"
            if flaw:
                hint = "give it another name; an output folder is named with -o"
                raise UsageError(f"an argument {flaw}: {printable(arg[:60])}", hint=hint)
        return super().parse_args(ctx, args)


class Family(_PlainFlags, typer.core.TyperGroup):
    """A group of verbs."""


class Verbs(Family):
    """The verbs of the core, and those of plug-ins, which are loaded when they are listed or called."""

    plug_ins = ("calibrate", "design", "fit", "inform", "report")
    """Verbs of plug-ins of ours: without them they say so."""

    def list_commands(self, ctx: Any) -> list[str]:
        """Names of all verbs but broken ones."""
        for name in offered("verb"):
            with contextlib.suppress(UsageError):  # whoever asks for it is told
                self.get_command(ctx, name)
        return super().list_commands(ctx)

    def get_command(self, ctx: Any, cmd_name: str) -> Any:
        """The verb of a name, or None; UsageError if its plug-in is broken or not installed."""
        if cmd_name not in self.commands and cmd_name in {*offered("verb"), *self.plug_ins}:
            self.commands.update(typer.main.get_group(plugged_in("verb", cmd_name)).commands)
        elif cmd_name not in self.commands:
            self.list_commands(ctx)  # which verb was meant is guessed among all
        return super().get_command(ctx, cmd_name)


def new_family(**settings: Any) -> typer.Typer:
    """A group of verbs that also accepts -h and prints plain tracebacks."""
    names = {"help_option_names": ["-h", "--help"]}
    settings = {"cls": Family, "no_args_is_help": True, "context_settings": names, **settings}
    return typer.Typer(pretty_exceptions_enable=False, **settings)


class ReaderGone(Exception):
    """The reader of our output has closed it."""


def say(*lines: object) -> None:
    """Print data to stdout; ReaderGone, or EnvironmentFault if they cannot be written, as on a full disk."""
    for line in lines:
        with _writing():
            print(for_terminals(str(line)))


def flush_output() -> None:
    """Flush the output; ReaderGone or EnvironmentFault, as `say`."""
    with _writing():
        sys.stdout.flush()


@contextlib.contextmanager
def _writing() -> Iterator[None]:
    try:
        yield
    except BrokenPipeError:
        raise ReaderGone from None
    except OSError as error:
        raise EnvironmentFault(f"cannot write to standard output: {error.strerror}") from error


def say_json(value: Any) -> None:
    """Print one JSON object to stdout."""
    say(json.dumps(value, indent=1))


def require_suffix(path: Path | None, suffix: str) -> None:
    """Refuse a name for a new file that does not have its format's suffix, before anything is computed."""
    if path is not None and path.suffix != suffix:
        raise UsageError(f"{path} is no {suffix} file", hint=f"end its name in {suffix}")


def number_of(count: int, thing: str) -> str:
    """A number with its noun: 1 error, 2 errors."""
    return f"{count} {thing}{'s' * (count != 1)}"


def note(*lines: object) -> None:
    """Print messages to stderr, after flushing the data printed before: both may go to the same pipe."""
    with contextlib.suppress(OSError):  # reported when the command ends
        sys.stdout.flush()
    for line in lines:
        print(line, file=sys.stderr, flush=True)
