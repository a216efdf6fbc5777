"""`pipeline export`: a build in the files of other programs."""

from pathlib import Path
from typing import Annotated

import typer

from pipeline.app.verbs.terminal import OUTPUT, say


def _names(incomplete: str) -> list[str]:
    """Formats, for completion in a shell; after a comma the next one."""
    from pipeline.export_formats import FORMATS

    before, comma, begun = incomplete.rpartition(",")
    return [f"{before}{comma}{name}" for name in FORMATS if name.startswith(begun)]


def _print_list(wanted: bool) -> None:
    """Print the table of formats and end."""
    if not wanted:
        return
    from pipeline.export_formats import FORMATS
    from pipeline.exports.conventions import CONVENTIONS

    width = max(map(len, FORMATS))
    for name, form in FORMATS.items():
        say(f"{name:{width}}  {CONVENTIONS[name].consumer}: {', '.join(form.files)} [cameras: {form.cameras}]")
    raise typer.Exit


def export(
    formats: Annotated[
        str,
        typer.Argument(
            metavar="FORMAT[,FORMAT]…",
            help="One of --list, or several; opencv:saddle takes these positions.",
            autocompletion=_names,
        ),
    ],
    out: Annotated[Path, typer.Argument(metavar="OUT", help="The output folder of a build.")],
    folder: Annotated[
        Path | None,
        typer.Option(
            "--out",
            "-o",
            metavar="FOLDER",
            rich_help_panel=OUTPUT,
            help="Each format gets a folder in there; by default exports/NAME-OF-OUT.",
        ),
    ] = None,
    only: Annotated[
        list[str] | None,
        typer.Option("--only", metavar="NAME", help="Only this camera or target; as often as you like."),
    ] = None,
    noise: Annotated[
        str | None,
        typer.Option(
            metavar="PX[,outliers=SHARE][,outlier_px=PX][,missed=SHARE][,seed=N]",
            help="Add Gaussian noise, outliers and missed points; every file says so.",
        ),
    ] = None,
    listed: Annotated[
        bool, typer.Option("--list", is_eager=True, callback=_print_list, help="Say which formats there are, and end.")
    ] = False,
) -> None:
    """Write the exact positions, cameras and poses of a build as files that other programs read.

    docs/exports.md has what their numbers mean: pixel origin, axes, poses, units, numbers of microlenses.
    """
    from pipeline.built.output import open_output
    from pipeline.engine.files import chosen_place
    from pipeline.exports.export import Request
    from pipeline.exports.export import export as written
    from pipeline.exports.noise import Noise, noise_of

    output = open_output(out)
    place = folder or Path("exports") / out.absolute().name
    request = Request(only=tuple(only or ()), noise=noise_of(noise) if noise else Noise())
    with chosen_place("write", place):
        for path in written(output, formats.split(","), place, request):
            say(str(path))
