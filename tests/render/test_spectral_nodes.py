"""Claim: the wavelengths that stand for a spectrum integrate polynomials over it exactly."""

import numpy as np
import pytest

from pipeline.render.spectral.nodes import SpectrumError, gauss_nodes, points_of


@pytest.mark.parametrize("count", [1, 2, 5, 9])
def test_an_even_spectrum_has_the_nodes_of_legendre(count: int) -> None:
    found, share = gauss_nodes(points_of((np.array([400.0, 700.0]), np.ones(2))), count)
    node, weight = np.polynomial.legendre.leggauss(count)
    np.testing.assert_allclose(found, 550 + 150 * node, rtol=0, atol=1e-9)
    np.testing.assert_allclose(share, weight / 2, rtol=0, atol=1e-12)


def test_moments_of_a_tabulated_spectrum() -> None:
    """A triangle from 500 to 600 nm with its top at 540 nm: its moments in closed form."""
    found, share = gauss_nodes(points_of((np.array([500.0, 540.0, 600.0]), np.array([0.0, 3.0, 0.0]))), 3)
    a, b, c = 500.0, 600.0, 540.0
    mean = (a + b + c) / 3
    variance = (a * a + b * b + c * c - a * b - a * c - b * c) / 18
    third = (a + b - 2 * c) * (2 * a - b - c) * (a - 2 * b + c) / 270
    np.testing.assert_allclose(share.sum(), 1, rtol=1e-14)
    np.testing.assert_allclose(share @ found, mean, rtol=1e-13)
    np.testing.assert_allclose(share @ (found - mean) ** 2, variance, rtol=1e-11)
    np.testing.assert_allclose(share @ (found - mean) ** 3, third, rtol=1e-9)


def test_nodes_lie_within_the_spectrum_and_ascend() -> None:
    wavelengths = np.linspace(380, 780, 81)
    response = np.exp(-0.5 * ((wavelengths - 610) / 25) ** 2)
    found, share = gauss_nodes(points_of((wavelengths, response)), 8)
    assert (np.diff(found) > 0).all()
    assert found[0] > 380
    assert found[-1] < 780
    assert (share > 0).all()


@pytest.mark.parametrize(
    ("wavelengths", "weight"),
    [([500.0], [1.0]), ([500.0, 490.0], [1.0, 1.0]), ([500.0, 510.0], [0.0, 0.0]), ([500.0, 510.0], [1.0, -1.0])],
)
def test_what_is_no_spectrum_is_refused(wavelengths: list[float], weight: list[float]) -> None:
    with pytest.raises(SpectrumError):
        points_of((np.array(wavelengths), np.array(weight)))
