"""Spectra of ink and paper, and what they make of the black and the white of a target."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from pipeline.targets.mesh import MeshTarget
from pipeline.targets.target import AnyTarget

Colours = tuple[tuple[float, float], ...]
"""Radiance or reflectance of black and of white at each wavelength of an image; empty: as the target has them."""


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
