"""Doubts about a formula that a user wrote for a glass: what it says where it is used is no property of clear glass."""

import math
from dataclasses import dataclass

from pipeline.optics.glass.dispersion import Sellmeier
from pipeline.optics.glass.medium import Medium
from pipeline.optics.glass.row import Written

_NEAR = 1.25
"""Ratio of a wavelength and a resonance, the longer over the shorter, below which light is absorbed [1]: at 400 nm no
glass of the catalogue is nearer than 1.38."""
_STEP_UM = 1e-3
"""Step over which the slope of an index is asked [um]."""


@dataclass(frozen=True, slots=True)
class Doubt:
    """A doubt, and how to mend what it is about."""

    what: str
    hint: str


def doubt_of(medium: Medium, wavelength_nm: float) -> Doubt | None:
    """Doubt about a written formula at a wavelength in air; None for entries of the catalogue, and where it is sound.

    Raises
    ------
    GlassError
        There is no index at that wavelength.
    """
    if not isinstance(medium.dispersion, Written):
        return None
    index, wavelength_um = medium.index(wavelength_nm), wavelength_nm / 1000.0
    at = f'"{medium.label}" is used at {wavelength_nm:.7g} nm'
    for resonance_um in _resonances_um(medium):
        if 1.0 / _NEAR < wavelength_um / resonance_um < _NEAR:
            hint = "c1, c2, ... are squares of wavelengths in um^2: 0.01 in the ultraviolet, 100 in the infrared"
            what = f"{at}, in the absorption band about its resonance at {1000 * resonance_um:.7g} nm"
            return Doubt(f"{what}, where its index is {index:.4g}", hint)
    if medium.dispersion.index(wavelength_um + _STEP_UM) > index:
        hint = "coefficients belong to wavelengths in um: are their units, signs and order right?"
        return Doubt(f"{at}, where its index grows with the wavelength, as no clear glass has it", hint)
    return None


def _resonances_um(medium: Medium) -> list[float]:
    formula = medium.dispersion.dispersion if isinstance(medium.dispersion, Written) else None
    return [math.sqrt(c) for b, c in formula.terms if b != 0 and c > 0] if isinstance(formula, Sellmeier) else []
