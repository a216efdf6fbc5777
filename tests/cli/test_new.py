"""`pipeline new` as a user meets it: stages that pass `check`, the same again, with poses that fill what is seen."""

import dataclasses
import json
from pathlib import Path

import numpy as np
import pytest
from laws import rigs
from laws.solving import rig_of, solved

from pipeline.app.authoring.poses import Wish, poses_that_fill
from pipeline.camera.focusing.depth_of_field import foci
from pipeline.errors import UsageError
from pipeline.scene.load import load
from pipeline.share import share
from pipeline.targets.patterns.checkerboard import Checkerboard
from pipeline.targets.target import Target

PARTS = ("--rig", "rigs/conventional_100mm.usda", "--target", "targets/charuco_8x5.usda")


@pytest.fixture
def pipeline(tmp_path, monkeypatch, in_this_process):
    """Run the command in an empty folder: exit code, stdout, stderr."""
    monkeypatch.chdir(tmp_path)
    return in_this_process


def test_a_new_dataset_passes_check_and_is_the_same_again(pipeline):
    for name in ("a", "b"):
        assert pipeline("new", "dataset", f"{name}.usda", *PARTS, "--poses", "4", "--fit")[0] == 0
    one, other = (Path(f"{name}.usda").read_text(encoding="utf-8") for name in ("a", "b"))
    assert one.replace('"A"', '"B"').replace("</A/", "</B/") == other
    loaded = load("a.usda", look=True)
    assert loaded.problems == []
    assert len(loaded.dataset.frames) == 4
    assert "of 28 points" in one  # a comment on each pose


def test_another_seed_gives_other_poses(pipeline):
    texts = []
    for seed in ("1", "2"):
        pipeline("new", "dataset", f"{seed}.usda", *PARTS, "--poses", "1", "--fit", "--seed", seed)
        texts.append(Path(f"{seed}.usda").read_text(encoding="utf-8").partition("timeSamples")[2])
    assert texts[0] != texts[1]


def test_a_new_rig_is_focused_and_stopped_as_asked(pipeline):
    parts = ("--lens", "lenses/tessar_100mm_zemax.usda", "--sensor", "sensors/sensor_640x480_10um.usda")
    assert pipeline("new", "rig", "r.usda", *parts, "--focus", "1000", "--f-number", "8")[:2] == (0, "r.usda\n")
    code, output, _ = pipeline("show", "r.usda")
    assert code == 0
    assert "focus at 1000 mm sets the sensor distance" in output
    assert "f-number                      8.00" in output
    assert pipeline("new", "dataset", "d.usda", "--rig", "r.usda", *PARTS[2:], "--poses", "2", "--fit")[0] == 0
    assert load("d.usda").errors == []


THIN = ("--focal-length", "12", "--f-number", "2", "--sensor", "sensors/sensor_640x480_10um.usda")


def test_a_lens_that_nobody_knows_is_a_thin_one(pipeline):
    """1/f = 1/a + 1/b; what viewers need is in the file, and what an image costs is said: 640 x 480 x 256 x 0.1 us."""
    code, _, log = pipeline("new", "rig", "r.usda", *THIN, "--focus", "500")
    assert code == 0 and "640 x 480 px; an image takes about 7.9 s" in log
    shown = json.loads(pipeline("show", "r.usda", "--json")[1])
    assert shown["sensor_distance_mm"] == pytest.approx(1 / (1 / 12 - 1 / 500), rel=1e-12)
    assert shown["lens"]["stop_diameter_mm"] == pytest.approx(6.0)
    assert "usdview" not in pipeline("check", "r.usda")[2]


def test_a_rig_that_no_distance_focuses_says_what_to_give(pipeline):
    """As in Lytro's cameras, microlenses as far from the sensor as their focal length see every object through."""
    text = Path(share("stages") / "mlas/michels_2019.usda").read_text(encoding="utf-8")
    Path("a.usda").write_text(text.replace("[1.9, 2.1, 2.3]", "[1.9]"), encoding="utf-8")
    rig = ("new", "rig", "r.usda", *THIN, "--microlenses", "a.usda", "--microlens-distance", "1.9")
    assert "give --sensor-distance instead of --focus" in pipeline(*rig, "--focus", "500")[2]
    assert pipeline(*rig, "--sensor-distance", "14.2")[0] == 0
    far = ("new", "rig", "far.usda", *THIN, "--focus", "inf")
    assert "give --near and --far" in pipeline(*far)[2] and not Path("far.usda").exists()
    assert pipeline(*far, "--near", "300", "--far", "900")[0] == 0


@pytest.mark.parametrize("where", [("--focus", "0.5"), (), ("--focus", "500", "--sensor-distance", "12")])
def test_a_rig_that_cannot_be_leaves_no_file_and_names_no_line_of_it(pipeline, where):
    code, output, log = pipeline("new", "rig", "r.usda", *THIN, *where)
    assert (code, output) == (2, "") and "hint: " in log and ".usda:" not in log.replace("r.usda: error", "")
    assert not list(Path().glob("*.usda"))


def test_a_rig_that_lies_outside_is_told_without_a_file_that_nobody_has(pipeline, tmp_path, monkeypatch):
    pipeline("new", "rig", "r.usda", *THIN, "--focus", "500")
    (tmp_path / "below").mkdir()
    monkeypatch.chdir(tmp_path / "below")
    log = pipeline("new", "dataset", "d.usda", "--rig", "../r.usda", *PARTS[2:])[2]
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
def test_what_cannot_be_is_refused_and_nothing_is_written(pipeline, changed, said):
    asked = {**dict(zip(PARTS[::2], PARTS[1::2], strict=True)), **changed}
    words = [word for pair in asked.items() for word in pair]
    code, output, log = pipeline("new", "dataset", "x.usda", *words, "--poses", "1")
    assert (code, output) == (2, "")
    assert said in log
    assert not list(Path().glob("*.usda"))


@pytest.mark.parametrize(("out", "said"), [("no/such/x.usda", "mkdir -p no/such"), ("x.usd", "write x.usda")])
@pytest.mark.parametrize("verb", ["dataset", "rig"])
def test_a_place_where_no_stage_can_be_written_is_refused_at_once(pipeline, verb, out, said):
    of_rig = ("--lens", "lenses/tessar_100mm_zemax.usda", "--sensor", "sensors/none.usda", "--focus", "1000")
    code, output, log = pipeline("new", verb, out, *(PARTS if verb == "dataset" else of_rig))
    assert (code, output) == (2, "") and said in log


def test_a_file_that_is_there_stays(pipeline):
    Path("x.usda").write_text("mine", encoding="utf-8")
    assert pipeline("new", "dataset", "x.usda", *PARTS)[0] == 2
    assert Path("x.usda").read_text(encoding="utf-8") == "mine"


@pytest.mark.parametrize("is_plenoptic", [False, pytest.param(True, marks=pytest.mark.heavy)])
def test_poses_fill_the_image_and_stay_in_the_depth_of_field(is_plenoptic):
    camera = rigs.plenoptic(5.0, 500, 400) if is_plenoptic else rigs.conventional(4.5, 192, 144, 0.05)
    board = Target(Checkerboard(columns=4, rows=3, square_mm=1.2))
    wish = Wish(count=16, seed=3, blur_px=4.0)
    poses = poses_that_fill(camera, board, wish)
    seen = np.concatenate([pose.seen_px for pose in poses])
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


def test_what_is_around_the_points_is_in_the_image_as_well():
    """A board with wider squares in the same poses: its corners lie a third of a square or more farther out.

    Detectors need that: with discs and squares cut by the edge findCirclesGrid found two of eight boards.
    """
    camera = rigs.conventional(4.5, 192, 144, 0.05)
    board, wider = (Checkerboard(columns=4, rows=3, square_mm=square) for square in (1.2, 1.6))
    for pose in poses_that_fill(camera, Target(board), Wish(count=8, seed=3, blur_px=4.0)):
        assert len(solved(rig_of(camera), wider, pose.vision_from_target).found.point) == 12


@pytest.mark.heavy
def test_a_target_that_is_too_large_is_refused():
    """The command says so in `test_what_cannot_be_is_refused_and_nothing_is_written`."""
    with pytest.raises(UsageError, match="shows enough of it"):
        poses_that_fill(rigs.conventional(), Target(Checkerboard(columns=4, rows=3, square_mm=30.0)), Wish(count=1))
