"""Splines on numbers that may change with time, and on others: what is read, and what check says where."""

from pathlib import Path

import numpy as np
import pytest
from places import DATA
from pxr import Usd
from stage_text import edited, over_tiny, stage_in

from pipeline.scene.load import Loaded, load, open_dataset, varied_cameras
from pipeline.scene.usd.problems import StageError

DISTANCE, FREE = "double plen:camera:sensorDistance", "double plen:camera:focusDistance = None"
PULL = f"{FREE}\n{DISTANCE}.spline = {{\nbezier,\n1: 131.8; post curve (0.25, 0.4),\n2.5: 131.9; pre (0.5, 0),\n}}"
MOVED = 'double xformOp:rotateZ.spline = {\n%s\n}\nuniform token[] xformOpOrder = ["xformOp:rotateZ"]'


def read(folder: Path, camera: str, lens: str = "") -> Loaded:
    return load(stage_in(folder, over_tiny(camera, lens)), [DATA])


def test_a_focus_pull_by_a_spline_has_its_value_in_each_frame_and_no_derivative(tmp_path):
    loaded = read(tmp_path, PULL)
    assert loaded.problems == []
    found = [entry.camera.sensor_distance_mm for entry in loaded.dataset.cameras]
    times, places = np.array([1, 1.25, 2, 2.5]), np.array([131.8, 131.8 + 0.25 * 0.4, 131.9, 131.9])
    to_power = np.array([[-1, 3, -3, 1], [3, -6, 3, 0], [-3, 3, 0, 0], [1, 0, 0, 0]])
    roots = np.roots(to_power @ times - [0, 0, 0, 2])
    u = next(root.real for root in roots if abs(root.imag) < 1e-9 and 0 <= root.real <= 1)
    assert found == pytest.approx([131.8, np.polyval(to_power @ places, u)], abs=1e-10)
    with pytest.raises(StageError, match="it is a spline"):
        varied_cameras(tmp_path / "dataset.usda", "Rig/Camera.plen:camera:sensorDistance", [DATA])


def test_steps_of_a_number_that_changes_are_steps_in_all_its_frames_at_any_rate(tmp_path):
    asked = "rel plen:truth:derivatives = </TinyConventional/Rig/Camera.plen:camera:sensorDistance>"
    path = stage_in(tmp_path, over_tiny(f"{FREE}\n{DISTANCE}.timeSamples = {{1: 131.8, 2: 131.9}}\n{asked}"))
    text = Usd.Stage.Open(str(path)).ExportToString()  # one file, as rates of files must agree
    for rate in (24, 1000):
        changed = edited(text, ("timeCodesPerSecond = 24", f"timeCodesPerSecond = {rate}"))
        dataset = open_dataset(stage_in(tmp_path, changed))
        ((number,),) = dataset.varied.values()
        assert 0 < number.step < 0.01
        for end, step in ((dataset, 0), (number.less, -number.step), (number.more, number.step)):
            found = [entry.camera.sensor_distance_mm for entry in end.cameras]
            assert found == pytest.approx([131.8 + step, 131.9 + step], abs=1e-12)


RADIUS = 'over "S1" {\nuniform double plen:radius.spline = { 1: 60; post linear, 2: 61 }\n}'


def distance(knots: str) -> str:
    return f"{FREE}\n{DISTANCE}.spline = {{\n{knots}\n}}"


@pytest.mark.parametrize(
    ("camera", "lens", "code", "line", "says"),
    [
        ("", RADIUS, "uniform-animated", 2, "or a spline"),
        (distance("1: 131.8; post linear,\n2: -5,"), "", "out-of-range", 4, "= -5"),
        (distance("bezier,\n1: 9; post curve (0.5, -80),\n2: 9,"), "", "out-of-range", 2, "= -8.7"),
        (MOVED % "1: 1e308; post linear,\n2: -1e308,", "", "out-of-range", 2, "1e+308"),
        (MOVED % "1: 0; post none,\n2: 3,", "", "no-pose-sample", 1, "no value"),
    ],
)
def test_mistakes_in_splines_are_told_at_their_lines(tmp_path, camera, lens, code, line, says):
    problems = read(tmp_path, camera, lens).errors
    lines = (tmp_path / "dataset.usda").read_text().splitlines()
    assert problems[0].code == code and {"written-twice", "usd-syntax"}.isdisjoint(one.code for one in problems)
    first = next(number for number, text in enumerate(lines, 1) if text == (camera or lens).splitlines()[0])
    assert problems[0].line == first + line - 1 and says in problems[0].message


def test_a_spline_that_repeats_itself_within_an_exposure_without_end_is_refused(tmp_path):
    moved = MOVED % "post: loop repeat,\n1: 0; post linear,\n1.00001: 1,"
    exposed = 'uniform double2 plen:shutter:exposure = (1, 100)\nuniform token plen:truth:method = "direct"\n'
    (problem,) = read(tmp_path, f"{exposed}{moved}").errors
    assert "more than 100 times" in problem.message
