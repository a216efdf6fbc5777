"""Glass at other temperatures: its index by Schott's formula, and its expansion, from the table that ships here.

Schott, Technical Information TIE-19, "Temperature Coefficient of the Refractive Index": constants of the formula are
those of the index in vacuum. The catalogue's index is relative to air, and so is the result here, relative to air of
the glass's temperature.
"""

from dataclasses import dataclass
from functools import cache

from pipeline.optics.glass.catalogue import rows_of
from pipeline.optics.glass.fluids import vacuum_index_of_air
from pipeline.optics.glass.medium import GlassError


@dataclass(frozen=True, slots=True)
class Thermal:
    """Constants of a glass.

    `reference_c` is the temperature at which the formula is 0; `powers` are D0, D1, D2 [1/K^n], `resonant` E0 and E1
    [um^2/K^n], `resonance_um` is lambda_TK; `expansion_per_k` is linear, near room temperature.
    """

    reference_c: float
    powers: tuple[float, float, float]
    resonant: tuple[float, float]
    resonance_um: float
    expansion_per_k: float

    def index(self, index: float, wavelength_um: float, from_c: float, to_c: float) -> float:
        """Index at one temperature [1] from `index` at another, both relative to air of the glass's temperature.

        The wavelength is that in air.
        """
        air_before, air = (vacuum_index_of_air(wavelength_um, celsius) for celsius in (from_c, to_c))
        absolute = index * air_before
        change = self._absolute(absolute, wavelength_um * air_before, to_c)
        return (absolute + change - self._absolute(absolute, wavelength_um * air_before, from_c)) / air

    def _absolute(self, index: float, wavelength_um: float, celsius: float) -> float:
        """Change of the index in vacuum from the reference [1], at a wavelength in vacuum."""
        warmer = celsius - self.reference_c
        d0, d1, d2 = self.powers
        e0, e1 = self.resonant
        resonant = (e0 * warmer + e1 * warmer**2) / (wavelength_um**2 - self.resonance_um**2)
        return (index**2 - 1) / (2 * index) * (d0 * warmer + d1 * warmer**2 + d2 * warmer**3 + resonant)


def thermal_constants(label: str) -> Thermal:
    """Thermal constants of a glass of the catalogue, by `vendor:name`; GlassError if the table lacks them."""
    row = _rows().get(label)
    if row is None:
        message = f"nothing is known of how {label} changes with its temperature"
        hint = "write plen:indexSlope and plen:expansion on its surface, with their source"
        raise GlassError(message, hint=hint, code="unknown-thermal")
    numbers = {name: float(text) for name, text in row.items() if name not in ("vendor", "glass")}
    return Thermal(
        reference_c=numbers["temp_C"],
        powers=(numbers["D0"], numbers["D1"], numbers["D2"]),
        resonant=(numbers["E0"], numbers["E1"]),
        resonance_um=numbers["wl_tk_um"],
        expansion_per_k=numbers["expansion_per_K"],
    )


@cache
def _rows() -> dict[str, dict[str, str]]:
    return {f"{row['vendor']}:{row['glass']}": row for row in rows_of("thermal.csv.gz")}
