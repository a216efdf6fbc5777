"""The verbs `pipeline fit`, `inform` and `calibrate`."""

from pathlib import Path
from typing import Annotated, Literal

import typer

from pipeline.app.verbs.after import BuiltFolder, CameraName
from pipeline.app.verbs.terminal import (
    OUTPUT,
    USE,
    Json,
    Roots,
    Stage,
    Verb,
    library_file,
    new_family,
    note,
    option,
    require_suffix,
    say,
)
from pipeline.errors import Exit, UsageError

verbs = new_family()


def _print_models(is_requested: bool) -> None:
    """Print the models that can be fitted, and end the command."""
    if not is_requested:
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
    stage_or_build: Annotated[
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
    camera_fit = fitted(stage_or_build, camera, names, tuple(allow_root or ()))
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
    report, written = plugged_in("report", "html")() if to_report else None, None
    knowledge = informed(out, camera, model, noise, tuple(allow_root or ()))
    if plot is not None:
        stages.draw(drawing(knowledge), plot)
    if report is not None:
        report.tell("Information", knowledge.camera, page(knowledge), maps(knowledge))
        written = report.write(out, warn=note)
    say(json_bytes(document(knowledge)).decode().rstrip("\n") if as_json else "\n".join(page(knowledge)))
    note(*(f"wrote {file}" for file in (plot, written) if file is not None))


PixelOrigin = Annotated[str | None, typer.Option(metavar="0|0.5|1", help="Number of the centre of the top-left pixel.")]
Position = Annotated[
    str | None, typer.Option(metavar="exact|saddle|centroid|chief", help="Image position that the detector looks for.")
]
Centres = Annotated[
    str | None,
    typer.Option(metavar="centroid|chief|none", help="Position that a file means by centres of micro-images."),
]


@verbs.command("calibrate", cls=Verb, rich_help_panel=USE)
def calibrate(
    stage: Stage,
    observations: Annotated[
        list[Path],
        typer.Argument(metavar="OBSERVATIONS…", help="Positions that a detector found: .csv, .npz, .vnl, .bin.gz."),
    ],
    out: Annotated[Path, option(OUTPUT, "--out", "-o", metavar="FITTED.usda", help="New layer over the dataset.")],
    free: Annotated[
        list[str] | None,
        typer.Option(metavar="PATH", help="A number that is free, or a prim: all with tolerances there; repeatable."),
    ] = None,
    centres: Centres = None,
    sigma: Annotated[
        float | None, typer.Option(metavar="PX", help="Error of positions, one sigma, if the file has none.", min=1e-9)
    ] = None,
    pixel_origin: PixelOrigin = None,
    position: Position = None,
    camera: Annotated[str | None, typer.Option(metavar="NAME", help="Camera of a file that names none.")] = None,
    poses: Annotated[
        Literal["free", "known"], typer.Option(metavar="free|known", help="Poses of boards: fitted, or the stage's.")
    ] = "free",
    loss: Annotated[
        float | None, typer.Option(metavar="SIGMAS", help="Cauchy's loss: rows further off count less.", min=0.1)
    ] = None,
    images: Annotated[
        list[str] | None,
        option(OUTPUT, metavar="[CAMERA=]FOLDER", help="The real images, for the report of the twin's build."),
    ] = None,
    plot: Annotated[Path | None, option(OUTPUT, metavar="FILE.svg", help="Draw the residual of each position.")] = None,
    as_json: Json = False,
    allow_root: Roots = None,
) -> None:
    """Fit a stage to the images of a real camera: numbers of its lens, stop, focus, array and sensor, and poses.

    Ends with 6 if something is left that noise does not explain. docs/how_to/calibrate.md.
    """
    from pipeline.app.stages import draw
    from pipeline.files.jsonfile import json_bytes
    from pipeline.plugins.fits.calibration import calibrate as fitted
    from pipeline.plugins.fits.free_numbers import FreeStage
    from pipeline.plugins.fits.observations import Stated
    from pipeline.plugins.fits.real_images import found_images
    from pipeline.plugins.fits.twin import document, require_new
    from pipeline.plugins.fits.twin_page import page, residual_maps
    from pipeline.results.notebook import require_plots

    require_new(out)
    require_suffix(plot, ".svg")
    if plot is not None:
        require_plots()
    numbers = FreeStage(stage, free or [], tuple(allow_root or ()))
    pictures = found_images(images or [], numbers.nominal, out)
    stated = Stated(pixel_origin=pixel_origin, position=position, centres=centres, sigma_px=sigma, camera=camera)
    twin = fitted(numbers, observations, stated, loss_scale=loss, known_poses=poses == "known", tell=note)
    files, fit = [*twin.write(out, pictures)], document(twin)
    if plot is not None:
        draw(residual_maps(fit), plot)
        files.append(plot)
    say(json_bytes(fit).decode().rstrip("\n") if as_json else "\n".join(page(fit)))
    note(*(f"wrote {file}" for file in files))
    if twin.doubts:
        raise typer.Exit(Exit.NOT_CONFIRMED)
