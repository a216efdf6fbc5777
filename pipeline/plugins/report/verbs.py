"""The verb `pipeline report`."""

from pathlib import Path
from typing import Annotated

import typer

from pipeline.app.verbs.after import BuiltFolder
from pipeline.app.verbs.terminal import OUTPUT, USE, Json, Verb, new_family, note, option, say, say_json

verbs = new_family()


@verbs.command("report", cls=Verb, rich_help_panel=USE)
def report(
    out: BuiltFolder,
    folder: Annotated[
        Path | None,
        option(OUTPUT, "--out", "-o", metavar="FOLDER", help="Folder of the report; by default OUT.report."),
    ] = None,
    show: Annotated[bool, option(OUTPUT, "--open", help="Open the page in the browser of this desktop.")] = False,
    as_json: Json = False,
) -> None:
    """Write one page about a build: certificate, images with their truth, scene, lens, spots, residuals, tasks.

    It works from disk, without a network. `pipeline build` writes it, too, unless told --no-report.
    """
    from pipeline.engine.files import chosen_place
    from pipeline.plugins.report.report import Report

    with chosen_place("write", folder or out):
        page = Report().write(out, folder, warn=note)
    say_json({"report": str(page)}) if as_json else say(page)
    if show:
        typer.launch(page.absolute().as_uri())
