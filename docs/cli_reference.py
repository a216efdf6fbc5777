"""The reference of the command, as Markdown, from the parser itself: what docs/cli.md shows on the site.

python docs/cli_reference.py
"""

import argparse
import re
from collections.abc import Iterator
from typing import Any

import typer.main

from pipeline import cli

PLAIN = "Options"
"""Heading of options that belong to no panel of `--help`."""


def verbs(command: Any = None, path: tuple[str, ...] = ()) -> Iterator[tuple[tuple[str, ...], Any]]:
    """Every verb with the words that call it; a family of verbs comes before its members."""
    command = command or typer.main.get_command(cli.app)
    for name, below in getattr(command, "commands", {}).items():
        yield (*path, name), below
        yield from verbs(below, (*path, name))


def page() -> str:
    """All verbs by panel: usage, purpose, arguments and options."""
    found: dict[str, list[str]] = {}
    panel_of: dict[str, str] = {}
    for path, verb in verbs():
        panel = panel_of.setdefault(path[0], verb.rich_help_panel)
        found.setdefault(panel, []).append(section(path, verb))
    return "\n".join(part for panel, sections in found.items() for part in (f"## {panel}\n", *sections))


def section(path: tuple[str, ...], verb: Any) -> str:
    """One verb."""
    words = " ".join(("pipeline", *path))
    head = f"{'#' * (len(path) + 2)} {words}\n\n{' '.join(verb.help.split())}\n"
    if getattr(verb, "commands", None):
        return head
    arguments = [one for one in verb.params if one.param_type_name == "argument"]
    options = [one for one in verb.params if one.param_type_name == "option" and not one.hidden]
    usage = " ".join([words, *(["[OPTIONS]"] if options else []), *map(placeholder, arguments)])
    rows = [*map(row, arguments), *panels(options)]
    table = ["| | |", "|---|---|", *rows, ""] if rows else []
    return "\n".join([head, f"```text\n{usage}\n```\n", *table])


def placeholder(argument: Any) -> str:
    """An argument as `--help` writes it."""
    name = argument.metavar or argument.name.upper()
    several = "..." if argument.nargs == -1 else ""
    return f"{name}{several}" if argument.required else f"[{name}{several}]"


def panels(options: list[Any]) -> Iterator[str]:
    """Rows of options by panel, in the order in which panels first appear; the name of each stands above its rows."""
    order = list(dict.fromkeys(one.rich_help_panel or PLAIN for one in options))
    for panel in order:
        if len(order) > 1:
            yield f"| **{panel}** | |"
        yield from (row(one) for one in options if (one.rich_help_panel or PLAIN) == panel)


def row(parameter: Any) -> str:
    """An argument or option in the table of its verb."""
    return f"| {named(parameter)} | {told(parameter)} |"


def named(parameter: Any) -> str:
    """Names of an option and its value."""
    if parameter.param_type_name == "argument":
        return f"`{parameter.metavar or parameter.name.upper()}`"
    value = f" {parameter.metavar}" if parameter.metavar else ""
    return ", ".join(f"`{name}{value}`" for name in (*parameter.opts, *parameter.secondary_opts))


def told(parameter: Any) -> str:
    """Help of a parameter, safe in a cell of a table."""
    text = " ".join((parameter.help or "").split())
    return re.sub(r"([|<>*_])", r"\\\1", text)


if __name__ == "__main__":
    argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter).parse_args()
    print(page())
