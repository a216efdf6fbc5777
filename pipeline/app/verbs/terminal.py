"""Common ground of all verbs: stdout is data, stderr is log and progress."""

import contextlib
import json
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any

import typer
import typer.core

from pipeline.errors import EnvironmentFault
from pipeline.places import flaw_of

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
        "--allow-root", metavar="DIR", rich_help_panel=READING, help="A further folder whose files the stage may read."
    ),
]
Json = Annotated[bool, typer.Option("--json", rich_help_panel=OUTPUT, help="Print one JSON object.")]
Untrusted = Annotated[
    bool,
    typer.Option(
        "--untrusted",
        rich_help_panel=READING,
        help="Read the stage in a process that can read, compute and answer, and nothing else.",
    ),
]


def library_file(path: Any) -> Any:
    """A stage that was typed; if it is not there, that of the shipped library, as stages find `@lenses/...@`."""
    if isinstance(path, (list, tuple)):
        return [library_file(one) for one in path]
    if path is None or flaw_of(path) or path.exists() or path.is_absolute():
        return path
    from pipeline.share import share

    shipped = share("stages") / path
    if not shipped.is_file():
        return path
    note(f"{path} of the library: {shipped}")
    return shipped


StageOrPart = Annotated[
    Path,
    typer.Argument(
        metavar="STAGE",
        help="A dataset, or a rig, a lens or a target alone; also of the library: lenses/NAME.usda.",
        callback=library_file,
    ),
]


class Verb(typer.core.TyperCommand):
    """A verb in whose help flags stand without a type of value."""

    def get_params(self, ctx: Any) -> list[Any]:
        """Options and arguments, `--help` included."""
        return _flags_plain(super().get_params(ctx))


class Family(typer.core.TyperGroup):
    """The same for a group of verbs."""

    def get_params(self, ctx: Any) -> list[Any]:
        """Options, `--help` included."""
        return _flags_plain(super().get_params(ctx))


def _flags_plain(parameters: list[Any]) -> list[Any]:
    """Parameters of which those without a value do not show `<bool>`, as if one were expected."""
    for parameter in parameters:
        if getattr(parameter, "is_flag", False) or getattr(parameter, "count", False):
            parameter.metavar = ""
    return parameters


def new_family(**settings: Any) -> typer.Typer:
    """A group of verbs: help by -h too, and plain tracebacks."""
    names = {"help_option_names": ["-h", "--help"]}
    return typer.Typer(
        cls=Family, no_args_is_help=True, pretty_exceptions_enable=False, context_settings=names, **settings
    )


class ReaderGone(Exception):
    """Nobody reads our output any more."""


def say(text: str) -> None:
    """Print data to stdout.

    Raises
    ------
    ReaderGone
    EnvironmentFault
        It cannot be written, for example because a disk is full.
    """
    with _writing():
        print(text)


def written() -> None:
    """Write what waits in a buffer; raises as `say`."""
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
    """1 error, 2 errors."""
    return f"{count} {thing}{'s' * (count != 1)}"


def note(text: str) -> None:
    """Print what is not data to stderr, after the data that was said before: both may end in one pipe."""
    with contextlib.suppress(OSError):  # that is told when the command ends
        sys.stdout.flush()
    print(text, file=sys.stderr, flush=True)
