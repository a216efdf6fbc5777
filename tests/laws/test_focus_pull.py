"""Claim: a camera whose lens or sensor changes is in each frame the still camera of that state, built once for each."""

import json
import re
from collections import Counter
from pathlib import Path

import numpy as np
import pytest
from builds import made
from pxr import Usd, UsdGeom
from stage_text import tiny_text

import pipeline
from pipeline.files.tables import read_table
from pipeline.products.graph import graph_of
from pipeline.scene.load import load, open_dataset

_RAYS = "            uniform bool plen:truth:rays = 1\n"
_SENSOR = '        over "Sensor"\n        {\n'
_SEED = "    uniform int plen:seed = 3\n"
_EXPORTS = f'{_SEED}    uniform token[] plen:exports = ["colmap", "opencv"]\n'


def stage(path: Path, camera: str, *edits: tuple[str, str], sensor: str = "", lens: str = "", end: int = 2) -> Path:
    """The tiny stage with lines of its camera, its sensor and its lens, and with a board that stands still after 2."""
    own = f'        over "Lens"\n        {{\n{lens}\n        }}\n\n' if lens else ""
    ended = ("endTimeCode = 2", f"endTimeCode = {end}"), (_SENSOR, f"{own}{_SENSOR}{sensor}\n")
    text = tiny_text("conventional", (_RAYS, f"{camera}\n"), *ended, *edits)
    for sample in re.findall(r"2: (\(.*\)),", text) if end > 2 else ():
        text = text.replace(f"2: {sample}", ", ".join(f"{number}: {sample}" for number in range(2, end + 1)))
    path.write_text(text, encoding="utf-8")
    return path


def focused(value: str) -> str:
    return f"double plen:camera:focusDistance{value}\ndouble plen:camera:sensorDistance = None"


def field_of_view(out: Path, frame: int) -> float:
    """Focal length of the pinhole that viewers see in the stage of a build."""
    built = Usd.Stage.Open(str(out / "dataset.usda"))
    return float(UsdGeom.Camera.Get(built, "/TinyConventional/Rig/Camera").GetFocalLengthAttr().Get(frame))


def test_a_frame_of_a_focus_pull_is_that_of_a_still_rig_byte_for_byte(tmp_path, common_store):
    pulled = made(
        stage(tmp_path / "pull.usda", focused(".timeSamples = {0: 410, 4: 450}"), (_SEED, _EXPORTS)),
        tmp_path / "pull",
        common_store,
    ).out
    assert sorted(path.name for path in (pulled / "cameras").iterdir()) == ["Rig.Camera.0001", "Rig.Camera.0002"]
    for frame, focus_mm in ((1, 420), (2, 430)):
        text, asked = focused(f" = {focus_mm}"), f"{_EXPORTS}    uniform int[] plen:frames = [{frame}]\n"
        still = made(stage(tmp_path / "still.usda", text, (_SEED, asked)), tmp_path / f"{frame}", common_store).out
        for place in (f"frames/{frame:04d}", "cameras"):
            files = sorted(path.name for path in (still / place / "Rig.Camera").iterdir())
            assert files == sorted(path.name for path in (pulled / place / f"Rig.Camera.{frame:04d}").iterdir())
            for file in files:
                state = (pulled / place / f"Rig.Camera.{frame:04d}" / file).read_bytes()
                assert (
                    state.replace(b"Rig.Camera.%04d" % frame, b"Rig.Camera")
                    == (still / place / "Rig.Camera" / file).read_bytes()
                ), file
        exported = np.load(pulled / f"exports/opencv/Rig.Camera.{frame:04d}.npz")
        record = json.loads((still / "cameras/Rig.Camera/camera.json").read_text())
        distance_px = record["pinhole"]["with_distortion"]["principal_distance_px"]
        assert exported["camera_matrix"][0, 0] == distance_px and exported["frames"].tolist() == [frame]
        assert pipeline.open_output(pulled).view(frame).camera == f"Rig.Camera.{frame:04d}"
        viewers = [field_of_view(folder, frame) for folder in (pulled, still)]
        assert viewers[0] == viewers[1] and viewers[0] != field_of_view(pulled, 3 - frame)
    listed = (pulled / "exports/colmap/cameras.txt").read_text().splitlines()
    assert len({line.split()[4] for line in listed if line[0] != "#"}) == 2


def test_a_frame_may_have_its_own_shutter(tmp_path, common_store):
    """Frame 1 is an instant; frame 2 is scanned while the board flies, with the files of a camera that always scans."""
    shutter = {"token plen:shutter:scanOrder": ('"none"', '"topToBottom"')}
    shutter |= {
        "double2 plen:shutter:lineOffset": ("(0, 1)", "(1, 1000)"),
        "double2 plen:shutter:opens": ("(0, 1)", "(-1, 50)"),
    }
    once = [f"{name}.timeSamples = {{1: {first}, 2: {second}}}" for name, (first, second) in shutter.items()]
    always = [f"{name} = {second}" for name, (_, second) in shutter.items()]
    folders = []
    for name, lines in (("once", once), ("always", always)):
        path = stage(tmp_path / f"{name}.usda", "\n".join(lines), end=3)
        folders.append(made(path, tmp_path / name, common_store).out)
    scanned, reference = (folder / "frames/0002" for folder in folders)
    rows = [read_table(folders[1] / f"frames/{n:04d}/Rig.Camera/correspondences.csv").numbers("x_px") for n in (2, 3)]
    assert np.abs(rows[0] - rows[1]).min() > 1e-3, "the board is where it is in frame 3, but it moved before"
    for file in ("image.exr", "correspondences.csv", "poses.json"):
        own = (scanned / "Rig.Camera.0002" / file).read_bytes().replace(b"Rig.Camera.0002", b"Rig.Camera")
        assert own == (reference / "Rig.Camera" / file).read_bytes(), file
    assert "t_s" not in (folders[0] / "frames/0001/Rig.Camera.0001/correspondences.csv").read_text()
    assert [path.name for path in (folders[0] / "frames/0003").iterdir()] == ["Rig.Camera.0002"]


def test_a_request_and_the_camera_that_fulfils_it_share_everything_but_what_states_the_request(tmp_path):
    asked = open_dataset(stage(tmp_path / "asked.usda", focused(" = 420")))
    sensor_mm = asked.cameras[0].camera.sensor_distance_mm
    placed = open_dataset(stage(tmp_path / "placed.usda", f"double plen:camera:sensorDistance = {sensor_mm!r}"))
    one, other = graph_of(asked).graph, graph_of(placed).graph
    assert list(one) == list(other)
    assert [name for name in one if one[name].canonical != other[name].canonical] == ["first_order/Rig.Camera"]


def test_a_hundred_frames_at_five_focus_settings_make_five_rigs(tmp_path):
    held = ", ".join(f"{20 * n + 1}: {400 + 10 * n}, {20 * n + 20}: {400 + 10 * n}" for n in range(5))
    dataset = open_dataset(stage(tmp_path / "pull.usda", focused(f".timeSamples = {{{held}}}"), end=100))
    assert [entry.asked.focus_distance_mm for entry in dataset.cameras] == [400, 410, 420, 430, 440]
    assert [len(dataset.frames_of(entry)) for entry in dataset.cameras] == [20] * 5
    kinds = Counter(name.partition("/")[0] for name in graph_of(dataset).graph)
    assert kinds["white"] == kinds["pinhole"] == 5 and kinds["camera"] == 2 * 5, "with and without planes"
    assert kinds["truth"] == kinds["image"] == 100


@pytest.mark.parametrize(
    ("sensor", "lens"),
    [
        ("double2 plen:offset = (0.1, 0)", ""),
        ("", 'over "Stop"\n{\ndouble plen:semiDiameter = 3\n}'),
        ("", 'over "S5"\n{\ndouble plen:thickness = 9\n}'),
        (
            "",
            'def PlenLensGroup "Front"\n{\nuniform token[] plen:surfaces = ["S1"]\ndouble2 plen:decentre = (0.2, 0)\n}',
        ),
    ],
)
def test_whatever_may_change_is_that_of_its_frame(tmp_path, sensor, lens):
    """Sensor shift, stop, gaps of a zoom, and a group that stabilises: samples 1: none, 2: this."""
    line = next(line for line in f"{sensor}\n{lens}".splitlines() if line.startswith("double"))
    name, _, value = line.partition(" = ")
    still = open_dataset(stage(tmp_path / "still.usda", "", sensor=sensor, lens=lens))
    sampled = f"{name}.timeSamples = {{2: {value}}}"
    moving = open_dataset(
        stage(tmp_path / "moving.usda", "", sensor=sensor.replace(line, sampled), lens=lens.replace(line, sampled))
    )
    assert len(moving.cameras) == 1 and moving.cameras[0].asked == still.cameras[0].asked  # held before the first
    other = value.replace("0.", "0.0").replace("3", "4").replace("9", "9.5")
    two = f"{name}.timeSamples = {{1: {other}, 2: {value}}}"
    moving = open_dataset(
        stage(tmp_path / "two.usda", "", sensor=sensor.replace(line, two), lens=lens.replace(line, two))
    )
    first, second = moving.cameras
    assert second.asked == still.cameras[0].asked != first.asked
    assert [entry.name for entry in moving.cameras] == ["Rig.Camera.0001", "Rig.Camera.0002"]


@pytest.mark.parametrize(
    ("camera", "lens", "code"),
    [
        (focused(".timeSamples = {1: 420, 2: 30}"), "", "out-of-reach"),
        (focused(".timeSamples = {1: 420, 2: None}"), "", "unreadable-value"),
        (focused(".spline = {\n1: 420; post none,\n3: 420,\n}"), "", "unreadable-value"),
        ("", 'over "S1"\n{\ndouble plen:thickness.timeSamples = {1: 8.8, 2: 1}\n}', "surfaces-cross"),
        ("", 'over "S1"\n{\nuniform double plen:radius.timeSamples = {1: 38.9, 2: 40}\n}', "uniform-animated"),
    ],
)
def test_mistakes_of_one_frame_are_told(tmp_path, camera, lens, code):
    problems = load(stage(tmp_path / "dataset.usda", camera, lens=lens, end=3)).problems
    assert code in [problem.code for problem in problems]
