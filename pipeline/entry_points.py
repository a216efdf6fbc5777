"""Entry points by which verbs, engines and formats of plug-ins are found, in this package and in others.

A plug-in is a folder of `plugins/` or a package of its own. Nothing imports it: entry points name what it adds.
"""

import sys
from functools import cache
from typing import TYPE_CHECKING, Any

from pipeline.errors import UsageError

if TYPE_CHECKING:
    from importlib.metadata import EntryPoint  # it takes a tenth of the time of `pipeline --help`

VERBS = "plenoptic_pipeline.verbs"
"""Group of functions that add verbs to the command: `add_to(app)`."""
ENGINES = "plenoptic_pipeline.engines"
"""Group of functions that give the engine of `--engine NAME:WHERE`: `engine_of(where, timeout_s)`."""
FORMATS = "plenoptic_pipeline.formats"
"""Group of the modules of export formats: docs/export_format.md."""


def offered(group: str) -> dict[str, list["EntryPoint"]]:
    """Name -> entry points of the distributions on `sys.path`; none is loaded."""
    return _offered(group, tuple(sys.path))


@cache
def _offered(group: str, _path: tuple[str, ...]) -> dict[str, list["EntryPoint"]]:
    from importlib.metadata import entry_points

    entries: dict[str, list[EntryPoint]] = {}
    for entry in entry_points(group=group):
        entries.setdefault(entry.name, []).append(entry)
    return entries


def package_of(entry: "EntryPoint") -> str:
    """The distribution of an entry point."""
    return entry.dist.name if entry.dist else entry.module


def plugged_in(group: str, name: str) -> Any:
    """Load what an entry point names; UsageError if no plug-in has it, or if that is broken."""
    kind, entries = group.rpartition(".")[2].removesuffix("s"), offered(group)
    if name not in entries:
        hint = f"{kind}s of plug-ins: {', '.join(sorted(entries)) or 'none; install plenoptic-pipeline again'}"
        raise UsageError(f'no plug-in that is installed has the {kind} "{name}"', hint=hint)
    entry = entries[name][0]
    try:
        return entry.load()
    except Exception as error:  # a stranger's code may fail in any way
        what = f'the {kind} "{name}" of the package {package_of(entry)} cannot be loaded'
        raise UsageError(f"{what}: {type(error).__name__}: {error}", hint="mend or remove that package") from error
