"""Claim: the image of all channels says what traced its rays, if a device did."""

import numpy as np
import pytest

from pipeline.files.exr_bands import BandedPart, ExrWindows, write_bands
from pipeline.tasks import colour_image
from pipeline.tasks.params.cameras import ChannelLabel
from pipeline.tasks.params.outputs import ColourImage

RAYS = "float32, cuda sm_90, numba-cuda 0.30.4"


@pytest.mark.parametrize("rays", [{}, {"rays": RAYS}])
def test_the_picture_and_the_spectrum_name_the_device_of_their_channels(rays, tmp_path):
    inputs, channels = {}, []
    for i, (name, nm) in enumerate((("red", 640.0), ("green", 550.0), ("blue", 460.0))):
        (folder := tmp_path / name).mkdir()
        pixels = np.full((4, 5), 0.25 * (i + 1), np.float32)
        part = BandedPart(
            name="image",
            shape=pixels.shape,
            channels=("Y",),
            rows=lambda first, end, pixels=pixels: {"Y": pixels[first:end]},
            attributes={"content": "relative irradiance", **rays},
        )
        write_bands(folder / "image.exr", [part])
        inputs[f"channel{i}"] = {"image.exr": folder / "image.exr"}
        channels.append(ChannelLabel(name=name, wavelengths_nm=(nm,), shares=(1.0,)))
    colour_image.run(ColourImage(name="image", channels=tuple(channels)), inputs, tmp_path)
    picture, spectrum = ExrWindows(tmp_path / "image.exr"), ExrWindows(tmp_path / "spectral.exr")
    found = [picture.headers["image"].texts, spectrum.headers["spectral"].texts]
    assert [texts.get("rays") for texts in found] == [rays.get("rays")] * 2
    np.testing.assert_array_equal(picture.rows("image", 0, 4)["B"], np.full((4, 5), 0.75, np.float32))
