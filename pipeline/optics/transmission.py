"""Transmittance of a lens, ray by ray, by NumPy: its coatings, bare surfaces and absorbing glass.

A coating is a table of measured reflectances by wavelength and angle, or a stack of thin films whose interference is
computed. Angles of a table are those in the medium of the lower index: in air unless the surface is cemented. So they
do not depend on the direction of light. A bare surface follows Fresnel's equations for unpolarised light: s and p
polarisation carry half of it each and do not mix, as in a centred lens near its meridional planes. Light that reaches
the sensor after two reflections is left out.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from typing import Annotated, NamedTuple

import numpy as np

from pipeline.optics.prescription import PrescriptionError
from pipeline.optics.rays import dot, incidence, traced
from pipeline.optics.table import INDEX_RATIO, TERMS
from pipeline.records.declared import settle
from pipeline.records.shapes import Float64


@dataclass(frozen=True, slots=True, kw_only=True)
class Film:
    """A thin film without absorption: its index relative to air, and its thickness over the wavelength in air."""

    index: float
    waves: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Coating:
    """A coating at one wavelength: reflectances by angle, or thin films."""

    reflectance: tuple[float, ...] = ()  # at each angle; without angles a single one, for all of them
    angles_deg: tuple[float, ...] = ()  # of incidence in the medium of the lower index, ascending
    films: tuple[Film, ...] = ()  # in the order in which light from the scene meets them; in place of reflectances

    def passed(self, before: float, behind: float, cosine: Float64[np.ndarray, "n"]) -> np.ndarray:
        """Transmittance for s and p polarisation, (2, n), by the indices before and behind the surface."""
        if self.films:
            return _through_films(self.films, before, behind, _lateral(before, cosine))
        if not self.angles_deg:
            return np.full((2, len(cosine)), 1 - self.reflectance[0])
        angles = angles_deg(before, behind, cosine)
        return np.stack([1 - np.interp(angles, self.angles_deg, self.reflectance)] * 2)


@dataclass(frozen=True, slots=True, kw_only=True)
class CoatingData:
    """A coating at all wavelengths, as a stage states it. All empty: a bare surface.

    If its parts are inconsistent, the code of the PrescriptionError says which: `coating`, `coating-wavelengths`,
    `coating-angles` or `coating-films`.
    """

    wavelengths_nm: Annotated[tuple[float, ...], "plen:coatingWavelengths"] = ()  # ascending, as angles are
    angles_deg: Annotated[tuple[float, ...], "plen:coatingAngles"] = ()
    # At the first angle for all wavelengths, then at the second one, and so on; without angles once for all of them
    reflectance: Annotated[tuple[float, ...], "plen:coatingReflectance"] = ()
    # in the order in which light from the scene meets them
    film_indices: Annotated[tuple[float, ...], "plen:coatingFilmIndices"] = ()
    film_thicknesses_nm: Annotated[tuple[float, ...], "plen:coatingFilmThicknesses"] = ()

    def __post_init__(self) -> None:
        settle(self, PrescriptionError)
        _ascending(self.wavelengths_nm, "wavelengths", "nm")
        _ascending(self.angles_deg, "angles", "degrees")
        wavelengths, angles, values = map(len, (self.wavelengths_nm, self.angles_deg, self.reflectance))
        if values != wavelengths * max(1, angles):
            by_angle = f"{angles} angles, " if angles else ""
            message = f"a coating has {by_angle}{wavelengths} wavelengths and {values} reflectances"
            each = "a reflectance for each wavelength, at the first angle, then at the second one, and so on"
            raise PrescriptionError(message, hint=each if angles else "as many of both", code="coating")
        films = len(self.film_indices), len(self.film_thicknesses_nm)
        if films[0] != films[1]:
            message = f"a coating has films of {films[0]} indices and {films[1]} thicknesses"
            raise PrescriptionError(message, hint="as many of both", code="coating-films")
        if values and films[0]:
            message = "a coating is stated by reflectances and by films"
            raise PrescriptionError(message, hint="keep what was measured, or the films", code="coating-films")

    def at(self, wavelength_nm: float) -> Coating | None:
        """The coating at a wavelength in air, constant beyond the ends of the table; None for a bare surface."""
        if self.film_indices:
            films = zip(self.film_indices, self.film_thicknesses_nm, strict=True)
            return Coating(films=tuple(Film(index=index, waves=nm / wavelength_nm) for index, nm in films))
        if not self.wavelengths_nm:
            return None
        rows = np.reshape(self.reflectance, (-1, len(self.wavelengths_nm)))
        values = tuple(float(np.interp(wavelength_nm, self.wavelengths_nm, row)) for row in rows)
        return Coating(reflectance=values, angles_deg=self.angles_deg)


def angles_deg(before: float, behind: float, cosine: Float64[np.ndarray, "n"]) -> np.ndarray:
    """Angles of incidence in the medium of the lower index, (n,), from their cosines before the surface."""
    return np.degrees(np.arcsin(np.minimum(_lateral(before, cosine) / min(before, behind), 1.0)))


def _lateral(index: float, cosine: np.ndarray) -> np.ndarray:
    """The index times the sine of the angle, which Snell's law conserves."""
    return np.asarray(index * np.sqrt(np.maximum(1 - cosine**2, 0.0)))


def _ascending(values: tuple[float, ...], quantity: str, unit: str) -> None:
    """Raise a PrescriptionError unless values of a coating's table ascend."""
    for before, after in pairwise(values):
        if not before < after:
            message = f"{quantity} of a coating do not ascend: {after:.7g} {unit} follow {before:.7g}"
            hint = "write them in ascending order, and their reflectances in the same"
            raise PrescriptionError(message, hint=hint, code=f"coating-{quantity}")


def _through_films(films: tuple[Film, ...], before: float, behind: float, lateral: np.ndarray) -> np.ndarray:
    """Transmittance of a stack of plane films, as `Coating.passed`; `lateral` is the index times the sine of the angle.

    The characteristic matrix of each film [[cos d, i sin d / e], [i e sin d, cos d]], with the phase d = 2 pi n cos(a)
    thickness / wavelength and the admittance e = n cos(a) or n / cos(a) by polarisation, carries the field from its
    rear to its front (Abeles 1950; Born and Wolf, Principles of Optics, section 1.6). Where light cannot propagate in a
    film its cosine is imaginary.
    """
    with np.errstate(all="ignore"):  # dead rays are NaN
        # Cosines of the angle and admittances in all media, from the one before the stack to the one behind it.
        indices = (before, *(film.index for film in films), behind)
        cosines = [np.sqrt(1 - (lateral / n) ** 2 + 0j) for n in indices]
        first, *inner, last = (np.stack([n * cos, n / cos]) for n, cos in zip(indices, cosines, strict=True))
        # Carry a transmitted field of 1 from the rear of the stack to its front.
        electric, magnetic = np.ones_like(last), last
        for film, cosine, admittance in zip(films[::-1], cosines[-2:0:-1], inner[::-1], strict=True):
            phase = 2 * np.pi * film.index * film.waves * cosine
            cos, i_sin = np.cos(phase), 1j * np.sin(phase)
            electric, magnetic = (
                cos * electric + i_sin / admittance * magnetic,
                admittance * i_sin * electric + cos * magnetic,
            )
        passed: np.ndarray = 4 * first.real * last.real / np.abs(first * electric + magnetic) ** 2
    # Fields that fade away in many wavelengths of film overflow: nothing passes.
    return np.nan_to_num(passed, nan=0.0)


@dataclass(frozen=True, slots=True, kw_only=True)
class Losses:
    """Losses of a lens at one wavelength, from the scene to the sensor."""

    coatings: tuple[Coating | None, ...]  # of each surface; None: a bare one
    per_mm: tuple[float, ...]  # internal transmittance of a millimetre of the medium behind each surface


def transmitted(
    table: Float64[np.ndarray, "surfaces columns"],
    position_mm: Float64[np.ndarray, "n 3"],
    direction: Float64[np.ndarray, "n 3"],
    losses: Losses,
) -> np.ndarray:
    """Transmittance of rays through all surfaces of a table, (n,); 0 for those that do not pass.

    `table`: from `optics.table`.
    `position_mm`, `direction`: points on the rays and unit directions with a positive z.
    `losses`: in the order of the table, at whose end is air.
    """
    s = np.ones(len(position_mm))
    p = np.ones(len(position_mm))
    alive = np.ones(len(position_mm), bool)
    index_in_front = float(np.prod(table[:, INDEX_RATIO]))  # air is behind the last surface
    incidences = _incidences(table, position_mm, direction, index_in_front)
    for at, coating, per_mm in zip(incidences, losses.coatings, (1.0, *losses.per_mm[:-1]), strict=True):
        # Absorption on the way to the surface, then the share of each polarisation that it transmits.
        internal = np.asarray(per_mm ** np.where(np.isfinite(at.path_mm), np.maximum(at.path_mm, 0.0), 0.0))
        if coating is not None:
            shares = coating.passed(at.before, at.behind, at.cosine)
        elif at.row[TERMS] < 0 or at.row[INDEX_RATIO] == 1:
            shares = np.ones((2, len(alive)))
        else:
            shares = fresnel(at.row[INDEX_RATIO], at.direction, at.refracted)
        s = s * shares[0] * internal
        p = p * shares[1] * internal
        alive &= at.passes
    return np.where(alive, (s + p) / 2, 0.0)


def steepest_deg(
    table: Float64[np.ndarray, "surfaces columns"],
    position_mm: Float64[np.ndarray, "n 3"],
    direction: Float64[np.ndarray, "n 3"],
) -> np.ndarray:
    """Largest angle of incidence at each surface of rays that pass a table, (surfaces,), as tables of coatings count
    it.

    0 where no ray passes. The arguments are those of `transmitted`.
    """
    alive = np.ones(len(position_mm), bool)
    angles = []
    for at in _incidences(table, position_mm, direction, 1.0):
        angles.append(angles_deg(at.before, at.behind, at.cosine))
        alive &= at.passes
    return np.array([angle[alive].max(initial=0.0) for angle in angles])


class _Incidence(NamedTuple):
    """Rays at a surface: its row, path length to it, directions before and behind it, whether they pass, cosines of
    incidence, and the indices before and behind it.
    """

    row: np.ndarray
    path_mm: np.ndarray
    direction: np.ndarray
    refracted: np.ndarray
    passes: np.ndarray
    cosine: np.ndarray
    before: float
    behind: float


def _incidences(
    table: np.ndarray, position_mm: np.ndarray, direction: np.ndarray, index: float
) -> Iterator[_Incidence]:
    """Rays at one surface after the other; `index` is that of the medium that they come from."""
    for row in table:
        before = index
        index = before / row[INDEX_RATIO]
        point, refracted, passes = traced(row[None], position_mm, direction)
        path_mm = dot(point - position_mm, direction)
        yield _Incidence(row, path_mm, direction, refracted, passes, incidence(row, point, direction), before, index)
        position_mm, direction = point, refracted


def fresnel(index_ratio: float, before: Float64[np.ndarray, "n 3"], behind: Float64[np.ndarray, "n 3"]) -> np.ndarray:
    """Transmittance of a bare surface for s and p polarisation, (2, n).

    With i and r the angles of incidence and of refraction, reflectances are (sin(i - r) / sin(i + r))^2 and (tan(i - r)
    / tan(i + r))^2 (Fresnel 1823), here by cosines, which hold at normal incidence, too.

    `index_ratio`: index before the surface over that behind it.
    `before`, `behind`: unit directions of rays.
    """
    # The normal lies along n' d' - n d, whose length is n' cos r - n cos i.
    normal = behind - index_ratio * before
    with np.errstate(invalid="ignore"):
        normal = normal / np.sqrt(dot(normal, normal))[:, None]
        cos_i, cos_r = (np.abs(dot(normal, ray)) for ray in (before, behind))
        s = (index_ratio * cos_i - cos_r) / (index_ratio * cos_i + cos_r)
        p = (index_ratio * cos_r - cos_i) / (index_ratio * cos_r + cos_i)
    return np.stack([1 - s**2, 1 - p**2])
