"""The verbs that write stages: `library`, `new dataset`, `new rig`, `import lens` and `import camera`."""

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any, Literal

import typer

from pipeline.app.verbs.terminal import Json, Verb, new_family, note, say, say_json, valued
from pipeline.errors import Exit, UsageError

new = new_family(help="Write new stages: a dataset of poses, a rig of parts.")
imports = new_family(help="Turn files of other programs into stages.")

NewFile = Annotated[Path, typer.Argument(metavar="OUT.usda", help="The new file.")]
StageOrStdout = Annotated[
    Path | None, typer.Option("--out", "-o", metavar="OUT.usda", help="Write here; else to stdout.")
]
_LIBRARY = "a file, or a name of the library such as"


SensorOfRig = Annotated[Path, valued("SENSOR", f"{_LIBRARY} sensors/sensor_640x480_10um.usda.")]
LensOfRig = Annotated[Path | None, valued("LENS", f"{_LIBRARY} lenses/tessar_100mm_zemax.usda.")]
FocalLength = Annotated[float | None, valued("MM", "Instead of a lens: an ideal thin lens.", min=1e-3, max=1e7)]


@new.command("dataset", cls=Verb)
def dataset(
    out: NewFile,
    rig: Annotated[Path, valued("RIG", f"{_LIBRARY} rigs/conventional_100mm.usda.")],
    target: Annotated[Path, valued("TARGET", f"{_LIBRARY} targets/charuco_8x5.usda.")],
    poses: Annotated[int | None, valued("N", "Frames, one pose each; else 12.", min=1, max=1000)] = None,
    camera: Annotated[str | None, valued("NAME", "One of the rig; else all see each pose.")] = None,
    tilt: Annotated[float, valued("DEGREES", "Largest tilt of the target.", min=0, max=80)] = 40.0,
    seen: Annotated[float, valued("SHARE", "Least share of its points that a pose shows.", min=0.01, max=1)] = 1.0,
    blur: Annotated[
        float | None, valued("PX", "Largest blur; 3, or behind microlenses as the rig says.", min=0.1, max=1e4)
    ] = None,
    seed: Annotated[int, valued("S", "Seed of the poses.", min=0)] = 1,
    fit: Annotated[bool, typer.Option("--fit", help="Scale the target to inform a calibration best.")] = False,
    best: Annotated[
        int | None, valued("N", "Instead of --poses: the N most informative of many.", min=2, max=100)
    ] = None,
) -> None:
    """Write a dataset whose poses fill the field of view and the depth of field of the real lens.

    It predicts how well a calibration by these poses determines the camera, and what limits that. Repeating the command
    writes an identical file. The file is a starting point to edit: every pose has a comment.
    """
    from pipeline.app.authoring.new_dataset import new_dataset
    from pipeline.app.authoring.poses import CANDIDATES, Wish

    if poses is not None and best is not None:
        raise UsageError("--poses and --best both say how many frames there are", hint="give one of them")
    # With --best every pose is chosen from several candidates; else the candidates are the poses.
    count, per_pose = (poses or 12, 1) if best is None else (best, CANDIDATES)
    wish = Wish(count=count, seed=seed, most_tilt_deg=tilt, least_seen=seen, blur_px=blur, fit=fit, of=per_pose)
    _end(out, new_dataset(out, rig, target, wish, camera, note))


@new.command("rig", cls=Verb)
def rig(
    out: NewFile,
    sensor: SensorOfRig,
    lens: LensOfRig = None,
    focal_length: FocalLength = None,
    focus: Annotated[float | None, valued("MM", "Object distance from the stop in focus; inf.", min=0)] = None,
    sensor_distance: Annotated[float | None, valued("MM", "Instead of --focus: from stop to sensor.")] = None,
    f_number: Annotated[float | None, valued("N", "By default as the lens is.", min=1e-3, max=1e4)] = None,
    microlenses: Annotated[Path | None, valued("ARRAY", f"{_LIBRARY} mlas/michels_2019.usda.")] = None,
    microlens_distance: Annotated[float | None, valued("MM", "From the sensor to the microlenses.")] = None,
    near: Annotated[float | None, valued("MM", "Plane of rays, where focus is at infinity.")] = None,
    far: Annotated[float | None, valued("MM", "The other one, beyond it.")] = None,
) -> None:
    """Write a rig of a lens and a sensor, focused at a distance."""
    from pipeline.app.authoring.new_rig import RigWish, new_rig

    wish = RigWish(
        lens=lens_of_rig(lens, focal_length),
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


def lens_of_rig(lens: Path | None, focal_length: float | None) -> Path | float:
    """The lens of a rig, or the focal length of a thin one; UsageError if there is neither, or both."""
    either = focal_length if lens is None else lens
    if either is None or (lens is not None and focal_length is not None):
        hint = "give --lens or, where nobody knows the prescription, --focal-length"
        raise UsageError("a rig has one lens", hint=hint)
    return either


def _end(out: Path, loaded: Any) -> None:
    """Report what the new stage lacks, what it costs, and where it is."""
    from pipeline.products.sizes import cost_lines

    note(*loaded.problems, *cost_lines(loaded.dataset, loaded.cameras))
    say(out)
    raise typer.Exit(Exit.DONE)


@imports.command("lens", cls=Verb)
def import_lens(
    file: Annotated[
        Path,
        typer.Argument(
            metavar="FILE",
            help="Zemax .zmx, .zar; CODE V .seq; pbrt .dat; FlareSim .lens; a text of the Optical Bench; a table .csv,"
            " .tsv, .txt, also of the Blender add-on.",
        ),
    ],
    out: StageOrStdout = None,
    spacing: Annotated[
        Literal["before", "after"] | None, valued("before|after", "Position of thicknesses in a pbrt table.")
    ] = None,
    apertures: Annotated[
        Literal["diameter", "semi-diameter"] | None,
        valued("diameter|semi-diameter", "Meaning of the column semi_ap of a FlareSim lens."),
    ] = None,
    scenario: Annotated[int | None, valued("N", "Focal length and focus of an Optical Bench text, from 1.")] = None,
    f_number: Annotated[float | None, valued("N", "For a table without semi-diameters: F-number at infinity.")] = None,
    half_field: Annotated[
        float | None, valued("DEGREES", "For a table without semi-diameters: largest field angle.")
    ] = None,
    glasses: Annotated[
        list[Path] | None, valued("FILE.agf", "Catalogue of a glass maker, which takes precedence; may be repeated.")
    ] = None,
    glass: Annotated[
        list[str] | None, valued("NAME=vendor:OTHER", "Glass in place of one of the file; may be repeated.")
    ] = None,
) -> None:
    """Write the lens of another program's file, or of a table, as a stage, and report what could not be kept.

    A table has a header and a row per surface, from the scene to the sensor, separated by commas, semicolons or tabs:
    surface, radius, thickness, nd (or glass), vd, semi_diameter (or diameter), conic, A4, A6 … One row says "stop".
    Missing semi-diameters are computed from --f-number and --half-field. All names are in docs/lenses.md.
    """
    from pipeline.app.stages import import_lens

    options = {"apertures": apertures, "scenario": scenario, "f_number": f_number, "half_field_deg": half_field}
    _deliver(import_lens(file, spacing, glasses or (), glass or (), **options), out)


@imports.command("camera", cls=Verb)
def import_camera(
    file: Annotated[Path, typer.Argument(metavar="FILE", help="Blender add-on .csv, libpleno .js.")],
    out: StageOrStdout = None,
    lens: Annotated[Path | None, valued("FILE.csv", "Lens table for a camera of the Blender add-on.")] = None,
) -> None:
    """Write the camera of another program's file as a rig, and report what could not be kept."""
    from pipeline.app.stages import import_camera

    _deliver(import_camera(file, lens), out)


def _deliver(imported: Any, out: Path | None) -> None:
    """Print warnings to stderr; print the stage to stdout, or write it to a new file and check it."""
    from pipeline.app.stages import write_stage

    note(*imported.warnings)
    if out is None:
        say(imported.text.rstrip("\n"))
        return
    problems = write_stage(imported.text, out)
    note(*problems)
    say(out)
    raise typer.Exit(Exit.USAGE if any(problem.is_error for problem in problems) else Exit.DONE)


_HEADS = {
    "lenses": ("efl_mm", "f_number", "bfd_mm", "surfaces"),
    "rigs": ("efl_mm", "f_number", "width_px", "height_px", "pitch_mm", "microlens_types"),
    "sensors": ("width_px", "height_px", "pitch_mm", "bits", "full_well_electrons"),
    "mlas": ("pitch_mm", "focal_lengths_mm", "layout", "model"),
    "targets": ("kind", "points"),
}
"""Figures in the columns of each table; --json has all."""


def _kinds(incomplete: str) -> list[str]:
    """Kinds, for completion in a shell."""
    return [kind for kind in _HEADS if kind.startswith(incomplete)]


def library(
    kind: Annotated[
        str | None,
        typer.Argument(
            metavar="KIND", help="lenses, rigs, sensors, mlas or targets; by default all.", autocompletion=_kinds
        ),
    ] = None,
    as_json: Json = False,
) -> None:
    """List the lenses, rigs, sensors, microlens arrays and targets of the library with their key figures.

    Stages refer to them by these names, as @lenses/cooke_triplet_50mm.usda@; `pipeline show` and `pipeline target`
    describe one of them.
    """
    from pipeline.app.library import library as parts_of

    library_parts = parts_of(kind)
    if as_json:
        say_json({name: [part.to_dict() for part in parts] for name, parts in library_parts.items()})
        return
    for number, (name, parts) in enumerate(library_parts.items()):
        rows = [("", *_HEADS[name], "")]
        rows += [(part.name, *(_cell(part.figures.get(head)) for head in _HEADS[name]), part.title) for part in parts]
        say(*([""] if number else []), *_table(rows))


def _cell(value: Any) -> str:
    if value is None:
        return "-"
    if isinstance(value, list):
        return ", ".join(map(_cell, value))
    return f"{value:.6g}" if isinstance(value, float) else str(value)


def _table(rows: Sequence[tuple[str, ...]]) -> list[str]:
    """Lines with columns as wide as their cells; numbers are right-aligned."""
    first, *widths = (max(map(len, column)) for column in zip(*rows, strict=True))
    return ["  ".join([row[0].ljust(first), *map(str.rjust, row[1:-1], widths), row[-1]]).rstrip() for row in rows]
