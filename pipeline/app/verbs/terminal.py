"""Shared parts of all verbs. Data go to stdout, messages and progress to stderr."""

import contextlib
import json
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any

import typer
import typer.core

from pipeline.errors import EnvironmentFault, UsageError
from pipeline.folders import flaw_of

OUTPUT, RUNNING, CHECKING, READING = "Output", "Running", "Checking results", "Reading the stage"
"""Panels of `--help`."""

Stage = Annotated[Path, typer.Argument(metavar="STAGE", help="The dataset: a USD stage.")]
Out = Annotated[
    Path | None,
    typer.Option(
        "--out", "-o", metavar="OUT", rich_help_panel=OUTPUT, help="Output folder; by default build/NAME-OF-THE-STAGE."
    ),
]
Jobs = Annotated[
    int | None,
    typer.Option(
        "--jobs", "-j", metavar="N", min=1, rich_help_panel=RUNNING, help="Worker processes; by default one per core."
    ),
]
Roots = Annotated[
    list[Path] | None,
    typer.Option(
        "--allow-root",
        metavar="DIR",
        rich_help_panel=READING,
        help="A further folder from which the stage may read files.",
    ),
]
Json = Annotated[bool, typer.Option("--json", rich_help_panel=OUTPUT, help="Print one JSON object.")]
Untrusted = Annotated[
    bool,
    typer.Option(
        "--untrusted",
        rich_help_panel=READING,
        help="Do not trust the stage: read it in a confined process that cannot write files.",
    ),
]


def library_file(path: Any) -> Any:
    """The path of a stage as typed; if no such file exists, the one in the shipped library, found as `@lenses/...@`
    is.
    """
    if isinstance(path, (list, tuple)):
        return [library_file(one) for one in path]
    if path is None or flaw_of(path) or path.exists() or path.is_absolute():
        return path
    from pipeline.folders import share

    shipped = share("stages") / path
    if not shipped.is_file():
        return path
    note(f"{path} of the library: {shipped}")
    return shipped


StageOrPart = Annotated[
    Path,
    typer.Argument(
        metavar="STAGE",
        help="A dataset, a rig, a lens or a target; also one of the library: lenses/NAME.usda.",
        callback=library_file,
    ),
]


_ALSO_CALLED = {
    "--jobs": ("--workers", "--threads", "--processes", "--cores", "--parallel"),
    "--out": ("--output", "--outdir", "--output-dir", "--out-dir"),
    "--force": ("--rebuild", "--no-cache", "--clean"),
    "--poses": ("--frames", "--views"),
    "--quiet": ("--silent",),
}
"""What other programs call our options: names that no letters bring near."""


class Verb(typer.core.TyperCommand):
    """A verb whose help shows flags without a type of value, and which knows other names of its options."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """The words of a command line; an unknown option gets the name that we have for it."""
        try:
            return super().parse_args(ctx, args)
        except typer.TyperException as error:
            own = {name for parameter in self.params for name in parameter.opts}
            typed = getattr(error, "option_name", None)
            meant = [name for name, others in _ALSO_CALLED.items() if typed in others and name in own]
            if meant:
                error.possibilities = meant  # type: ignore[attr-defined]
            raise

    def get_params(self, ctx: Any) -> list[Any]:
        """Options and arguments, `--help` included."""
        return _flags_plain(super().get_params(ctx))


class Family(typer.core.TyperGroup):
    """A group of verbs whose help shows flags without a type of value, and which completes a shell by its name."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """The words of a command line; a shell that is named after an option of completion is the one to complete.

        Typer takes the shell that runs in any case, and drops the name without a word.
        """
        option, _, shell = " ".join(args).replace("=", " ", 1).partition(" ")
        if ctx.parent is None and shell and option in ("--install-completion", "--show-completion"):
            _complete(ctx, option, shell)
        return super().parse_args(ctx, args)

    def get_params(self, ctx: Any) -> list[Any]:
        """Options, `--help` included."""
        return _flags_plain(super().get_params(ctx))


def _complete(ctx: Any, option: str, shell: str) -> None:
    """Install or print the completion of a named shell, and end."""
    from typer.completion import Shells, install_callback, show_callback

    if shell not in list(Shells):
        hint = f"{option} with one of {', '.join(sorted(Shells))}; without a name it takes the shell that runs"
        raise UsageError(f'"{shell}" is no shell that can be completed', hint=hint)
    act = install_callback if option == "--install-completion" else show_callback
    with ctx:
        act(ctx, next(one for one in ctx.command.params if option in one.opts), shell)


def _flags_plain(parameters: list[Any]) -> list[Any]:
    """The parameters, with flags that do not show `<bool>`: they take no value."""
    for parameter in parameters:
        if getattr(parameter, "is_flag", False) or getattr(parameter, "count", False):
            parameter.metavar = ""
    return parameters


def new_family(**settings: Any) -> typer.Typer:
    """A group of verbs that also accepts -h and prints plain tracebacks."""
    names = {"help_option_names": ["-h", "--help"]}
    return typer.Typer(
        cls=Family, no_args_is_help=True, pretty_exceptions_enable=False, context_settings=names, **settings
    )


class ReaderGone(Exception):
    """The reader of our output has closed it."""


def say(text: str) -> None:
    """Print data to stdout.

    Raises
    ------
    ReaderGone
    EnvironmentFault
        The output cannot be written, for example because the disk is full.
    """
    with _writing():
        print(text)


def written() -> None:
    """Flush the output; raises as `say` does."""
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


def number_of(count: int, thing: str) -> str:
    """A number with its noun: 1 error, 2 errors."""
    return f"{count} {thing}{'s' * (count != 1)}"


def note(text: str) -> None:
    """Print a message to stderr, after flushing the data printed before: both may go to the same pipe."""
    with contextlib.suppress(OSError):  # reported when the command ends
        sys.stdout.flush()
    print(text, file=sys.stderr, flush=True)
