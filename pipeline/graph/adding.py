"""Tasks added to a graph: their names, kinds and parameters, alone or as tiles."""

from collections.abc import Sequence
from typing import Any

from pipeline.engine.planning.graph import TaskGraph
from pipeline.records.plain import to_plain

_MODULES = {
    "camera": ("focus", "channel", "stop", "planes", "pinhole", "first_order"),
    "images": ("image", "image_tile", "image_pass", "white", "white_tile", "white_pass", "noise_level", "noise_check"),
    "micro_images": ("micro_images", "micro_images_tile"),
    "pictures": ("picture", "sheet", "parts"),
    "poses": ("frame_poses", "baselines"),
    "raw_images": ("expose", "transmission", "fixed_pattern"),
    "rays": ("rays", "rays_tile"),
    "truth": ("truth", "truth_tile"),
}
KINDS = {kind: f"pipeline.tasks.{module}:{kind}" for module, kinds in _MODULES.items() for kind in kinds} | {
    kind: f"pipeline.tasks.{kind}" for kind in ("certificate", "colour_image", "export", "positions")
}
"""Kinds of tasks by the name with which names of their tasks begin."""


def add(
    graph: TaskGraph, name: str, params: Any, reads: dict[str, str] | None = None, together: str | None = None
) -> str:
    """Add a task whose name begins with its kind, and return its name."""
    return graph.add(name, KINDS[name.partition("/")[0]], to_plain(params), reads, together)


def add_tiles(
    graph: TaskGraph, name: str, params: Sequence[Any], reads: dict[str, str], together: str | None = None
) -> dict[str, str]:
    """Add tile tasks, one for each of the params; role and name of each. A single tile needs no task.

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
        for number, tile in enumerate(params if len(params) > 1 else [])
    }
