"""Coloured ink and paper: what a target reflects at each wavelength of an image."""

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from pipeline.render.light import TargetLight
from pipeline.targets.mesh import MeshTarget
from pipeline.targets.occluder import Occluder
from pipeline.targets.target import AnyTarget, Target

Colours = tuple[tuple[float, float], ...]
"""Radiance or reflectance of black and of white at each wavelength of an image; empty: as the target has them."""
Placed = Sequence[tuple[AnyTarget, np.ndarray]]
"""Targets with their poses vision_from_target."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Spectrum:
    """Reflectance of ink or paper, linear between wavelengths [nm] and constant beyond them; empty: neutral."""

    wavelengths_nm: tuple[float, ...] = ()
    reflectance: tuple[float, ...] = ()

    def at(self, wavelength_nm: float) -> float:
        """The reflectance at a wavelength."""
        return float(np.interp(wavelength_nm, self.wavelengths_nm, self.reflectance))


@dataclass(frozen=True, slots=True, kw_only=True)
class Print:
    """Spectra of ink and paper of a target."""

    ink: Spectrum = field(default_factory=Spectrum)
    paper: Spectrum = field(default_factory=Spectrum)

    def colours(self, target: AnyTarget, wavelengths_nm: Sequence[float]) -> Colours:
        """Black and white of a target at some wavelengths: spectra times its white, or what it has itself."""
        if isinstance(target, MeshTarget) or self == Print():
            return ()
        white, black = target.pattern.white, target.pattern.black
        return tuple(
            (
                white * self.ink.at(nm) if self.ink.reflectance else black,
                white * self.paper.at(nm) if self.paper.reflectance else white,
            )
            for nm in wavelengths_nm
        )


def inked(targets: Placed, colours: Sequence[Colours], number: int) -> Placed:
    """Targets in one of the wavelengths of an image; no colours at all: as they are."""
    return [
        (_in_colours(target, own[number]) if own else target, pose)
        for (target, pose), own in zip(targets, colours or [()] * len(targets), strict=True)
    ]


def _in_colours(target: AnyTarget, colours: tuple[float, float]) -> AnyTarget:
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

    def in_light(self, number: int, samples: int) -> TargetLight:
        """The view at one of its wavelengths."""
        return TargetLight(inked(self.targets, self.colours, number), self.background, self.occluders)
