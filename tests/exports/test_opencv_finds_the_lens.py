"""OpenCV calibrates from the export of a real lens: it finds the pinhole, the pupil and all poses as they were."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from pipeline.app.build import build
from pipeline.built.output import open_output
from pipeline.exports.export import export

ROOT = Path(__file__).resolve().parents[2]
FLAGS = (
    cv2.CALIB_FIX_PRINCIPAL_POINT
    | cv2.CALIB_FIX_ASPECT_RATIO
    | cv2.CALIB_ZERO_TANGENT_DIST
    | cv2.CALIB_FIX_K2
    | cv2.CALIB_FIX_K3
    | cv2.CALIB_USE_INTRINSIC_GUESS
)
"""As in examples/01_conventional/calibrate.py: a field of 3 degrees cannot tell more."""
FACING = (1, 2)
"""Frames whose boards stand in focus as a whole: the stated residual is that of planes parallel to the sensor."""
TILTED_PX = 0.01
"""On tilted boards out of focus J moves on by the bias of `two-plane`, outputs.md says: poses take it up."""
STOP = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_COUNT, 1000, 1e-14)
STAGE = f"""#usda 1.0
(
    defaultPrim = "Conventional"
    endTimeCode = 6
    metersPerUnit = 0.001
    startTimeCode = 1
    subLayers = [
        @{(ROOT / "examples/01_conventional/dataset.usda").as_posix()}@
    ]
    timeCodesPerSecond = 24
    upAxis = "Y"
)

over "Conventional"
{{
    over "Rig"
    {{
        over "Camera"
        {{
            uniform int plen:image:samples = 4
        }}
    }}
}}
"""


@pytest.fixture(scope="module")
def output(tmp_path_factory, common_store):
    folder = tmp_path_factory.mktemp("lens")
    (folder / "stage.usda").write_text(STAGE)
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("PIPELINE_CACHE", str(common_store))
        result = build(folder / "stage.usda", folder / "out", allow_roots=[ROOT], jobs=1)
    assert result.exit_code == 0
    return open_output(folder / "out")


def test_principal_distance_pupil_and_poses_are_found_within_the_residual(output, tmp_path):
    (folder,) = export(output, ["opencv"], tmp_path)
    data = np.load(folder / "Rig.Camera.npz")
    points, pixels = (np.split(data[name], data["starts"][1:-1]) for name in ("object_points", "image_points"))
    width, height = data["image_size"].tolist()
    guess = np.array([[1e4, 0, (width - 1) / 2], [0, 1e4, (height - 1) / 2], [0, 0, 1]])
    rms, matrix, distortion, turns, shifts = cv2.calibrateCamera(
        points, pixels, (width, height), guess, None, flags=FLAGS, criteria=STOP
    )
    residual = output.camera.pinhole_with_distortion
    assert rms < residual.rms_px
    assert abs(matrix[0, 0] / residual.principal_distance_px - 1) < residual.rms_px / 10  # 20 px of leverage
    for view, turn, shift, rvec, tvec, board in zip(
        output.camera.views, turns, shifts, data["rvecs"], data["tvecs"], points, strict=True
    ):
        known = cv2.projectPoints(board, rvec, tvec, data["camera_matrix"], data["dist_coeffs"])[0]
        found = cv2.projectPoints(board, turn, shift, matrix, distortion)[0]
        off = np.hypot(*(found - known)[:, 0].T).max()
        assert off < (residual.max_px if view.frame in FACING else TILTED_PX)
        to_stop = view.poses.camera_from_target["Board"]
        point = board[0, 0] @ cv2.Rodrigues(turn)[0].T + shift.ravel()
        pupil_mm = (to_stop @ [*output.targets["Board"].points_mm[0], 1])[:3] - point
        np.testing.assert_allclose(pupil_mm, output.camera.pinhole.centre_mm, rtol=0, atol=0.01)
