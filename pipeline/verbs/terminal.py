"""What all verbs share: stdout is data, stderr is log and progress."""

import json
import sys
from pathlib import Path
from typing import Annotated, Any

import typer

Stage = Annotated[Path, typer.Argument(metavar="STAGE", help="The dataset: a USD stage.")]
Out = Annotated[Path | None, typer.Option("--out", "-o", metavar="OUT", help="Output folder [build/<name>].")]
Roots = Annotated[
    list[Path] | None, typer.Option("--allow-root", metavar="DIR", help="A further folder that assets may lie in.")
]
Json = Annotated[bool, typer.Option("--json", help="Print one JSON object.")]
Untrusted = Annotated[bool, typer.Option("--untrusted", help="Read the stage in a process of its own, with limits.")]


class ReaderGone(Exception):
    """Nobody reads our output any more."""


def say(text: str) -> None:
    """Print data to stdout."""
    try:
        print(text)
    except BrokenPipeError:
        raise ReaderGone from None


def say_json(value: Any) -> None:
    """Print one JSON object to stdout."""
    say(json.dumps(value, indent=1))


def note(text: str) -> None:
    """Print what is not data to stderr."""
    print(text, file=sys.stderr, flush=True)
