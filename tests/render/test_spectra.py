"""Previews follow the published sRGB curve and stay neutral."""

import subprocess
import sys

import numpy as np
import pytest
from colour.models import eotf_inverse_sRGB

from pipeline.render.spectral.preview import srgb_encoded, srgb_preview


def published_srgb(linear: np.ndarray) -> np.ndarray:
    """IEC 61966-2-1: 12.92 c up to 0.0031308, else 1.055 c^(1/2.4) - 0.055."""
    return np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)


def test_the_curve_is_the_published_one() -> None:
    linear = np.linspace(0, 1, 10_001)
    # The standard prints its constants to 4 digits; the two branches differ by 3e-8 at the threshold.
    assert srgb_encoded(linear).tobytes() == np.asarray(eotf_inverse_sRGB(linear)).tobytes(), "as colour-science has it"
    # The two branches differ by 3e-8 at the threshold.
    assert srgb_encoded(np.array([0.0, 0.0031308, 0.5, 1.0])) == pytest.approx([0.0, 0.04045, 0.735357, 1.0], abs=1e-6)


def test_pixels_are_the_rounded_curve() -> None:
    linear = np.linspace(0, 1, 5_000).reshape(50, 100)
    expected = np.rint(255 * published_srgb(linear)).astype(np.uint8)
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


@pytest.mark.parametrize("pixel", [np.nan, np.inf])
def test_pixels_without_a_number_are_an_error(pixel: float) -> None:
    with pytest.raises(ValueError, match="1 of 2 pixels"):
        srgb_preview(np.array([[0.5, pixel]]), white=1.0)


@pytest.mark.parametrize("white", [0.0, -1.0, np.nan, np.inf])
def test_white_must_be_light(white: float) -> None:
    with pytest.raises(ValueError, match="white"):
        srgb_preview(np.ones((2, 2)), white=white)


@pytest.mark.heavy
def test_the_import_is_silent() -> None:
    """A user must not meet advice about packages that nobody asked for, not even with every warning on."""
    command = [sys.executable, "-W", "always", "-c", "import pipeline.render.spectral.spectra"]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    assert "colour" not in done.stderr.lower()
    assert done.stdout == ""
