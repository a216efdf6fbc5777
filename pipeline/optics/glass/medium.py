"""A transparent medium: a dispersion formula and the wavelengths for which it holds."""

import math
from dataclasses import dataclass

from pipeline.optics.glass.dispersion import C_UM, D_UM, F_UM, Dispersion
from pipeline.optics.glass.errors import OutOfRange


@dataclass(frozen=True, slots=True, kw_only=True)
class Medium:
    """A medium behind a surface.

    Attributes
    ----------
    label : str
        For people: messages, tables, reports.
    dispersion : Dispersion
        Its formula.
    min_nm, max_nm : float
        Wavelengths in air for which the formula holds.
    """

    label: str
    dispersion: Dispersion
    min_nm: float = 0.0
    max_nm: float = math.inf

    def index(self, wavelength_nm: float) -> float:
        """Refractive index relative to air at a wavelength in air.

        Raises
        ------
        OutOfRange
            The formula does not hold there.
        """
        if not self.holds(wavelength_nm):
            raise OutOfRange(
                f"{self.label} is known from {self.min_nm:.7g} to {self.max_nm:.7g} nm, not at {wavelength_nm:.7g} nm"
            )
        return self.dispersion.index(wavelength_nm / 1000.0)

    def holds(self, wavelength_nm: float) -> bool:
        """Whether the formula holds at a wavelength."""
        return self.min_nm <= wavelength_nm <= self.max_nm

    @property
    def nd(self) -> float | None:
        """Index at the helium d line; None for media that are not known there."""
        return self.dispersion.index(D_UM) if self.holds(1000.0 * D_UM) else None

    @property
    def vd(self) -> float | None:
        """Abbe number (n_d - 1) / (n_F - n_C); None for media without dispersion or unknown in the visible."""
        if not (self.holds(1000.0 * F_UM) and self.holds(1000.0 * C_UM)):
            return None
        blue, yellow, red = (self.dispersion.index(line) for line in (F_UM, D_UM, C_UM))
        return (yellow - 1.0) / (blue - red) if blue != red else None
