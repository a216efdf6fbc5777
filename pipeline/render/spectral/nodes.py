"""Wavelengths that stand for a spectrum: a quadrature of Gauss for any tabulated weight."""

import numpy as np

from pipeline.errors import PipelineError
from pipeline.records.shapes import Float64

_STEP_NM = 5.0
"""Longest piece of a table that is integrated at once [nm]: eight points on each, exact to the fifteenth degree."""


class SpectrumError(PipelineError):
    """A spectrum that no light has."""

    code = "spectrum"


def gauss_nodes(
    wavelengths_nm: Float64[np.ndarray, "m"], weight: Float64[np.ndarray, "k"], count: int
) -> tuple[np.ndarray, np.ndarray]:
    """Wavelengths and shares for integrals over a spectrum: exact for polynomials of a degree below twice their number.

    By the procedure of Stieltjes and the eigenvalues of Jacobi's matrix (Golub and Welsch, 1969).

    Parameters
    ----------
    wavelengths_nm : (m,) float64
        Ascending, at least two.
    weight : (m,) float64
        Not negative, linear between two entries of the table and 0 outside of it.
    count : int

    Returns
    -------
    (count,) float64, (count,) float64
        Ascending wavelengths [nm], and shares, which sum up to 1.

    Raises
    ------
    SpectrumError
        The table is none, or all of it is 0.
    """
    require_spectrum(wavelengths_nm, weight)
    point, share = _points(wavelengths_nm, weight)
    middle, half = (wavelengths_nm[0] + wavelengths_nm[-1]) / 2, (wavelengths_nm[-1] - wavelengths_nm[0]) / 2
    diagonal, beside = _recurrence((point - middle) / half, share / share.sum(), count)
    values, vectors = np.linalg.eigh(np.diag(diagonal) + np.diag(beside, 1) + np.diag(beside, -1))
    return middle + half * values, vectors[0] ** 2


def require_spectrum(wavelengths_nm: Float64[np.ndarray, "m"], weight: Float64[np.ndarray, "k"]) -> None:
    """Raise SpectrumError for a table that is no spectrum."""
    if len(wavelengths_nm) < 2 or len(weight) != len(wavelengths_nm) or (np.diff(wavelengths_nm) <= 0).any():
        raise SpectrumError("a spectrum needs at least two wavelengths, ascending, and a value for each")
    if not (np.isfinite(weight).all() and (weight >= 0).all() and weight.any()):
        raise SpectrumError("a spectrum needs values that are not negative, and one that is not 0")


def _points(wavelengths_nm: np.ndarray, weight: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Points all over a table, and the weight that each stands for."""
    node, part = np.polynomial.legendre.leggauss(8)
    pieces = np.ceil(np.diff(wavelengths_nm) / _STEP_NM).astype(int)
    spans = zip(wavelengths_nm[:-1], wavelengths_nm[1:], pieces, strict=True)
    inner = [np.linspace(low, high, parts + 1)[1:] for low, high, parts in spans]
    marks = np.concatenate([wavelengths_nm[:1], *inner])
    half = np.diff(marks)[:, None] / 2
    point = (marks[:-1, None] + half * (node + 1)).ravel()
    return point, (half * part).ravel() * np.interp(point, wavelengths_nm, weight)


def _recurrence(x: np.ndarray, share: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Coefficients of the three-term recurrence of the orthonormal polynomials of a discrete weight."""
    diagonal, beside = np.empty(count), np.empty(count - 1)
    before, here = np.zeros_like(x), np.ones_like(x)
    for number in range(count):
        diagonal[number] = share @ (x * here**2)
        if number == count - 1:
            break
        following = (x - diagonal[number]) * here - (beside[number - 1] if number else 0.0) * before
        beside[number] = np.sqrt(share @ following**2)
        before, here = here, following / beside[number]
    return diagonal, beside
