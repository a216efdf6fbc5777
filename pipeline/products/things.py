"""Everything in a frame, in the frame of a camera, as params of tasks.

The task `image` gets targets and occluders with their colours; tasks that compute positions get them without, so that a
colour affects no correspondence.
"""

import dataclasses
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from pipeline.products.images.params import Image
from pipeline.products.views import Matrix, PaintedView, PlacedOccluder, PlacedTarget
from pipeline.records.plain import Shared, to_plain
from pipeline.render.spectral.prints import Colours
from pipeline.scene.dataset import CameraEntry, Dataset, Frame, Motions
from pipeline.targets.target import bare, plain_from_target

if TYPE_CHECKING:
    from pipeline.products.draft import Draft


def target_poses(dataset: Dataset, frame: Frame, camera: str) -> dict[str, np.ndarray]:
    """vision_from_target of all targets of a dataset, by name."""
    return {target.name: frame.vision_from_target(camera, target.name) for target in dataset.targets}


def poses_at_lines(dataset: Dataset, frame: Frame, entry: CameraEntry) -> dict[str, tuple[Matrix, ...]]:
    """vision_from_target when the first line of a camera with a shutter is exposed, and the last; else none."""
    if entry.shutter is None:
        return {}
    ends_s = entry.shutter.ends_s(entry.asked.sensor.size_px)
    motions = frame.motions[entry.name].targets
    return {
        name: tuple(map(matrix, motions[name].at(ends_s) if name in motions else [pose, pose]))
        for name, pose in target_poses(dataset, frame, entry.name).items()
    }


class Things:
    """All targets and occluders of a dataset: painted with the radiances of the stage, or white 1 and black 0."""

    IMAGE: ClassVar[type[Image]] = Image
    """Params of images of these things."""

    def __init__(self, dataset: Dataset, *, painted: bool) -> None:
        self.dataset = dataset
        targets = {entry.name: entry.target for entry in dataset.targets}
        if not painted:
            targets = {name: bare(target) for name, target in targets.items()}
        self._targets = {name: Shared(plain_from_target(target)) for name, target in targets.items()}
        self._occluders = {
            shape: Shared(to_plain(shape if painted else dataclasses.replace(shape, radiance=0.0)))
            for shape in dict.fromkeys(entry.occluder for entry in dataset.occluders)
        }

    def reads(self, draft: "Draft") -> dict[str, str]:
        """Role and task of what their images read besides a camera; tasks are added at their first use."""
        return {}

    def targets(
        self, poses: dict[str, np.ndarray], motions: Motions | None = None, *, named: bool = True
    ) -> tuple[PlacedTarget, ...]:
        """All targets, posed as `target_poses` says; with their motions before a camera whose shutter is open."""
        return tuple(
            PlacedTarget(
                name=name if named else "",
                target=target,
                vision_from_target=matrix(poses[name]),
                motion=motions.targets.get(name) if motions else None,
            )
            for name, target in self._targets.items()
        )

    def occluders(self, frame: Frame, camera: str) -> tuple[PlacedOccluder, ...]:
        """The visible occluders of a frame."""
        vision_from_world = np.array(frame.camera_from_world[camera])
        motions = frame.motions.get(camera)
        return tuple(
            PlacedOccluder(
                occluder=self._occluders[entry.occluder],
                vision_from_occluder=matrix(vision_from_world @ frame.world_from_occluder[entry.prim_path]),
                motion=motions.things.get(entry.prim_path) if motions else None,
            )
            for entry in self.dataset.occluders_in(frame)
        )

    def view(self, frame: Frame, entry: CameraEntry, colours: tuple[Colours, ...]) -> PaintedView:
        """A frame before a camera, for its image; `colours` are those of the targets in its light."""
        return PaintedView(
            targets=self.targets(
                target_poses(self.dataset, frame, entry.name), frame.motions.get(entry.name), named=False
            ),
            occluders=self.occluders(frame, entry.name),
            background=self.dataset.background,
            colours=colours,
        )


def matrix(transform: np.ndarray) -> Matrix:
    """A transform as a param."""
    return (transform + 0.0).tolist()  # type: ignore[no-any-return]  # + 0.0: no -0.0 in a key
