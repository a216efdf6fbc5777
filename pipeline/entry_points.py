"""Entry points, by which plug-ins are found: those in `plugins/`, which nothing imports, and those of other packages.

Groups are `plenoptic_pipeline.verbs`: a `typer.Typer` with verbs of the command; `.engines`: `engine_of(where,
timeout_s)` of `--engine NAME:WHERE`; `.products`: plans, see docs/how_to/task.md; `.reports`: `html`, which listens to
a build and then writes about its folder; `.sections`: functions (report, stage, output) that `tell` such a report more
about a build; `.readers`: `lens.SUFFIX` and `camera.SUFFIX`, functions of files; `.formats`: modules, see
docs/export_format.md; `.scenes`: `reader`, a module that is a `scene.usd.plug_in.SceneReader`, and `things`, a
`products.things.Things` that lamps light; `.kernels`: by the name of a step of compilation,
`app.compile_kernels.Part`s; `.poses`: `best`, the most informative poses for `new dataset`, and `prediction`, lines on
how well a calibration by poses determines cameras.
"""

import sys
from functools import cache
from typing import TYPE_CHECKING, Any

from pipeline.errors import UsageError

if TYPE_CHECKING:
    from importlib.metadata import EntryPoint  # it takes a tenth of the time of `pipeline --help`


def offered(kind: str) -> dict[str, list["EntryPoint"]]:
    """Name -> entry points of a kind, such as "verb", of the distributions on `sys.path`; none is loaded."""
    return _offered(f"plenoptic_pipeline.{kind}s", tuple(sys.path))


@cache
def _offered(group: str, _path: tuple[str, ...]) -> dict[str, list["EntryPoint"]]:
    from importlib.metadata import entry_points

    entries: dict[str, list[EntryPoint]] = {}
    for entry in entry_points(group=group):
        entries.setdefault(entry.name, []).append(entry)
    return entries


def package_of(entry: "EntryPoint") -> str:
    """Name of the distribution that declares an entry point."""
    return entry.dist.name if entry.dist else entry.module


def plugged_in(kind: str, name: str) -> Any:
    """Load the object that an entry point names; UsageError if no plug-in declares it, several do, or it is broken."""
    if name not in (entries := offered(kind)):
        hint = f"{kind}s of plug-ins: {', '.join(sorted(entries)) or 'none; install plenoptic-pipeline again'}"
        raise UsageError(f'no plug-in that is installed has the {kind} "{name}"', hint=hint)
    if len(entries[name]) > 1:
        packages = " and ".join(sorted(map(package_of, entries[name])))
        raise UsageError(f'the packages {packages} each have the {kind} "{name}"', hint="remove one of them")
    (entry,) = entries[name]
    try:
        return entry.load()
    except Exception as error:  # a stranger's code may fail in any way
        message = f'the {kind} "{name}" of the package {package_of(entry)} cannot be loaded'
        raise UsageError(f"{message}: {type(error).__name__}: {error}", hint="mend or remove that package") from error
