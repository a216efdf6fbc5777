"""Tasks added to a graph: their names, kinds and parameters, alone, as tiles, or as passes over strips of rows.

Of images that are sampled to a stated noise, all passes that there may be are in the graph, with checks between them.
Those after the noise is low enough hand on what they read.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from pipeline.engine.planning.graph import TaskGraph
from pipeline.limits import MOST_SAMPLES
from pipeline.records.plain import to_plain
from pipeline.tasks.params.cameras import BEFORE, CHECK, STRIP, NoiseCheck, Nothing, White
from pipeline.tasks.params.frames import Image

_MODULES = {
    "camera": ("camera", "pinhole", "first_order"),
    "images": ("image", "image_tile", "image_pass", "white", "white_tile", "white_pass", "noise_level", "noise_check"),
    "derivatives": ("derivatives",),
    "micro_images": ("micro_images", "micro_images_tile"),
    "pictures": ("sheet",),
    "poses": ("frame_poses", "baselines"),
    "raw_images": ("expose", "transmission", "fixed_pattern"),
    "rays": ("rays", "rays_tile"),
    "truth": ("truth", "truth_tile"),
}
KINDS = {kind: f"pipeline.tasks.{module}:{kind}" for module, kinds in _MODULES.items() for kind in kinds} | {
    kind: f"pipeline.tasks.{kind}" for kind in ("certificate", "colour_image", "export", "parts", "positions")
}
"""Kinds of the core's tasks by the name with which names of their tasks begin."""


def add(
    graph: TaskGraph, name: str, params: Any, reads: dict[str, str] | None = None, together: str | None = None
) -> str:
    """Add a task whose name begins with its kind, and return its name. Params of a plug-in name the module of it."""
    kind, module = name.partition("/")[0], getattr(params, "MODULE", None)
    return graph.add(name, f"{module}:{kind}" if module else KINDS[kind], to_plain(params), reads, together)


def add_tiles(
    graph: TaskGraph,
    name: str,
    params: Sequence[Any],
    reads: dict[str, str],
    together: str | None = None,
    *,
    least: int = 2,
) -> dict[str, str]:
    """Add tile tasks, one for each of the params; role and name of each. Fewer than `least` tiles need no tasks.

    Tiles with the same number share work with those of other calls with the same `together`. A name in `reads` that
    ends with a slash stands for tiles: each tile reads the one with its own number.
    """
    return {
        f"tile{number}": add(
            graph,
            f"{name}/{number:04d}",
            tile,
            {role: f"{source}{number:04d}" if source.endswith("/") else source for role, source in reads.items()},
            f"{together}/{number}" if together else None,
        )
        for number, tile in enumerate(params if len(params) >= least else [])
    }


def add_passes(
    graph: TaskGraph, name: str, parts: Sequence[White | Image], reads: dict[str, str], noise: float
) -> dict[str, str]:
    """Add all passes over an image; role and name of what the image reads of them.

    The name is that of the passes and what they belong to, such as `image_pass/Rig.Camera/0001`; `parts` are the first
    pass over each strip. A name in `reads` that ends with a slash stands for strips: their first passes. The noise that
    is asked for is a standard error relative to the mean of the image.
    """
    kind, _, subject = name.partition("/")
    subject = subject if kind == "image_pass" else f"{subject}/white"
    reads_of = [
        {role: pass_name(read[:-1], strip, 0) if read.endswith("/") else read for role, read in reads.items()}
        for strip in range(len(parts))
    ]
    first = [
        add(graph, pass_name(name, strip, 0), part, source)
        for strip, (part, source) in enumerate(zip(parts, reads_of, strict=True))
    ]
    level = add(graph, f"noise_level/{subject}", Nothing(), _roles(STRIP, first))
    last = list(first)
    for number in range(1, passes_of(parts[0].exposure.samples)):
        for strip, part in enumerate(parts):
            check = f"noise_check/{subject}/{strip:04d}/{number - 1:02d}"
            add(graph, check, NoiseCheck(noise=noise), {BEFORE: last[strip], "level": level})
            source = {**reads_of[strip], "first": first[strip], BEFORE: last[strip], CHECK: check}
            last[strip] = add(graph, pass_name(name, strip, number), replace(part, number=number), source)
    return {"level": level, **_roles(STRIP, last), **_roles("first", first)}


def passes_of(samples: int) -> int:
    """Number of passes that there may be after a first one with so many samples, itself included."""
    return 1 + max(0, (MOST_SAMPLES // samples).bit_length() - 1)


def pass_name(name: str, strip: int, number: int) -> str:
    """Name of a pass over a strip."""
    return f"{name}/{strip:04d}/{number:02d}"


def _roles(role: str, names: Sequence[str]) -> dict[str, str]:
    return {f"{role}{number}": name for number, name in enumerate(names)}
