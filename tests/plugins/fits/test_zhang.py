"""Claim: of the corners of five images of a real camera `pipeline calibrate` finds the numbers that Zhang printed.

Z. Zhang, "A Flexible New Technique for Camera Calibration", IEEE PAMI 22 (2000), Microsoft Research MSR-TR-98-71. His
model has two coefficients of distortion, as here, and a skew and an aspect, which he found to be 0.2 px and 1.00004.
"""

import cv2
import numpy as np
import pytest
from places import DATA

from pipeline.camera.figures.equivalent_pinhole import pinhole
from pipeline.plugins.fits.calibration import calibrate
from pipeline.plugins.fits.free_numbers import FreeStage
from pipeline.plugins.fits.observations import Stated
from pipeline.plugins.fits.predicted_rows import points_of
from pipeline.plugins.fits.twin import Twin

ZHANG = np.array([832.5, 303.959, 206.585, -0.228601, 0.190353])
"""Principal distance and point [px], k1, k2, as printed on the page of the data."""
FREE = ("plen:camera:sensorDistance", "plen:camera:distortion[0]", "plen:camera:distortion[1]")


@pytest.fixture(scope="module")
def twin() -> Twin:
    free = [*(f"Rig/Camera.{name}" for name in FREE), "Rig/Sensor.plen:offset"]
    stage = FreeStage(DATA / "zhang_1998/dataset.usda", free)
    return calibrate(stage, [DATA / "zhang_1998/corners.csv"], Stated(sigma_px=0.24))


def numbers(twin: Twin) -> np.ndarray:
    camera = pinhole(twin.stage.at(twin.solution.correction).cameras[0].camera).distorted
    return np.array([camera.principal_distance_px, *camera.principal_point_px, *camera.distortion[:2]])


@pytest.mark.heavy
def test_a_real_camera_has_the_numbers_that_zhang_printed(twin):
    """His deviations with these corners, 1.4 px of the distance and 0.7 px of the point, are mostly common to both."""
    assert twin.solution.converged
    assert (np.abs(numbers(twin) - ZHANG) < [0.3, 0.25, 0.25, 0.001, 0.003]).all()


@pytest.mark.heavy
def test_opencv_finds_the_same_real_camera(twin):
    """As near as a fit comes that ends when no number moves by more than a thousandth of its deviation."""
    seen = twin.observations
    points = points_of(twin.stage.nominal)["Board"].position_mm.astype(np.float32)
    frames = [seen.frame == frame for frame in range(1, 6)]
    _, matrix, distortion, _, _, deviations, *_ = cv2.calibrateCameraExtended(
        [points[seen.point_id[rows]] for rows in frames],
        [seen.x_px[rows].astype(np.float32) for rows in frames],
        (640, 480),
        np.array([[800.0, 0, 320], [0, 800, 240], [0, 0, 1]]),
        None,
        flags=cv2.CALIB_FIX_ASPECT_RATIO
        | cv2.CALIB_ZERO_TANGENT_DIST
        | cv2.CALIB_FIX_K3
        | cv2.CALIB_USE_INTRINSIC_GUESS,
        criteria=(3, 500, 1e-16),
    )
    theirs = np.array([matrix[0, 0], *matrix[:2, 2], *distortion.ravel()[:2]])
    assert (np.abs(numbers(twin) - theirs) < 1e-3 * deviations.ravel()[1:6]).all()
