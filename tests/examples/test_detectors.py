"""Further columns of a built table, and OpenCV's detector against them."""

import cv2
import numpy as np
import pytest
from builds import DATA, made
from tolerances import DETECTOR_MEAN_PX, DETECTOR_RMS_PX

from pipeline.files.exr import read_exr
from pipeline.files.tables import read_table


@pytest.fixture(scope="module")
def frame(tmp_path_factory, common_store):
    out = tmp_path_factory.mktemp("columns")
    made(DATA / "detectors/dataset.usda", out, common_store, allow_roots=(DATA,))
    return out / "frames/0001/Rig.Camera"


def test_further_columns_are_the_last_in_an_order_of_their_own(frame):
    table = read_table(frame / "correspondences.csv")
    assert list(table.columns)[-5:] == ["method", "chief_x_px", "chief_y_px", "saddle_x_px", "saddle_y_px"]
    assert any(line.startswith("saddle: ") for line in table.comments) and "chief 20; saddle 20" in table.comments[-1]


def test_opencv_finds_the_saddles(frame):
    """findChessboardCornersSB in a rendered image in focus, where J, chief and saddle are within a few hundredths."""
    table, (part,) = read_table(frame / "correspondences.csv"), read_exr(frame / "image.exr").values()
    (image,) = part.channels.values()
    grey = np.clip(np.rint(255 * image), 0, 255).astype(np.uint8)
    ok, corners = cv2.findChessboardCornersSB(grey, (5, 4), flags=cv2.CALIB_CB_ACCURACY | cv2.CALIB_CB_EXHAUSTIVE)
    assert ok
    assert (table.numbers("blur_xx_px2") + table.numbers("blur_yy_px2") < 1).all()
    saddles = np.stack([table.numbers("saddle_x_px"), table.numbers("saddle_y_px")], axis=1)
    corners = corners.reshape(-1, 2)
    apart = corners[np.argmin(np.linalg.norm(saddles[:, None] - corners, axis=2), axis=1)] - saddles
    assert np.sqrt((apart**2).sum(axis=1).mean()) < DETECTOR_RMS_PX
    assert np.abs(apart.mean(axis=0)).max() < DETECTOR_MEAN_PX
