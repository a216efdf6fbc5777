"""Coloured ink and paper: what a target reflects in each light of an image."""

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pipeline.render.glow.light import TargetLight
from pipeline.render.spectral.prints import Colours
from pipeline.targets.mesh import MeshTarget
from pipeline.targets.occluder import Occluder
from pipeline.targets.target import AnyTarget, Target

Placed = Sequence[tuple[AnyTarget, np.ndarray]]
"""Targets with their poses vision_from_target."""


def inked(targets: Placed, colours: Sequence[Colours], number: int, slices: slice = slice(None)) -> Placed:
    """Targets at a wavelength of an image, in the mean of some of its slices; no colours at all: as they are."""
    return [
        (_in_colours(target, np.mean(light[number][slices], axis=0).tolist()) if light else target, pose)
        for (target, pose), light in zip(targets, colours or [()] * len(targets), strict=True)
    ]


def _in_colours(target: AnyTarget, colours: Sequence[float]) -> AnyTarget:
    """A target with other radiances of black and white."""
    if isinstance(target, MeshTarget):
        return target
    black, white = colours
    return Target(dataclasses.replace(target.pattern, black=black, white=white), target.surface)  # type: ignore[type-var]


@dataclass(frozen=True, slots=True)
class GlowingView:
    """Targets with coloured ink or paper that glow evenly, without lamps."""

    targets: Placed
    background: float
    occluders: Sequence[tuple[Occluder, np.ndarray]]
    colours: Sequence[Colours]

    def in_light(self, number: int) -> TargetLight:
        """The view at one of its wavelengths."""
        return TargetLight(inked(self.targets, self.colours, number), self.background, self.occluders)
