"""Thermal state of a lens: indices of glasses, and thermal expansion of glasses, mount, sensor and microlenses.

Elements are scaled. A surface is scaled with the glass behind it, or else with that before it; the stop, and gaps of
air from vertex to vertex, are scaled with the mount.
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace

from pxr import Usd

from pipeline.camera.parts.microlens_array import MicrolensArray
from pipeline.optics.glass.catalogue import find
from pipeline.optics.glass.fluids import AIR, VACUUM
from pipeline.optics.glass.medium import GlassError
from pipeline.optics.glass.thermal import Thermal, thermal_constants
from pipeline.optics.prescription import Relief, Surface
from pipeline.scene.usd.problems import Problem, warning
from pipeline.scene.usd.values import UnreadableValue, need, read, target

_NAMES = ("plen:expansion", "plen:indexSlope", "plen:mountExpansion")
"""Attributes of lenses, surfaces, sensors and microlenses that count where the lens has a temperature."""
_PER_K = 1e-6
"""Unit of expansions and slopes in stages [1/K]."""


def check_unused_thermal(prim: Usd.Prim) -> Iterator[Problem]:
    """Warnings of thermal attributes of a lens, or of sensor and microlenses, while the lens has no temperature."""
    lens, parts = prim, list(Usd.PrimRange(prim))
    if not prim.IsA("PlenLens"):
        links = ("lens", "PlenLens"), ("sensor", "PlenSensor"), ("microlenses", "PlenMicrolensArray")
        lens, *parts = (target(prim, f"plen:camera:{name}", kind) for name, kind in links)
    for part in filter(None, parts if lens and read(lens, "plen:temperature") is None else ()):
        for attribute in (part.GetAttribute(name) for name in _NAMES if part.GetAttribute(name).HasAuthoredValue()):
            message = f'"{attribute.GetName()}" has no effect without "plen:temperature" of <{lens.GetPath()}>'
            yield warning(attribute, "unused-value", message, hint="write the temperature, or leave this out")


def warmed(lens: Usd.Prim, surface: Usd.Prim, index: float, wavelength_nm: float) -> float:
    """Index behind a surface at the temperature of its lens, from that at the temperature of the prescription."""
    from_c, to_c = temperatures_c(lens)
    if from_c == to_c or index == 1:
        return index
    slope = read(surface, "plen:indexSlope")
    if slope is not None:
        return float(index + slope * _PER_K * (to_c - from_c))
    return _thermal(surface).index(index, wavelength_nm / 1000.0, from_c, to_c)


def expanded(lens: Usd.Prim, prims: Sequence[Usd.Prim], surfaces: Sequence[Surface]) -> list[Surface]:
    """Surfaces of a lens with their lengths at its temperature; their indices are kept."""
    from_c, to_c = temperatures_c(lens)
    if from_c == to_c:
        return list(surfaces)
    # Growths of the glasses behind the surfaces; a surface has that of its glass, a gap of air that of the mount.
    growths = [1 + _expansion_per_k(prim) * (to_c - from_c) if _is_glass(prim) else None for prim in prims]
    result = list[Surface]()
    before = None
    for surface, behind in zip(surfaces, growths, strict=True):
        gap = behind or mount_growth(lens)
        result.append(scaled(surface, behind or before or gap, gap))
        before = behind
    return result


def mount_growth(lens: Usd.Prim) -> float:
    """Ratio of lengths of the mount to those at the temperature of the prescription."""
    from_c, to_c = temperatures_c(lens)
    return 1.0 if from_c == to_c else float(1 + need(lens, "plen:mountExpansion") * _PER_K * (to_c - from_c))


def growth_of(part: Usd.Prim, lens: Usd.Prim) -> float:
    """Ratio of lengths of a sensor or of microlenses at the temperature of the lens; 1 if no expansion is stated."""
    from_c, to_c = temperatures_c(lens)
    stated = read(part, "plen:expansion")
    return 1.0 if stated is None else float(1 + stated * _PER_K * (to_c - from_c))


def temperatures_c(lens: Usd.Prim) -> tuple[float, float]:
    """Temperatures of the prescription of a lens and of the lens."""
    from_c = need(lens, "plen:prescriptionTemperature")
    to_c = read(lens, "plen:temperature")
    return from_c, from_c if to_c is None else to_c


def _is_glass(prim: Usd.Prim) -> bool:
    """Whether there is glass behind a surface, by its name or by a printed index."""
    name = need(prim, "plen:glass")
    return name not in (AIR, VACUUM) if name else need(prim, "plen:index") != 1


def _expansion_per_k(prim: Usd.Prim) -> float:
    """Thermal expansion of the glass behind a surface, as stated or from the table [1/K]."""
    stated = read(prim, "plen:expansion")
    return _thermal(prim).expansion_per_k if stated is None else stated * _PER_K


def _thermal(prim: Usd.Prim) -> Thermal:
    """Thermal constants of the glass behind a surface, by its name; UnreadableValue: unknown."""
    name = need(prim, "plen:glass")
    try:
        if not name:
            hint = "write plen:indexSlope and plen:expansion, or its plen:glass"
            raise GlassError("nothing is known of how a glass without name changes with its temperature", hint=hint)
        return thermal_constants(find(name).label)
    except GlassError as error:
        raise UnreadableValue(error.message, prim.GetAttribute("plen:glass"), error.hint, "unknown-thermal") from None


def scaled(surface: Surface, growth: float, gap: float) -> Surface:
    """A surface scaled by `growth`, its thickness by `gap`. The term a_p r^p of an asphere is a length."""
    widths = surface.half_widths_mm
    relief = surface.relief
    semi_mm = surface.semi_diameter_mm * growth
    if relief is not None:
        heights_mm = tuple(tuple(height * growth for height in row) for row in relief.heights_mm)
        relief = Relief(heights_mm=heights_mm, spacing_mm=relief.spacing_mm * growth)
        semi_mm = min(semi_mm, *relief.half_widths_mm)  # a grid as wide as the aperture, but for rounding
    return replace(
        surface,
        radius_mm=surface.radius_mm * growth,
        thickness_mm=surface.thickness_mm * gap,
        semi_diameter_mm=semi_mm,
        inner_semi_diameter_mm=surface.inner_semi_diameter_mm * growth,
        half_widths_mm=widths and (widths[0] * growth, widths[1] * growth),
        relief=relief,
        even_coefficients=tuple(a * growth ** (-1 - 2 * i) for i, a in enumerate(surface.even_coefficients)),
        odd_coefficients=tuple(a * growth ** (-2 - 2 * i) for i, a in enumerate(surface.odd_coefficients)),
    )


def scaled_array(array: MicrolensArray, growth: float) -> MicrolensArray:
    """Microlenses scaled, with their distance from the sensor; offset, an error of assembly, and index are kept."""
    if growth == 1:
        return array

    def grown(length_mm: float | None) -> float | None:
        return None if length_mm is None else length_mm * growth

    def all_grown(lengths_mm: tuple[float, ...]) -> tuple[float, ...]:
        return tuple(length_mm * growth for length_mm in lengths_mm)

    return replace(
        array,
        pitch_mm=array.pitch_mm * growth,
        cross_pitch_mm=grown(array.cross_pitch_mm),
        width_mm=grown(array.width_mm),
        height_mm=grown(array.height_mm),
        distance_mm=array.distance_mm * growth,
        disc_diameter_mm=grown(array.disc_diameter_mm),
        thickness_mm=grown(array.thickness_mm),
        front_radii_mm=all_grown(array.front_radii_mm),
        rear_radii_mm=all_grown(array.rear_radii_mm),
        focal_lengths_mm=() if array.model == "refractive" else all_grown(array.focal_lengths_mm),  # radii decide
    )
