"""Targets and occluders of a frame as params of tasks, in the camera's own frame.

The task `image` gets them with their colours; tasks that compute positions get them without, so that a colour
affects no correspondence.
"""

import dataclasses

import numpy as np

from pipeline.graph.poses import vision_from_lamp, vision_from_occluder
from pipeline.records.plain import Shared, to_plain
from pipeline.render.lighting.records import Lighting, PlacedLamp
from pipeline.scene.dataset import Dataset, Frame
from pipeline.targets.target import bare, plain_from_target
from pipeline.tasks.params.placed import Matrix, PlacedOccluder, PlacedTarget


class Things:
    """All targets and occluders of a dataset; `tasks.artefacts.surroundings` reads them again.

    Painted ones have the radiances of the stage; else white is 1 and black is 0.
    """

    def __init__(self, dataset: Dataset, *, painted: bool) -> None:
        targets = {entry.name: entry.target for entry in dataset.targets}
        occluders = {entry.prim_path: entry.occluder for entry in dataset.occluders}
        if not painted:
            targets = {name: bare(target) for name, target in targets.items()}
            occluders = {path: dataclasses.replace(mesh, radiance=0.0) for path, mesh in occluders.items()}
        self._lamps = {entry.prim_path: Shared(to_plain(entry.lamp)) for entry in dataset.lamps}
        self._finishes = {e.prim_path: Shared(to_plain(e.finish)) for e in dataset.occluders if e.finish}
        self._coats = tuple(entry.coat for entry in dataset.targets)
        self._targets = {name: Shared(plain_from_target(target)) for name, target in targets.items()}
        self._occluders = {path: Shared(to_plain(mesh)) for path, mesh in occluders.items()}

    def targets(self, poses: dict[str, np.ndarray], *, named: bool = True) -> tuple[PlacedTarget, ...]:
        """All targets, posed as `target_poses` says."""
        return tuple(
            PlacedTarget(name=name if named else "", target=target, vision_from_target=matrix(poses[name]))
            for name, target in self._targets.items()
        )

    def occluders(self, frame: Frame, camera: str) -> tuple[PlacedOccluder, ...]:
        """The visible occluders of a frame."""
        return tuple(
            PlacedOccluder(occluder=occluder, vision_from_occluder=matrix(vision_from_occluder(frame, camera, path)))
            for path, occluder in self._occluders.items()
            if path in frame.world_from_occluder
        )

    def lighting(self, frame: Frame, camera: str, bounces: int) -> Lighting | None:
        """The lamps that shine in a frame, and what everything is made of; None if the dataset has no lamps."""
        if not self._lamps:
            return None
        lamps = [
            PlacedLamp(lamp=lamp, vision_from_lamp=matrix(vision_from_lamp(frame, camera, path)))
            for path, lamp in self._lamps.items()
            if path in frame.world_from_lamp
        ]
        finishes = [finish for path, finish in self._finishes.items() if path in frame.world_from_occluder]
        return Lighting(lamps=tuple(lamps), coats=self._coats, finishes=tuple(finishes), bounces=bounces)


def matrix(transform: np.ndarray) -> Matrix:
    """A transform as a param."""
    return (transform + 0.0).tolist()  # type: ignore[no-any-return]  # + 0.0: no -0.0 in a key
