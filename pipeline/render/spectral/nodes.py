"""Wavelengths that represent a spectrum: Gauss quadrature for products of tables, and slices of equal weight."""

import numpy as np

from pipeline.camera.parts.spectrum import Slice, Slices
from pipeline.errors import PipelineError
from pipeline.records.shapes import Float64

_STEP_NM = 5.0
"""Longest piece of a table that is integrated at once [nm]: eight Gauss points on each, exact to degree 15."""
_GRID_NM = 5.0
"""Step of published reflectances and of the spectra of sRGB [nm]: means of piecewise linear functions are exact."""
SLICES = 8
"""Slices of each wavelength's interval [1]: for light that is reflected more than once, see docs/colour.md."""

Table = tuple[np.ndarray, np.ndarray]
"""Wavelengths (m,) [nm], ascending, and values (m,) at them; linear in between."""


class SpectrumError(PipelineError):
    """A spectrum that no light has."""

    code = "spectrum"


def gauss_nodes(points: Table, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Wavelengths and shares for integrals over a spectrum: exact for polynomials of a degree below twice their number.

    The recurrence comes from the Stieltjes procedure, nodes and shares from the eigenvalues and eigenvectors of the
    Jacobi matrix: Golub and Welsch, "Calculation of Gauss Quadrature Rules", Mathematics of Computation 23 (1969) 221.

    `points`: points of a spectrum, from `points_of`.
    Returns (count,), (count,) float64: ascending wavelengths [nm], and shares, which sum up to 1.
    """
    point, share = points
    middle = (point[0] + point[-1]) / 2
    half = (point[-1] - point[0]) / 2
    diagonal, off_diagonal = _stieltjes((point - middle) / half, share / share.sum(), count)
    values, vectors = np.linalg.eigh(np.diag(diagonal) + np.diag(off_diagonal, 1) + np.diag(off_diagonal, -1))
    return middle + half * values, vectors[0] ** 2


def slices_of(points: Table, shares: Float64[np.ndarray, "n"]) -> tuple[Slices, ...]:
    """Slices of the consecutive intervals whose weights are the shares of a spectrum.

    Gauss shares cut the spectrum so that each node lies in its own interval (separation theorem of Chebyshev, Markov
    and Stieltjes). Values at the wavelengths of a slice give the exact mean over it of functions that are linear
    between multiples of 5 nm.
    """
    point, weight = points
    # Cumulative weight at the end of each point's share, and at each cut between slices
    ends, cuts = (
        np.concatenate([[0.0], np.cumsum(parts) / parts.sum()]) for parts in (weight, np.repeat(shares, SLICES))
    )
    # Weight of each point inside each slice, (slices, points)
    inside = np.diff(np.clip(ends, cuts[:-1, None], cuts[1:, None]), axis=1)
    # Share it out to the two multiples of 5 nm around the point, by linear interpolation.
    phase = point / _GRID_NM - np.floor(point[0] / _GRID_NM)
    below = phase.astype(np.int64)
    fraction = phase % 1.0
    grid_nm = _GRID_NM * (np.floor(point[0] / _GRID_NM) + np.arange(below[-1] + 2))
    slices = []
    for weights in inside:
        at_lower = np.bincount(below, weights * (1.0 - fraction), len(grid_nm))
        at_upper = np.bincount(below + 1, weights * fraction, len(grid_nm))
        slices.append(_slice(grid_nm, at_lower + at_upper))
    return tuple(tuple(slices[first : first + SLICES]) for first in range(0, len(slices), SLICES))


def points_of(*tables: Table, counts_photons: bool = False) -> Table:
    """Points over the common range of tables, and the weight of each in the integral of their product.

    `counts_photons`: one of them is a response per photon and another one a power: the wavelength is a factor, too.
    Raises SpectrumError: one of them is no spectrum, they have no wavelength in common, or the product is 0 everywhere.
    """
    for table in tables:
        require_spectrum(*table)
    low = max(table[0][0] for table in tables)
    high = min(table[0][-1] for table in tables)
    if not low < high:
        ranges = " and ".join(f"from {table[0][0]:g} to {table[0][-1]:g} nm" for table in tables)
        raise SpectrumError(f"spectra {ranges} have no wavelength in common")
    entries = np.unique(np.concatenate([[low, high], *(table[0] for table in tables)]))
    entries = entries[(entries >= low) & (entries <= high)]
    # Gauss-Legendre on pieces of at most 5 nm, whose ends include all entries of the tables
    node, part = np.polynomial.legendre.leggauss(8)
    pieces = np.ceil(np.diff(entries) / _STEP_NM).astype(int)
    spans = zip(entries[:-1], entries[1:], pieces, strict=True)
    marks = np.concatenate([entries[:1], *(np.linspace(a, b, parts + 1)[1:] for a, b, parts in spans)])
    half = np.diff(marks)[:, None] / 2
    point = (marks[:-1, None] + half * (node + 1)).ravel()
    weight = (half * part).ravel()
    for table in tables:
        weight = weight * np.interp(point, *table)
    weight = weight * point if counts_photons else weight
    if not weight.any():
        raise SpectrumError("spectra that have no light at the same wavelength")
    return point, weight


def require_spectrum(wavelengths_nm: Float64[np.ndarray, "m"], weight: Float64[np.ndarray, "k"]) -> None:
    """Raise SpectrumError for a table that is no spectrum."""
    if len(wavelengths_nm) < 2 or len(weight) != len(wavelengths_nm) or (np.diff(wavelengths_nm) <= 0).any():
        raise SpectrumError("a spectrum needs at least two wavelengths, ascending, and a value for each")
    if not (np.isfinite(weight).all() and (weight >= 0).all() and weight.any()):
        raise SpectrumError("a spectrum needs values that are not negative, and one that is not 0")


def _slice(grid_nm: np.ndarray, weight: np.ndarray) -> Slice:
    """A slice of the wavelengths that have a weight."""
    weight = weight if weight.any() else np.ones(len(weight))  # too little light for a float, so that any colour does
    lit = np.flatnonzero(weight > 0)
    shares = weight[lit] / weight.sum()
    return Slice(wavelengths_nm=tuple(grid_nm[lit].tolist()), shares=tuple(shares.tolist()))


def _stieltjes(x: np.ndarray, share: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Recurrence coefficients of the orthonormal polynomials of a discrete weight, diagonal (count,) and off-diagonal
    (count - 1,) of the Jacobi matrix: b_k p_k+1 = (x - a_k) p_k - b_k-1 p_k-1.

    Source: W. Gautschi, "Orthogonal Polynomials: Computation and Approximation", Oxford 2004, section 2.2.3.
    """
    diagonal = np.empty(count)
    off_diagonal = np.empty(count - 1)
    previous = np.zeros_like(x)
    current = np.ones_like(x)
    for k in range(count):
        diagonal[k] = share @ (x * current**2)
        if k == count - 1:
            break
        following = (x - diagonal[k]) * current - (off_diagonal[k - 1] if k else 0.0) * previous
        off_diagonal[k] = np.sqrt(share @ following**2)
        previous = current
        current = following / off_diagonal[k]
    return diagonal, off_diagonal
