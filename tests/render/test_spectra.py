"""Previews follow the published sRGB curve; the wavelengths that stand for a spectrum integrate polynomials exactly."""

import subprocess
import sys

import numpy as np
import pytest
from colour.models import eotf_inverse_sRGB

from pipeline.render.spectral.nodes import SpectrumError, gauss_nodes, points_of
from pipeline.render.spectral.preview import srgb_encoded, srgb_preview


def test_the_curve_is_the_published_one() -> None:
    linear = np.linspace(0, 1, 10_001)
    assert srgb_encoded(linear).tobytes() == np.asarray(eotf_inverse_sRGB(linear)).tobytes(), "as colour-science has it"
    # IEC 61966-2-1 prints its constants to 4 digits; the two branches differ by 3e-8 at the threshold.
    assert srgb_encoded(np.array([0.0, 0.0031308, 0.5, 1.0])) == pytest.approx([0.0, 0.04045, 0.735357, 1.0], abs=1e-6)


def test_pixels_are_the_rounded_curve() -> None:
    linear = np.linspace(0, 1, 5_000).reshape(50, 100)
    expected = np.rint(255 * eotf_inverse_sRGB(linear)).astype(np.uint8)
    preview = srgb_preview(linear * 7.5, white=7.5)
    assert preview.shape == (50, 100, 3)
    assert preview.dtype == np.uint8
    # One step where the curve lies on a rounding border.
    assert np.abs(preview[..., 0].astype(int) - expected).max() <= 1
    assert np.mean(preview[..., 0] != expected) < 1e-3


def test_black_half_and_white() -> None:
    """0.5 is encoded as 0.735357, 187.5 of 255: linear light is not the number in the file."""
    assert srgb_preview(np.array([[0.0, 0.18, 1.0]]), white=1.0)[0, :, 0].tolist() == [0, 118, 255]


def test_grey_stays_neutral_and_too_much_light_is_clipped() -> None:
    preview = srgb_preview(np.array([[-0.1, 0.3, 5.0]], dtype=np.float32), white=1.0)
    assert preview[0, 0].tolist() == [0, 0, 0]
    assert preview[0, 2].tolist() == [255, 255, 255]
    assert len(set(preview[0, 1].tolist())) == 1


@pytest.mark.parametrize(
    ("pixel", "white", "words"),
    [
        (np.nan, 1.0, "1 of 2 pixels"),
        (np.inf, 1.0, "1 of 2 pixels"),
        *((0.5, white, "white") for white in (0.0, -1.0, np.nan)),
    ],
)
def test_pixels_without_a_number_and_white_without_light_are_refused(pixel: float, white: float, words: str) -> None:
    with pytest.raises(ValueError, match=words):
        srgb_preview(np.array([[0.5, pixel]]), white=white)


@pytest.mark.heavy
def test_the_import_is_silent() -> None:
    """A user must not meet advice about packages that nobody asked for, not even with every warning on.

    NumPy prints all digits as before.
    """
    code = "import numpy, pipeline.render.spectral.spectra; print(numpy.float64(1) / 3)"
    command = [sys.executable, "-W", "always", "-c", code]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    assert "colour" not in done.stderr.lower()
    assert done.stdout == "0.3333333333333333\n"


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
