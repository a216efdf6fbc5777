"""A wide lens whose pupil moves with the angle, and boards that leave corners out: calibrations find the pinhole of the
rows, which exports state, and not that of the whole image, 0.06 % and 0.35 mm away.
"""

import json
from itertools import pairwise
from pathlib import Path

import cv2
import numpy as np
import pycolmap
import pytest
from builds import DATA, made
from places import ROOT
from plugins.formats.pretended import F_PX, Scene, write_build
from stage_text import head, over_tiny, stage_in

from pipeline.camera.figures.equivalent_pinhole import Sightings
from pipeline.exports import gathering
from pipeline.exports.export import Request, export
from pipeline.exports.row_pinhole import row_pinhole
from pipeline.results.output import open_output
from pipeline.results.records import BuiltPinhole

LENS = DATA.parents[1] / "stages/lenses/retrofocus_28mm_leica.usda"
SIZE_PX, FRAMES = (100, 70), range(1, 11)
NEAR_F, NEAR_MM = 5e-5, 0.02
"""Relative and in mm, a tenth of what the two pinholes are apart: k3, p1, p2 and the principal point, of which ours
has none or others, move f and centre by half of that.
"""
GUESS = cv2.CALIB_USE_INTRINSIC_GUESS | cv2.CALIB_FIX_ASPECT_RATIO
CENTRED = GUESS | cv2.CALIB_FIX_PRINCIPAL_POINT | cv2.CALIB_ZERO_TANGENT_DIST
FLOAT32_PX = 5e-6
"""Rounding of single precision at 100 px."""
STOP = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_COUNT, 1000, 1e-15)
CAMERA = """
    def Xform "{name}"
    {{
        double xformOp:rotateY = {turn}
        double3 xformOp:translate = ({x}, 0, 0)
        uniform token[] xformOpOrder = ["xformOp:translate", "xformOp:rotateY"]

        def Camera "Camera" (
            prepend apiSchemas = ["PlenCameraAPI"]
        )
        {{
            rel plen:camera:lens = </Wide/Lens>
            rel plen:camera:sensor = </Wide/Sensor>
            uniform double plen:camera:focusDistance = 700
            uniform int plen:image:samples = 4
        }}
    }}
"""


def stage() -> str:
    """Two cameras of 28 mm at f/8, 120 mm apart and toed in, before ten poses of a board at 0.6 to 0.83 m."""
    random = np.random.default_rng(5)
    turns, places = "", ""
    for frame in FRAMES:
        if frame % 2:
            axis, half = random.uniform(-1, 1, 3) * [1, 1, 0.3], np.deg2rad(random.uniform(10, 30)) / 2
            place = np.array([*random.uniform(-1, 1, 2) * [0.15, 0.12], -1]) * random.uniform(600, 830)
        else:  # across the axis, so that boards cover the image evenly
            axis, place = axis * [-1, -1, 1], place * [-1, -1, 1]
        turn = [np.cos(half), *np.sin(half) * axis / np.linalg.norm(axis)]
        turns += f"            {frame}: ({', '.join(map(repr, map(float, turn)))}),\n"
        places += f"            {frame}: ({', '.join(map(repr, map(float, place)))}),\n"
    cameras = CAMERA.format(name="Left", turn=-5, x=-60) + CAMERA.format(name="Right", turn=5, x=60)
    return (
        head("Wide", end=FRAMES[-1])
        + f"""
def PlenDataset "Wide"
{{
    rel plen:cameras = [</Wide/Left/Camera>, </Wide/Right/Camera>]
    uniform int plen:seed = 3
    rel plen:targets = </Wide/Board>
{cameras}
    def "Lens" (
        prepend references = @{LENS}@
    )
    {{
        over "Stop"
        {{
            uniform double plen:semiDiameter = 2.2
        }}
    }}

    def PlenSensor "Sensor"
    {{
        uniform double plen:pixelPitch = 0.3
        uniform int2 plen:resolution = {SIZE_PX}
    }}

    def PlenCheckerboard "Board"
    {{
        uniform int plen:columns = 11
        uniform int plen:rows = 8
        uniform double plen:squareSize = 30
        quatd xformOp:orient.timeSamples = {{
{turns}        }}
        double3 xformOp:translate.timeSamples = {{
{places}        }}
        uniform token[] xformOpOrder = ["xformOp:translate", "xformOp:orient"]
    }}
}}
"""
    )


@pytest.fixture(scope="module")
def exported(tmp_path_factory, common_store):
    folder = tmp_path_factory.mktemp("wide")
    (folder / "stage.usda").write_text(stage())
    made(folder / "stage.usda", folder / "out", common_store, allow_roots=[ROOT])
    export(open_output(folder / "out"), ["opencv", "colmap"], folder)
    return folder


def found_in(data, flags):
    """Residual, focal length and poses by OpenCV from the arrays of an export."""
    points, pixels = (np.split(data[name], data["starts"][1:-1]) for name in ("object_points", "image_points"))
    guess = np.array([[100.0, 0, (SIZE_PX[0] - 1) / 2], [0, 100.0, (SIZE_PX[1] - 1) / 2], [0, 0, 1]])
    rms, matrix, _, turns, shifts = cv2.calibrateCamera(
        points, pixels, SIZE_PX, guess, None, flags=flags, criteria=STOP
    )
    return rms, matrix[0, 0], zip(turns, shifts, strict=True)


@pytest.mark.heavy
@pytest.mark.parametrize("flags", [GUESS, CENTRED])
@pytest.mark.parametrize("camera", ["Left.Camera", "Right.Camera"])
def test_opencv_finds_the_focal_length_the_poses_and_the_residual_of_the_rows(exported, camera, flags):
    data = np.load(exported / f"opencv/{camera}.npz")
    rms, f, poses = found_in(data, flags)
    assert abs(f / data["camera_matrix"][0, 0] - 1) < NEAR_F
    stated = json.loads((exported / "opencv/export.json").read_text())["pinholes_of_rows"][camera]
    assert 0.5 * stated["residual_px"]["rms"] < rms < stated["residual_px"]["rms"] + FLOAT32_PX
    middle = np.array([150.0, 105.0, 0.0])  # of the board, from point 0
    for (turn, shift), rvec, tvec in zip(poses, data["rvecs"], data["tvecs"], strict=True):
        found, ours = (cv2.Rodrigues(r)[0] @ middle + np.ravel(t) for r, t in ((turn, shift), (rvec, tvec)))
        assert np.linalg.norm((found - ours)[0 if flags == CENTRED else 2 :]) < NEAR_MM  # c moves with x and y


@pytest.mark.heavy
def test_opencv_finds_the_baseline_of_the_rows(exported):
    data = np.load(exported / "opencv/stereo-Left.Camera-Right.Camera.npz")
    views = [np.split(data[name], data["starts"][1:-1]) for name in ("object_points", "image_points1", "image_points2")]
    models = [data[name].copy() for name in ("M1", "D1", "M2", "D2")]
    shift = cv2.stereoCalibrate(*views, *models, SIZE_PX, flags=GUESS, criteria=STOP)[6]
    assert abs(np.linalg.norm(shift) - np.linalg.norm(data["T"])) < NEAR_MM / 2


@pytest.mark.heavy
def test_the_errors_of_colmaps_points_are_those_that_colmap_computes(exported):
    model = pycolmap.Reconstruction(str(exported / "colmap"))
    stated = [point.error for point in model.points3D.values()]
    model.update_point_3d_errors()
    assert min(stated) > FLOAT32_PX
    np.testing.assert_allclose(stated, [point.error for point in model.points3D.values()], rtol=1e-9)


def stated(out, folder):
    (place,) = export(open_output(out), ["opencv"], folder)
    return json.loads((place / "export.json").read_text())


def test_the_pinhole_that_made_the_rows_is_found(tmp_path):
    """Rows of a pinhole with the centre of camera.json and 1 % more focal length."""
    matrix = Scene().matrix * np.array([[1.01, 1, 1], [1, 1.01, 1], [1, 1, 1]])
    for found in stated(write_build(tmp_path / "out", Scene(matrix=matrix)), tmp_path)["pinholes_of_rows"].values():
        assert found["principal_distance_px"] == pytest.approx(1.01 * F_PX, rel=1e-9)
        np.testing.assert_allclose(found["centre_mm"], [0, 0, -6], rtol=0, atol=1e-6)


def test_boards_that_face_a_camera_leave_its_principal_distance_open():
    """They may be nearer, too: a hundredth of a pixel of noise decides how far they are."""
    pinhole = BuiltPinhole(
        centre_mm=np.array([0.0, 0.0, -6.0]),
        principal_distance_px=1000.0,
        principal_point_px=np.array([300.0, 200.0]),
        distortion=np.zeros(5),
        rms_px=0.0,
        max_px=0.0,
    )
    random = np.random.default_rng(5)
    board_mm = np.append(np.mgrid[-60:61:20, -40:41:20].reshape(2, -1).T, np.full((35, 1), 394.0), axis=1)
    x_px = pinhole.principal_point_px + 1000 * board_mm[:, :2] / 400
    noisy = [Sightings(x_px + random.normal(scale=0.01, size=x_px.shape), board_mm) for _ in range(2)]
    assert "principal distance" in row_pinhole(pinhole, noisy)


def test_a_pinhole_that_is_none_determines_none_and_formats_that_read_none_never_ask(output, tmp_path, monkeypatch):
    """A fit that had run away, with f of a twentieth of a pixel, before a board that was seen in an image of 260 px."""
    random = np.random.default_rng(3)
    nonsense = BuiltPinhole(
        centre_mm=np.array([0.0, 0.0, 31.2]),
        principal_distance_px=0.0464,
        principal_point_px=np.array([129.5, 129.5]),
        distortion=np.zeros(5),
        rms_px=98.7,
        max_px=139.0,
    )
    points_mm = random.uniform((-50, -50, 120), (50, 50, 220), (28, 3))
    seen = [Sightings(random.uniform(0, 259, (28, 2)), points_mm)] * 2
    assert isinstance(row_pinhole(nonsense, seen), str)

    def asked(*_):
        raise AssertionError("a pinhole of rows")

    monkeypatch.setattr(gathering, "row_pinhole", asked)
    export(output, ["coco", "npz", "lensboy", "rays"], tmp_path, Request(only=("Left",)))
    with pytest.raises(AssertionError, match="a pinhole of rows"):
        export(output, ["opencv"], tmp_path)


BROWN = [-0.9, 3.0, 0.01, -0.02, 5.0]
SQUARE_MM = 1.4
"""Of the board, as its stage says [mm]."""
EXACT_PX = 1e-9
"""Largest difference of truth and projection [px]: what a build makes of a pinhole is rounding."""
SINGLE_PX = 2e-6
"""Half a unit of a position below 32 px in the single precision that OpenCV takes [px]."""
PINHOLE_STAGE = over_tiny(
    camera=f"""uniform double[] plen:camera:distortion = {BROWN}
    uniform token plen:camera:model = "pinhole"
    uniform token plen:truth:method = "direct\""""
)


@pytest.mark.heavy
def test_the_export_of_a_pinhole_has_its_own_coefficients_and_its_truth_is_their_projection(
    tmp_path: Path, common_store: Path
) -> None:
    stage = stage_in(tmp_path, PINHOLE_STAGE)
    output = open_output(made(stage, tmp_path / "out", common_store, allow_roots=(ROOT,)).out)
    export(output, ["opencv"], tmp_path / "exports")
    (file,) = (tmp_path / "exports/opencv").glob("*.npz")
    with np.load(file) as arrays:
        found = dict(arrays)
    assert found["dist_coeffs"].ravel().tolist() == BROWN
    sensor_px = found["camera_matrix"][0, 0]
    principal = [[sensor_px, 0, (32 - 1) / 2], [0, sensor_px, (24 - 1) / 2], [0, 0, 1]]
    np.testing.assert_allclose(found["camera_matrix"], principal, rtol=1e-15)
    assert found["starts"][-1] == 12
    points = np.round(found["object_points"].astype(float) / SQUARE_MM) * SQUARE_MM  # once single
    exact = np.stack([output.correspondences.x_px, output.correspondences.y_px], axis=1)[:, None]
    views = zip(pairwise(found["starts"]), found["rvecs"], found["tvecs"], strict=True)
    for (first, end), turn, shift in views:
        bent = found["dist_coeffs"].ravel()
        projected = cv2.projectPoints(points[first:end], turn, shift, found["camera_matrix"], bent)[0]
        assert np.abs(projected - found["image_points"][first:end]).max() < SINGLE_PX
        assert np.abs(projected - exact[first:end]).max() < EXACT_PX
