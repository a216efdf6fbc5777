"""`pipeline report`: the page about a build."""

from pathlib import Path
from typing import Annotated

import typer

from pipeline.app.verbs.terminal import OUTPUT, note, say


def report(
    out: Annotated[Path, typer.Argument(metavar="OUT", help="The output folder of a build.")],
    folder: Annotated[
        Path | None,
        typer.Option(
            "--out", "-o", metavar="FOLDER", rich_help_panel=OUTPUT, help="Folder of the report; by default OUT.report."
        ),
    ] = None,
    show: Annotated[
        bool, typer.Option("--open", rich_help_panel=OUTPUT, help="Open the page in the browser of this desktop.")
    ] = False,
) -> None:
    """Write one page about a build: certificate, images with their truth, scene, lens, spots, residuals, tasks.

    It works from disk, without a network. `pipeline build` writes it, too, unless told --no-report.
    """
    from pipeline.app.reporting import report as written
    from pipeline.engine.files import chosen_place

    with chosen_place("write", folder or out):
        page = written(out, folder, warn=note)
    say(str(page))
    if show:
        typer.launch(page.absolute().as_uri())
