"""The command `pipeline`. Data go to stdout, messages and progress to stderr.

Verbs import what they need when they run, so that `--help` is fast.
"""

import atexit
import gc
import os
import sys
import traceback
from pathlib import Path
from typing import Annotated

import typer

from pipeline.app.verbs import after, building, planning
from pipeline.app.verbs.authoring import imports, library, new
from pipeline.app.verbs.care import cache, doctor, warm
from pipeline.app.verbs.terminal import (
    BUILD,
    CARE,
    CHECKING,
    LOOK,
    OUTPUT,
    USE,
    WRITE,
    Json,
    ReaderGone,
    Roots,
    StageOrPart,
    Verb,
    Verbs,
    flush_output,
    library_file,
    new_family,
    note,
    number_of,
    option,
    require_suffix,
    say,
    say_json,
)
from pipeline.errors import Exit, PipelineError, UsageError
from pipeline.folders import shipped_folder
from pipeline.jit.waits import before_compiling
from pipeline.machine.process import require_resources
from pipeline.machine.processor import pin

app = new_family(
    cls=Verbs,
    help="Calibration images through real lenses and microlens arrays, with exact ground truth, from USD stages.",
    epilog=f"Documentation: {shipped_folder('docs') / 'index.md'}",
)


@app.callback(invoke_without_command=True)
def pipeline(
    version: Annotated[
        bool, typer.Option("--version", help="Print versions and the plug-in path.", is_eager=True)
    ] = False,
) -> None:
    if not version:
        return
    from importlib import metadata

    from pipeline import __version__

    try:
        usd = metadata.version("usd-core")
    except metadata.PackageNotFoundError:
        usd = "not installed"
    say(f"pipeline {__version__}\nusd-core {usd}\nplug-in path {shipped_folder('schemas')}")
    raise typer.Exit


def check(
    stages: Annotated[
        list[Path],
        typer.Argument(metavar="STAGE", help="Datasets, rigs, lenses or targets to check.", callback=library_file),
    ],
    as_json: Json = False,
    allow_root: Roots = None,
) -> None:
    """Report all problems of stages, with file and line; exit with 2 if one is an error."""
    from pipeline.products.sizes import cost_lines
    from pipeline.scene.load import load

    stages_read = [(path, load(path, tuple(allow_root or ()), look=True)) for path in stages]
    problems = [(path, problem) for path, loaded in stages_read for problem in loaded.problems]
    errors = sum(problem.is_error for _, problem in problems)
    if as_json:
        rows = [{"stage": str(path), **problem.to_dict()} for path, problem in problems]
        say_json({"errors": errors, "warnings": len(rows) - errors, "problems": rows})
    else:
        say(*(problem for _, problem in problems))
        counts = f"{number_of(errors, 'error')}, {number_of(len(problems) - errors, 'warning')}"
        note(f"{number_of(len(stages), 'stage')} checked: {counts}")
        for _, loaded in stages_read:
            note(*cost_lines(loaded.dataset, loaded.cameras))
    raise typer.Exit(Exit.USAGE if errors else Exit.DONE)


def show(
    stage: StageOrPart,
    camera: Annotated[str | None, typer.Argument(metavar="CAMERA", help="Show only the camera with this name.")] = None,
    as_json: Annotated[
        bool, option(OUTPUT, "--json", help="Print one JSON object: camera.json, field curves, point images.")
    ] = False,
    plot: Annotated[Path | None, option(OUTPUT, metavar="FILE.svg", help="Draw the lens and its rays.")] = None,
    psf: Annotated[
        Path | None, option(OUTPUT, metavar="FILE.svg", help="Draw images of points by diffraction.")
    ] = None,
    at: Annotated[
        tuple[float, float] | None,
        typer.Option(metavar="X Y", help="Image position of --psf in pixels; default: a few over the field."),
    ] = None,
    distance: Annotated[
        float | None,
        typer.Option(metavar="MM", help="Distance of the points of --psf from the stop; default: focus."),
    ] = None,
    allow_root: Roots = None,
) -> None:
    """Print the properties of a camera or a lens: focal lengths, pupils, focus, depth of field, real rays."""
    from pipeline.app import show as shows
    from pipeline.results.notebook import require_plots

    for file in (plot, psf):
        require_suffix(file, ".svg")
    if psf is not None:
        require_plots()
    if psf is None and (at, distance) != (None, None):
        raise UsageError("--at and --distance say which points --psf draws", hint="add --psf FILE.svg")
    if distance is not None and not distance > 0:
        raise UsageError(f"--distance {distance:g} is not in front of the camera")
    cameras = shows.show(stage, camera, tuple(allow_root or ()))
    if plot is not None:
        shows.plot(cameras, plot)
    points = shows.draw_points(cameras, psf, at, distance) if psf is not None else None
    note(*cameras[0].warnings)
    pages = ("\n".join(part.page()) for part in cameras)
    say(shows.plain_json(cameras, points).rstrip("\n") if as_json else "\n\n".join(pages))
    if points is not None and not as_json:
        say(*points.lines())
    for file in (plot, psf):
        if file is not None:
            note(f"wrote {file}")


def print_target(
    stage: StageOrPart,
    target: Annotated[
        str | None, typer.Argument(metavar="TARGET", help="Name of the target, if there are several.")
    ] = None,
    svg: Annotated[Path | None, option(OUTPUT, metavar="FILE.svg", help="Draw it in true size, as SVG.")] = None,
    pdf: Annotated[Path | None, option(OUTPUT, metavar="FILE.pdf", help="Draw it in true size, as PDF.")] = None,
    as_json: Json = False,
    allow_root: Roots = None,
) -> None:
    """Describe a target, its points and ids; print it in true size."""
    from pipeline.app.show import artwork

    for path, suffix in ((svg, ".svg"), (pdf, ".pdf")):
        require_suffix(path, suffix)
    target_print = artwork(stage, target, tuple(allow_root or ()))
    entry = target_print.entry
    note(*target_print.warnings)
    points = entry.target.points()
    facts = {"name": entry.name, "kinds": list(points.kinds), "points_mm": points.position_mm.tolist()}
    try:  # files first: printing fails if the reader of a pipe has left
        papers = [f"wrote {path}: {target_print.write(path)}" for path in (svg, pdf) if path]
    finally:
        say_json(facts) if as_json else say("\n".join(target_print.page()))
    note(*papers)


def verify(
    out: after.BuiltFolder,
    seed: Annotated[int, option(CHECKING, metavar="N", min=0, help="Seed of the drawn rows.")] = 1,
    as_json: Json = False,
) -> None:
    """Check a finished folder, and a sample of its ground truth with another seed; exit with 6 if it disagrees.

    Only the folder is needed. Every file is compared with the manifest, which lists the files that a build of the
    folder's stage writes. The certificate judges 135 rows of each camera with another seed. All other columns and files
    are compared by digest only. Nothing is signed: verification finds accidents and mistakes, not forgery.
    """
    from pipeline.app.pages.ending import lines_of_verdict
    from pipeline.app.verify import verify as verdict_on

    verdict = verdict_on(out, seed)
    if as_json:
        say_json({"out": str(out.absolute()), **verdict.to_dict()})
    else:
        say(*lines_of_verdict(verdict.to_dict()))
    raise typer.Exit(Exit.DONE if verdict.agrees else Exit.NOT_CONFIRMED)


def plugin_path() -> None:
    """Print the USD plug-in folder and the folder of shipped stages, for other programs."""
    from pipeline.folders import shipped_folder

    say(shipped_folder("schemas"), shipped_folder("stages"))


_VERBS = (
    (WRITE, "library", library),
    (WRITE, "check", check),
    (WRITE, "show", show),
    (WRITE, "target", print_target),
    (BUILD, "build", building.build),
    (BUILD, "ensemble", building.ensemble),
    (BUILD, "plan", planning.plan),
    (BUILD, "run-task", building.run_task),
    (LOOK, "status", planning.status),
    (LOOK, "explain", planning.explain),
    (LOOK, "graph", planning.graph),
    (LOOK, "logs", planning.logs),
    (LOOK, "verify", verify),
    (USE, "export", after.export),
    (CARE, "doctor", doctor),
    (CARE, "warm", warm),
    (CARE, "plugin-path", plugin_path),
)
for _panel, _name, _verb in _VERBS:
    app.command(_name, cls=Verb, rich_help_panel=_panel)(_verb)
app.add_typer(new, name="new", rich_help_panel=WRITE)
app.add_typer(imports, name="import", rich_help_panel=WRITE)
app.add_typer(cache, name="cache", rich_help_panel=CARE)


def main() -> None:
    """Run the command line and end the process with its exit code."""
    pin()  # before anything imports NumPy
    before_compiling[:] = [_warm_up]
    # A large plan makes many records that all stay in use, 150,000 objects for 1,000 frames, and drops as many at once:
    # searching them for garbage took a tenth of the time.
    gc.set_threshold(1_000_000)
    atexit.register(_spare_last_search)
    code = _exit_code()
    try:
        sys.stdout.flush()
    except OSError:  # it was reported; nothing more may be written, not even by the interpreter at its end
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    sys.exit(code)


def _warm_up() -> None:
    from pipeline.app.build import warm_up

    warm_up()


def _spare_last_search() -> None:
    """Spare Python its last garbage collection; not beside OpenImageIO, which would report its own objects as leaks."""
    if "OpenImageIO" not in sys.modules:
        gc.freeze()


def _exit_code() -> int:
    """Run the command, print the message of an error, and return the exit code."""
    from pipeline.engine.files import is_machines_fault

    try:
        require_resources()
        # Not standalone: errors are handled here, and an Exit carries its code.
        code = int(app(prog_name="pipeline", standalone_mode=False) or 0)
        flush_output()
        return code
    except ReaderGone:
        return Exit.READER_GONE
    except (KeyboardInterrupt, typer.Abort):
        note("interrupted")
        return Exit.INTERRUPTED
    except PipelineError as error:
        note(error.as_text)
        return error.exit_code
    except Exception as error:
        if is_machines_fault(error):
            note(f"error: {error}")
            return Exit.MACHINE
        if hasattr(error, "show") and hasattr(error, "exit_code"):  # wrong usage, found by the option parser
            error.show()
            return int(error.exit_code)
        note("".join(traceback.format_exception(error)))
        note("This is a bug of ours. Please report it with the lines above and your stage.")
        return Exit.BUG


if __name__ == "__main__":
    main()
