"""Records are exactly what the stage says, in millimetres and in our frames."""

import dataclasses
import math
import re

import numpy as np
import pytest
from laws import rigs
from places import ROOT, TINY
from pxr import Usd, UsdGeom
from stage_text import head, placed, stage_in

from pipeline.frames import VISION_FROM_CAMERA
from pipeline.optics.prescription import Group, Prescription, PrescriptionError
from pipeline.scene.lens import read_prescription
from pipeline.scene.load import load, open_dataset
from pipeline.scene.usd.opening import open_stage
from pipeline.scene.usd.problems import StageError


@pytest.fixture
def write(tmp_path):
    """Write a whole dataset into one file, with a camera of two surfaces; gives its path."""

    def writer(board, rig="", unit="0.001", dataset=""):
        path = tmp_path / "dataset.usda"
        path.write_text(
            head("Dataset", unit=unit)
            + f"""
def PlenDataset "Dataset"
{{
    rel plen:cameras = </Dataset/Rig/Camera>
    rel plen:targets = </Dataset/Arm/Board>
    {dataset}

    def Xform "Rig"
    {{
        {rig}
        def Camera "Camera" (
            prepend apiSchemas = ["PlenCameraAPI"]
        )
        {{
            rel plen:camera:lens = </Dataset/Rig/Lens>
            rel plen:camera:sensor = </Dataset/Rig/Sensor>
            uniform double plen:camera:sensorDistance = 50
        }}
        def PlenLens "Lens"
        {{
            uniform token[] plen:surfaceOrder = ["Front", "Stop"]
            def PlenSurface "Stop"
            {{
                uniform bool plen:isStop = 1
                uniform double plen:semiDiameter = 4
            }}
            def PlenSurface "Front"
            {{
                uniform double plen:index = 1
                uniform double plen:focalLength = 45
                uniform double plen:semiDiameter = 5
                uniform double plen:thickness = 3
            }}
        }}
        def PlenSensor "Sensor"
        {{
            uniform double2 plen:offset = (-0.0, 0.25)
            uniform double plen:pixelPitch = 0.01
            uniform int2 plen:resolution = (20, 10)
        }}
    }}
    {board}
}}
"""
        )
        return path

    return writer


def board(arm="", pose=""):
    """An Xform "Arm" that holds a board of 3 x 2 corners."""
    return f"""
    def Xform "Arm"
    {{
        {arm}
        def PlenCheckerboard "Board"
        {{
            uniform int plen:columns = 3
            uniform int plen:rows = 2
            uniform double plen:squareSize = 2
            {pose}
        }}
    }}
"""


def ordered(turn):
    return f'double3 xformOp:translate = (1, 2, -400)\nuniform token[] xformOpOrder = ["xformOp:translate", "{turn}"]'


def test_an_ideal_thin_lens_works_at_any_wavelength(write):
    """It has no index that could be printed for another one."""
    path = write(board(pose=placed(0, 0, -400)))
    path.write_text(
        path.read_text().replace(
            "sensorDistance = 50", "sensorDistance = 50\nuniform double plen:camera:wavelength = 450"
        )
    )
    loaded = load(path)
    assert loaded.errors == []
    assert loaded.dataset.cameras[0].wavelength_nm == 450
    path.write_text(path.read_text().replace("plen:index = 1\n", "plen:index = 1.5\n"))
    assert "printed-wavelength" in [one.code for one in load(path).errors]


def test_the_tiny_dataset_reads_as_written():
    dataset = open_dataset(TINY)
    (entry,), (target,) = dataset.cameras, dataset.targets

    assert (dataset.stage_name, dataset.seed, dataset.background) == ("TinyConventional", 3, 0.0)
    assert (entry.name, entry.prim_path) == ("Rig.Camera", "/TinyConventional/Rig/Camera")
    assert (entry.lens_name, entry.index_source) == ("Tronnier double Gauss 100 mm f/2", "printed")
    assert (entry.wavelength_nm, entry.weight, entry.footprint) == (587.56, "irradiance", "point")
    assert dataclasses.astuple(entry.camera.sensor)[:7] == (32, 24, 0.1, 0.0, 0.0, (0.0, 0.0), "all")
    assert entry.camera.microlenses is None
    assert (entry.asked.near_mm, entry.asked.far_mm) == (None, None)
    assert dataclasses.astuple(entry.sampling) == (1, 64, 3)
    board = target.target.pattern
    assert (target.name, board.columns, board.rows, board.square_mm) == ("Board", 3, 2, 1.4)
    assert [frame.number for frame in dataset.frames] == [1, 2]


def test_surfaces_stand_in_the_order_that_the_lens_states(write):
    (entry,) = open_dataset(write(board(pose=placed(0, 0, -400)))).cameras

    assert [surface.is_stop for surface in entry.asked.prescription.surfaces] == [False, True]
    assert math.isinf(entry.asked.prescription.stop.radius_mm)


def test_minus_zero_does_not_reach_a_record(write):
    dataset = open_dataset(write(board(pose=placed("-0.0", 0, -400))))

    assert math.copysign(1, dataset.cameras[0].asked.sensor.offset_x_mm) == 1
    matrices = [*dataset.frames[0].camera_from_world.values(), *dataset.frames[0].world_from_target.values()]
    assert all(math.copysign(1, value) == 1 for matrix in matrices for row in matrix for value in row if value == 0)


@pytest.mark.parametrize(("unit", "distance"), [("0.001", 400), ("0.01", 40), ("1", 0.4)])
def test_poses_are_in_the_unit_of_the_stage_and_our_own_lengths_in_millimetres(write, unit, distance):
    dataset = open_dataset(write(board(pose=placed(0, 0, -distance)), unit=unit))

    assert dataset.frames[0].world_from_target["Board"][2][3] == pytest.approx(-400, rel=1e-15)
    assert dataset.cameras[0].asked.sensor.pitch_mm == 0.01
    assert dataset.targets[0].target.pattern.square_mm == 2.0


def test_a_board_before_the_camera_lies_at_positive_z_of_the_vision_frame(write):
    (frame,) = open_dataset(write(board(pose=placed(1, 2, -400)))).frames

    camera_from_target = np.array(frame.camera_from_world["Rig.Camera"]) @ np.array(frame.world_from_target["Board"])

    assert np.array_equal(camera_from_target[:3, 3], [1, -2, 400])
    assert np.array_equal(camera_from_target[:3, :3], np.diag([1, -1, -1]))


COS, SIN = math.cos(math.pi / 8), math.sin(math.pi / 8)
TURN = 'double xformOp:rotateY = -90\nuniform token[] xformOpOrder = ["xformOp:rotateY"]'


@pytest.mark.parametrize(
    ("arm", "pose"),
    [
        ("", f"double3 xformOp:rotateXYZ = (10, 20, 30)\n{ordered('xformOp:rotateXYZ')}"),
        ("", f"quatd xformOp:orient = ({COS}, {SIN}, 0, 0)\n{ordered('!invert!xformOp:orient')}"),
        (TURN, placed(-400, 0, 0)),
    ],
)
def test_rigid_transforms_agree_with_those_of_usd(write, arm, pose):
    path = write(board(arm=arm, pose=pose), rig=placed(0, 5, 0))
    (frame,) = open_dataset(path).frames
    cache = UsdGeom.XformCache(1)
    stage = Usd.Stage.Open(path.as_posix())
    theirs, camera = (
        np.array(cache.GetLocalToWorldTransform(stage.GetPrimAtPath(f"/Dataset/{at}"))).T
        for at in ("Arm/Board", "Rig/Camera")
    )
    assert np.array(frame.world_from_target["Board"]) == pytest.approx(theirs, abs=1e-12)
    vision = VISION_FROM_CAMERA @ np.linalg.inv(camera)
    assert np.array(frame.camera_from_world["Rig.Camera"]) == pytest.approx(vision, abs=1e-12)


def test_a_quaternion_slightly_off_unit_length_is_normalised_with_a_warning(write):
    pose = (
        "quatd xformOp:orient = (0.9239, 0.3827, 0, 0)\ndouble3 xformOp:translate = (0, 0, -400)\n"
        'uniform token[] xformOpOrder = ["xformOp:translate", "xformOp:orient"]'
    )
    loaded = load(write(board(pose=pose)))
    rotation = np.array(loaded.dataset.frames[0].world_from_target["Board"])[:3, :3]

    assert [(problem.severity, problem.code) for problem in loaded.problems] == [("warning", "normalised")]
    assert rotation.T @ rotation == pytest.approx(np.eye(3), abs=1e-15)


def test_frames_can_be_listed(write):
    pose = (
        "double3 xformOp:translate.timeSamples = {\n7: (0, 0, -400),\n3: (0, 0, -410),\n}\n"
        'uniform token[] xformOpOrder = ["xformOp:translate"]'
    )
    dataset = open_dataset(write(board(pose=pose), dataset="uniform int[] plen:frames = [7, 3]"))

    distances_mm = {frame.number: frame.world_from_target["Board"][2][3] for frame in dataset.frames}
    assert list(distances_mm.items()) == [(3, -410.0), (7, -400.0)]


def test_a_lens_passes_the_check_but_is_no_dataset():
    lens = ROOT / "stages/lenses/double_gauss_100mm_tronnier.usda"

    assert load(lens).problems == []
    with pytest.raises(StageError, match="no-dataset"):
        open_dataset(lens)


@pytest.mark.parametrize("name", ["tiny_conventional", "tiny_plenoptic"])
def test_the_flattened_stage_stands_alone_and_reads_the_same(tmp_path, name):
    loaded = load(ROOT / f"tests/data/{name}/dataset.usda")
    alone = stage_in(tmp_path, loaded.flattened)

    again = load(alone)

    assert again.problems == []
    assert again.dataset == loaded.dataset
    assert again.flattened == loaded.flattened
    assert str(ROOT) not in loaded.flattened
    named = [f"./{entry.picture_file}" for entry in loaded.dataset.targets]
    named += [f"./{entry.parts_file}" for entry in loaded.dataset.cameras]
    assert sorted(re.findall("@([^@]*)@", loaded.flattened)) == sorted(named)  # what viewers find beside it


def test_a_surface_carries_its_shape_and_its_aperture(tmp_path):
    """Coefficients in the order of their powers; of the aperture only what its shape reads."""
    path = tmp_path / "dataset.usda"
    path.write_text(
        head("Dataset")
        + f"""
def "Dataset" (prepend references = @{TINY}@)
{{
    over "Rig"
    {{
        over "Lens"
        {{
            over "S1"
            {{
                uniform double plen:conic = -0.5
                uniform double[] plen:evenCoefficients = [0, 1e-7, -2e-11]
                uniform double[] plen:oddCoefficients = [1e-8]
                uniform token plen:apertureShape = "rectangular"
                uniform double2 plen:halfWidths = (20, 15)
                uniform double plen:apertureRotation = 10
            }}
            over "S2"
            {{
                uniform token plen:apertureShape = "annular"
                uniform double plen:innerSemiDiameter = 2
            }}
            over "Stop"
            {{
                uniform token plen:apertureShape = "polygonal"
                uniform int plen:blades = 6
                uniform double plen:apertureRotation = 30
            }}
        }}
    }}
}}
"""
    )

    lens = open_dataset(path, allow_roots=[ROOT]).cameras[0].camera.prescription

    front, second, stop = lens.surfaces[0], lens.surfaces[1], lens.stop
    assert (front.conic, front.even_coefficients, front.odd_coefficients) == (-0.5, (0.0, 1e-7, -2e-11), (1e-8,))
    assert (front.half_widths_mm, front.aperture_rotation_deg, front.blades) == ((20.0, 15.0), 10.0, 0)
    assert (second.inner_semi_diameter_mm, second.conic, second.aperture_rotation_deg) == (2.0, 0.0, 0.0)
    assert (stop.blades, stop.aperture_rotation_deg, stop.half_widths_mm) == (6, 30.0, None)


GROUPED = """
def PlenLens "Lens" (
    prepend references = @lenses/double_gauss_100mm_tronnier.usda@
)
{
    def PlenLensGroup "Rear"
    {
        uniform double2 plen:decentre = (0.05, -0.02)
        uniform double plen:pivot = 1.5
        uniform token[] plen:surfaces = ["S7", "S8", "S9"]
        uniform double2 plen:tilt = (0.1, -0.0)
    }

    def PlenLensGroup "Front"
    {
        uniform token[] plen:surfaces = ["S1", "S2"]
    }

    over "S3"
    {
        uniform double2 plen:tilt = (0, 0.2)
    }
}
"""


def test_groups_laid_over_a_lens_are_named_ranges_of_its_surfaces(tmp_path):
    path = tmp_path / "lens.usda"
    path.write_text(head("Lens") + GROUPED)
    stage, _ = open_stage(path)
    lens = read_prescription(stage.GetDefaultPrim())

    front, rear = lens.groups
    assert front == Group(name="Front", first=0, count=2)
    assert rear == Group(name="Rear", first=6, count=3, decentre_mm=(0.05, -0.02), tilt_deg=(0.1, 0.0), pivot_mm=1.5)
    assert list(rear.members) == [6, 7, 8]
    assert [i for i, surface in enumerate(lens.surfaces) if any(surface.tilt_deg)] == [2]
    assert not lens.is_centred
    assert Prescription(surfaces=rigs.tronnier().surfaces, groups=(front,)).is_centred


def test_groups_that_no_lens_can_have_are_refused_by_the_record():
    overlapping = (Group(name="A", first=0, count=2), Group(name="B", first=1, count=1))
    for groups in (overlapping, (Group(name="A", first=9, count=3),)):
        with pytest.raises(PrescriptionError, match="groups"):
            Prescription(surfaces=rigs.tronnier().surfaces, groups=groups)
