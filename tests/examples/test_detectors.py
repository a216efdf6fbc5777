"""Further columns of a built table, and OpenCV's detector against them."""

import cv2
import numpy as np
import pytest
from builds import DATA, made
from stage_text import edited, stage_in
from tolerances import DETECTOR_MEAN_PX, DETECTOR_RMS_PX

from pipeline.files.exr import read_exr
from pipeline.files.tables import read_table

STAGE = DATA / "detectors/dataset.usda"


def test_further_columns_are_the_last_in_an_order_of_their_own(tmp_path, common_store):
    """Of two corners: each saddle takes a second."""
    tiny = (DATA / "tiny_conventional/dataset.usda").as_posix()
    two = ("@../tiny_conventional/dataset.usda@", f"@{tiny}@"), ("columns = 5", "columns = 2"), ("rows = 4", "rows = 1")
    stage = stage_in(tmp_path, edited(STAGE.read_text(encoding="utf-8"), *two))
    file = "frames/0001/Rig.Camera/correspondences.csv"
    table = read_table(made(stage, tmp_path / "out", common_store, allow_roots=(DATA,), targets=[file]).out / file)
    assert list(table.columns)[-5:] == ["method", "chief_x_px", "chief_y_px", "saddle_x_px", "saddle_y_px"]
    assert any(line.startswith("saddle: ") for line in table.comments) and "chief 2; saddle 2" in table.comments[-1]


@pytest.mark.heavy
def test_opencv_finds_the_saddles(tmp_path, common_store):
    """findChessboardCornersSB in a rendered image in focus, where J, chief and saddle are within a few hundredths."""
    frame = made(STAGE, tmp_path, common_store, allow_roots=(DATA,)).out / "frames/0001/Rig.Camera"
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
