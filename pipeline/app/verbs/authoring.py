"""The verbs that write stages to begin with: `new dataset`, `new rig`, `import lens` and `import camera`."""

from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any

import typer

from pipeline.app.verbs.terminal import Verb, new_family, note, say
from pipeline.errors import Exit, UsageError

new = new_family(help="Write stages to begin with: a dataset of poses, a rig of parts.")
imports = new_family(help="Turn files of other programs into stages.")

NewFile = Annotated[Path, typer.Argument(metavar="OUT.usda", help="The new file.")]
_LIBRARY = "a file, or a name of the library such as"


class Spacing(StrEnum):
    """Place of the thicknesses in a pbrt table: before or after the surface of their row."""

    BEFORE = "before"
    AFTER = "after"


class ApertureMeaning(StrEnum):
    """Meaning of the apertures in a FlareSim lens: whole diameters or half of them."""

    DIAMETER = "diameter"
    SEMI_DIAMETER = "semi-diameter"


@new.command("dataset", cls=Verb)
def dataset(
    out: NewFile,
    rig: Annotated[Path, typer.Option(metavar="RIG", help=f"{_LIBRARY} rigs/conventional_100mm.usda.")],
    target: Annotated[Path, typer.Option(metavar="TARGET", help=f"{_LIBRARY} targets/charuco_8x5.usda.")],
    poses: Annotated[int, typer.Option(metavar="N", min=1, max=1000, help="Frames, one pose each.")] = 12,
    camera: Annotated[str | None, typer.Option(metavar="NAME", help="One of the rig; else all see each pose.")] = None,
    tilt: Annotated[float, typer.Option(metavar="DEGREES", min=0, max=80, help="Largest tilt of the target.")] = 40.0,
    seen: Annotated[
        float, typer.Option(metavar="SHARE", min=0.01, max=1, help="Least share of its points that a pose shows.")
    ] = 1.0,
    blur: Annotated[
        float | None,
        typer.Option(metavar="PX", min=0.1, help="Largest blur; 3, or behind microlenses as the rig says."),
    ] = None,
    seed: Annotated[int, typer.Option(metavar="S", min=0, help="Other poses of the same kind.")] = 1,
    fit: Annotated[bool, typer.Option("--fit", help="Scale the target so that calibrations know most.")] = False,
) -> None:
    """Write a dataset whose poses fill the field of view and the depth of field of the real lens.

    It says how well a calibration by them will know the camera, and what limits that. The same command writes the same
    file. It is a text to go on from: every pose has a comment.
    """
    from pipeline.app.authoring.new_dataset import new_dataset
    from pipeline.app.authoring.poses import Wish

    wish = Wish(count=poses, seed=seed, most_tilt_deg=tilt, least_seen=seen, blur_px=blur, fit=fit)
    made = new_dataset(out, rig, target, wish, camera, note)
    for line in made.lines:
        note(line)
    _end(out, made.loaded)


@new.command("rig", cls=Verb)
def rig(
    out: NewFile,
    sensor: Annotated[Path, typer.Option(metavar="SENSOR", help=f"{_LIBRARY} sensors/sensor_640x480_10um.usda.")],
    lens: Annotated[
        Path | None, typer.Option(metavar="LENS", help=f"{_LIBRARY} lenses/tessar_100mm_zemax.usda.")
    ] = None,
    focal_length: Annotated[
        float | None,
        typer.Option("--focal-length", metavar="MM", min=1e-3, help="Instead of a lens: an ideal thin lens."),
    ] = None,
    focus: Annotated[
        float | None, typer.Option(metavar="MM", min=0, help="Object distance from the stop in focus; inf.")
    ] = None,
    sensor_distance: Annotated[
        float | None, typer.Option("--sensor-distance", metavar="MM", help="Instead of --focus: from stop to sensor.")
    ] = None,
    f_number: Annotated[
        float | None, typer.Option("--f-number", metavar="N", min=1e-3, help="By default as the lens is.")
    ] = None,
    microlenses: Annotated[
        Path | None, typer.Option(metavar="ARRAY", help=f"{_LIBRARY} mlas/michels_2019.usda.")
    ] = None,
    microlens_distance: Annotated[
        float | None, typer.Option("--microlens-distance", metavar="MM", help="From the sensor to the microlenses.")
    ] = None,
    near: Annotated[float | None, typer.Option(metavar="MM", help="Plane of rays, where focus is at infinity.")] = None,
    far: Annotated[float | None, typer.Option(metavar="MM", help="The other one, beyond it.")] = None,
) -> None:
    """Write a rig of a lens and a sensor, focused at a distance."""
    from pipeline.app.authoring.new_rig import RigWish, new_rig

    either = focal_length if lens is None else lens
    if either is None or (lens is not None and focal_length is not None):
        hint = "give --lens or, where nobody knows the prescription, --focal-length"
        raise UsageError("a rig has one lens", hint=hint)
    wish = RigWish(
        lens=either,
        sensor=sensor,
        focus_mm=focus,
        sensor_distance_mm=sensor_distance,
        f_number=f_number,
        microlenses=microlenses,
        microlens_distance_mm=microlens_distance,
        near_mm=near,
        far_mm=far,
    )
    _end(out, new_rig(out, wish))


def _end(out: Path, loaded: Any) -> None:
    """Say what the new stage lacks, what it costs, and where it is."""
    from pipeline.graph.sizes import cost_lines

    for line in (*map(str, loaded.problems), *cost_lines(loaded.dataset, loaded.cameras)):
        note(line)
    say(str(out))
    raise typer.Exit(Exit.DONE)


@imports.command("lens", cls=Verb)
def import_lens(
    file: Annotated[
        Path,
        typer.Argument(
            metavar="FILE",
            help="Zemax .zmx, CODE V .seq, pbrt .dat, FlareSim .lens; a text of the Optical Bench; a table .csv, .tsv,"
            " .txt, also of the Blender add-on.",
        ),
    ],
    out: Annotated[
        Path | None, typer.Option("--out", "-o", metavar="OUT.usda", help="Write here; else to stdout.")
    ] = None,
    spacing: Annotated[
        Spacing | None, typer.Option(metavar="before|after", help="Position of thicknesses in a pbrt table.")
    ] = None,
    apertures: Annotated[
        ApertureMeaning | None,
        typer.Option(metavar="diameter|semi-diameter", help="Meaning of the column semi_ap of a FlareSim lens."),
    ] = None,
    scenario: Annotated[
        int | None,
        typer.Option("--scenario", metavar="N", help="Focal length and focus of an Optical Bench text, from 1."),
    ] = None,
    f_number: Annotated[
        float | None,
        typer.Option("--f-number", metavar="N", help="For a table without semi-diameters: F-number at infinity."),
    ] = None,
    half_field: Annotated[
        float | None,
        typer.Option(
            "--half-field", metavar="DEGREES", help="For a table without semi-diameters: largest field angle."
        ),
    ] = None,
) -> None:
    """Write the lens of another program's file, or of a table, as a stage, and report what could not be kept.

    A table has a header and a row per surface, from the scene to the sensor, separated by commas, semicolons or tabs:
    surface, radius, thickness, nd (or glass), vd, semi_diameter (or diameter), conic, A4, A6 … One row says "stop".
    Missing semi-diameters are computed from --f-number and --half-field. All names are in docs/lenses.md.
    """
    from pipeline.app.importing import import_lens

    meaning = apertures and apertures.value
    beam = {"f_number": f_number, "half_field_deg": half_field}
    _deliver(import_lens(file, spacing and spacing.value, apertures=meaning, scenario=scenario, **beam), out)


@imports.command("camera", cls=Verb)
def import_camera(
    file: Annotated[Path, typer.Argument(metavar="FILE", help="Blender add-on .csv, libpleno .js.")],
    out: Annotated[
        Path | None, typer.Option("--out", "-o", metavar="OUT.usda", help="Write here; else to stdout.")
    ] = None,
    lens: Annotated[
        Path | None, typer.Option("--lens", metavar="FILE.csv", help="Lens table for a camera of the Blender add-on.")
    ] = None,
) -> None:
    """Write the camera of another program's file as a rig, and report what could not be kept."""
    from pipeline.app.importing import import_camera

    _deliver(import_camera(file, lens), out)


def _deliver(imported: Any, out: Path | None) -> None:
    """Print warnings to stderr; print the stage to stdout, or write it to a new file and check it."""
    from pipeline.app.importing import write_stage

    for line in imported.warnings:
        note(line)
    if out is None:
        say(imported.text.rstrip("\n"))
        return
    problems = write_stage(imported.text, out)
    for problem in problems:
        note(str(problem))
    say(str(out))
    raise typer.Exit(Exit.USAGE if any(problem.is_error for problem in problems) else Exit.DONE)
