"""What poses of a target tell a calibration is what OpenCV's calibrations of noisy corners find."""

import re
from pathlib import Path

import cv2
import numpy as np
import pytest
from laws import rigs
from laws.solving import rig_of, solved

import pipeline
from pipeline.app.authoring.new_dataset import new_dataset
from pipeline.app.authoring.poses import BoardPose, CameraField, Wish, poses_that_fill
from pipeline.camera.focusing.depth_of_field import focused
from pipeline.camera.focusing.focus_request import FocusRequest, stopped_down
from pipeline.camera.parts.camera import Camera, Sensor
from pipeline.fits.field import field_rays
from pipeline.folders import shipped_folder
from pipeline.frames import apply, rigid
from pipeline.plugins.fits.best_poses import best_of, predicted
from pipeline.scene.load import load
from pipeline.targets.patterns.checkerboard import Checkerboard
from pipeline.targets.target import Target


def filled(camera: Camera, board: Target, wish: Wish) -> tuple[CameraField, list[BoardPose]]:
    """A camera before a board, and its poses by real rays."""
    field = CameraField(camera=camera, target=board, wish=wish, vision_from_first=np.eye(4))
    return field, list(poses_that_fill([field]))


def found_by_opencv(field: CameraField, poses: list[BoardPose], tries: int) -> np.ndarray:
    """Standard deviations of f, x and y of the centre by calibrations of exact corners with 0.05 px of noise."""
    board, rng, rows = field.target.pattern, np.random.default_rng(1), []
    exact = [solved(rig_of(field.camera), board, pose.vision_from_target).solutions for pose in poses]
    objects = [(board.points_mm()[found.point] * (1, -1, 0)).astype(np.float32) for found in exact]
    f, (x, y) = field.principal_distance_px, field.middle_px
    size = field.camera.sensor.width_px, field.camera.sensor.height_px
    flags = cv2.CALIB_USE_INTRINSIC_GUESS | cv2.CALIB_FIX_ASPECT_RATIO | cv2.CALIB_ZERO_TANGENT_DIST
    for _ in range(tries):
        corners = [np.stack([one.x_px, one.y_px], axis=1) for one in exact]
        noisy = [(one + rng.normal(0, 0.05, one.shape)).astype(np.float32) for one in corners]
        guess = np.array([[f, 0, x], [0, f, y], [0, 0, 1.0]])
        fixed = flags | cv2.CALIB_FIX_K2 | cv2.CALIB_FIX_K3
        _, matrix, *_ = cv2.calibrateCamera(objects, noisy, size, guess, np.zeros(5), flags=fixed)
        rows.append((matrix[0, 0], matrix[0, 2], matrix[1, 2]))
    return np.std(rows, axis=0, ddof=1)


@pytest.mark.parametrize(("stop_mm", "tries"), [(8.0, 60), pytest.param(1.0, 200, marks=pytest.mark.heavy)])
def test_the_uncertainty_of_a_calibration_is_what_opencv_finds(stop_mm, tries):
    """Within three sigma of a standard deviation of so many tries: 28 and 15 percent; in a shallow and a deep field."""
    camera = rigs.conventional(stop_mm, 640, 480, 0.03)
    board = Target(Checkerboard(columns=7, rows=4, square_mm=4.0))
    field, poses = filled(camera, board, Wish(count=8, blur_px=1.0))
    assert (field.steepest_deg < 20) == (stop_mm == 8.0)
    (known,) = predicted([field], poses)
    found = found_by_opencv(field, poses, tries)
    expected = (known.principal_distance_px, *known.principal_point_px)
    np.testing.assert_allclose(expected, found, rtol=3 / np.sqrt(2 * (tries - 1)), atol=0)


def test_a_new_dataset_says_how_well_its_poses_tell_the_camera(tmp_path):
    """Before, tilts of ten such poses were 4 to 23 degrees and f known to 1.2 %: 151 px by the same law."""
    parts, told = ("rigs/conventional_100mm.usda", "targets/charuco_8x5.usda"), list[str]()
    new_dataset(tmp_path / "d.usda", *map(Path, parts), Wish(count=10, fit=True), None, told.append)
    share, f_px = map(float, re.search(r"knows f to (\S+) % \((\S+) px\)", "\n".join(told)).groups())
    assert f_px < 100 and share == pytest.approx(100 * f_px / 12809, rel=0.05)


def projected_by_opencv(field: CameraField, poses: list[BoardPose], tries: int) -> float:
    """Root mean square error of projections by calibrations of noisy corners, against exact rays over the image and the
    depth of field [px]; the poses of all views carry the rays' points to the camera, which is in their mean.
    """
    exact = [solved(rig_of(field.camera), field.target.pattern, pose.vision_from_target).solutions for pose in poses]
    rays, rng, wrong = field_rays(pipeline.ready(field.camera)), np.random.default_rng(2), []
    points = np.concatenate([rays.points(z_mm)[::29] for z_mm in field.depth_mm])
    objects = [field.points_mm[rows.point].astype(np.float32) for rows in exact]
    f, (x, y) = field.principal_distance_px, field.middle_px
    size, none = (field.camera.sensor.width_px, field.camera.sensor.height_px), np.zeros(3)
    for _ in range(tries):
        corners = [(rows.xy_px + rng.normal(0, 0.05, rows.xy_px.shape)).astype(np.float32) for rows in exact]
        guess, flags = np.array([[f, 0, x], [0, f, y], [0, 0, 1.0]]), cv2.CALIB_USE_INTRINSIC_GUESS
        _, matrix, bent, turns, shifts = cv2.calibrateCamera(objects, corners, size, guess, np.zeros(5), flags=flags)
        carried = []
        for turn, shift, pose in zip(turns, shifts, poses, strict=True):
            there = rigid(cv2.Rodrigues(turn)[0], shift.ravel()) @ np.linalg.inv(pose.vision_from_target)
            carried.append(apply(there, points))
        images = cv2.projectPoints(np.mean(carried, axis=0), none, none, matrix, bent)[0][:, 0]
        wrong.append(((images - np.tile(rays.x_px[::29], (2, 1))) ** 2).sum(axis=1).mean())
    return float(np.sqrt(np.mean(wrong)))


@pytest.mark.heavy
def test_the_best_of_many_poses_project_better_by_opencv_s_calibrations_than_the_first_and_than_any_six():
    """A wide field, whose coefficients corners do tell: 1.7 times better than the first six and 2.7 than six at random
    were found; asked for is half of the gain.
    """
    lens = load(shipped_folder("stages") / "lenses/retrofocus_28mm_leica.usda").lens.prescription
    sensor = Sensor(width_px=640, height_px=480, pitch_mm=0.045)
    camera = stopped_down(focused(FocusRequest(prescription=lens, sensor=sensor, focus_distance_mm=400.0)), 8.0)
    board = Target(Checkerboard(columns=8, rows=5, square_mm=30.0))
    field, poses = filled(camera, board, Wish(count=6, of=12))
    best = best_of([field], poses, 6, lambda line: None)
    rng = np.random.default_rng(3)
    others = [[poses[i] for i in rng.choice(len(poses), 6, replace=False)] for _ in range(4)]
    wrong = [projected_by_opencv(field, some, 20) for some in (best, poses[:6], *others)]
    print("projections wrong by px rms: best, first, random:", np.round(wrong, 3))

    assert wrong[0] < wrong[1] / 1.3
    assert wrong[0] < np.mean(wrong[2:]) / 1.5
