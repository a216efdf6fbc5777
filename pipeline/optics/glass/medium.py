"""Transparent media: dispersion formulas with their ranges of wavelengths, and errors of glasses.

A formula is the index relative to air as a function of the wavelength in air, in micrometres, because coefficients are
printed for them; everywhere else wavelengths are nanometres. The code of an error is the stable name under which
`check` reports it.
"""

import math
from dataclasses import dataclass
from typing import Protocol

from pipeline.errors import PipelineError


class GlassError(PipelineError):
    """A medium without an index or an absorption."""

    code = "glass"


class OutOfRange(GlassError):
    """A wavelength for which the dispersion formula does not hold."""

    code = "wavelength-out-of-range"


D_UM, F_UM, C_UM = 0.5875618, 0.4861327, 0.6562725
"""The lines of n_d and V_d: helium d, hydrogen F and C, in air."""

GAS = 0.01
"""Largest difference of the index of a gas from that of air [1]: dense ones have 1.001, a vacuum 0.99973."""

Terms = tuple[tuple[float, float], ...]


class Dispersion(Protocol):
    """The refractive index as a function of the wavelength."""

    def index(self, wavelength_um: float) -> float:
        """Refractive index relative to air [1]."""
        ...


@dataclass(frozen=True, slots=True, kw_only=True)
class Constant:
    """A constant n: no dispersion."""

    n: float

    def index(self, wavelength_um: float) -> float:
        return self.n


@dataclass(frozen=True, slots=True, kw_only=True)
class Sellmeier:
    """n^2 = 1 + constant + sum of b w^2 / (w^2 - c) over terms (b, c); c is the squared resonance [um^2].

    Schott, Technical Information TIE-29, "Refractive Index and Dispersion".
    """

    terms: Terms
    constant: float = 0.0

    def index(self, wavelength_um: float) -> float:
        square = wavelength_um * wavelength_um
        return math.sqrt(1.0 + self.constant + sum(b * square / (square - c) for b, c in self.terms))


@dataclass(frozen=True, slots=True, kw_only=True)
class Polynomial:
    """n^2 = constant + sum of a w^e over terms (a, e): Schott's old formula with e = 2, -2, -4, -6, -8."""

    constant: float
    terms: Terms

    def index(self, wavelength_um: float) -> float:
        return math.sqrt(self.constant + sum(a * wavelength_um**e for a, e in self.terms))


@dataclass(frozen=True, slots=True, kw_only=True)
class Cauchy:
    """n = coefficients[0] + coefficients[1] / w^2 + coefficients[2] / w^4 + ..."""

    coefficients: tuple[float, ...]

    def index(self, wavelength_um: float) -> float:
        inverse = 1.0 / (wavelength_um * wavelength_um)
        return sum(a * inverse**power for power, a in enumerate(self.coefficients))


@dataclass(frozen=True, slots=True, kw_only=True)
class NormalLine:
    """The typical dispersion of a glass with this n_d and V_d; both are met exactly.

    n(w) = n_d + (n_d - 1) / V_d * [f2 + (-0.0154391 + 0.160210 / V_d) g4 + (0.0000962216 + 0.0685038 / V_d) g6]
    with f_k(w) = w^-k - d^-k, f2 scaled to 1 between F and C, and g_k(w) = f_k less its part along f2.

    The four coefficients are a least-squares fit to 1,583 glasses of the catalogue from 400 to 700 nm. The largest
    error over that band is 1.8e-4 for the median glass, below 5e-4 for 95 per cent of them, 1.3e-3 at worst (a Cauchy
    formula through the same two numbers: 9e-4, 8e-3, 3e-2). Glasses off the normal line are the worst.
    """

    nd: float
    vd: float

    @classmethod
    def through(cls, index: float, vd: float, wavelength_um: float) -> "NormalLine":
        """The model that has a given index at a given wavelength: n - 1 scales with n_d - 1."""
        return cls(nd=1.0 + (index - 1.0) / (1.0 + _relative(wavelength_um, vd)), vd=vd)

    def index(self, wavelength_um: float) -> float:
        return self.nd + (self.nd - 1.0) * _relative(wavelength_um, self.vd)


def _relative(wavelength_um: float, vd: float) -> float:
    """(n - n_d) / (n_d - 1) on the normal line."""
    f2 = _from_d(wavelength_um, 2) / _between_f_and_c(2)
    g4, g6 = (_from_d(wavelength_um, k) - _between_f_and_c(k) * f2 for k in (4, 6))
    return (f2 + (-0.0154391 + 0.160210 / vd) * g4 + (0.0000962216 + 0.0685038 / vd) * g6) / vd


def _from_d(wavelength_um: float, k: int) -> float:
    return wavelength_um**-k - D_UM**-k


def _between_f_and_c(k: int) -> float:
    return F_UM**-k - C_UM**-k


@dataclass(frozen=True, slots=True)
class Melt:
    """A melt whose index differs from that of its glass by a constant at all wavelengths."""

    glass: Dispersion
    offset: float

    def index(self, wavelength_um: float) -> float:
        return self.glass.index(wavelength_um) + self.offset


@dataclass(frozen=True, slots=True, kw_only=True)
class Medium:
    """A transparent medium behind a surface."""

    label: str  # for people
    dispersion: Dispersion
    min_nm: float = 0.0  # wavelengths in air for which the formula holds
    max_nm: float = math.inf

    def index(self, wavelength_nm: float) -> float:
        """Refractive index relative to air at a wavelength in air; OutOfRange where the formula does not hold."""
        if not self.holds(wavelength_nm):
            raise OutOfRange(
                f"{self.label} is known from {self.min_nm:.7g} to {self.max_nm:.7g} nm, not at {wavelength_nm:.7g} nm"
            )
        return self.dispersion.index(wavelength_nm / 1000.0)

    def holds(self, wavelength_nm: float) -> bool:
        return self.min_nm <= wavelength_nm <= self.max_nm

    @property
    def nd(self) -> float | None:
        """Index at the helium d line; None for media whose formula does not hold there."""
        return self.dispersion.index(D_UM) if self.holds(1000.0 * D_UM) else None

    @property
    def vd(self) -> float | None:
        """Abbe number (n_d - 1) / (n_F - n_C); None for media without dispersion or undefined in the visible."""
        if not (self.holds(1000.0 * F_UM) and self.holds(1000.0 * C_UM)):
            return None
        blue, yellow, red = (self.dispersion.index(line) for line in (F_UM, D_UM, C_UM))
        return (yellow - 1.0) / (blue - red) if blue != red else None
