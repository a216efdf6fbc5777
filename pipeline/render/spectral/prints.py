"""Spectra of ink and paper, and the black and white that they give a target."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from pipeline.camera.parts.spectrum import Slice, Slices
from pipeline.targets.mesh import MeshTarget
from pipeline.targets.target import AnyTarget

Colours = tuple[tuple[tuple[float, float], ...], ...]
"""Radiance or reflectance of black and of white in each slice of each wavelength; empty: unchanged."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Spectrum:
    """Reflectance of ink or paper, linear between wavelengths [nm] and constant beyond them; empty: neutral."""

    wavelengths_nm: tuple[float, ...] = ()
    reflectance: tuple[float, ...] = ()

    def mean(self, light: Slice) -> float:
        """The mean reflectance over a slice of light."""
        return float((np.interp(light.wavelengths_nm, self.wavelengths_nm, self.reflectance) * light.shares).sum())


@dataclass(frozen=True, slots=True, kw_only=True)
class Print:
    """Spectra of ink and paper of a target."""

    ink: Spectrum = field(default_factory=Spectrum)
    paper: Spectrum = field(default_factory=Spectrum)

    def colours(self, target: AnyTarget, lights: Sequence[Slices]) -> Colours:
        """Black and white of a target in some lights: its spectra times its white, or its own values."""
        if isinstance(target, MeshTarget) or self == Print():
            return ()
        white, black = target.pattern.white, target.pattern.black
        return tuple(
            tuple(
                (
                    white * self.ink.mean(slices_of_light) if self.ink.reflectance else black,
                    white * self.paper.mean(slices_of_light) if self.paper.reflectance else white,
                )
                for slices_of_light in slices
            )
            for slices in lights
        )
