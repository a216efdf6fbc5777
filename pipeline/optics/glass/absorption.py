"""Absorption of glass over the wavelength: as stated for a thickness, or from the table that ships with the package.

Between two entries the coefficient of absorption is linear, and so is the logarithm of the internal transmittance: a
glass stated for 10 mm and for 25 mm absorbs equally at every wavelength.
"""

import math
from dataclasses import dataclass
from functools import cache
from itertools import pairwise

import numpy as np

from pipeline.optics.glass.catalogue import rows_of
from pipeline.optics.glass.medium import GlassError, Medium, OutOfRange

BAD_ABSORPTION = "internal-transmittance"
"""Code of an internal transmittance that no glass has."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Absorption:
    """Absorption of a medium by coefficients a: the internal transmittance of d mm is exp(-a d) (Beer and Lambert)."""

    label: str  # for people
    wavelengths_nm: tuple[float, ...]  # ascending
    coefficients_per_mm: tuple[float, ...]

    def share_per_mm(self, wavelength_nm: float) -> float:
        """Internal transmittance of a millimetre; OutOfRange beyond the first and the last entry."""
        low, high = self.wavelengths_nm[0], self.wavelengths_nm[-1]
        if not low <= wavelength_nm <= high:
            message = f"the absorption of {self.label} is known from {low:.7g} to {high:.7g} nm"
            raise OutOfRange(
                f"{message}, not at {wavelength_nm:.7g} nm", hint="add entries from its source: none is guessed"
            )
        return math.exp(-float(np.interp(wavelength_nm, self.wavelengths_nm, self.coefficients_per_mm)))


def stated(wavelengths_nm: tuple[float, ...], transmittance: tuple[float, ...], thickness_mm: float) -> Absorption:
    """Absorption from the internal transmittances of a thickness, as glass catalogues print them.

    Raises GlassError: numbers of entries differ, wavelengths do not ascend, or a transmittance is not in (0, 1].
    """
    if not wavelengths_nm or len(wavelengths_nm) != len(transmittance):
        message = f"an internal transmittance has {len(wavelengths_nm)} wavelengths and {len(transmittance)} values"
        raise GlassError(message, hint="as many of both", code=BAD_ABSORPTION)
    for before, after in pairwise(wavelengths_nm):
        if not before < after:
            message = f"wavelengths of an internal transmittance do not ascend: {after:.7g} nm follow {before:.7g}"
            raise GlassError(
                message, hint="write them in ascending order, and their values in the same", code="glass-wavelengths"
            )
    if not all(0 < value <= 1 for value in transmittance) or not thickness_mm > 0:
        message = f"internal transmittances are above 0 and at most 1: {transmittance} of {thickness_mm} mm"
        raise GlassError(message, code=BAD_ABSORPTION)
    coefficients = tuple(-math.log(value) / thickness_mm + 0.0 for value in transmittance)
    return Absorption(label="the medium", wavelengths_nm=wavelengths_nm, coefficients_per_mm=coefficients)


def measured(medium: Medium) -> Absorption | None:
    """Tabulated absorption of a medium; None for air, which absorbs nothing. GlassError: the table lacks the medium."""
    if medium.label == "air":
        return None
    row = _rows().get(medium.label.casefold())
    if row is None:
        hint = 'write "plen:internalTransmittanceTable" on the surface, with its source'
        raise GlassError(f"the absorption of {medium.label} is not known", hint=hint, code="unknown-absorption")
    wavelengths_um, extinction = (np.array(text.split(), float) for text in (row["wavelengths_um"], row["k"]))
    # a = 4 pi k / wavelength, with the extinction coefficient k of the complex index (Born and Wolf, section 14.1).
    coefficients = 4 * np.pi * extinction / (1000 * wavelengths_um) * 1e6
    nm = tuple((1000 * wavelengths_um).tolist())
    return Absorption(label=medium.label, wavelengths_nm=nm, coefficients_per_mm=tuple(coefficients.tolist()))


@cache
def _rows() -> dict[str, dict[str, str]]:
    """Wavelengths [um] and extinction coefficients k of each glass, by `vendor:name` in lower case."""
    return {f"{row['vendor']}:{row['glass']}".casefold(): row for row in rows_of("absorption.csv.gz")}
