"""Ids of names as Cryptomatte's specification has them, read back by OpenImageIO."""

import json

import numpy as np
import pytest

from pipeline.files.exr import Part, write_exr
from pipeline.plugins.scenes.labels.cryptomatte import attributes_of, id_of, murmur3

PUBLISHED = {
    b"": 0x00000000,
    b"hello": 0x248BFA47,
    b"hello, world": 0x149BBB7F,
    b"The quick brown fox jumps over the lazy dog": 0x2E4FF723,
}
"""MurmurHash3_x86_32 with the seed 0, https://en.wikipedia.org/wiki/MurmurHash and the verification of SMHasher."""
SAMPLE = {"bunny": "13851a76", "default": "42c9679f"}
"""The manifest of the sample images of Psyop/Cryptomatte, whose layer uCryptoAsset has the key d593dd7."""


@pytest.mark.parametrize("text", PUBLISHED)
def test_the_hash_is_that_of_its_author(text):
    assert murmur3(text) == PUBLISHED[text]


def test_manifest_and_key_are_those_of_the_sample_images():
    attributes = attributes_of("uCryptoAsset", ["default", "bunny"])
    assert json.loads(attributes["cryptomatte/d593dd7/manifest"]) == SAMPLE
    assert attributes["cryptomatte/d593dd7/conversion"] == "uint32_to_float32"


def test_no_id_is_a_number_that_programs_change():
    """Neither NaN, nor infinite, nor denormal: one bit of the exponent is flipped for the names that would be."""
    names = [f"/World/Thing{k}" for k in range(3000)]
    ids = np.array([id_of(name) for name in names], np.float32)
    bits = ids.view(np.uint32) >> 23 & 255
    assert np.isfinite(ids).all() and (bits > 0).all() and (bits < 255).all()
    changed = [int(i.view(np.uint32)) != murmur3(name.encode()) for i, name in zip(ids, names, strict=True)]
    assert 0 < sum(changed) < 60


def test_another_program_finds_a_matte_by_its_name(tmp_path):
    oiio = pytest.importorskip("OpenImageIO")
    ids, share = np.full((3, 4), id_of("/A/Board")), np.linspace(0, 1, 12, dtype=np.float32).reshape(3, 4)
    channels = {"Crypto00.R": ids, "Crypto00.G": share}
    write_exr(
        tmp_path / "a.exr", [Part(name="labels", channels=channels, attributes=attributes_of("Crypto", ["/A/Board"]))]
    )
    image = oiio.ImageBuf(str(tmp_path / "a.exr"))
    about = {each.name: each.value for each in image.spec().extra_attribs}
    (manifest,) = [text for name, text in about.items() if name.endswith("/manifest")]
    number = np.uint32(int(json.loads(manifest)["/A/Board"], 16))
    names, pixels = image.spec().channelnames, image.get_pixels(oiio.FLOAT)
    is_it = pixels[..., names.index("Crypto00.R")].view(np.uint32) == number
    np.testing.assert_array_equal(np.where(is_it, pixels[..., names.index("Crypto00.G")], 0), share)
