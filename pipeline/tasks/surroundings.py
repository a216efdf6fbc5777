"""What stands around in a frame, from the params of the tasks `image`, `truth` and `verify`."""

from typing import Any

import numpy as np

from pipeline.records import from_plain
from pipeline.render.surroundings import Surroundings
from pipeline.target.occluder import Occluder
from pipeline.target.target import AnyTarget, target_from_plain


def placed_targets(entries: list[dict[str, Any]]) -> list[tuple[AnyTarget, np.ndarray]]:
    """Targets, each with its pose vision_from_target, from a list of {target, vision_from_target}."""
    return [(target_from_plain(entry["target"]), np.array(entry["vision_from_target"])) for entry in entries]


def placed_occluders(entries: list[dict[str, Any]]) -> list[tuple[Occluder, np.ndarray]]:
    """Occluders, each with its pose vision_from_occluder, from a list of {occluder, vision_from_occluder}."""
    return [(from_plain(Occluder, entry["occluder"]), np.array(entry["vision_from_occluder"])) for entry in entries]


def surroundings_of(targets: list[dict[str, Any]], occluders: list[dict[str, Any]]) -> Surroundings:
    """All targets of a frame, in their order, and all occluders."""
    return Surroundings(placed_targets(targets), placed_occluders(occluders))
