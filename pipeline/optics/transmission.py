"""Share of light that passes the surfaces and the glass of a lens, ray by ray, by NumPy.

Fresnel's equations for unpolarised light at every bare surface: half of it is polarised along the surface, half across,
and both halves keep to themselves in a centred lens near its meridional planes. A coating is a reflectance, the same at
all angles. Light that is reflected twice and arrives after all is lost here.
"""

from dataclasses import dataclass

import numpy as np

from pipeline.optics.prescription import PrescriptionError
from pipeline.optics.rays import traced
from pipeline.optics.table import INDEX_RATIO, TERMS
from pipeline.records.declared import settle
from pipeline.records.shapes import Float64


@dataclass(frozen=True, slots=True, kw_only=True)
class Losses:
    """Losses of a lens at one wavelength, from the scene to the sensor.

    Attributes
    ----------
    reflectance : tuple of float or None
        Reflectance of the coating of each surface; None: a bare one.
    per_mm : tuple of float
        Share of light that a millimetre of the medium behind each surface lets pass.
    """

    reflectance: tuple[float | None, ...]
    per_mm: tuple[float, ...]

    def __post_init__(self) -> None:
        settle(self, PrescriptionError)
        if not all(one is None or 0 <= one <= 1 for one in self.reflectance):
            raise PrescriptionError(f"a coating reflects a share of light between 0 and 1: {self.reflectance}")
        if not all(0 < one <= 1 for one in self.per_mm):
            raise PrescriptionError(f"a medium lets a share of light above 0 and up to 1 pass: {self.per_mm} per mm")


def reflectance_at(
    wavelength_nm: float, wavelengths_nm: tuple[float, ...], reflectance: tuple[float, ...]
) -> float | None:
    """Reflectance of a coating by its table; None for an empty one.

    Raises
    ------
    PrescriptionError
        The table is none.
    """
    if len(wavelengths_nm) != len(reflectance) or any(np.diff(wavelengths_nm) <= 0):
        raise PrescriptionError(
            f"a coating has {len(wavelengths_nm)} wavelengths and {len(reflectance)} reflectances",
            hint="as many of both, and wavelengths ascending",
            code="coating",
        )
    return float(np.interp(wavelength_nm, wavelengths_nm, reflectance)) if wavelengths_nm else None


def transmitted(
    table: Float64[np.ndarray, "surfaces columns"],
    position_mm: Float64[np.ndarray, "n 3"],
    direction: Float64[np.ndarray, "n 3"],
    losses: Losses,
) -> np.ndarray:
    """Share of the light of rays that leaves the last surface of a table, (n,); 0 for those that do not pass.

    Parameters
    ----------
    table : (surfaces, columns) float64
        Table from `optics.table`.
    position_mm, direction : (n, 3) float64
        Points on the rays and unit directions with a positive z.
    losses : Losses
        Losses in the order of the table. Light comes from air.
    """
    across, along = np.ones(len(position_mm)), np.ones(len(position_mm))
    alive = np.ones(len(position_mm), bool)
    for row, coat, glass in zip(table, losses.reflectance, (1.0, *losses.per_mm[:-1]), strict=True):
        point, bent, passes = traced(row[None], position_mm, direction)
        way = np.sum((point - position_mm) * direction, axis=1)
        inside = np.asarray(glass ** np.where(np.isfinite(way), np.maximum(way, 0.0), 0.0))
        if coat is not None:
            shares = np.full((2, len(way)), 1 - coat)
        elif row[TERMS] < 0 or row[INDEX_RATIO] == 1:
            shares = np.ones((2, len(way)))
        else:
            shares = fresnel(row[INDEX_RATIO], direction, bent)
        across, along = across * shares[0] * inside, along * shares[1] * inside
        alive &= passes
        position_mm, direction = point, bent
    return np.where(alive, (across + along) / 2, 0.0)


def fresnel(index_ratio: float, before: Float64[np.ndarray, "n 3"], behind: Float64[np.ndarray, "n 3"]) -> np.ndarray:
    """Share of light that a bare surface lets pass, polarised across the plane of incidence and in it, (2, n).

    With i and r the angles of incidence and of refraction, reflectances are (sin(i - r) / sin(i + r))^2 and
    (tan(i - r) / tan(i + r))^2 (Fresnel 1823), here by cosines, which hold at normal incidence, too.

    Parameters
    ----------
    index_ratio : float
        Index before the surface over that behind it.
    before, behind : (n, 3) float64
        Unit directions of rays.
    """
    # The normal lies along n' d' - n d, whose length is n' cos r - n cos i.
    normal = behind - index_ratio * before
    with np.errstate(invalid="ignore"):
        normal = normal / np.linalg.norm(normal, axis=1, keepdims=True)
        i, r = (np.abs(np.sum(normal * way, axis=1)) for way in (before, behind))
        n = index_ratio
        s, p = (n * i - r) / (n * i + r), (n * r - i) / (n * r + i)
    return np.stack([1 - s**2, 1 - p**2])
