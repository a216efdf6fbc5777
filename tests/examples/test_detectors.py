"""Further columns in a built table, and OpenCV's detector against them."""

from pathlib import Path

import cv2
import numpy as np
import pytest
from tolerances import DETECTOR_MEAN_PX, DETECTOR_RMS_PX

import pipeline
from pipeline.files.exr import read_exr
from pipeline.files.tables import read_table

pytestmark = pytest.mark.heavy  # a sharp image of many pixels; tests/exports has further columns of a smaller build
TINY = Path(__file__).parents[1] / "data/tiny_conventional/dataset.usda"
STAGE = """#usda 1.0
(
    defaultPrim = "TinyConventional"
    endTimeCode = 1
    metersPerUnit = 0.001
    startTimeCode = 1
    subLayers = [@{tiny}@]
    timeCodesPerSecond = 24
    upAxis = "Y"
)

over "TinyConventional"
{{
    over "Board"
    {{
        uniform int plen:columns = 5
        uniform int plen:rows = 4
        uniform double plen:squareSize = 1.2
    }}

    over "Rig"
    {{
        over "Camera"
        {{
            uniform int plen:image:samples = 64
            uniform token plen:truth:method = "direct"
            {columns}
        }}

        over "Sensor"
        {{
            uniform double plen:pixelPitch = 0.01
            uniform int2 plen:resolution = (300, 260)
        }}
    }}
}}
"""
COLUMNS = 'uniform token[] plen:truth:columns = ["saddle", "chief"]'


@pytest.fixture(scope="module")
def built(tmp_path_factory):
    """Frame folders of one dataset, without further columns and with two sets of them."""
    folder = tmp_path_factory.mktemp("columns")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("PIPELINE_CACHE", str(folder / "store"))
        for name, columns in (("plain", ""), ("more", COLUMNS)):
            (folder / f"{name}.usda").write_text(STAGE.format(tiny=TINY, columns=columns), encoding="utf-8")
            result = pipeline.build(folder / f"{name}.usda", folder / name, jobs=1, allow_roots=(TINY.parents[3],))
            assert result.exit_code == 0
    return [folder / name / "frames/0001/Rig.Camera" for name in ("plain", "more")]


def test_further_columns_stand_behind_those_of_every_table(built):
    """In an order of their own, however they are written; nothing else of the table changes."""
    plain, more = (read_table(folder / "correspondences.csv") for folder in built)
    names = list(plain.columns)
    assert list(more.columns) == [*names, "chief_x_px", "chief_y_px", "saddle_x_px", "saddle_y_px"]
    assert all(more.columns[name] == plain.columns[name] for name in names)
    assert [line for line in more.comments if line.startswith("saddle: ")]
    assert "chief 20; saddle 20" in more.comments[-1]


def test_opencv_finds_the_saddles(built):
    """findChessboardCornersSB in a rendered image in focus, where J, chief and saddle are within a few hundredths."""
    table, (part,) = read_table(built[1] / "correspondences.csv"), read_exr(built[1] / "image.exr").values()
    (image,) = part.channels.values()
    grey = np.clip(np.rint(255 * image), 0, 255).astype(np.uint8)
    ok, corners = cv2.findChessboardCornersSB(grey, (5, 4), flags=cv2.CALIB_CB_ACCURACY | cv2.CALIB_CB_EXHAUSTIVE)
    assert ok
    assert (table.numbers("blur_xx_px2") + table.numbers("blur_yy_px2") < 1).all()
    saddle = np.stack([table.numbers("saddle_x_px"), table.numbers("saddle_y_px")], axis=1)
    found = corners.reshape(-1, 2)
    apart = found[np.argmin(np.linalg.norm(saddle[:, None] - found, axis=2), axis=1)] - saddle
    assert np.sqrt((apart**2).sum(axis=1).mean()) < DETECTOR_RMS_PX
    assert np.abs(apart.mean(axis=0)).max() < DETECTOR_MEAN_PX
