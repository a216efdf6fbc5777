"""The medium of one row of a prescription, from its glass, printed index and Abbe number.

In this order: a glass of the catalogue; a formula written in its place; without a name air, or the normal line through
index and Abbe number. An unknown name is never replaced. A written formula is doubted where its index is not that of a
clear glass.
"""

import math
from dataclasses import dataclass

from pipeline.optics.glass.catalogue import find, listed, nearest
from pipeline.optics.glass.fluids import FLUIDS, fluid
from pipeline.optics.glass.medium import (
    Cauchy,
    Constant,
    Dispersion,
    GlassError,
    Medium,
    NormalLine,
    Polynomial,
    Sellmeier,
)

MAX_INDEX_DIFFERENCE = 5e-4
"""Largest difference between a printed index and that of the named glass [1]: prints are rounded to 1e-3."""
MAX_ABBE_DIFFERENCE = 0.5
"""Largest difference between a printed Abbe number and that of the named glass [1]: prints are mostly rounded to
0.1."""

MODEL_RANGE_NM = (400.0, 700.0)
"""Wavelengths over which the normal line was fitted."""

_SCHOTT_EXPONENTS = (2, -2, -4, -6, -8)
"""Powers of the wavelength [um] behind the constant in Schott's formula for the squared index."""
_KINDS = ("constant(", "cauchy(", "sellmeier(", "schott(", "polynomial(")
_FORMULAS = (
    "constant(n), cauchy(a, b, ...), sellmeier(b1, c1, b2, c2, ...), schott(a0, a1, ..., a5), "
    "polynomial(a0, a1, e1, a2, e2, ...)"
)
_BAD_FORMULA = "glass-formula"
"""Code of a written dispersion formula that cannot be evaluated."""
_NEAR = 1.25
"""Ratio of a wavelength and a resonance, the longer over the shorter, below which light is absorbed [1]: at 400 nm no
glass of the catalogue is nearer than 1.38."""
_STEP_UM = 1e-3
"""Step over which the slope of an index is measured [um]."""


def names_an_entry(glass: str) -> bool:
    """Whether a glass is stated with its vendor or as a formula, not merely by a name as printed."""
    return ":" in glass or _is_written(glass)


def medium(*, glass: str, index: float | None, abbe: float | None, wavelength_nm: float) -> Medium:
    """The medium of a row; a GlassError if it is unknown, or contradicts the printed values.

    `glass`: `vendor:name`, a name that one vendor uses, a formula, or empty.
    `index`, `abbe`: printed values; None where nothing is printed.
    `wavelength_nm`: of the printed index.
    """
    if not glass:
        return _nameless(index, abbe, wavelength_nm)
    if glass in FLUIDS:
        return fluid(glass)
    try:
        stated = _written(glass) if _is_written(glass) else find(glass)
    except GlassError as error:
        raise _with_neighbours(error, glass, index, abbe) from None
    _refuse_mismatch(stated, index, abbe, wavelength_nm)
    return stated


def _nameless(index: float | None, abbe: float | None, wavelength_nm: float) -> Medium:
    """The medium of a row without a glass: air, or the normal line through its index and Abbe number."""
    if index is None or index == 1:
        return Medium(label="air", dispersion=Constant(n=1.0))
    if abbe is None:
        hint = 'write "plen:glass", or "plen:abbe" for a model, or plen:glass = "constant(n)" for no dispersion'
        message = f"nothing is known of the dispersion of a medium with index {index}"
        raise GlassError(message, hint=hint, code="unknown-glass")
    low_nm, high_nm = MODEL_RANGE_NM
    line = NormalLine.through(index, abbe, wavelength_nm / 1000.0)
    model = Medium(label=f"normal line {index:g}/{abbe:g}", dispersion=line, min_nm=low_nm, max_nm=high_nm)
    model.index(wavelength_nm)  # drawn through the printed index, it must hold there
    return model


def _is_written(glass: str) -> bool:
    # A bracket alone does not tell: K-PFK80(M) is a glass.
    return glass.casefold().startswith(_KINDS)


def _written(text: str) -> Medium:
    """A formula in place of a name, with wavelengths in micrometres."""
    kind, _, numbers = text.partition("(")
    try:
        if not numbers.endswith(")"):
            raise ValueError(text)
        dispersion = _formula(kind.casefold(), [float(number) for number in numbers[:-1].split(",")])
    except ValueError:
        hint = f"write one of {_FORMULAS}"
        raise GlassError(f'"{text}" is no dispersion formula', hint=hint, code=_BAD_FORMULA) from None
    return Medium(label=text, dispersion=Written(text=text, dispersion=dispersion))


def _formula(kind: str, numbers: list[float]) -> Dispersion:
    """The dispersion of a kind with these coefficients; a ValueError for a wrong number of them."""
    if not all(map(math.isfinite, numbers)):
        raise ValueError(kind)
    if kind == "constant":
        (n,) = numbers
        return Constant(n=n)
    if kind == "cauchy":
        return Cauchy(coefficients=tuple(numbers))
    if kind == "sellmeier":
        return Sellmeier(terms=tuple(zip(numbers[0::2], numbers[1::2], strict=True)))
    if kind == "polynomial":
        return Polynomial(constant=numbers[0], terms=tuple(zip(numbers[1::2], numbers[2::2], strict=True)))
    return Polynomial(constant=numbers[0], terms=tuple(zip(numbers[1:], _SCHOTT_EXPONENTS, strict=True)))


@dataclass(frozen=True, slots=True, kw_only=True)
class Written:
    """A formula of unknown range, which refuses to yield an index that no glass has."""

    text: str
    dispersion: Dispersion

    def index(self, wavelength_um: float) -> float:
        """Refractive index relative to air [1]."""
        try:
            n = self.dispersion.index(wavelength_um)
        except (ValueError, ZeroDivisionError, OverflowError):
            n = math.nan
        if not 1 <= n < math.inf:
            hint = "coefficients belong to wavelengths in um: are their units, signs and order right?"
            message = f'"{self.text}" gives no index of 1 or more at {1000 * wavelength_um:.7g} nm'
            raise GlassError(message, hint=hint, code=_BAD_FORMULA)
        return n


def _refuse_mismatch(entry: Medium, index: float | None, abbe: float | None, wavelength_nm: float) -> None:
    """Raise a GlassError if an entry has not the printed index or Abbe number; None: nothing is printed."""
    differences = []
    if index is not None:
        actual = entry.index(wavelength_nm)
        if not abs(actual - index) <= MAX_INDEX_DIFFERENCE:  # NaN is refused, too
            differences.append(
                f"index {actual:.6f} at {wavelength_nm:.7g} nm, printed is {index:g} ({actual - index:+.6f})"
            )
    # A formula that is right at the wavelengths of the rays may give no index at those of the Abbe number, or none.
    vd = None if abbe is None else entry.vd
    if abbe is not None and vd is not None and not abs(vd - abbe) <= MAX_ABBE_DIFFERENCE:
        differences.append(f"Abbe number {vd:.3f}, printed is {abbe:g} ({vd - abbe:+.3f})")
    if differences:
        error = GlassError(f"{entry.label} has {' and '.join(differences)}", code="glass-mismatch")
        raise _with_neighbours(error, entry.label, index, abbe)


def _with_neighbours(error: GlassError, glass: str, index: float | None, abbe: float | None) -> GlassError:
    """The error with a hint that names glasses close to the printed values, those of the same name first."""
    if index is None or abbe is None:
        return error
    name = glass.rpartition(":")[2].casefold()
    close = nearest(index, abbe, MAX_INDEX_DIFFERENCE, MAX_ABBE_DIFFERENCE)
    close = sorted(close, key=lambda entry: entry.name.casefold() != name)[:3]
    fits = f"{index:g}/{abbe:g} fits {listed(close)}" if close else f"no glass of the catalogue has {index:g}/{abbe:g}"
    return GlassError(error.message, hint=f"{error.hint}; {fits}" if error.hint else fits, code=error.code)


@dataclass(frozen=True, slots=True)
class Doubt:
    """A plausibility warning and its remedy."""

    message: str
    hint: str


def doubt_of(medium: Medium, wavelength_nm: float) -> Doubt | None:
    """Plausibility warning about a written formula at a wavelength in air; None if sound, or for glasses by name."""
    if not isinstance(medium.dispersion, Written):
        return None
    index = medium.index(wavelength_nm)
    wavelength_um = wavelength_nm / 1000.0
    at = f'"{medium.label}" is used at {wavelength_nm:.7g} nm'
    formula = medium.dispersion.dispersion
    terms = formula.terms if isinstance(formula, Sellmeier) else ()
    for resonance_um in (math.sqrt(c) for b, c in terms if b != 0 and c > 0):
        if 1.0 / _NEAR < wavelength_um / resonance_um < _NEAR:
            hint = "c1, c2, ... are squares of wavelengths in um^2: 0.01 in the ultraviolet, 100 in the infrared"
            message = f"{at}, in the absorption band about its resonance at {1000 * resonance_um:.7g} nm"
            return Doubt(f"{message}, where its index is {index:.4g}", hint)
    if medium.dispersion.index(wavelength_um + _STEP_UM) > index:
        hint = "coefficients belong to wavelengths in um: are their units, signs and order right?"
        return Doubt(f"{at}, where its index grows with the wavelength, as no clear glass has it", hint)
    return None
