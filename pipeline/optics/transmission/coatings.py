"""Coatings of surfaces: measured reflectances by wavelength and angle, or films whose interference is computed.

Angles of a table are those in the medium of the lower index at the surface: in air unless the surface is cemented. So
they do not depend on the way that light goes.
"""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from pipeline.optics.prescription import PrescriptionError
from pipeline.records.declared import settle
from pipeline.records.shapes import Float64


@dataclass(frozen=True, slots=True, kw_only=True)
class Film:
    """A film without absorption.

    Attributes
    ----------
    index : float
        Relative to air.
    waves : float
        Thickness over the wavelength in air.
    """

    index: float
    waves: float

    def __post_init__(self) -> None:
        settle(self, PrescriptionError)
        if not (self.index >= 1 and self.waves > 0):
            raise PrescriptionError(f"a film has index {self.index} and is {self.waves} wavelengths thick")


@dataclass(frozen=True, slots=True, kw_only=True)
class Coating:
    """A coating at one wavelength: reflectances, or films.

    Attributes
    ----------
    reflectance : tuple of float
        Share of light that is reflected at each of `angles_deg`; without angles a single one, for all angles.
    angles_deg : tuple of float
        Angles of incidence in the medium of the lower index, ascending.
    films : tuple of Film
        In the order in which light from the scene meets them; in place of reflectances.
    """

    reflectance: tuple[float, ...] = ()
    angles_deg: tuple[float, ...] = ()
    films: tuple[Film, ...] = ()

    def __post_init__(self) -> None:
        settle(self, PrescriptionError)
        if not all(0 <= share <= 1 for share in self.reflectance):
            raise PrescriptionError(f"a coating reflects a share of light between 0 and 1: {self.reflectance}")
        if len(self.reflectance) != (0 if self.films else max(1, len(self.angles_deg))):
            raise PrescriptionError("a coating is a reflectance, one for each of its angles, or films")

    def passed(self, before: float, behind: float, cosine: Float64[np.ndarray, "n"]) -> np.ndarray:
        """Share of light that passes, polarised across the plane of incidence and in it, (2, n).

        Parameters
        ----------
        before, behind : float
            Refractive indices of the media.
        cosine : (n,) float64
            Cosines of the angles of incidence, before the surface.
        """
        if self.films:
            return _through_films(self.films, before, behind, _lateral(before, cosine))
        if not self.angles_deg:
            return np.full((2, len(cosine)), 1 - self.reflectance[0])
        angles = angles_deg(before, behind, cosine)
        return np.stack([1 - np.interp(angles, self.angles_deg, self.reflectance)] * 2)


@dataclass(frozen=True, slots=True, kw_only=True)
class CoatingData:
    """A coating at all wavelengths, as a stage states it. All empty: a bare surface.

    Attributes
    ----------
    wavelengths_nm, angles_deg : tuple of float
        Ascending.
    reflectance : tuple of float
        At the first angle for all wavelengths, then at the second one, and so on; without angles once for all of them.
    film_indices, film_thicknesses_nm : tuple of float
        Films in the order in which light from the scene meets them.

    Raises
    ------
    PrescriptionError
        They do not fit together. Its code says where: `coating`, `coating-wavelengths`, `coating-angles` or
        `coating-films`.
    """

    wavelengths_nm: tuple[float, ...] = ()
    angles_deg: tuple[float, ...] = ()
    reflectance: tuple[float, ...] = ()
    film_indices: tuple[float, ...] = ()
    film_thicknesses_nm: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        settle(self, PrescriptionError)
        _ascending(self.wavelengths_nm, "wavelengths", "nm")
        _ascending(self.angles_deg, "angles", "degrees")
        wavelengths, angles, values = map(len, (self.wavelengths_nm, self.angles_deg, self.reflectance))
        if values != wavelengths * max(1, angles):
            by_angle = f"{angles} angles, " if angles else ""
            what = f"a coating has {by_angle}{wavelengths} wavelengths and {values} reflectances"
            each = "a reflectance for each wavelength, at the first angle, then at the second one, and so on"
            raise PrescriptionError(what, hint=each if angles else "as many of both", code="coating")
        films = len(self.film_indices), len(self.film_thicknesses_nm)
        if films[0] != films[1]:
            what = f"a coating has films of {films[0]} indices and {films[1]} thicknesses"
            raise PrescriptionError(what, hint="as many of both", code="coating-films")
        if values and films[0]:
            what = "a coating is stated by reflectances and by films"
            raise PrescriptionError(what, hint="keep what was measured, or the films", code="coating-films")

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
    """Angles of incidence in the medium of the lower index, (n,), by their cosines before the surface."""
    return np.degrees(np.arcsin(np.minimum(_lateral(before, cosine) / min(before, behind), 1.0)))


def _lateral(index: float, cosine: np.ndarray) -> np.ndarray:
    """The index times the sine of the angle: the same in all media (Snell)."""
    return np.asarray(index * np.sqrt(np.maximum(1 - cosine**2, 0.0)))


def _ascending(values: tuple[float, ...], what: str, unit: str) -> None:
    for before, after in pairwise(values):
        if not before < after:
            message = f"{what} of a coating do not ascend: {after:.7g} {unit} follow {before:.7g}"
            hint = "write them in ascending order, and their reflectances in the same"
            raise PrescriptionError(message, hint=hint, code=f"coating-{what}")


def _through_films(films: tuple[Film, ...], before: float, behind: float, lateral: np.ndarray) -> np.ndarray:
    """Share of light that passes plane films, as `Coating.passed`; `lateral` is the index times the sine of the angle.

    The characteristic matrix of each film [[cos d, i sin d / e], [i e sin d, cos d]], with the phase d = 2 pi n cos(a)
    thickness / wavelength and the admittance e = n cos(a) or n / cos(a) by polarisation, carries the field from its
    rear to its front (Abeles 1950; Born and Wolf, Principles of Optics, section 1.6). Where light cannot propagate in a
    film its cosine is imaginary.
    """
    with np.errstate(all="ignore"):  # dead rays are NaN
        cosines = [np.sqrt(1 - (lateral / n) ** 2 + 0j) for n in (before, *(film.index for film in films), behind)]
        first, *inner, last = (
            np.stack([n * cosine, n / cosine])
            for n, cosine in zip((before, *(film.index for film in films), behind), cosines, strict=True)
        )
        electric, magnetic = np.ones_like(last), last
        for film, cosine, admittance in zip(films[::-1], cosines[-2:0:-1], inner[::-1], strict=True):
            phase = 2 * np.pi * film.index * film.waves * cosine
            cos, sin = np.cos(phase), 1j * np.sin(phase)
            electric, magnetic = (
                cos * electric + sin / admittance * magnetic,
                admittance * sin * electric + cos * magnetic,
            )
        passed: np.ndarray = 4 * first.real * last.real / np.abs(first * electric + magnetic) ** 2
    # Fields that fade away in many wavelengths of film overflow: nothing passes.
    return np.nan_to_num(passed, nan=0.0)
