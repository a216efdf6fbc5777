"""The verbs `pipeline fit` and `inform`."""

from pathlib import Path
from typing import Annotated

import typer

from pipeline.app.verbs.after import BuiltFolder, CameraName
from pipeline.app.verbs.terminal import (
    OUTPUT,
    USE,
    Json,
    Roots,
    Verb,
    library_file,
    new_family,
    note,
    option,
    require_suffix,
    say,
)
from pipeline.errors import UsageError

verbs = new_family()


def _print_models(wanted: bool) -> None:
    if not wanted:
        return
    from pipeline.fits.fitting import MODELS
    from pipeline.plugins.fits.result import ALL, THIN_LENS

    for name, model in MODELS.items():
        say(f"{name:20}  {model.consumer}")
    say(f"{THIN_LENS:20}  a thin lens before pinholes, as libpleno has it: plenoptic cameras")
    say(f"{ALL:20}  all of them")
    raise typer.Exit


@verbs.command("fit", cls=Verb, rich_help_panel=USE)
def fit(
    place: Annotated[
        Path,
        typer.Argument(metavar="STAGE|OUT", help="A dataset, a rig or the folder of a build.", callback=library_file),
    ],
    camera: CameraName = None,
    models: Annotated[
        list[str] | None,
        typer.Option(
            "--model", "-m", metavar="NAME[,NAME]…", help="Models of --list; by default brown, OpenCV's 5 coefficients."
        ),
    ] = None,
    plot: Annotated[
        Path | None, option(OUTPUT, metavar="FILE.svg", help="Draw the residuals of the best model.")
    ] = None,
    layer: Annotated[
        Path | None,
        option(
            OUTPUT,
            "--out",
            "-o",
            metavar="FILE.usda",
            help="Write a layer on top of STAGE with the schemas OmniLensDistortion…API on the camera.",
        ),
    ] = None,
    as_json: Json = False,
    allow_root: Roots = None,
    listed: Annotated[
        bool,
        typer.Option("--list", is_eager=True, callback=_print_models, help="Say which models there are, and end."),
    ] = False,
) -> None:
    """Fit models of other programs to the exact rays of a camera, and say what they cannot explain.

    Residuals over the image, at other distances, and the entrance pupil over the field. docs/fits.md.
    """
    from pipeline.files.jsonfile import json_bytes
    from pipeline.plugins.fits.fit_camera import fit as fitted
    from pipeline.plugins.fits.result import document, page
    from pipeline.results.notebook import require_plots

    require_suffix(plot, ".svg")  # before anything is computed
    if plot is not None:
        require_plots()
    if layer is not None and (layer.suffix != ".usda" or layer.exists()):
        wrong = "exists" if layer.exists() else "must end in .usda"
        raise UsageError(f"{layer} {wrong}", hint="choose another name")
    names = [name.strip() for item in models or () for name in item.split(",") if name.strip()]
    camera_fit = fitted(place, camera, names, tuple(allow_root or ()))
    fits = camera_fit.camera
    files = ((plot, camera_fit.plot), (layer, camera_fit.layer))
    for path, write in files:  # before whoever reads the page may leave
        if path is not None:
            write(path)
    say(json_bytes(document(fits)).decode().rstrip("\n") if as_json else "\n".join(page(fits)))
    if camera_fit.left_out is not None:
        note(f"no thin lens before pinholes: {camera_fit.left_out}")
    note(*(f"wrote {path}" for path, _ in files if path is not None))


@verbs.command("inform", cls=Verb, rich_help_panel=USE)
def inform(
    out: BuiltFolder,
    camera: CameraName = None,
    model: Annotated[
        str | None,
        typer.Option(
            "--model", "-m", metavar="NAME", help="Of `fit --list`, or a splined one of mrcal; by default brown."
        ),
    ] = None,
    noise: Annotated[
        float, typer.Option(metavar="PX", help="Error of detected corners along x and y, one sigma.", min=1e-6, max=100)
    ] = 0.05,
    plot: Annotated[
        Path | None, option(OUTPUT, metavar="FILE.svg", help="Draw what is known of projections over the image.")
    ] = None,
    to_report: Annotated[bool, option(OUTPUT, "--report", help="Put it into the report of the build, too.")] = False,
    as_json: Json = False,
    allow_root: Roots = None,
) -> None:
    """Say what the corners of a build tell a calibration: its parameters, their deviations, and what is undetermined.

    And how well the calibrated model then projects, over the image and at several distances. docs/information.md.
    """
    from pipeline.app import stages
    from pipeline.entry_points import plugged_in
    from pipeline.files.jsonfile import json_bytes
    from pipeline.plugins.fits.informing import document, drawing, maps, page
    from pipeline.plugins.fits.informing import inform as informed
    from pipeline.results.notebook import require_plots

    require_suffix(plot, ".svg")  # before anything is computed
    if plot is not None or to_report:
        require_plots()
    report, written = plugged_in("product", "report")() if to_report else None, None
    known = informed(out, camera, model, noise, tuple(allow_root or ()))
    if plot is not None:
        stages.draw(drawing(known), plot)
    if report is not None:
        report.inform(known.camera, page(known), maps(known))
        written = report.write(out, warn=note)
    say(json_bytes(document(known)).decode().rstrip("\n") if as_json else "\n".join(page(known)))
    note(*(f"wrote {file}" for file in (plot, written) if file is not None))
