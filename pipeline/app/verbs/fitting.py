"""`pipeline fit`: the models of other programs that are nearest to a camera."""

from pathlib import Path
from typing import Annotated

import typer

from pipeline.app.verbs.terminal import OUTPUT, Json, Roots, library_file, note, require_suffix, say
from pipeline.errors import UsageError


def _print_list(wanted: bool) -> None:
    """Print the models and end."""
    if not wanted:
        return
    from pipeline.fits.models import MODELS
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
    camera: Annotated[
        str | None, typer.Argument(metavar="CAMERA", help="Name of the camera, if there are several.")
    ] = None,
    models: Annotated[
        list[str] | None,
        typer.Option(
            "--model", "-m", metavar="NAME[,NAME]…", help="Models of --list; by default brown, OpenCV's 5 coefficients."
        ),
    ] = None,
    plot: Annotated[
        Path | None,
        typer.Option(
            "--plot", metavar="FILE.svg", rich_help_panel=OUTPUT, help="Draw the residuals of the best model."
        ),
    ] = None,
    layer: Annotated[
        Path | None,
        typer.Option(
            "--out",
            "-o",
            metavar="FILE.usda",
            rich_help_panel=OUTPUT,
            help="Write a layer on top of STAGE with the schemas OmniLensDistortion…API on the camera.",
        ),
    ] = None,
    as_json: Json = False,
    allow_root: Roots = None,
    listed: Annotated[
        bool, typer.Option("--list", is_eager=True, callback=_print_list, help="Say which models there are, and end.")
    ] = False,
) -> None:
    """Fit models of other programs to the exact rays of a camera, and say what they cannot explain.

    Residuals over the image, at other distances, and the entrance pupil over the field. docs/fits.md.
    """
    from pipeline.app.fitting import fit as fitted

    _require_usable(plot, layer)
    names = [name.strip() for item in models or () for name in item.split(",") if name.strip()]
    fitted_camera = fitted(place, camera, names, tuple(allow_root or ()))
    say(fitted_camera.json().rstrip("\n") if as_json else "\n".join(fitted_camera.page()))
    if fitted_camera.left_out is not None:
        note(f"no thin lens before pinholes: {fitted_camera.left_out}")
    if plot is not None:
        fitted_camera.plot(plot)
        note(f"wrote {plot}")
    if layer is not None:
        fitted_camera.layer(layer)
        note(f"wrote {layer}")


def _require_usable(plot: Path | None, layer: Path | None) -> None:
    """Refuse files that cannot be written, before anything is computed."""
    require_suffix(plot, ".svg")
    if layer is not None and (layer.suffix != ".usda" or layer.exists()):
        wrong = "exists" if layer.exists() else "must end in .usda"
        raise UsageError(f"{layer} {wrong}", hint="choose another name")
