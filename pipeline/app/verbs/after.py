"""The verbs after a build: `pipeline export`, `fit` and `inform`."""

from pathlib import Path
from typing import Annotated

import typer

from pipeline.app.verbs.terminal import OUTPUT, Json, Roots, library_file, note, option, require_suffix, say, say_json
from pipeline.errors import UsageError

BuiltFolder = Annotated[Path, typer.Argument(metavar="OUT", help="The output folder of a build.")]
CameraName = Annotated[str | None, typer.Argument(metavar="CAMERA", help="Name of the camera, if there are several.")]


def _formats(incomplete: str) -> list[str]:
    """Formats, for completion in a shell; after a comma the next one."""
    from pipeline.formats import names

    before, comma, begun = incomplete.rpartition(",")
    return [f"{before}{comma}{name}" for name in names() if name.startswith(begun)]


def _print_formats(context: typer.Context, wanted: bool) -> None:
    if not wanted:
        return
    from pipeline.formats import ExportError, format_of, names

    listed = dict[str, str]()
    for name in names():
        try:
            record = format_of(name)
            listed[name] = f"{record.consumer}: {', '.join(record.files)} [cameras: {record.cameras}]"
        except ExportError as error:
            listed[name] = error.what
    if context.params["as_json"]:
        say_json(listed)
    else:
        say(*(f"{name:{max(map(len, listed))}}  {told}" for name, told in listed.items()))
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
        typer.Option(metavar="NAME", help="Only this camera or target; as often as you like."),
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

    docs/exports.md has what their numbers mean: pixel origin, axes, poses, units, numbers of microlenses.
    """
    from pipeline.engine.files import chosen_place
    from pipeline.exports.export import Request
    from pipeline.exports.export import export as written
    from pipeline.exports.noise import Noise, noise_of
    from pipeline.results.output import open_output

    output = open_output(out)
    place = folder or Path("exports") / out.absolute().name
    request = Request(only=tuple(only or ()), noise=noise_of(noise) if noise else Noise(), replace=replace)
    with chosen_place("write", place):
        folders = [str(path) for path in written(output, formats.split(","), place, request)]
    say_json({"folders": folders}) if as_json else say("\n".join(folders))


def _print_models(wanted: bool) -> None:
    if not wanted:
        return
    from pipeline.fits.fitting import MODELS
    from pipeline.fits.result import ALL, THIN_LENS

    for name, model in MODELS.items():
        say(f"{name:20}  {model.consumer}")
    say(f"{THIN_LENS:20}  a thin lens before pinholes, as libpleno has it: plenoptic cameras")
    say(f"{ALL:20}  all of them")
    raise typer.Exit


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
    from pipeline.app.fitting import fit as fitted
    from pipeline.files.jsonfile import json_bytes
    from pipeline.fits.result import document, page
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
    from pipeline.app.informing import document, drawing, maps, page
    from pipeline.app.informing import inform as informed
    from pipeline.entry_points import plugged_in
    from pipeline.files.jsonfile import json_bytes
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
