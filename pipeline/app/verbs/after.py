"""The verb `pipeline export`, and arguments of verbs after a build."""

from pathlib import Path
from typing import Annotated

import typer

from pipeline.app.verbs.terminal import OUTPUT, option, say, say_json

BuiltFolder = Annotated[Path, typer.Argument(metavar="OUT", help="The output folder of a build.")]
CameraName = Annotated[str | None, typer.Argument(metavar="CAMERA", help="Name of the camera, if there are several.")]


def _formats(incomplete: str) -> list[str]:
    """Format names, for completion in a shell; after a comma the next one."""
    from pipeline.formats import names

    before, comma, begun = incomplete.rpartition(",")
    return [f"{before}{comma}{name}" for name in names() if name.startswith(begun)]


def _print_formats(context: typer.Context, is_given: bool) -> None:
    """Callback of --list: print all formats, or why one cannot be loaded, and end."""
    if not is_given:
        return
    from pipeline.formats import ExportError, format_of, names

    listed = dict[str, str]()
    for name in names():
        try:
            record = format_of(name)
            listed[name] = f"{record.consumer}: {', '.join(record.files)} [cameras: {record.cameras}]"
        except ExportError as error:
            listed[name] = error.message
    if context.params["as_json"]:
        say_json(listed)
    else:
        say(*(f"{name:{max(map(len, listed))}}  {text}" for name, text in listed.items()))
    raise typer.Exit


def export(
    formats: Annotated[
        str,
        typer.Argument(
            metavar="FORMAT[,FORMAT]…",
            help="One of --list, or several; opencv:saddle takes these positions.",
            autocompletion=_formats,
        ),
    ],
    out: BuiltFolder,
    folder: Annotated[
        Path | None,
        option(
            OUTPUT,
            "--out",
            "-o",
            metavar="FOLDER",
            help="Each format gets a folder in there; by default exports/NAME-OF-OUT.",
        ),
    ] = None,
    only: Annotated[
        list[str] | None,
        typer.Option(metavar="NAME", help="Only this camera or target; may be repeated."),
    ] = None,
    noise: Annotated[
        str | None,
        typer.Option(
            metavar="PX[,outliers=SHARE][,outlier_px=PX][,missed=SHARE][,seed=N]",
            help="Add Gaussian noise, outliers and missed points; every file says so.",
        ),
    ] = None,
    replace: Annotated[bool, option(OUTPUT, "--replace", help="Replace folders of formats that are there.")] = False,
    as_json: Annotated[bool, option(OUTPUT, "--json", is_eager=True, help="Print one JSON object.")] = False,
    listed: Annotated[
        bool, typer.Option("--list", callback=_print_formats, help="Say which formats there are, and end.")
    ] = False,
) -> None:
    """Write the exact positions, cameras and poses of a build as files that other programs read.

    docs/exports.md states the meaning of their numbers: pixel origin, axes, poses, units, numbering of microlenses.
    """
    from pipeline.engine.files import chosen_place
    from pipeline.exports.export import Request
    from pipeline.exports.export import export as write_exports
    from pipeline.exports.noise import Noise, noise_of
    from pipeline.results.output import open_output

    output = open_output(out)
    destination = folder or Path("exports") / out.absolute().name
    request = Request(only=tuple(only or ()), noise=noise_of(noise) if noise else Noise(), replace=replace)
    with chosen_place("write", destination):
        folders = [str(path) for path in write_exports(output, formats.split(","), destination, request)]
    say_json({"folders": folders}) if as_json else say("\n".join(folders))
