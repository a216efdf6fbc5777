"""Cameras that a pinhole with the coefficients of Brown does not describe: models fitted to the rays of the image."""

import json
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache
from types import SimpleNamespace

import cv2
import numpy as np
import pytest
import yaml
from builds import made
from fits.pixel_rays import lit_rays
from fits.test_models import SPHERES, unprojected
from plugins.formats.pretended import board_mm, same, turned, write_manifest, write_poses, write_rows, write_target
from plugins.formats.readers import seen_by_nerfstudio
from stage_text import head, stage_in

from pipeline.exports import export
from pipeline.exports.central import central_model
from pipeline.exports.export import Request
from pipeline.exports.material import ExportCamera
from pipeline.formats import ExportError, loadable
from pipeline.frames import apply, rigid
from pipeline.results.output import open_output
from pipeline.results.records import BuiltPinhole

SIZE_PX, MATRIX = (320, 240), np.array([[200.0, 0, 161.25], [0, 200.0, 118.5], [0, 0, 1]])
STOP_MM, WORLD_MM = np.array([0.0, 0.0, 7.0]), np.array([1.0, 2.0, 3.0])
"""Centre of projection in the vision frame; of the stop in the world."""
POSE = rigid(turned(0.2, -0.35, 0.1) @ np.diag([1.0, -1.0, -1.0]), np.array([3.0, 5.0, 60.0]))
"""Target before the centre of projection."""
FITTED_PX = {"fisheye": 1e-6, "rational": 1e-4}
"""Largest residual that fits may leave of a camera that is their model: coefficients are held near 0, and eight of them
are hardly told from each other."""
STOP = (cv2.TERM_CRITERIA_COUNT, 200, 0)


@dataclass
class Wide:
    """A camera made ready, all of whose rays meet in one centre: 55 degrees from the axis in the corners."""

    name: str
    coefficients: np.ndarray
    project: Callable
    undistort: Callable
    asked: int = 0

    def rays(self, x_px, y_px):
        self.asked += 1
        slopes = self.undistort(np.column_stack([x_px, y_px])[:, None], MATRIX, self.coefficients, criteria=STOP)[:, 0]
        ahead = np.column_stack([slopes, np.ones(len(slopes))])
        return lit_rays(np.asarray(x_px), np.asarray(y_px), STOP_MM - STOP_MM[2] * ahead, ahead)

    def seen(self, matrix: np.ndarray, coefficients: np.ndarray) -> np.ndarray:
        """Positions of the points of the board by a camera of its kind, (n, 2)."""
        before, none = apply(POSE, board_mm())[:, None], np.zeros(3)
        return self.project(before, none, none, matrix, coefficients)[0][:, 0]

    @property
    def pixels(self) -> np.ndarray:
        return self.seen(MATRIX, self.coefficients)


FISHEYE = Wide("fisheye", np.array([0.05, -0.02, 0.01, -0.004]), cv2.fisheye.projectPoints, cv2.fisheye.undistortPoints)
RATIONAL = Wide(
    "rational",
    np.array([0.05, 0.01, 0.001, -0.002, 0.0, 0.2, 0.03, 0.01]),
    cv2.projectPoints,
    cv2.undistortPoints,
)


@dataclass
class Sphere:
    """A camera of 230 degrees that is a model of spheres, by its published unprojection."""

    name: str

    @property
    def parameters(self) -> np.ndarray:
        """Of `test_models`, before this image."""
        fx, _, _, _, *bent = SPHERES[self.name]
        return np.array([70 * fx / SPHERES["eucm"][0], 70 * fx / SPHERES["eucm"][0], 161.25, 118.5, *bent])

    def rays(self, x_px, y_px):
        ahead = unprojected(self.name, self.parameters, np.column_stack([x_px, y_px]))
        return lit_rays(np.asarray(x_px), np.asarray(y_px), STOP_MM + 0 * ahead, ahead)

    @property
    def pixels(self) -> np.ndarray:
        return FISHEYE.pixels


@pytest.fixture(params=[FISHEYE, RATIONAL], ids=lambda wide: wide.name)
def wide(request):
    return request.param


@pytest.fixture
def exported(wide, tmp_path, monkeypatch):
    """Folder of a format, of a build with a camera in which no pinhole fits."""
    folder = tmp_path / "out"
    camera, view = folder / "cameras/Wide", folder / "frames/0001/Wide"
    camera.mkdir(parents=True)
    lens = {"entrance_pupil": {"z_mm": 6.0}}
    figures = {"principal_distance_px": 198.0, "optical_axis_px": [160.0, 119.0], "near_far_mm": [40.0, 90.0]}
    record = {"resolution": SIZE_PX, "pixel_pitch_mm": 0.01, "pinhole": None, "lens": lens, **figures}
    (camera / "camera.json").write_text(json.dumps(record))
    write_poses(view, rigid(np.eye(3), WORLD_MM - STOP_MM), {"Board": POSE}, STOP_MM)
    poses = json.loads((view / "poses.json").read_text())
    poses["pinhole"] = poses["targets"]["Board"]["pinhole"] = None
    (view / "poses.json").write_text(json.dumps(poses))
    write_rows(view, range(len(board_mm())), wide.pixels)
    write_target(folder, 10.0)
    write_manifest(folder)
    monkeypatch.setattr(export, "sight_of", lambda out, name: wide)
    return lambda name: export.export(open_output(folder), [name], tmp_path)[0]


def test_ros_has_the_model_that_explains_the_rays(exported, wide):
    folder = exported("ros")
    info = yaml.safe_load((folder / "Wide.yaml").read_text())
    names = {"fisheye": "equidistant", "rational": "rational_polynomial"}
    assert info["distortion_model"] == names[wide.name]
    k, d = np.reshape(info["camera_matrix"]["data"], (3, 3)), np.array(info["distortion_coefficients"]["data"])
    stated = json.loads((folder / "export.json").read_text())["central_models"]["Wide"]
    assert stated["max_px"] < FITTED_PX[wide.name]
    same(wide.seen(k, d), wide.pixels, FITTED_PX[wide.name])
    same(stated["centre_mm"], STOP_MM, 1e-3)


def test_ncore_has_it_too(exported, wide):
    model = json.loads((exported("ncore") / "Wide.json").read_text())
    own = model["camera_model_parameters"]
    (fx, fy), (cx, cy), radial = own["focal_length"], own["principal_point"], own["radial_coeffs"]
    if wide.name == "fisheye":
        corner = wide.rays([-0.5], [-0.5]).direction[0]
        assert 1 < own["max_angle"] / np.arccos(corner[2]) < 1.02, "rays of the corners are imaged"
    coefficients = radial if wide.name == "fisheye" else [*radial[:2], *own["tangential_coeffs"], *radial[2:]]
    matrix = np.array([[fx, 0, cx - 0.5], [0, fy, cy - 0.5], [0, 0, 1]])
    assert model["camera_model_type"] == {"fisheye": "opencv-fisheye", "rational": "opencv-pinhole"}[wide.name]
    same(wide.seen(matrix, np.array(coefficients)), wide.pixels, FITTED_PX[wide.name])


def test_nerfstudio_knows_the_fisheye_alone_and_poses_lead_to_its_centre(exported, wide):
    data = json.loads((exported("nerfstudio") / "transforms.json").read_text())
    (frame,) = data["frames"]
    assert data["camera_model"] == "OPENCV_FISHEYE"
    ahead, matrix = seen_by_nerfstudio(frame, board_mm() / 1000)
    seen = FISHEYE.project(ahead[:, None], np.zeros(3), np.zeros(3), matrix, np.array([frame[f"k{i}"] for i in "1234"]))
    if wide is FISHEYE:
        same(seen[0][:, 0], wide.pixels, FITTED_PX[wide.name])


@pytest.mark.parametrize("wide", [Sphere("eucm"), Sphere("double-sphere")], indirect=True, ids=lambda wide: wide.name)
def test_kalibr_has_the_model_of_spheres_behind_90_degrees(exported, wide):
    """ConfigReader.py of Kalibr: [alpha, beta, fu, fv, pu, pv] of eucm, [xi, alpha, fu, fv, pu, pv] of ds."""
    camera = yaml.safe_load((exported("kalibr") / "camchain.yaml").read_text())["cam0"]
    assert camera["camera_model"] == {"eucm": "eucm", "double-sphere": "ds"}[wide.name]
    assert (camera["distortion_model"], camera["distortion_coeffs"]) == ("none", [])
    focal_and_centre, bent = np.split(wide.parameters, [4])
    np.testing.assert_allclose(camera["intrinsics"], [*bent, *focal_and_centre], rtol=1e-5)


def test_a_pinhole_that_leaves_next_to_nothing_asks_for_no_rays(output, tmp_path, monkeypatch):
    sight = replace(FISHEYE, asked=0)
    monkeypatch.setattr(export, "sight_of", lambda out, name: sight)
    export.export(output, ["ros"], tmp_path)
    assert sight.asked == 0


def test_a_channel_has_the_model_of_its_own_rays():
    """The pinhole of camera.json is that of another wavelength, whatever it leaves there."""
    other = BuiltPinhole(
        centre_mm=STOP_MM,
        principal_distance_px=199.0,
        principal_point_px=MATRIX[:2, 2],
        distortion=np.zeros(5),
        rms_px=0.0,
        max_px=0.0,
    )
    figures = {"principal_distance_px": 198.0, "optical_axis_px": [160.0, 119.0], "near_far_mm": [40.0, 90.0]}
    built = SimpleNamespace(record={"lens": {"entrance_pupil": {"z_mm": 6.0}}, **figures})
    red = replace(RATIONAL, coefficients=np.array([-0.05, 0.01, 0.001, -0.002, 0.0]))
    parts = {"size_px": SIZE_PX, "pitch_mm": 0.01, "axis": np.zeros(2), "micro_images": None}
    rays = SimpleNamespace(sight=red)
    model = central_model(ExportCamera(name="Wide@red", pinhole=other, built=built, rays=rays, **parts), ())
    matrix = np.diag([*model.focal_px, 1.0])
    matrix[:2, 2] = model.principal_point_px
    same(red.seen(matrix, model.coefficients), red.pixels, 1e-6)
    assert model.name == "brown" and model.max_px < 1e-6


def test_what_a_format_cannot_hold_is_said_and_not_left_out():
    """A tilted sensor where five coefficients are all, and a telecentric lens where one centre is."""
    tilted = BuiltPinhole(
        centre_mm=np.zeros(3),
        principal_distance_px=900.0,
        principal_point_px=np.zeros(2),
        distortion=np.array([*(0.0,) * 12, 0.1, 0.0]),
        rms_px=0.0,
        max_px=0.0,
    )
    parts = {"size_px": SIZE_PX, "pitch_mm": 0.01, "axis": np.zeros(2), "micro_images": None, "rays": None}
    built = SimpleNamespace(record={"principal_distance_px": "inf", "near_far_mm": [200.0, 400.0]})
    camera = ExportCamera(name="Rig.Camera", pinhole=tilted, built=built, **parts)
    for ask in (lambda of: of.opencv, lambda of: central_model(of, ("rational",))):
        with pytest.raises(ExportError, match=r"sensor of Rig\.Camera is tilted"):
            ask(camera)
    with pytest.raises(ExportError, match=r"lens of Rig\.Camera is telecentric"):
        central_model(replace(camera, pinhole=None), ("rational",))


CAMERA = """
    def Camera "{name}" (
        prepend apiSchemas = ["PlenCameraAPI"]
    )
    {{
        rel plen:camera:lens = </Two/{name}Lens>
        rel plen:camera:sensor = </Two/{name}Sensor>
        uniform double plen:camera:focusDistance = 400
        uniform int plen:image:samples = 4
    }}

    def PlenSensor "{name}Sensor"
    {{
        uniform double plen:pixelPitch = {pitch}
        uniform int2 plen:resolution = {size}
    }}
"""
TWO = f"""{head("Two")}
def PlenDataset "Two"
{{
    rel plen:cameras = [</Two/Thin>, </Two/Fish>]
    rel plen:targets = </Two/Board>
    uniform int plen:seed = 3
{CAMERA.format(name="Thin", pitch=0.18, size=(200, 150))}
{CAMERA.format(name="Fish", pitch=1.3, size=(16, 16))}
    def PlenLens "ThinLens"
    {{
        uniform token[] plen:surfaceOrder = ["Stop"]

        def PlenSurface "Stop"
        {{
            uniform double plen:focalLength = 50
            uniform bool plen:isStop = 1
            uniform double plen:semiDiameter = 18
        }}
    }}

    def "FishLens" (
        prepend references = @lenses/fisheye_6mm_nikkor.usda@
    )
    {{
    }}

    def PlenCheckerboard "Board"
    {{
        uniform int plen:columns = 5
        uniform int plen:rows = 4
        uniform double plen:squareSize = 30
        double3 xformOp:rotateXYZ = (0, 0, 11)
        double3 xformOp:translate = (5, -4, -400)
        uniform token[] xformOpOrder = ["xformOp:translate", "xformOp:rotateXYZ"]
    }}
}}
"""
"""A wide ideal lens, and a fisheye whose image circle ends inside its sensor, beyond 90 degrees."""


@pytest.fixture(scope="module")
def two(tmp_path_factory, common_store):
    folder = tmp_path_factory.mktemp("two")
    return open_output(made(stage_in(folder, TWO), folder / "out", common_store).out)


def test_a_fisheye_is_refused_only_by_formats_that_read_a_pinhole(two, tmp_path, monkeypatch):
    """With a sentence; the tables, rays and models for wide fields hold it."""
    monkeypatch.setattr(export, "sight_of", cache(export.sight_of))  # a camera is made ready once, for all of them
    refuses, fish = {"bop", "colmap", "lensboy", "matlab", "mrcal", "stmap"}, Request(only=("Fish",))
    known = {name: record for name, record in loadable().items() if record.takes(is_plenoptic=False)}
    for name in refuses & known.keys():
        with pytest.raises(ExportError, match="pinhole"):
            export.export(two, [name], tmp_path, fish)
    of_one = [name for name, record in known.items() if record.least_cameras == 1 and name not in refuses]
    assert len(export.export(two, of_one, tmp_path, fish)) > 10
    view = two.view(camera="Fish", frame=1)
    assert two.cameras["Fish"].pinhole is None and not view.poses.pinhole_from_target


def test_the_box_of_coco_is_that_of_the_board_and_not_of_its_corners(two, tmp_path):
    """The sheet, a square and a half beyond the outermost corners, as its pinhole shows it, to a pixel of its tips."""
    export.export(two, ["coco"], tmp_path, Request(only=("Thin",)))
    (found,) = json.loads((tmp_path / "coco/coco.json").read_text())["annotations"]
    half = np.array([(5 + 3) * 15.0, (4 + 3) * 15.0])
    sheet = np.array([[x, y, 0] for x in (-half[0], half[0]) for y in (-half[1], half[1])])
    pinhole = two.cameras["Thin"].pinhole_with_distortion
    ahead = apply(two.view(camera="Thin", frame=1).poses.pinhole_from_target["Board"], sheet)
    tips = np.clip(pinhole.projected(ahead) + 0.5, 0, [200, 150])
    left, top, width, height = found["bbox"]
    same([left, top, left + width, top + height], [*tips.min(axis=0), *tips.max(axis=0)], 1.5)
    assert 0.5 * width * height < found["area"] <= width * height


def test_an_ideal_lens_is_a_pinhole_without_distortion_in_its_own_place(two, tmp_path):
    """It leaves more of the rays than another model would, and yet bends none: boards are where rows show them."""
    export.export(two, ["ros", "ncore", "nerfstudio"], tmp_path, Request(only=("Thin",)))
    info = yaml.safe_load((tmp_path / "ros/Thin.yaml").read_text())
    assert info["distortion_model"] == "plumb_bob" and not any(info["distortion_coefficients"]["data"])
    model = json.loads((tmp_path / "ncore/Thin.json").read_text())
    own = model["camera_model_parameters"]
    assert model["camera_model_type"] == "opencv-pinhole"
    assert not any([*own["radial_coeffs"], *own["tangential_coeffs"], *own["thin_prism_coeffs"]])
    (frame,) = json.loads((tmp_path / "nerfstudio/transforms.json").read_text())["frames"]
    assert not any(frame.get(f"k{i}", 0) for i in range(1, 7))
    pinhole = two.cameras["Thin"].pinhole_with_distortion
    assert pinhole.rms_px > 1e-3
    rows = two.view(camera="Thin", frame=1).correspondences
    ahead, matrix = seen_by_nerfstudio(frame, two.targets["Board"].points_mm[rows.point_id] / 1000)
    seen = ahead @ matrix.T
    same(seen[:, :2] / seen[:, 2:], np.stack([rows.x_px, rows.y_px], axis=1), pinhole.max_px)
