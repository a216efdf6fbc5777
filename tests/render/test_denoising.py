"""Denoised previews: less noise, the same light, and nothing else changes."""

import sys
from pathlib import Path

import numpy as np
import pytest
from stage_text import over_tiny

from pipeline.app.build import project
from pipeline.errors import UsageError
from pipeline.files.exr import Part, write_exr
from pipeline.files.png import read_png
from pipeline.render.denoising import denoised
from pipeline.render.spectral.preview import srgb_encoded
from pipeline.tasks.denoised import run
from pipeline.tasks.params.cameras import Nothing

ROOTS = (Path(__file__).parents[1] / "data",)
ASKED = "uniform bool plen:image:denoised = true"
SHADES = {"R": 0.6, "G": 0.1, "B": 0.25}


def test_noise_goes_and_light_stays():
    """A checkerboard with the noise of few samples, in one wavelength."""
    y, x = np.mgrid[0:64, 0:96]
    true = 0.2 + 0.6 * ((x // 16 + y // 16) % 2)[..., None]
    noisy = (true * np.random.default_rng(1).gamma(25, 1 / 25, true.shape)).astype(np.float32)
    clear = denoised(noisy)
    assert clear.shape == noisy.shape and clear.dtype == np.float32
    assert np.std(clear - true) < 0.5 * np.std(noisy - true)
    assert clear.mean() == pytest.approx(true.mean(), rel=0.01)
    assert (denoised(noisy) == clear).all()


@pytest.mark.parametrize(
    ("channels", "shown"),
    [(SHADES, (0.6, 0.1, 0.25)), ({"Y": 0.3}, (0.3,) * 3), ({"450nm": 0.1, "650nm": 0.5}, (0.3,) * 3)],
    ids=["colours", "mono", "spectral"],
)
def test_each_colour_stays_where_it_is(channels, shown, tmp_path):
    noise = np.random.default_rng(2).gamma(400, 1 / 400, (32, 48))
    write_exr(
        tmp_path / "image.exr",
        [Part(name="image", channels={name: (c * noise).astype("f4") for name, c in channels.items()})],
    )
    run(Nothing(), {"image": {"image.exr": tmp_path / "image.exr"}}, tmp_path)
    picture = read_png(tmp_path / "denoised.png")
    np.testing.assert_allclose(picture.mean(axis=(0, 1)), 255 * srgb_encoded(np.array(shown)), rtol=0, atol=2)


def test_a_camera_that_asks_for_it_has_one_in_every_frame(tmp_path):
    (tmp_path / "stage.usda").write_text(over_tiny(camera=ASKED), encoding="utf-8")
    for preview in (False, True):
        files = project(tmp_path / "stage.usda", tmp_path / "out", ROOTS, preview=preview).files
        frames = [name for name in files if name.endswith("image.png")]
        assert [name for name in files if "denoised" in name] == [
            name.replace("image.png", "denoised.png") for name in frames
        ]


def test_without_its_library_a_plan_says_what_to_install(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "mitsuba_oidn", None)
    (tmp_path / "stage.usda").write_text(over_tiny(camera=ASKED), encoding="utf-8")
    with pytest.raises(UsageError, match="mitsuba-oidn is not installed") as caught:
        project(tmp_path / "stage.usda", tmp_path / "out", ROOTS)
    assert "plenoptic-pipeline[denoise]" in str(caught.value)
