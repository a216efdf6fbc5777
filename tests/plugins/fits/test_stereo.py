"""Claim: of the corners of a real stereo camera `pipeline calibrate` finds the two cameras that OpenCV finds, and how
they stand to each other.
"""

import cv2
import numpy as np
import pytest
from places import DATA

from pipeline.camera.figures.equivalent_pinhole import paraxial_pinhole
from pipeline.plugins.fits.calibration import calibrate
from pipeline.plugins.fits.free_numbers import FreeStage
from pipeline.plugins.fits.observations import Stated
from pipeline.plugins.fits.predicted_rows import points_of
from pipeline.plugins.fits.twin import Twin, document

CAMERA = ("Lens/Stop.plen:focalLength", "Sensor.plen:offset", "Camera.plen:camera:distortion")
FREE = [f"{side}/{name}" for side in ("Left", "Right") for name in CAMERA]
PLACED = ["Right.xformOp:rotateXYZ", "Right.xformOp:translate"]
IN_PIXELS = np.array([*2 * [*3 * [True], *5 * [False]], *6 * [False]])
"""Free numbers that are lengths on the sensor, or nearly: focal lengths and principal points."""


def of_the_stage(twin: Twin) -> np.ndarray:
    """Of each camera the principal distance and point [px] and k1, k2, p1, p2, k3; then the turn [deg] and the shift
    [mm] that take a point from the left camera's frame to that of the right one, (22,).
    """
    numbers = document(twin)["numbers"]
    dataset = twin.stage.at(np.array([each["after"] - each["before"] for each in numbers]))
    distortion = [each["after"] for each in numbers if "distortion" in each["name"]]
    left, right = (np.array(dataset.frames[0].camera_from_world[entry.name]) for entry in dataset.cameras)
    right_from_left = right @ np.linalg.inv(left)
    pinholes = [paraxial_pinhole(entry.camera)[:3] for entry in dataset.cameras]
    turn = np.degrees(cv2.Rodrigues(right_from_left[:3, :3])[0].ravel())
    return np.concatenate([pinholes[0], distortion[:5], pinholes[1], distortion[5:], turn, right_from_left[:3, 3]])


def of_opencv(twin: Twin) -> np.ndarray:
    """The same numbers by OpenCV, which adjusts both cameras and all boards at once."""
    rows, start = twin.observations, np.array([[550.0, 0, 320], [0, 550, 240], [0, 0, 1]])
    frames = np.unique(rows.frame)
    corners = [
        [rows.x_px[(rows.camera == name) & (rows.frame == frame)].astype(np.float32) for frame in frames]
        for name in ("Left.Camera", "Right.Camera")
    ]
    board = points_of(twin.stage.nominal)["Board"].position_mm.astype(np.float32)
    _, left, left_k, right, right_k, turn, shift_mm, *_ = cv2.stereoCalibrate(
        [board] * len(frames),
        *corners,
        start.copy(),
        np.zeros(5),
        start.copy(),
        np.zeros(5),
        (640, 480),
        flags=cv2.CALIB_FIX_ASPECT_RATIO | cv2.CALIB_USE_INTRINSIC_GUESS,
        criteria=(3, 1000, 1e-16),
    )
    cameras = [np.array([matrix[0, 0], *matrix[:2, 2], *k.ravel()]) for matrix, k in ((left, left_k), (right, right_k))]
    return np.concatenate([*cameras, np.degrees(cv2.Rodrigues(turn)[0].ravel()), shift_mm.ravel()])


@pytest.mark.heavy
def test_opencv_finds_the_same_two_cameras_at_the_same_distance():
    """As near as fits end: to a hundredth of their deviations."""
    stage = FreeStage(DATA / "opencv_stereo/dataset.usda", [*FREE, *PLACED])
    twin = calibrate(stage, [DATA / "opencv_stereo/corners.csv"], Stated(sigma_px=0.15))
    assert twin.solution.converged
    deviation = twin.solution.deviation / np.where(IN_PIXELS, stage.nominal.cameras[0].camera.sensor.pitch_mm, 1.0)
    assert (np.abs(of_the_stage(twin) - of_opencv(twin)) < 1e-2 * deviation).all()
