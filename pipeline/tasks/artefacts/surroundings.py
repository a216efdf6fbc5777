"""Targets and occluders of a frame, from the params of the tasks `image`, `truth` and `verify`."""

from collections.abc import Iterable

import numpy as np

from pipeline.records.plain import from_plain
from pipeline.render.surroundings import Surroundings
from pipeline.targets.mesh import Occluder
from pipeline.targets.target import AnyTarget, target_from_plain
from pipeline.tasks.params.frames import PlacedOccluder, PlacedTarget


def placed_target(entry: PlacedTarget) -> tuple[AnyTarget, np.ndarray]:
    return target_from_plain(entry.target), np.array(entry.vision_from_target)


def placed_occluder(entry: PlacedOccluder) -> tuple[Occluder, np.ndarray]:
    return from_plain(Occluder, entry.occluder), np.array(entry.vision_from_occluder)


def surroundings_of(targets: Iterable[PlacedTarget], occluders: Iterable[PlacedOccluder]) -> Surroundings:
    """All targets of a frame, in their order, and all occluders."""
    return Surroundings(list(map(placed_target, targets)), list(map(placed_occluder, occluders)))
