"""docs/reading.md names every file that a build writes, and OpenCV finds in them what the documents promise."""

import json
from pathlib import Path

import cv2
import numpy as np
import pytest
from builds import cells
from scipy.optimize import least_squares

from pipeline.files.exr import read_exr
from pipeline.files.tiff import read_tiff
from pipeline.frames import rigid, rotation_vector
from pipeline.products.poses.make import poses
from pipeline.products.poses.params import PosedFrame

PAGE = (Path(__file__).resolve().parents[2] / "docs/reading.md").read_text(encoding="utf-8")
TURN_DEG, BOARD_MM = 12.0, 430.0
"""Angle between the cameras of the pair, and their distance from the board [mm]: tests/data/reading."""


@pytest.fixture(scope="module")
def built(builds: Path) -> Path:
    return builds / "build/02_plenoptic"


def test_the_page_names_every_file_of_the_folder(built: Path) -> None:
    names = {path.name for path in built.rglob("*") if path.is_file()} - {"Board.json", "Board.png"}
    assert {name for name in names if name not in PAGE} == set()
    assert {"positions.exr", "rays.exr", "micro_image_outlines.csv", "baselines.csv", "manifest.json"} <= names


def test_a_raw_image_has_the_mean_of_the_linear_one(built: Path) -> None:
    """As the page computes it, by the number of electrons and pixels."""
    folder = built / "frames/0001/Rig.Camera"
    numbers, about = read_tiff(folder / "raw.tiff")
    light = read_exr(folder / "image.exr")["image"].channels["Y"].astype(float)
    expected = 60 + 0.4 * np.minimum(light * 0.7 * 9000, 9000)
    spread = np.sqrt(0.4 * (expected - 60) + 0.4**2 * 4 + 1 / 12)
    assert about["photons_at_relative_irradiance_1"] * 0.6 == pytest.approx(6300, rel=1e-12)
    assert abs(np.mean(numbers - expected)) < 5 * np.sqrt(np.sum(spread**2)) / light.size
    assert abs(np.mean(((numbers - expected) / spread) ** 2) - 1) < 5 * np.sqrt(2 / light.size)


def read(path: Path) -> dict:
    return json.loads(path.read_text(encoding="utf-8"))


def numbers(table: list[dict[str, str]], *names: str) -> np.ndarray:
    return np.array([[float(row[name]) for name in names] for row in table])


def matrix_of(model: dict) -> np.ndarray:
    f, (x, y) = model["principal_distance_px"], model["principal_point_px"]
    return np.array([[f, 0, x], [0, f, y], [0, 0, 1]])


def truth(built: Path, name: str) -> tuple[np.ndarray, np.ndarray]:
    """Target points (n, 3) [mm] and their exact positions (n, 2) [px]."""
    table = cells(built / f"frames/0001/{name}/correspondences.csv")
    return numbers(table, "target_x_mm", "target_y_mm", "target_z_mm"), numbers(table, "x_px", "y_px")


def test_opencv_projects_points_to_their_exact_positions(built: Path) -> None:
    """The board faces the left camera: within the stated residual, a hundredth of what the stop leaves."""
    camera = read(built / "cameras/Left.Camera/camera.json")
    pose = read(built / "frames/0001/Left.Camera/poses.json")["targets"]["Board"]
    points, exact = truth(built, "Left.Camera")
    for model in (camera["pinhole"], camera["pinhole"]["with_distortion"]):
        distortion = np.array(model.get("distortion", [0.0] * 5))
        poses = [np.array(pose["pinhole"]["tvec"]), np.array(pose["camera_from_target"])[:3, 3]]
        off = []
        for tvec in poses:
            pixels = cv2.projectPoints(points, np.array(pose["pinhole"]["rvec"]), tvec, matrix_of(model), distortion)
            off.append(np.hypot(*(pixels[0][:, 0] - exact).T))
        assert len(exact) == 6 and off[0].max() <= model["residual_px"]["max"]
        assert off[1].max() > 100 * model["residual_px"]["max"] and off[1].max() > 0.03


def solved(points: np.ndarray, exact: np.ndarray, *model_and_start: np.ndarray) -> np.ndarray:
    """The pose with which OpenCV projects points to their positions; the start is rvec and tvec."""
    matrix, distortion, start = model_and_start

    def off(pose: np.ndarray) -> np.ndarray:
        return (cv2.projectPoints(points, pose[:3], pose[3:], matrix, distortion)[0][:, 0] - exact).ravel()

    pose = least_squares(off, start, method="lm", x_scale="jac", xtol=1e-15, ftol=1e-15, gtol=1e-15).x
    return rigid(cv2.Rodrigues(pose[:3])[0], pose[3:])


def test_baselines_are_what_opencv_finds_from_the_exact_positions(built: Path) -> None:
    """By the poses of both cameras that OpenCV solves for; the baseline between the stops is another by 1 mm."""
    (stated,) = [
        row
        for row in cells(built / "baselines.csv")
        if (row["frame"], row["camera"], row["second_camera"]) == ("1", "Left.Camera", "Right.Camera")
    ]
    found = []
    for name in ("Left.Camera", "Right.Camera"):
        model = read(built / f"cameras/{name}/camera.json")["pinhole"]["with_distortion"]
        pose = read(built / f"frames/0001/{name}/poses.json")["targets"]["Board"]
        start = np.append(pose["pinhole"]["rvec"], np.array(pose["camera_from_target"])[:3, 3])
        found.append(solved(*truth(built, name), matrix_of(model), np.array(model["distortion"]), start))
    between = found[1] @ np.linalg.inv(found[0])
    t, stop_t = (np.array([float(stated[f"{kind}_t_{axis}_mm"]) for axis in "xyz"]) for kind in ("pinhole", "stop"))
    np.testing.assert_allclose(between[:3, 3], t, rtol=0, atol=0.02)
    assert np.linalg.norm(stop_t - t) == pytest.approx(2 * 5.935 * np.sin(np.deg2rad(TURN_DEG / 2)), abs=0.01)
    rvec = [float(stated[f"rvec_{axis}_rad"]) for axis in "xyz"]
    np.testing.assert_allclose(rotation_vector(between), rvec, rtol=0, atol=5e-5)
    stop_mm = 2 * BOARD_MM * np.sin(np.deg2rad(TURN_DEG / 2))  # a chord of the circle about the board
    assert float(stated["stop_baseline_mm"]) == pytest.approx(stop_mm, rel=1e-9)
    assert float(stated["pinhole_baseline_mm"]) == pytest.approx(np.linalg.norm(t), rel=1e-12)


def test_poses_of_the_world_lead_to_both_centres(built: Path) -> None:
    """The pinhole stands on the axis of the camera, its stated distance before the stop, wherever the rig is."""
    poses = read(built / "frames/0001/Right.Camera/poses.json")
    centre = read(built / "cameras/Right.Camera/camera.json")["pinhole"]["centre_mm"]
    place = np.array(poses["pinhole"]["world_from_pinhole"])[:3, 3]
    angle = np.deg2rad(TURN_DEG)
    stop, axis = (
        np.array([np.sin(angle), 0, np.cos(angle) - 1]) * BOARD_MM,
        -np.array([np.sin(angle), 0, np.cos(angle)]),
    )
    np.testing.assert_allclose(place, stop + centre[2] * axis, rtol=0, atol=1e-9)
    assert centre[:2] == [0, 0] and centre[2] == pytest.approx(-5.93, abs=0.01)
    assert poses["targets"]["Board"].keys() == {"camera_from_target", "pinhole"}


def test_a_camera_without_a_pinhole_has_poses_to_its_stop_alone() -> None:
    still = np.eye(4).tolist()
    content = poses("Left", PosedFrame(number=1, camera_from_world=still, targets={"Board": still}), None)
    assert content["pinhole"] is None and content["targets"]["Board"] == {"camera_from_target": still, "pinhole": None}
