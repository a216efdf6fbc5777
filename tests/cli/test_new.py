"""`pipeline new` as a user meets it: stages that pass `check`, the same again, with poses that fill what is seen."""

import dataclasses
import itertools
import json
import re
from pathlib import Path

import numpy as np
import pytest
from laws import rigs
from laws.solving import rig_of, solved
from pxr import Usd
from shorter import few
from stage_text import edited, head

from pipeline.app.authoring import new_dataset
from pipeline.app.authoring.poses import BoardPose, CameraField, Wish, poses_that_fill
from pipeline.camera.focusing.depth_of_field import foci, focused, view_of
from pipeline.camera.focusing.focus_request import FocusRequest
from pipeline.camera.parts.camera import Camera, Sensor
from pipeline.folders import shipped_folder
from pipeline.render.glow import TargetLight
from pipeline.render.imaging import irradiance
from pipeline.scene.dataset import Motions
from pipeline.scene.load import load
from pipeline.targets.patterns.checkerboard import Checkerboard
from pipeline.targets.target import Target

PARTS = ("--rig", "rigs/conventional_100mm.usda", "--target", "targets/charuco_8x5.usda")
PLENOPTIC = ("--lens", "lenses/double_gauss_100mm_tronnier.usda", "--f-number", "7", "--microlens-distance")
RIG = head("Rig")
PINHOLE = """def "Rig" (prepend references = @rigs/conventional_100mm.usda@)
{
    over "Camera"
    {
        uniform token plen:camera:model = "pinhole"
    }
}
"""
SINGLE = """def PlenMicrolensArray "Rig"
{
    uniform double[] plen:focalLengths = [0.9]
    uniform double plen:height = 5
    uniform token plen:layout = "square"
    uniform double plen:pitch = 0.125
    uniform double plen:width = 7
}
"""


NO_MOTION = Motions(targets={}, things={})
SMALL = """def PlenSensor "Sensor"
{
    uniform double plen:pixelPitch = 0.0055
    uniform int2 plen:resolution = (600, 450)
}
"""
UNFOCUSED = (
    *("--lens", "lenses/double_gauss_50mm_tronnier.usda", "--f-number", "2.7", "--sensor", "s.usda"),
    *("--microlenses", "a.usda", "--microlens-distance", "0.223", "--focus", "706"),
)


def filled(camera: Camera, board: Target, wish: Wish) -> tuple[CameraField, list[BoardPose]]:
    """A camera before a board, and its poses by real rays."""
    field = CameraField(camera=camera, target=board, wish=wish, vision_from_first=np.eye(4))
    return field, list(poses_that_fill([field]))


def test_a_new_dataset_passes_check_and_is_the_same_again_with_the_same_seed(run):
    for name, seed in (("a", "1"), ("b", "1"), ("c", "2")):
        assert run("new", "dataset", f"{name}.usda", *PARTS, "--poses", "1", "--fit", "--seed", seed)[0] == 0
    text, same, other = (Path(f"{name}.usda").read_text(encoding="utf-8") for name in ("a", "b", "c"))
    assert text.replace('"A"', '"B"').replace("</A/", "</B/") == same
    assert text.partition("timeSamples")[2] != other.partition("timeSamples")[2]
    loaded = load("a.usda", look=True)
    assert loaded.problems == []
    assert len(loaded.dataset.frames) == 1
    assert "of 28 points" in text  # a comment on each pose


def test_a_new_rig_is_focused_and_stopped_as_asked(run):
    parts = ("--lens", "lenses/tessar_100mm_zemax.usda", "--sensor", "sensors/sensor_640x480_10um.usda")
    assert run("new", "rig", "r.usda", *parts, "--focus", "1000", "--f-number", "8")[:2] == (0, "r.usda\n")
    code, output, _ = run("show", "r.usda")
    assert code == 0
    assert "focus at 1000 mm sets the sensor distance" in output
    assert "f-number                      8.00" in output
    assert run("new", "dataset", "d.usda", "--rig", "r.usda", *PARTS[2:], "--poses", "2", "--fit")[0] == 0
    assert load("d.usda").errors == []


THIN = ("--focal-length", "12", "--f-number", "2", "--sensor", "sensors/sensor_640x480_10um.usda")


def test_a_lens_that_nobody_knows_is_a_thin_one(run):
    """1/f = 1/a + 1/b; what an image costs is said: 640 x 480 x 256 x 0.1 us. Its distortion is none, and a calibration
    may free each of OpenCV's five coefficients.
    """
    code, _, log = run("new", "rig", "r.usda", *THIN, "--focus", "500")
    assert code == 0 and "640 x 480 px; an image takes about 7.9 s" in log
    shown = json.loads(run("show", "r.usda", "--json")[1])
    assert shown["sensor_distance_mm"] == pytest.approx(1 / (1 / 12 - 1 / 500), rel=1e-12)
    assert shown["lens"]["stop_diameter_mm"] == pytest.approx(6.0)
    stage = Usd.Stage.Open("r.usda")
    camera = stage.GetPrimAtPath("/Rig/Camera")
    written = {name: camera.GetAttribute(f"plen:camera:{name}").Get() for name in ("model", "distortion")}
    assert written == {"model": "thinLens", "distortion": [0.0] * 5}
    assert not re.search(r"-0\.0+\b", run("show", "r.usda")[1])


def test_a_rig_keeps_all_digits_of_what_was_asked(run):
    asked = ("--focal-length", "12.00125", "--f-number", "2", "--focus", "500.00375")
    assert run("new", "rig", "r.usda", *asked, "--sensor", THIN[-1])[0] == 0
    shown = json.loads(run("show", "r.usda", "--json")[1])
    assert shown["sensor_distance_mm"] == pytest.approx(1 / (1 / 12.00125 - 1 / 500.00375), rel=1e-12)


def test_a_rig_that_no_distance_focuses_says_what_to_give(run):
    """Infinity; but microlenses as far from the sensor as their focal length, as Lytro's, have the array in focus."""
    text = Path(shipped_folder("stages") / "mlas/michels_2019.usda").read_text(encoding="utf-8")
    Path("a.usda").write_text(text.replace("[1.9, 2.1, 2.3]", "[1.9]"), encoding="utf-8")
    rig = ("new", "rig", "r.usda", *THIN, "--microlenses", "a.usda", "--microlens-distance", "1.9")
    assert run(*rig, "--focus", "500")[0] == 0
    shown = json.loads(run("show", "r.usda", "--json")[1])
    assert shown["sensor_distance_mm"] - 1.9 == pytest.approx(1 / (1 / 12 - 1 / 500), rel=1e-12)
    far = ("new", "rig", "far.usda", *THIN, "--focus", "inf")
    assert "give --near and --far" in run(*far)[2] and not Path("far.usda").exists()
    assert run(*far, "--near", "300", "--far", "900")[0] == 0


@pytest.mark.parametrize("where", [("--focus", "0.5"), (), ("--focus", "500", "--sensor-distance", "12")])
def test_a_rig_that_cannot_be_leaves_no_file_and_names_no_line_of_it(run, where):
    code, output, log = run("new", "rig", "r.usda", *THIN, *where)
    assert (code, output) == (2, "") and "hint: " in log and ".usda:" not in log.replace("r.usda: error", "")
    assert not list(Path().glob("*.usda"))


def test_a_rig_that_lies_outside_is_told_without_a_file_that_nobody_has(run, tmp_path, monkeypatch):
    run("new", "rig", "r.usda", *THIN, "--focus", "500")
    (tmp_path / "below").mkdir()
    monkeypatch.chdir(tmp_path / "below")
    log = run("new", "dataset", "d.usda", "--rig", "../r.usda", *PARTS[2:])[2]
    assert log.startswith("d.usda: error: ") and "lies outside the folders" in log


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        ({"--rig": "rigs/convention_100mm.usda"}, 'did you mean "rigs/conventional_100mm.usda"?'),
        ({"--rig": "conventional_100mm"}, 'did you mean "rigs/conventional_100mm.usda"?'),
        ({"--rig": "nothing/like_it.usda"}, "`pipeline library`"),
        ({"--rig": "targets/charuco_8x5.usda"}, "targets/charuco_8x5.usda holds no camera"),
        ({"--target": "rigs/conventional_100mm.usda"}, "rigs/conventional_100mm.usda holds no target"),
        ({"--camera": "Kamera"}, 'did you mean "Camera"?'),
        ({"--target": "targets/circles_7x5.usda"}, "--fit"),
    ],
)
def test_what_cannot_be_is_refused_and_nothing_is_written(run, changed, said):
    asked = {**dict(zip(PARTS[::2], PARTS[1::2], strict=True)), **changed}
    words = [word for pair in asked.items() for word in pair]
    code, output, log = run("new", "dataset", "x.usda", *words, "--poses", "1")
    assert (code, output) == (2, "")
    assert said in log
    assert not list(Path().glob("*.usda"))


@pytest.mark.parametrize(
    ("out", "said"), [("no/such/x.usda", "mkdir -p no/such"), ("x.usd", "write x.usda"), ("mine.usda", "exists")]
)
@pytest.mark.parametrize("verb", ["dataset", "rig"])
def test_a_place_where_no_stage_can_be_written_is_refused_at_once_and_a_file_stays(run, verb, out, said):
    Path("mine.usda").write_text("mine", encoding="utf-8")
    of_rig = ("--lens", "lenses/tessar_100mm_zemax.usda", "--sensor", "sensors/none.usda", "--focus", "1000")
    code, output, log = run("new", verb, out, *(PARTS if verb == "dataset" else of_rig))
    assert (code, output) == (2, "") and said in log
    assert Path("mine.usda").read_text(encoding="utf-8") == "mine"


@pytest.mark.parametrize("is_plenoptic", [False, pytest.param(True, marks=pytest.mark.heavy)])
def test_poses_fill_the_image_and_stay_in_the_depth_of_field(is_plenoptic):
    camera = rigs.plenoptic(5.0, 500, 400) if is_plenoptic else rigs.conventional(4.5, 192, 144, 0.05)
    board = Target(Checkerboard(columns=4, rows=3, square_mm=1.2))
    wish = Wish(count=16, seed=3, blur_px=4.0)
    _, poses = filled(camera, board, wish)
    seen = np.concatenate([pose.seen_px[0] for pose in poses])
    assert np.isfinite(seen).all()
    size = np.array([camera.sensor.width_px, camera.sensor.height_px])
    assert (np.abs(seen - (size - 1) / 2) <= size / 2).all()
    thirds = {tuple(cell) for cell in np.floor((seen + 0.5) / size * 3).astype(int)}
    assert len(thirds) == 9
    blurred = foci(dataclasses.replace(camera, circle_of_confusion_px=wish.blur_px))
    near, far = min(f.depth_of_field_mm[0] for f in blurred), max(f.depth_of_field_mm[1] for f in blurred)
    depths = [
        (pose.vision_from_target[:3, :3] @ p + pose.vision_from_target[:3, 3])[2]
        for pose in poses
        for p in board.points().position_mm
    ]
    assert near < min(depths)
    assert max(depths) < far
    assert max(depths) - min(depths) > 0.6 * (far - near)
    assert max(pose.tilt_deg for pose in poses) > 20


def test_a_pose_is_solved_once_and_glances_choose_it(monkeypatch):
    """Ten places are tried for a pose; ray by ray 200 poses took minutes. A glance is right to a pixel."""
    solved_for = []
    exact = CameraField.seen_px

    def counted(field, pose):
        solved_for.append((field.roughly_px(pose), exact(field, pose)))
        return solved_for[-1][1]

    monkeypatch.setattr(CameraField, "seen_px", counted)
    camera = rigs.conventional(4.5, 192, 144, 0.05)
    _, poses = filled(camera, Target(Checkerboard(columns=4, rows=3, square_mm=1.2)), Wish(count=16, blur_px=4.0))
    assert len(poses) <= len(solved_for) < 1.3 * len(poses)
    assert np.nanmax([np.abs(rough - seen).max() for rough, seen in solved_for]) < 1


def test_what_is_around_the_points_is_in_the_image_as_well():
    """A board with wider squares in the same poses: its corners lie a third of a square or more farther out.

    Detectors need that: with discs and squares cut by the edge findCirclesGrid found two of eight boards.
    """
    camera = rigs.conventional(4.5, 192, 144, 0.05)
    board, wider = (Checkerboard(columns=4, rows=3, square_mm=square) for square in (1.2, 1.6))
    for pose in filled(camera, Target(board), Wish(count=8, seed=3, blur_px=4.0))[1]:
        assert len(solved(rig_of(camera), wider, pose.vision_from_target).solutions.point) == 12


def write_rig(run, kind: str) -> None:
    """The rig of docs/how_to/own_rig.md with three types of microlens, one of a single type, a pinhole, a Lytro's."""
    if kind == "pinhole":
        Path("r.usda").write_text(RIG + PINHOLE, encoding="utf-8")
        return
    if kind == "unfocused":
        array = edited(SINGLE, ("[0.9]", "[0.223]"), ("pitch = 0.125", "pitch = 0.077"))
        Path("a.usda").write_text(RIG + array, encoding="utf-8")
        Path("s.usda").write_text(head("Sensor") + SMALL, encoding="utf-8")
        assert run("new", "rig", "r.usda", *UNFOCUSED)[0] == 0
        return
    Path("a.usda").write_text(RIG + SINGLE, encoding="utf-8")
    parts = {
        "three types": ("mlas/michels_2019.usda", "1.7", "420", "sensors/sensor_800x600_10um.usda"),
        "one type": ("a.usda", "0.75", "410", "sensors/sensor_640x480_10um.usda"),
    }
    array, distance, focus, sensor = parts[kind]
    words = (*PLENOPTIC, distance, "--microlenses", array, "--focus", focus, "--sensor", sensor)
    assert run("new", "rig", "r.usda", *words)[0] == 0


@pytest.mark.parametrize("kind", few(["pinhole"], "unfocused", "one type", "three types"))
def test_a_fitted_board_is_sharp_behind_microlenses_and_seen_by_a_pinhole(run, kind):
    """Blur by real rays, and light and dark squares in images of the middle of the sensor.

    With the blur of a conventional camera the board of one type stood at 151 and 290 mm: micro-images of grey, whose
    standard deviation was 0.13 and 0.23 of white. Half of black and half of white have 0.5. Before Lytro's kind it
    stood where micro-images would be sharp, at 142 and 271 mm: 0.06 and 0.08.
    """
    write_rig(run, kind)
    target = ("--target", "targets/checkerboard_4x7.usda")
    assert run("new", "dataset", "d.usda", "--rig", "r.usda", *target, "--fit", "--poses", "2")[0] == 0
    loaded = load("d.usda", look=True)
    assert loaded.problems == []
    dataset = loaded.dataset
    camera, entry, board = focused(dataset.cameras[0].camera), dataset.cameras[0], dataset.targets[0]
    small = dataclasses.replace(camera, sensor=dataclasses.replace(camera.sensor, width_px=96, height_px=96))
    rig = rig_of(small if camera.microlenses else camera)
    for frame in dataset.frames:
        pose = np.array(frame.camera_from_world[entry.name]) @ np.array(frame.world_from_target[board.name])
        found = solved(rig, board.target.pattern, pose, 1e-2)
        if camera.microlenses is None:
            assert len(found.solutions.point) == 28
            continue
        assert len(found.solutions.point) > 0
        is_view = view_of(camera) is not camera  # its blur is that of a view, not of a micro-image
        for point in (
            [] if is_view else np.unique(found.solutions.point)
        ):  # 0.1 px of a diameter of 1 px: aberrations of the lens
            assert 2 * np.abs(found.rho_px[found.solutions.point == point]).min() < camera.circle_of_confusion_px + 0.1
        white = irradiance(rig, 16, None)
        lit = white > 0.5 * white.max()
        shown = irradiance(rig, 16, TargetLight([(board.target, pose)], 0.5, []).radiance)
        assert (shown[lit] / white[lit]).std() > (0.25 if is_view else 0.35)  # squares of two pixels of a view


SHUTTER = """def "Rig" (prepend references = @rigs/conventional_100mm.usda@)
{{
    over "Camera"
    {{
        double2 plen:shutter:exposure = (2, 1000)
        double2 plen:shutter:lineOffset = ({micro_s}, 1000000)
        uniform token plen:shutter:scanOrder = "topToBottom"
    }}
}}
"""


@pytest.mark.parametrize("micro_s", [30, 300])
def test_poses_before_a_shutter_are_held_while_it_is_open(run, micro_s):
    """480 lines are read in 14 ms, or in 144, while three frames of others would pass: those of this dataset wait."""
    Path("r.usda").write_text(RIG + SHUTTER.format(micro_s=micro_s), encoding="utf-8")
    assert run("new", "dataset", "d.usda", "--rig", "r.usda", *PARTS[2:], "--poses", "3", "--fit")[0] == 0
    loaded = load("d.usda", look=True)
    assert loaded.problems == []
    (entry,), frames = loaded.dataset.cameras, loaded.dataset.frames
    assert len(frames) == 3 and all(not frame.motions.get(entry.name, NO_MOTION).targets for frame in frames)
    first_s, end_s = entry.shutter.window_s(entry.camera.sensor.size_px)
    assert end_s - first_s == pytest.approx(2e-3 + micro_s * 1e-6 * (entry.camera.sensor.height_px - 1))
    assert all(b.number - a.number > 24 * (end_s - first_s) for a, b in itertools.pairwise(frames))


def test_more_blur_that_would_allow_no_steeper_tilt_is_no_remedy():
    """Farther than twice the nearest no target stands, however much blur is allowed."""
    lens = load(shipped_folder("stages") / "lenses/fisheye_10mm_muller.usda").lens.prescription
    sensor = Sensor(width_px=400, height_px=320, pitch_mm=0.03)
    camera = focused(FocusRequest(prescription=lens, sensor=sensor, focus_distance_mm=500.0))
    board = Target(Checkerboard(columns=8, rows=5, square_mm=60.0))
    wish = Wish(count=1, least_seen=0.5)
    field = CameraField(camera=camera, target=board, wish=wish, vision_from_first=np.eye(4))
    (line,) = new_dataset._limit([field])
    assert re.fullmatch(r"poses from \d+\.\d to \d+\.\d mm limit tilts to \d+ degrees", line), line


def test_best_and_poses_at_once_are_refused(run):
    code, _, log = run("new", "dataset", "d.usda", *PARTS, "--best", "2", "--poses", "9")
    assert code == 2
    assert "--poses and --best" in log
    assert not Path("d.usda").exists()


def test_fitted_poses_are_as_steep_as_the_depth_of_field_permits_and_the_limit_is_said(run):
    code, _, log = run("new", "dataset", "d.usda", *PARTS, "--poses", "10", "--fit")
    assert code == 0
    assert "the depth of field, 430.9 to 437.9 mm, limits tilts to" in log
    assert "a stop half as wide, or --blur 6, allows 40" in log
    assert log.splitlines()[0].startswith("pose 1 of 10: ")
    assert "limits tilts to" in Path("d.usda").read_text(encoding="utf-8")


def test_a_stereo_rig_gets_poses_that_both_cameras_see(run):
    cameras = "".join(
        f"""    def "{name}" (prepend references = @rigs/conventional_100mm.usda@)
    {{
        double xformOp:rotateY = {turn}
        double3 xformOp:translate = ({x}, 0, 0)
        uniform token[] xformOpOrder = ["xformOp:translate", "xformOp:rotateY"]
    }}
"""
        for name, turn, x in (("Left", -3.3, -25), ("Right", 3.3, 25))
    )
    Path("r.usda").write_text(f'{RIG}def Xform "Rig"\n{{\n{cameras}}}\n', encoding="utf-8")
    words = ("--rig", "r.usda", "--target", "targets/checkerboard_4x7.usda", "--poses", "1", "--fit")
    assert run("new", "dataset", "d.usda", *words)[0] == 0
    dataset = load("d.usda", look=True).dataset
    assert [entry.name for entry in dataset.cameras] == ["Rig.Left.Camera", "Rig.Right.Camera"]
    for entry in dataset.cameras:
        for frame in dataset.frames:
            pose = np.array(frame.camera_from_world[entry.name]) @ np.array(frame.world_from_target["Board"])
            found = solved(rig_of(entry.camera), dataset.targets[0].target.pattern, pose, 1e-2)
            assert len(found.solutions.point) == 28
    code, _, log = run("new", "dataset", "e.usda", "--rig", "d.usda", *PARTS[2:])
    assert code == 2 and "d.usda is a dataset" in log
