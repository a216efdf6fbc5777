"""Spectra of lamps and of sensors that colour-science knows by name."""

import re
import warnings

import numpy as np

from pipeline.records.shapes import Float64
from pipeline.render.spectral.nodes import SpectrumError, require_spectrum
from pipeline.spelling import nearest

with warnings.catch_warnings():
    # On import, colour warns that Matplotlib and other optional packages are missing. None of them is needed here.
    warnings.simplefilter("ignore")
    from colour.characterisation import MSDS_CAMERA_SENSITIVITIES, SDS_COLOURCHECKERS
    from colour.colorimetry import MSDS_CMFS, SDS_ILLUMINANTS, planck_law
    from colour.recovery import MSDS_BASIS_FUNCTIONS_sRGB_MALLETT2019

EQUAL_ENERGY = "E"
"""Name of the illuminant of equal energy at all wavelengths."""
_COLOURCHECKER = "ColorChecker N Ohta"
_BLACK_BODY = re.compile(r"(\d+(?:\.\d+)?) ?K")
_BLACK_BODY_NM = np.arange(150.0, 20001.0, 5.0)
"""Wavelengths of the table of a black body [nm]: all that a stage can ask for, and smooth between two of them."""

VISIBLE_NM = (380.0, 780.0)
"""Range over which the radiance of light with a spectrum is counted [nm]: what people see of it."""
_STEP_NM = 0.5
"""Step of integrals over products of tables [nm]: ten in the usual 5 nm of a table, right to 2e-6."""

Table = tuple[np.ndarray, np.ndarray]
"""Wavelengths (m,) [nm], ascending, and values (m,) at them; linear in between."""


def illuminant(name: str) -> Table:
    """Photons of an illuminant per wavelength, relative.

    Parameters
    ----------
    name : str
        `E`, a temperature such as `2856 K`, or a name of `colour.SDS_ILLUMINANTS`.

    Raises
    ------
    SpectrumError
        There is no such illuminant.
    """
    if name == EQUAL_ENERGY:
        return _photons(_BLACK_BODY_NM, np.ones_like(_BLACK_BODY_NM))
    if match := _BLACK_BODY.fullmatch(name):
        if not 100 <= float(match[1]) <= 1e6:
            hint = "a temperature from 100 K to 1000000 K"
            raise SpectrumError(f"a black body of {name}", hint=hint, code="unknown-illuminant")
        energy = np.asarray(planck_law(_BLACK_BODY_NM * 1e-9, float(match[1])))
        return _photons(_BLACK_BODY_NM, energy / energy.max())
    spectrum = SDS_ILLUMINANTS[_known(name, list(SDS_ILLUMINANTS), "illuminant")]
    return _photons(np.asarray(spectrum.wavelengths, float), np.asarray(spectrum.values, float))


def sensitivity(camera: str, component: str) -> Table:
    """Quantum efficiency of a component, `red`, `green` or `blue`, of a camera in `colour.MSDS_CAMERA_SENSITIVITIES`.

    They are relative responses to energy; a photon has the less of it the longer its wavelength.

    Raises
    ------
    SpectrumError
        There is no such camera.
    """
    cameras = [name for name, one in MSDS_CAMERA_SENSITIVITIES.items() if component in one.labels]
    table = MSDS_CAMERA_SENSITIVITIES[_known(camera, cameras, "camera")]
    wavelengths = np.asarray(table.wavelengths, float)
    response = np.maximum(np.asarray(table.values, float)[:, table.labels.index(component)], 0.0)
    return wavelengths, response / wavelengths


def reflectance(patch: str) -> Table:
    """Reflectance of a patch of the ColorChecker as N. Ohta measured it, from 380 to 780 nm in steps of 5 nm.

    Raises
    ------
    SpectrumError
        There is no such patch.
    """
    patches = SDS_COLOURCHECKERS[_COLOURCHECKER]
    spectrum = patches[_known(patch, list(patches), "patch")]
    return np.asarray(spectrum.wavelengths, float), np.asarray(spectrum.values, float)


def effective_nm(response: Table, light: Table) -> float:
    """Wavelength of which a joule has as many photons as count by a relative response for a joule of a light [nm].

    The joule is counted between `VISIBLE_NM`: the result is the integral of S r lambda over that of S.

    Parameters
    ----------
    response, light : Table
        Quantum efficiency, whose highest value counts as 1, and photons per wavelength, relative.

    Raises
    ------
    SpectrumError
        One of them is no spectrum, they have no wavelength in common, or the light has no visible part.
    """
    both_nm, _ = product(response, light)
    counted_nm = np.union1d(both_nm, np.arange(both_nm[0], both_nm[-1], _STEP_NM))
    photons = np.interp(counted_nm, *response) / np.max(response[1]) * np.interp(counted_nm, *light)
    fine_nm = np.arange(VISIBLE_NM[0], VISIBLE_NM[1] + _STEP_NM / 2, _STEP_NM)
    # Photons times the energy of each, in units of h c / nm.
    energy = np.trapezoid(np.interp(fine_nm, *light, left=0.0, right=0.0) / fine_nm, fine_nm)
    if not energy > 0:
        raise SpectrumError(
            f"light without any between {VISIBLE_NM[0]:g} and {VISIBLE_NM[1]:g} nm has no radiance there"
        )
    return float(np.trapezoid(photons, counted_nm) / energy)


def weights_of_rgb(wavelength_nm: float) -> np.ndarray:
    """Weights of the linear components of sRGB at a wavelength, (3,), whose sum is 1: a colour stands for the spectrum
    weights @ rgb, and white for 1 everywhere.

    Beyond 380 and 780 nm they stay as they are there.

    References
    ----------
    Mallett and Yuksel, "Spectral Primary Decomposition for Rendering with sRGB Reflectance", EGSR 2019.
    """
    basis = MSDS_BASIS_FUNCTIONS_sRGB_MALLETT2019
    values = np.array([np.interp(wavelength_nm, basis.wavelengths, column) for column in np.asarray(basis.values).T])
    return np.asarray(values / values.sum())


def product(one: Table, other: Table) -> Table:
    """The product of two tables where both are known, at the wavelengths of both.

    Raises
    ------
    SpectrumError
        One of them is no spectrum, or they have no wavelengths in common.
    """
    require_spectrum(*one)
    require_spectrum(*other)
    low, high = max(one[0][0], other[0][0]), min(one[0][-1], other[0][-1])
    if not low < high:
        raise SpectrumError(
            f"a response from {one[0][0]:g} to {one[0][-1]:g} nm and light from {other[0][0]:g} to {other[0][-1]:g} nm"
            " have no wavelength in common"
        )
    both = np.unique(np.concatenate([one[0], other[0], [low, high]]))
    both = both[(both >= low) & (both <= high)]
    return both, np.interp(both, *one) * np.interp(both, *other)


def patches_and_observer(wavelengths_nm: Float64[np.ndarray, "m"]) -> tuple[np.ndarray, np.ndarray]:
    """Reflectances of the ColorChecker, (24, m), and colour matching functions of the CIE 1931 observer, (3, m)."""
    table = MSDS_CMFS["CIE 1931 2 Degree Standard Observer"]
    curves = [(table.wavelengths, values) for values in np.asarray(table.values).T]
    patches = [reflectance(name) for name in SDS_COLOURCHECKERS[_COLOURCHECKER]]
    sampled = [np.array([np.interp(wavelengths_nm, *one) for one in some]) for some in (patches, curves)]
    return sampled[0], sampled[1]


def _photons(wavelengths_nm: np.ndarray, energy: np.ndarray) -> Table:
    return wavelengths_nm, energy * wavelengths_nm


def _known(name: str, names: list[str], what: str) -> str:
    if name in names:
        return name
    best = nearest(name, names)
    hint = f'did you mean "{best}"?' if best else f"known: {', '.join(names)}"
    raise SpectrumError(f'colour-science knows no {what} "{name}"', hint=hint, code=f"unknown-{what}")
