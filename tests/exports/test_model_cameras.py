"""A model camera goes through a build and an export, and arrives in OpenCV as what the stage says, to rounding."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from pipeline.app.build import build
from pipeline.exports.export import export
from pipeline.results.output import open_output

ROOT = Path(__file__).resolve().parents[2]
BROWN = [-0.9, 3.0, 0.01, -0.02, 5.0]
SQUARE_MM = 1.4
"""Of the board, as its stage says [mm]."""
EXACT_PX = 1e-9
"""Largest difference of truth and projection [px]: what a build makes of a pinhole is rounding."""
SINGLE_PX = 2e-6
"""Half a unit of a position below 32 px in the single precision that OpenCV takes [px]."""
STAGE = f"""#usda 1.0
(
    defaultPrim = "TinyConventional"
    endTimeCode = 2
    metersPerUnit = 0.001
    startTimeCode = 1
    subLayers = [
        @{(ROOT / "tests/data/tiny_conventional/dataset.usda").as_posix()}@
    ]
    timeCodesPerSecond = 24
    upAxis = "Y"
)

over "TinyConventional"
{{
    over "Rig"
    {{
        over "Camera"
        {{
            uniform double[] plen:camera:distortion = {BROWN}
            uniform token plen:camera:model = "pinhole"
            uniform token plen:truth:method = "direct"
        }}
    }}
}}
"""


@pytest.mark.heavy
def test_the_export_of_a_pinhole_has_its_own_coefficients_and_its_truth_is_their_projection(
    tmp_path: Path, common_store: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PIPELINE_CACHE", str(common_store))
    (tmp_path / "dataset.usda").write_text(STAGE)
    result = build(tmp_path / "dataset.usda", tmp_path / "out", jobs=1, allow_roots=(ROOT,))
    assert result.exit_code == 0, [task.error for task in result.failures]
    output = open_output(tmp_path / "out")
    export(output, ["opencv"], tmp_path / "exports")
    (file,) = (tmp_path / "exports/opencv").glob("*.npz")
    with np.load(file) as arrays:
        found = dict(arrays)
    assert found["dist_coeffs"].ravel().tolist() == BROWN
    sensor_px = found["camera_matrix"][0, 0]
    principal = [[sensor_px, 0, (32 - 1) / 2], [0, sensor_px, (24 - 1) / 2], [0, 0, 1]]
    np.testing.assert_allclose(found["camera_matrix"], principal, rtol=1e-15)
    rows, seen = output.correspondences, 0
    for view, frame in enumerate(found["frames"]):
        first, end = found["starts"][view : view + 2]
        pose = found["rvecs"][view], found["tvecs"][view]
        points = np.round(found["object_points"][first:end].astype(float) / SQUARE_MM) * SQUARE_MM  # once single
        projected = cv2.projectPoints(points, *pose, found["camera_matrix"], found["dist_coeffs"].ravel())[0][:, 0]
        assert np.abs(projected - found["image_points"][first:end, 0]).max() < SINGLE_PX
        own = rows[rows["frame"] == frame]
        exact = np.stack([own["x_px"], own["y_px"]], axis=1)[np.argsort(own["point_id"])]
        assert np.abs(exact - projected[np.argsort(found["ids"][first:end])]).max() < EXACT_PX
        seen += len(exact)
    assert seen == 12
