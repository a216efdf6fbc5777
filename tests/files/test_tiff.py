"""Raw images as TIFF and DNG: other programs read what we write, bit for bit, and damage is known."""

import shutil
import subprocess

import numpy as np
import pytest
import rawpy
import tifffile
from PIL import Image

from pipeline.files.tiff import Negative, mapped, read_tiff, write_dng, write_tiff

ABOUT = {"black_level_dn": 64.25, "filters": ["mono"]}
NUMBERS = np.random.default_rng(5).integers(0, 65536, (37, 53)).astype(np.uint16)
MOSAICS = [
    (("red", "green", "green", "blue"), [[0, 1], [3, 2]]),
    (("green", "blue", "red", "green"), [[3, 2], [0, 1]]),
    (("blue", "green", "green", "red"), [[2, 3], [1, 0]]),
    (("Red", "G", "G", "BLUE"), [[0, 1], [3, 2]]),
]
"""Filters, and the pattern that LibRaw tells of them: 0 red, 1 green, 2 blue, 3 the green beside blue."""


def rows(first, end):
    return NUMBERS[first:end]


def test_a_tiff_is_what_another_program_reads(tmp_path):
    write_tiff(tmp_path / "raw.tiff", NUMBERS.shape, rows, ABOUT)
    with Image.open(tmp_path / "raw.tiff") as picture:
        assert picture.mode == "I;16"
        np.testing.assert_array_equal(np.array(picture), NUMBERS)
    pixels, about = read_tiff(tmp_path / "raw.tiff")
    np.testing.assert_array_equal(pixels, NUMBERS)
    assert about == ABOUT
    np.testing.assert_array_equal(mapped(tmp_path / "raw.tiff"), NUMBERS)


def test_an_image_that_no_tiff_holds_is_refused_before_it_is_made(tmp_path):
    with pytest.raises(ValueError, match="more than a TIFF"):
        write_tiff(tmp_path / "raw.tiff", (65536, 65536), rows, ABOUT)


@pytest.mark.parametrize(("filters", "pattern"), MOSAICS)
def test_libraw_reads_the_mosaic_bit_for_bit(tmp_path, filters, pattern):
    path = tmp_path / "raw.dng"
    write_dng(path, NUMBERS.shape, rows, ABOUT, Negative(model="A.B", black_dn=64.0, white_dn=60123, filters=filters))
    with rawpy.imread(str(path)) as raw:
        np.testing.assert_array_equal(raw.raw_image, NUMBERS)
        assert raw.raw_pattern.tolist() == pattern
        assert raw.color_desc == b"RGBG"
        assert raw.black_level_per_channel == [64] * 4
        assert raw.white_level == 60123


def test_libraw_reads_a_camera_without_filters(tmp_path):
    path = tmp_path / "raw.dng"
    write_dng(path, NUMBERS.shape, rows, ABOUT, Negative(model="A.B", black_dn=63.7, white_dn=4000))
    with rawpy.imread(str(path)) as raw:
        np.testing.assert_array_equal(raw.raw_image, NUMBERS)
        assert raw.num_colors == 1
        assert (raw.black_level_per_channel, raw.white_level) == ([63] * 4, 4000)  # LibRaw cuts it to whole numbers
    np.testing.assert_array_equal(read_tiff(path)[0], NUMBERS)


def test_a_filter_that_dng_does_not_know_is_named(tmp_path):
    negative = Negative(model="A", black_dn=0.0, white_dn=255, filters=("red", "infrared", "green", "blue"))
    with pytest.raises(ValueError, match="infrared"):
        write_dng(tmp_path / "raw.dng", NUMBERS.shape, rows, ABOUT, negative)


def test_a_camera_may_have_any_name(tmp_path):
    negative = Negative(model="Kamera Süd", black_dn=0.0, white_dn=255)
    write_dng(tmp_path / "raw.dng", NUMBERS.shape, rows, ABOUT, negative)
    assert b"Kamera S\\xfcd" in (tmp_path / "raw.dng").read_bytes()
    np.testing.assert_array_equal(read_tiff(tmp_path / "raw.dng")[0], NUMBERS)


def test_the_tags_of_a_negative_are_those_of_the_specification(tmp_path):
    """By the numbers of DNG 1.4.0.0, chapters 4 and 5, and of TIFF/EP; no tag names a program or a date."""
    negative = Negative(
        model="A",
        black_dn=64.25,
        white_dn=60123,
        filters=("red", "green", "green", "blue"),
        exposure_time_s=0.0125,
        f_number=2.8,
        focal_length_mm=12.5,
        neutral=(0.5, 1.0, 0.75),
        from_xyz={"D65": [[1.25, -0.5, 0.0]], "the lamp": [[1.0, 0.0, 0.0]]},
    )
    write_dng(tmp_path / "raw.dng", NUMBERS.shape, rows, ABOUT, negative)
    with tifffile.TiffFile(tmp_path / "raw.dng") as file:
        tags = {tag.code: tag.value for tag in file.pages.first.tags}
    expected = {
        254: 0, 259: 1, 262: 32803, 271: "plenoptic-pipeline", 272: "A", 274: 1, 33421: (2, 2), 33422: b"\0\1\1\2",
        50706: b"\1\4\0\0", 50707: b"\1\1\0\0", 50708: "plenoptic-pipeline A", 50710: b"\0\1\2",
        50711: 1, 50713: (1, 1), 50714: (257, 4), 50717: 60123, 50721: (5, 4, -1, 2, 0, 1), 50722: (1, 1, 0, 1, 0, 1),
        50728: (1, 2, 1, 1, 3, 4), 50778: 21, 50779: 255,
    }  # fmt: skip
    assert {code: tags[code] for code in expected} == expected
    assert not {305, 306, 33434, 50827} & tags.keys()
    # Exif 2.3: what belongs to its own directory stands there, and the pixels are as before.
    exif = {"ExposureTime": (1, 80), "FNumber": (14, 5), "FocalLength": (25, 2), "ExifVersion": "0230"}
    assert tags[34665] == exif
    np.testing.assert_array_equal(read_tiff(tmp_path / "raw.dng")[0], NUMBERS)


@pytest.mark.skipif(shutil.which("exiftool") is None, reason="needs exiftool (Debian: libimage-exiftool-perl)")
def test_exiftool_finds_nothing_wrong_in_a_negative(tmp_path):
    negative = Negative(model="A", black_dn=64, white_dn=4000, exposure_time_s=0.02, f_number=2.8, focal_length_mm=12.5)
    write_dng(tmp_path / "raw.dng", NUMBERS.shape, rows, ABOUT, negative)
    command = ["exiftool", "-validate", "-warning", "-a", "-n", "-s3", str(tmp_path / "raw.dng")]
    assert subprocess.run(command, capture_output=True, text=True, check=True).stdout == "0 0 0\n"
