"""Spectra of illuminants and of sensors, by their names in colour-science."""

import re
import warnings

import numpy as np

from pipeline.camera.parts.spectrum import Slice
from pipeline.records.shapes import Float64
from pipeline.render.spectral.nodes import SpectrumError, Table, points_of
from pipeline.spelling import nearest

with warnings.catch_warnings(), np.printoptions():
    # On import, colour warns that Matplotlib and other optional packages are missing, of which none is needed here, and
    # cuts what NumPy prints to twelve digits, in the notebook of a user too.
    warnings.simplefilter("ignore")
    from colour.characterisation import MSDS_CAMERA_SENSITIVITIES, SDS_COLOURCHECKERS
    from colour.colorimetry import MSDS_CMFS, SDS_ILLUMINANTS, planck_law
    from colour.recovery import MSDS_BASIS_FUNCTIONS_sRGB_MALLETT2019

EQUAL_ENERGY = "E"
"""Name of the illuminant of equal energy at all wavelengths."""
_COLOURCHECKER = "ColorChecker N Ohta"
_BLACK_BODY = re.compile(r"(\d+(?:\.\d+)?) ?K")
_BLACK_BODY_NM = np.arange(150.0, 20001.0, 5.0)
"""Wavelengths of the table of a black body [nm]: all that a stage can ask for, and smooth between neighbours."""

VISIBLE_NM = (380.0, 780.0)
"""Range over which the radiance of light with a spectrum is integrated [nm]: the visible one."""


def illuminant(name: str) -> Table:
    """Power of an illuminant per wavelength, relative.

    `name`: `E`, a temperature such as `2856 K`, or a name of `colour.SDS_ILLUMINANTS`.
    Raises SpectrumError: there is no such illuminant.
    """
    if name == EQUAL_ENERGY:
        return _BLACK_BODY_NM, np.ones_like(_BLACK_BODY_NM)
    if match := _BLACK_BODY.fullmatch(name):
        if not 100 <= float(match[1]) <= 1e6:
            hint = "a temperature from 100 K to 1000000 K"
            raise SpectrumError(f"a black body of {name}", hint=hint, code="unknown-illuminant")
        energy = np.asarray(planck_law(_BLACK_BODY_NM * 1e-9, float(match[1])))
        return _BLACK_BODY_NM, energy / energy.max()
    spectrum = SDS_ILLUMINANTS[_existing(name, list(SDS_ILLUMINANTS), "illuminant")]
    return np.asarray(spectrum.wavelengths, float), np.asarray(spectrum.values, float)


def sensitivity(camera: str, component: str) -> Table:
    """Relative response to energy of a `red`, `green` or `blue` component of a camera in
    `colour.MSDS_CAMERA_SENSITIVITIES`. Raises SpectrumError: there is no such camera.
    """
    cameras = [name for name, curves in MSDS_CAMERA_SENSITIVITIES.items() if component in curves.labels]
    table = MSDS_CAMERA_SENSITIVITIES[_existing(camera, cameras, "camera")]
    wavelengths = np.asarray(table.wavelengths, float)
    response = np.maximum(np.asarray(table.values, float)[:, table.labels.index(component)], 0.0)
    return wavelengths, response


def reflectance(patch: str) -> Table:
    """Reflectance of a patch of the ColorChecker as N. Ohta measured it; SpectrumError: there is no such patch."""
    patches = SDS_COLOURCHECKERS[_COLOURCHECKER]
    spectrum = patches[_existing(patch, list(patches), "patch")]
    return np.asarray(spectrum.wavelengths, float), np.asarray(spectrum.values, float)


def effective_nm(response: Table, light: Table, counts_photons: bool = True) -> float:
    """Wavelength at which a joule has as many photons as a relative response counts per joule of a light [nm].

    The joule is counted between `VISIBLE_NM`: the result is the integral of S r lambda over that of S.

    `response`, `light`: response, whose highest quantum efficiency counts as 1, and power per wavelength, relative.
    `counts_photons`: whether the response is the quantum efficiency; else one to energy.
    Raises SpectrumError: as `points_of`, and where the light has no visible part.
    """
    highest = np.max(response[1] if counts_photons else response[1] / response[0])
    _, photons = points_of(response, light, counts_photons=counts_photons)
    _, energy = points_of((np.array(VISIBLE_NM), np.ones(2)), light)
    return float(photons.sum() / highest / energy.sum())


def weights_of_rgb(light: Slice) -> np.ndarray:
    """Weights of the linear components of sRGB in a slice of light, (3,), whose sum is 1: a colour has the spectrum
    weights @ rgb, and white is 1 everywhere.

    Beyond 380 and 780 nm they are constant.

    Source: Mallett and Yuksel, "Spectral Primary Decomposition for Rendering with sRGB Reflectance", EGSR 2019.
    """
    basis = MSDS_BASIS_FUNCTIONS_sRGB_MALLETT2019
    curves = np.asarray(basis.values).T
    values = np.array([np.interp(light.wavelengths_nm, basis.wavelengths, curve) for curve in curves])
    return np.asarray((values / values.sum(axis=0) * light.shares).sum(axis=1))


def patches_and_observer(wavelengths_nm: Float64[np.ndarray, "m"]) -> tuple[np.ndarray, np.ndarray]:
    """Reflectances of the ColorChecker, (24, m), and colour matching functions of the CIE 1931 observer, (3, m)."""
    table = MSDS_CMFS["CIE 1931 2 Degree Standard Observer"]
    curves = [(table.wavelengths, values) for values in np.asarray(table.values).T]
    patches = [reflectance(name) for name in SDS_COLOURCHECKERS[_COLOURCHECKER]]
    sampled = [np.array([np.interp(wavelengths_nm, *curve) for curve in tables]) for tables in (patches, curves)]
    return sampled[0], sampled[1]


def _existing(name: str, names: list[str], kind: str) -> str:
    """The name if it is one of the names; SpectrumError with a suggestion if it is not."""
    if name in names:
        return name
    best = nearest(name, names)
    hint = f'did you mean "{best}"?' if best else f"known: {', '.join(names)}"
    raise SpectrumError(f'colour-science knows no {kind} "{name}"', hint=hint, code=f"unknown-{kind}")
