"""The verbs `new dataset` and `new rig`: stages to begin with."""

from pathlib import Path
from typing import Annotated, Any

import typer

from pipeline.app.verbs.terminal import Verb, new_family, note, say
from pipeline.errors import Exit

new = new_family(help="Write stages to begin with: a dataset of poses, a rig of parts.")

NewFile = Annotated[Path, typer.Argument(metavar="OUT.usda", help="The new file.")]
_LIBRARY = "a file, or a name of the library such as"


@new.command("dataset", cls=Verb)
def dataset(
    out: NewFile,
    rig: Annotated[Path, typer.Option(metavar="RIG", help=f"{_LIBRARY} rigs/conventional_100mm.usda.")],
    target: Annotated[Path, typer.Option(metavar="TARGET", help=f"{_LIBRARY} targets/charuco_8x5.usda.")],
    poses: Annotated[int, typer.Option(metavar="N", min=1, max=1000, help="Frames, one pose each.")] = 12,
    camera: Annotated[str | None, typer.Option(metavar="NAME", help="Of the rig, where it has several.")] = None,
    tilt: Annotated[float, typer.Option(metavar="DEGREES", min=0, max=80, help="Largest tilt of the target.")] = 40.0,
    seen: Annotated[
        float, typer.Option(metavar="SHARE", min=0.01, max=1, help="Least share of its points that a pose shows.")
    ] = 1.0,
    blur: Annotated[float, typer.Option(metavar="PX", min=0.1, help="Largest diameter of blur.")] = 3.0,
    seed: Annotated[int, typer.Option(metavar="S", min=0, help="Other poses of the same kind.")] = 1,
    fit: Annotated[bool, typer.Option("--fit", help="Scale the target so that it fills half of the image.")] = False,
) -> None:
    """Write a dataset whose poses fill the field of view and the depth of field of the real lens.

    The same command writes the same file. It is a text to go on from: every pose has a comment.
    """
    from pipeline.app.authoring.new_dataset import new_dataset
    from pipeline.app.authoring.poses import Wish

    wish = Wish(count=poses, seed=seed, most_tilt_deg=tilt, least_seen=seen, blur_px=blur)
    made = new_dataset(out, rig, target, wish, camera, fit=fit)
    for line in made.lines:
        note(line)
    _end(out, made.problems)


@new.command("rig", cls=Verb)
def rig(
    out: NewFile,
    lens: Annotated[Path, typer.Option(metavar="LENS", help=f"{_LIBRARY} lenses/tessar_100mm_zemax.usda.")],
    sensor: Annotated[Path, typer.Option(metavar="SENSOR", help=f"{_LIBRARY} sensors/sensor_640x480_10um.usda.")],
    focus: Annotated[float, typer.Option(metavar="MM", min=0, help="Object distance from the stop in focus; inf.")],
    f_number: Annotated[
        float | None, typer.Option("--f-number", metavar="N", help="By default as the lens is.")
    ] = None,
    microlenses: Annotated[
        Path | None, typer.Option(metavar="ARRAY", help=f"{_LIBRARY} mlas/michels_2019.usda.")
    ] = None,
    microlens_distance: Annotated[
        float | None, typer.Option("--microlens-distance", metavar="MM", help="From the sensor to the microlenses.")
    ] = None,
) -> None:
    """Write a rig of a lens and a sensor, focused at a distance."""
    from pipeline.app.authoring.new_rig import RigWish, new_rig

    wish = RigWish(
        lens=lens,
        sensor=sensor,
        focus_mm=focus,
        f_number=f_number,
        microlenses=microlenses,
        microlens_distance_mm=microlens_distance,
    )
    _end(out, new_rig(out, wish))


def _end(out: Path, problems: list[Any]) -> None:
    """Say what the new stage lacks, and where it is."""
    for problem in problems:
        note(str(problem))
    say(str(out))
    raise typer.Exit(Exit.USAGE if any(problem.is_error for problem in problems) else Exit.DONE)
