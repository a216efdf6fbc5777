"""Programs that nobody here wrote read our exports, where they are installed.

REFEREES is a folder with clones of what no package index has, each under its own name; docs/exports.md has the commits.
"""

import importlib
import json
import os
import shutil
import subprocess
import sys
import types
from pathlib import Path

import numpy as np
import pytest
import yaml
from PIL import Image
from plugins.formats import maps, plenoptic_readers, test_shutters
from plugins.formats.pretended import SIZE_PX, Scene, board_mm, write_build
from plugins.formats.pretended_plenoptic import RADIUS_PX, TYPES_MM, PlenopticScene, write_plenoptic_build
from plugins.formats.pretended_plenoptic import SIZE_PX as PLENOPTIC_PX

from pipeline.exports.export import export
from pipeline.frames import apply
from pipeline.results.output import open_output

pytestmark = pytest.mark.heavy
needs_octave = pytest.mark.skipif(shutil.which("octave-cli") is None, reason="GNU Octave is not installed")


def clone(name: str) -> Path:
    path = Path(os.environ.get("REFEREES", "/none")) / name
    return path if path.is_dir() else pytest.skip(f"NOT JUDGED: REFEREES has no clone of {name}")


def exported(name: str, folder: Path, scene: Scene | PlenopticScene) -> Path:
    write = write_build if isinstance(scene, Scene) else write_plenoptic_build
    return export(open_output(write(folder / "out", scene)), [name], folder)[0]


def octave(program: str) -> dict[str, list]:
    """Variables that a program of Octave leaves in `found`, by JSON."""
    command = ["octave-cli", "--norc", "--quiet", "--eval", f"{program}; printf('%s', jsonencode(found))"]
    return json.loads(subprocess.run(command, capture_output=True, text=True, check=True).stdout)


def load(path: Path) -> dict[str, np.ndarray]:
    """Variables of a file as Octave has loaded them: matrices with more than one row and column."""
    return {name: np.array(value) for name, value in octave(f"found = load('{path}')").items()}


@needs_octave
def test_octave_reads_centres_types_and_correspondences_of_bok(tmp_path, monkeypatch):
    folder = exported("bok", tmp_path, scene := PlenopticScene())
    monkeypatch.setattr(plenoptic_readers, "loadmat", load)
    plenoptic_readers.check_bok(folder, scene)


@needs_octave
def test_octave_finds_the_types_in_matlab_files_that_cameraparameters_asks_for(tmp_path):
    file = exported("matlab", tmp_path, Scene()) / "Left.mat"
    program = f"p = load('{file}').cameraParams; found.kinds = structfun(@class, p, 'UniformOutput', false); "
    program += "found.sizes = structfun(@size, p, 'UniformOutput', false)"
    kinds, sizes = octave(program).values()
    others = {"WorldUnits": "char"} | dict.fromkeys(
        ("EstimateSkew", "EstimateTangentialDistortion", "DetectedKeypoints"), "logical"
    )
    assert {name: kind for name, kind in kinds.items() if kind != "double"} == others
    assert sizes["EstimateSkew"] == sizes["NumRadialDistortionCoefficients"] == [1, 1]
    assert sizes["WorldPoints"] == [12, 2] and sizes["ReprojectionErrors"] == [12, 2, 3]


@needs_octave
def test_lftoolbox_builds_the_exact_centres_of_a_turned_array_from_our_grid(tmp_path):
    tools = clone("LFToolbox") / "SupportFunctions"
    folder = exported("lftoolbox", tmp_path, scene := PlenopticScene())
    _, head, body = (tools / "LFBuildLensletGridModel.m").read_text().partition("function [GridCoords] =")
    (tmp_path / "LFBuildHexGrid.m").write_text(head + body)  # a private function, as it stands
    model = f"jsondecode(fileread('{folder}/{plenoptic_readers.NAME}.grid.json')).LensletGridModel"
    found = octave(f"addpath('{tools}', '{tmp_path}'); found.grid = LFBuildHexGrid({model})")
    plenoptic_readers.require_all_centres(np.reshape(found["grid"], (-1, 2)) - 1, scene)


def test_plenoptictoolbox_finds_centres_types_and_depths_of_raytrix(tmp_path, monkeypatch):
    monkeypatch.syspath_prepend(clone("PlenopticToolbox2.0") / "python")
    monkeypatch.setitem(sys.modules, "rendering.render", types.ModuleType("render"))  # wants scikit-image
    folder = exported("raytrix", tmp_path, scene := PlenopticScene())
    Image.new("RGB", PLENOPTIC_PX).save(tmp_path / "black.png")
    reader = importlib.import_module("plenopticIO.imgIO")
    lenses = reader.load_from_xml(tmp_path / "black.png", folder / f"{plenoptic_readers.NAME}.xml")
    assert len(lenses) > 100
    for lens in lenses.values():
        own = scene.array.types[plenoptic_readers.nearest(scene, lens.position[:2])]
        depths = lens.diameter / np.array([lens.max_disp, lens.min_disp])
        np.testing.assert_allclose(depths, plenoptic_readers.virtual_depths(TYPES_MM[own]), rtol=1e-9)
        assert abs(lens.inner_radius - RADIUS_PX) < plenoptic_readers.FITTED_PX


@pytest.fixture(scope="module")
def reprojects(tmp_path_factory) -> Path:
    """Our program with libpleno's sources, and with what its CMake would write; Eigen, Boost and OpenCV of Debian."""
    root, here = clone("libpleno"), tmp_path_factory.mktemp("libpleno")
    core = root / "third_parties/libv/core/src"
    for room in ("core", "geometry"):
        (here / "libv" / room / "found").mkdir(parents=True)
        (here / "libv" / room / "export.hpp").write_text(f"#define LIBV_{room.upper()}_EXPORT\n")
    for found in ("boost_iostreams", "eigen", "opencv", "yaml_cpp"):
        (here / "libv/core/found" / found).touch()
    (here / "opencv2").mkdir()
    (here / "opencv2/opencv.hpp").write_text("#include <iomanip>\n#include <opencv2/imgproc.hpp>\n")
    names = ["observation", "mesh", "mia", "mla", "pose", "sensor", "distortions", "internals", "ray", "plane"]
    names += [f"camera/{name}" for name in ("plenoptic", "camera", "thinlens", "pinhole")]
    sources = [root / f"pleno/geometry/{name}.cpp" for name in names]
    sources += [root / f"pleno/{name}.cpp" for name in ("io/printer", "processing/imgproc/trim")]
    names = ["auto_load", "noncopyable", "logger", "path", "console", "serialization/serializable"]
    names += [f"serialization/archives/{name}" for name in ("simple_binary", "property_tree")]
    sources += [core / f"libv/core/{name}.cpp" for name in names]
    places = [here, root / "pleno", root / "pleno/io", root / "pleno/geometry", core]
    places += [root / "third_parties/libv/geometry/src", "/usr/include/eigen3", "/usr/include/opencv4"]
    command = ["g++", "-std=c++17", "-w", "-DLIBV_CORE_BOOST_IOSTREAMS_FOUND", *(f"-I{place}" for place in places)]
    command += [Path(__file__).with_name("libpleno_reprojects.cpp"), *sources, "-o", here / "reprojects"]
    subprocess.run([*command, "-lboost_iostreams", "-lopencv_core", "-lopencv_imgproc"], check=True)
    return here / "reprojects"


@pytest.mark.parametrize("layout", ["hexagonal", "hexagonal-columns", "square"])
def test_libpleno_projects_points_and_centres_to_our_observations(layout, reprojects, tmp_path):
    folder = exported("libpleno", tmp_path, PlenopticScene(layout=layout)) / plenoptic_readers.NAME
    said = subprocess.run([reprojects, folder], capture_output=True, text=True, check=True).stdout
    off = np.array([line.split() for line in said.splitlines()], float)
    assert len(off) > 600
    np.testing.assert_allclose(off, 0, rtol=0, atol=1e-9)


def test_lensboy_loads_our_camera_and_projects_as_it(tmp_path):
    lensboy = pytest.importorskip("lensboy", reason="lensboy is not installed")
    folder = exported("lensboy", tmp_path, scene := Scene())
    for name in scene.rig:
        seen = apply(scene.camera_from_target(name, 2), board_mm())
        found = lensboy.OpenCV.load(folder / f"{name}.json").project_points(seen)
        np.testing.assert_allclose(found, scene.pixels(name, 2), rtol=0, atol=1e-9)


def test_ncore_decodes_our_cameras_and_projects_as_they_do(tmp_path):
    """In single precision: a millionth of the size of an image."""
    data = pytest.importorskip("ncore.data", reason="nvidia-ncore is not installed")
    sensors, scene = importlib.import_module("ncore.sensors"), Scene()
    folder = exported("ncore", tmp_path, scene)
    for name in scene.rig:
        model = json.loads((folder / f"{name}.json").read_text())
        parameters = data.OpenCVPinholeCameraModelParameters.from_dict(model["camera_model_parameters"])
        assert parameters.type() == model["camera_model_type"]
        seen = apply(scene.camera_from_target(name, 2), board_mm()).astype(np.float32)
        found = sensors.camera_model_from_parameters(parameters, device="cpu").camera_rays_to_image_points(seen)
        assert found.valid_flag.all()
        np.testing.assert_allclose(found.image_points.numpy(), scene.pixels(name, 2) + 0.5, rtol=0, atol=1e-3)


@pytest.mark.parametrize("order", test_shutters.ORDERS)
def test_gsplat_sees_a_corner_where_the_line_that_it_names_does(order, tmp_path, monkeypatch):
    """Its twin of the kernels, which runs without a GPU; its time is that of whole lines."""
    torch = pytest.importorskip("torch", reason="PyTorch is not installed")
    for name, path in (("gsplat", clone("gsplat") / "gsplat"), ("gsplat.cuda._backend", None)):  # compiled for GPUs
        monkeypatch.setitem(sys.modules, name, types.ModuleType(name))
        sys.modules[name].__dict__.update(_C=None, __path__=[str(path)])
    gsplat = importlib.import_module("gsplat.cuda._torch_cameras")
    scene, output = test_shutters.flown(tmp_path, order)
    (folder,) = export(output, ["nerfstudio"], tmp_path)
    axis, _ = test_shutters.ORDERS[order]
    for frame in json.loads((folder / "transforms.json").read_text())["frames"]:
        _, number, name, _ = frame["file_path"].split("/")
        model = gsplat._BaseCameraModel.create(
            width=frame["w"],
            height=frame["h"],
            focal_lengths=torch.tensor([[frame["fl_x"], frame["fl_y"]]], dtype=torch.float64),
            principal_points=torch.tensor([[frame["cx"], frame["cy"]]], dtype=torch.float64),
            radial_coeffs=torch.tensor([[frame[f"k{n}"] for n in (1, 2, 3)]], dtype=torch.float64),
            tangential_coeffs=torch.tensor([[frame["p1"], frame["p2"]]], dtype=torch.float64),
            rs_type=gsplat.RollingShutterType[frame["shutter_type"]],
        )
        matrices = [test_shutters.opencv_pose(frame[f"transform_matrix_{end}"]) for end in ("start", "end")]
        poses = [gsplat._viewmat_to_pose(torch.tensor(matrix[None])) for matrix in matrices]
        points = torch.tensor(board_mm()[None] / 1000)
        found, valid = model.world_point_to_image_point_shutter_pose(points, *poses, 0.1)
        assert valid.all()
        for pixel, own, point in zip(found[0].numpy(), scene.pixels(name, int(number)), board_mm(), strict=True):
            near = np.floor(pixel[axis]) + np.arange(-1.0, 2.0)  # it may go to and fro between two lines
            times_s = [scene.time_s(np.full(2, line)) for line in near]
            there = [test_shutters.seen_at(scene.motion(name, int(number), time_s), point) for time_s in times_s]
            assert np.abs(pixel - 0.5 - there).max(axis=1).min() < 1e-6
            np.testing.assert_allclose(pixel - 0.5, own, rtol=0, atol=0.2)


def test_nerfstudio_sends_rays_of_our_positions_through_the_points(tmp_path):
    """Undistorted to 1e-3 by itself, in single precision: 0.01 px, at 400 mm some 4 micrometres."""
    torch = pytest.importorskip("torch", reason="PyTorch is not installed")
    parser = pytest.importorskip(
        "nerfstudio.data.dataparsers.nerfstudio_dataparser", reason="nerfstudio is not installed"
    )
    options = {"downscale_factor": 1, "orientation_method": "none", "center_method": "none", "auto_scale_poses": False}
    file = exported("nerfstudio", tmp_path, scene := Scene()) / "transforms.json"
    config = parser.NerfstudioDataParserConfig(data=file, eval_mode="all", **options)
    outputs = config.setup().get_dataparser_outputs("train")
    np.testing.assert_array_equal(outputs.dataparser_transform.numpy(), np.eye(4)[:3])
    for number, image in enumerate(outputs.image_filenames):
        frame, name = int(image.parts[-3]), image.parts[-2]
        middle = torch.tensor(scene.pixels(name, frame)[:, ::-1] + 0.5, dtype=torch.float32)
        indices = torch.full((len(middle), 1), number)
        rays = outputs.cameras.generate_rays(camera_indices=indices, coords=middle)
        origin, way = rays.origins.numpy().astype(float), rays.directions.numpy().astype(float)
        to_point = board_mm() / 1000 - origin
        apart = np.linalg.norm(np.cross(to_point, way), axis=1) / np.linalg.norm(way, axis=1)
        assert (np.sum(to_point * way, axis=1) > 0).all()
        assert (apart * 1000 < 0.01 * 400 / 1000).all(), apart.max()


def test_kalibrs_reader_accepts_target_and_chain(tmp_path, monkeypatch):
    place = clone("kalibr") / "aslam_offline_calibration/kalibr/python/kalibr_common"
    for name in ("aslam_cv", "aslam_cv_backend", "sm"):  # its compiled parts
        monkeypatch.setitem(sys.modules, name, types.ModuleType(name))
    sys.modules["sm"].Transformation = lambda matrix: types.SimpleNamespace(T=lambda: matrix)
    monkeypatch.syspath_prepend(place)
    reader, scene = importlib.import_module("ConfigReader"), Scene()
    folder = exported("kalibr", tmp_path, scene)
    target = reader.CalibrationTargetParameters(str(folder / "target.yaml")).getTargetParams()
    assert (target["targetRows"], target["targetCols"], target["rowSpacingMeters"]) == (3, 4, 0.01)
    stated = yaml.safe_load((folder / "camchain.yaml").read_text())
    chain, rig = reader.CameraChainParameters(str(folder / "camchain.yaml")), list(scene.rig.values())
    for number in (1, 2):
        camera = chain.getCameraParameters(number)
        assert camera.getDistortion() == ("radtan", stated[f"cam{number}"]["distortion_coeffs"])
        assert camera.getIntrinsics() == (
            "pinhole",
            stated[f"cam{number}"]["intrinsics"],
        ) and camera.getResolution() == list(SIZE_PX)
        between = rig[number] @ np.linalg.inv(rig[number - 1])
        between[:3, 3] /= 1000
        np.testing.assert_allclose(chain.getExtrinsicsLastCamToHere(number).T(), between, atol=1e-12)


@pytest.mark.parametrize("name", ["undistort", "distort"])
def test_openimageio_warps_a_picture_by_our_map(name, tmp_path):
    """A picture whose channels are x and y, warped: as Nuke, with t from the bottom (`flip_t`)."""
    oiio = pytest.importorskip("OpenImageIO", reason="OpenImageIO is not installed")
    (folder,) = export(open_output(maps.write_small_build(tmp_path / "out")), ["stmap"], tmp_path)
    y, x = np.mgrid[0:48, 0:64].astype(np.float32)
    table = oiio.ImageBuf(str(folder / f"Left.{name}.exr"))
    warped = oiio.ImageBufAlgo.st_warp(oiio.ImageBuf(np.stack([x, y], axis=2)), table, "triangle", flip_t=True)
    row, column = np.mgrid[4:44:4, 4:60:6].reshape(2, -1)
    found = warped.get_pixels(oiio.FLOAT)[row, column]
    np.testing.assert_allclose(found, maps.looked_at(name, row, column), rtol=0, atol=1e-4)
