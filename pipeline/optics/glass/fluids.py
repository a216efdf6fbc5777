"""Air, vacuum and water as media of a scene: indices relative to the air that glasses are measured in.

That air has 20 °C and 101.325 kPa, and the index 1.
"""

import functools
from dataclasses import dataclass

from pipeline.optics.glass.medium import GlassError, Medium

AIR, VACUUM, WATER = "air", "vacuum", "water"
FLUIDS = AIR, VACUUM, WATER
"""Names of media that are no glasses."""
_MEASURED_C, _MEASURED_KPA = 20.0, 101.325
"""Temperature and pressure of the air to which indices are relative."""
_WATER_NM, _WATER_C, _SALINITY = (400.0, 700.0), (0.0, 30.0), (0.0, 43.0)
"""Wavelengths, temperatures and salinities [g/kg] over which the formula of water was fitted."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Air:
    """Dry air of a temperature and pressure (Birch and Downs, Metrologia 31, 1994, 315); a vacuum at 0 kPa."""

    temperature_c: float
    pressure_kpa: float

    def index(self, wavelength_um: float) -> float:
        """Refractive index relative to measured air [1]."""
        actual, measured = (
            vacuum_index_of_air(wavelength_um, *condition)
            for condition in ((self.temperature_c, self.pressure_kpa), (_MEASURED_C, _MEASURED_KPA))
        )
        return actual / measured


def vacuum_index_of_air(wavelength_um: float, temperature_c: float, pressure_kpa: float = _MEASURED_KPA) -> float:
    """Refractive index of dry air relative to vacuum [1], at a wavelength in air (Birch and Downs 1994)."""
    square = 1.0 / wavelength_um**2  # wavelengths in air differ from those in vacuum by 3e-4, and the index by 1e-9
    standard = 8342.54 + 2406147.0 / (130.0 - square) + 15998.0 / (38.9 - square)
    pressure_pa = 1e3 * pressure_kpa
    density = 1.0 + 1e-8 * (0.601 - 0.00972 * temperature_c) * pressure_pa
    return 1.0 + 1e-8 * standard * pressure_pa / 96095.43 * density / (1.0 + 0.003661 * temperature_c)


@dataclass(frozen=True, slots=True, kw_only=True)
class Water:
    """Fresh and sea water relative to air (Quan and Fry 1995, Applied Optics 34, 3477)."""

    temperature_c: float
    salinity: float  # [g/kg]

    def index(self, wavelength_um: float) -> float:
        """Refractive index relative to air [1]."""
        nm, t, s = 1e3 * wavelength_um, self.temperature_c, self.salinity
        by_salt = (1.779e-4 - 1.05e-6 * t + 1.6e-8 * t * t) * s
        by_colour = (15.868 + 0.01155 * s - 0.00423 * t) / nm - 4382.0 / nm**2 + 1.1455e6 / nm**3
        return 1.31405 + by_salt - 2.02e-6 * t * t + by_colour


@functools.cache
def fluid(
    name: str, temperature_c: float = _MEASURED_C, pressure_kpa: float = _MEASURED_KPA, salinity: float = 0.0
) -> Medium:
    """One of `FLUIDS`; GlassError for water outside of the ranges of its formula."""
    if name == WATER:
        ranges = (temperature_c, *_WATER_C, "plen:medium:temperature"), (salinity, *_SALINITY, "plen:medium:salinity")
        for value, low, high, attribute in ranges:
            if not low <= value <= high:
                message = f"water is known from {low:g} to {high:g}, and {attribute} is {value:g}"
                raise GlassError(message, hint='a medium of any index: plen:medium = "constant(1.333)"', code="medium")
        water = Water(temperature_c=temperature_c, salinity=salinity)
        return Medium(label=name, dispersion=water, min_nm=_WATER_NM[0], max_nm=_WATER_NM[1])
    return Medium(label=name, dispersion=Air(temperature_c=temperature_c, pressure_kpa=pressure_kpa * (name == AIR)))
