"""Tasks added to a graph: their names, kinds and parameters, alone, as tiles, or as strips of rows."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from pipeline.engine.planning.graph import TaskGraph
from pipeline.limits import MOST_SAMPLES
from pipeline.records.plain import to_plain
from pipeline.tasks.params.cameras import FIRST, OWN, White
from pipeline.tasks.params.frames import Image

_MODULES = {
    "camera": ("camera", "pinhole", "first_order"),
    "images": tuple(f"{kind}{part}" for kind in ("image", "white") for part in ("", "_tile", "_first", "_strip")),
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


def add_strips(
    graph: TaskGraph, name: str, parts: Sequence[White | Image], reads: dict[str, str], noise: float
) -> dict[str, str]:
    """Add the tasks of an image that is sampled to a stated noise; role and name of what the image reads of them.

    A first pass over each of `parts` says the mean of the image, relative to which the noise is a standard error; then
    each strip takes as many passes as it needs.
    """
    kind, _, subject = name.partition("/")
    first = add_tiles(graph, f"{kind}_first/{subject}", parts, reads, least=1)
    firsts = {f"{FIRST}{number}": task for number, task in enumerate(first.values())}
    known = {**reads, **firsts, OWN: f"{kind}_first/{subject}/"}
    passes = 1 + max(0, (MOST_SAMPLES // parts[0].exposure.samples).bit_length() - 1)
    wanted = [replace(part, noise=noise, passes=passes) for part in parts]
    return {**add_tiles(graph, f"{kind}_strip/{subject}", wanted, known, least=1), **firsts}
