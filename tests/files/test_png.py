"""PNG files return the pixels that went in."""

from pathlib import Path

import numpy as np
import pytest

from pipeline.files.png import read_png, write_png

rng = np.random.default_rng(0)
RGB = rng.integers(0, 256, (37, 53, 3), dtype=np.uint8)
GREY = rng.integers(0, 256, (37, 53), dtype=np.uint8)
RAW = rng.integers(0, 65536, (37, 53), dtype=np.uint16)


@pytest.mark.parametrize("image", [RGB, GREY, RAW, RAW[::-1], RAW.T, RGB[::2, ::-1]])
def test_pixels_return(tmp_path: Path, image: np.ndarray) -> None:
    write_png(tmp_path / "named-by-a-digest", image)
    read = read_png(tmp_path / "named-by-a-digest")
    assert read.dtype == image.dtype
    np.testing.assert_array_equal(read, image)


@pytest.mark.parametrize("image", [RGB, GREY, RAW])
def test_opencv_reads_the_same_pixels(tmp_path: Path, image: np.ndarray) -> None:
    cv2 = pytest.importorskip("cv2")
    write_png(tmp_path / "x.png", image)
    read = cv2.imread(str(tmp_path / "x.png"), cv2.IMREAD_UNCHANGED)
    np.testing.assert_array_equal(read[..., ::-1] if image.ndim == 3 else read, image)


@pytest.mark.parametrize(
    "image",
    [np.zeros((3, 3)), np.zeros((3, 3, 4), np.uint8), np.zeros((3, 3, 3), np.uint16), np.zeros((0, 3), np.uint8)],
)
def test_other_images_are_refused(tmp_path: Path, image: np.ndarray) -> None:
    with pytest.raises(ValueError, match="no PNG"):
        write_png(tmp_path / "x.png", image)
