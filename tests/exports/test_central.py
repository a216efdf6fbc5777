"""Cameras that a pinhole with the coefficients of Brown does not describe: models fitted to the rays of the image."""

import json
from dataclasses import dataclass

import cv2
import numpy as np
import pytest
import yaml
from exports import maps
from exports.pretended import board_mm, same, write_manifest, write_target

from pipeline.exports import export
from pipeline.files.tables import write_table
from pipeline.frames import apply, rigid, rotation_vector
from pipeline.results.output import open_output

SIZE_PX, MATRIX = (320, 240), np.array([[150.0, 0, 161.25], [0, 150.0, 118.5], [0, 0, 1]])
BENT = np.array([0.05, -0.02, 0.01, -0.004])
STOP_MM, WORLD_MM = np.array([0.0, 0.0, 7.0]), np.array([1.0, 2.0, 3.0])
"""Centre of projection in the vision frame; of the stop in the world."""
POSE = rigid(cv2.Rodrigues(np.array([0.2, -0.35, 0.1]))[0] @ np.diag([1.0, -1.0, -1.0]), np.array([3.0, 5.0, 60.0]))
"""Target before the centre of projection."""
FITTED_PX = 1e-6


def pixels() -> np.ndarray:
    """What cv2.fisheye projects of the board, (n, 2)."""
    rvec, tvec = rotation_vector(POSE), POSE[:3, 3]
    return cv2.fisheye.projectPoints(board_mm()[:, None], rvec, tvec, MATRIX, BENT)[0][:, 0]


@dataclass
class FisheyeSight:
    """The camera made ready: all rays meet in one centre, 76 degrees from the axis in the corners."""

    asked: int = 0

    def rays(self, x_px, y_px):
        self.asked += 1
        stop = (cv2.TERM_CRITERIA_COUNT, 60, 0)
        places = np.column_stack([x_px, y_px])[:, None]
        slopes = cv2.fisheye.undistortPoints(places, MATRIX, BENT, criteria=stop)[:, 0]
        ahead = np.column_stack([slopes, np.ones(len(slopes))])
        return maps.lit_rays(np.asarray(x_px), np.asarray(y_px), STOP_MM - STOP_MM[2] * ahead, ahead)


@pytest.fixture(scope="module")
def wide(tmp_path_factory):
    """A camera in which no pinhole fits, as a build writes it."""
    folder = tmp_path_factory.mktemp("wide") / "out"
    camera, view = folder / "cameras/Wide", folder / "frames/0001/Wide"
    camera.mkdir(parents=True), view.mkdir(parents=True)
    lens = {"entrance_pupil": {"z_mm": 6.0}}
    figures = {"principal_distance_px": 148.0, "optical_axis_px": [160.0, 119.0], "near_far_mm": [40.0, 90.0]}
    record = {"resolution": SIZE_PX, "pixel_pitch_mm": 0.01, "pinhole": None, "lens": lens, **figures}
    (camera / "camera.json").write_text(json.dumps(record))
    to_stop = rigid(np.eye(3), STOP_MM)
    targets = {"Board": {"camera_from_target": (to_stop @ POSE).tolist(), "pinhole": None}}
    poses = {"camera_from_world": rigid(np.eye(3), WORLD_MM).tolist(), "pinhole": None, "targets": targets}
    (view / "poses.json").write_text(json.dumps(poses))
    places, count = pixels(), len(board_mm())
    columns = {"frame": [1] * count, "camera": ["Wide"] * count, "target": ["Board"] * count}
    columns |= {"point_id": list(range(count)), "microlens_k": [""] * count, "microlens_l": [""] * count}
    columns |= {"microlens_type": [""] * count, "x_px": places[:, 0], "y_px": places[:, 1]}
    columns |= {"visibility": [1.0] * count, "rho_px": [0.1] * count, "method": ["direct"] * count}
    write_table(view / "correspondences.csv", ["by a fisheye"], columns)
    write_target(folder, 10.0)
    write_manifest(folder)
    return open_output(folder)


@pytest.fixture
def exported(wide, tmp_path, monkeypatch):
    monkeypatch.setattr(export, "sight_of", lambda out, name: FisheyeSight())
    return lambda name: export.export(wide, [name], tmp_path)[0]


def test_ros_has_an_equidistant_camera_where_no_pinhole_fits(exported):
    info = yaml.safe_load((exported("ros") / "Wide.yaml").read_text())
    assert info["distortion_model"] == "equidistant" and info["distortion_coefficients"]["cols"] == 4
    k, d = np.reshape(info["camera_matrix"]["data"], (3, 3)), np.array(info["distortion_coefficients"]["data"])
    before = apply(POSE, board_mm())[:, None]
    same(cv2.fisheye.projectPoints(before, np.zeros(3), np.zeros(3), k, d)[0][:, 0], pixels(), FITTED_PX)


def test_a_pinhole_that_leaves_next_to_nothing_asks_for_no_rays(output, tmp_path, monkeypatch):
    sight = FisheyeSight()
    monkeypatch.setattr(export, "sight_of", lambda out, name: sight)
    export.export(output, ["ros"], tmp_path)
    assert sight.asked == 0
