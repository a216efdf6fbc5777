"""Claim: a lens, a sensor or a focus that changes while a shutter is open is refused at its line, whatever curve it
follows; what holds then passes.
"""

from pathlib import Path

import pytest
from pxr import Sdf, Usd
from stage_text import stage_in, tiny_text

from pipeline.scene.load import load, open_dataset

_OPEN = "uniform double2 plen:shutter:exposure = (1, 48)\nuniform double2 plen:shutter:opens = (-1, 96)\n"
"""From a quarter of a time code before that of the frame to a quarter after it."""
_FOCUS, _OFFSET, _IRIS = "double plen:camera:focusDistance", "double2 plen:offset", "double plen:semiDiameter"


def stage(folder: Path, focus: str = " = 420", shutter: str = _OPEN, sensor: str = "", stop: str = "") -> Path:
    """The tiny stage in two frames, whose board stands still, with what its focus, its sensor and its stop do."""
    camera = f"{_FOCUS}{focus}\ndouble plen:camera:sensorDistance = None\n{shutter}"
    lens = f'over "Lens"\n{{\nover "Stop"\n{{\n{stop}\n}}\n}}\n'
    opening = 'over "Sensor"\n        {\n'
    rays = "            uniform bool plen:truth:rays = 1\n"
    text = tiny_text("conventional", (rays, camera), (opening, f"{lens}{opening}{sensor}\n"))
    for name in ("orient", "translate"):
        before, _, rest = text.partition(f"xformOp:{name}.timeSamples = {{\n            1: ")
        value, _, after = rest.partition(",\n            2: ")
        text = f"{before}xformOp:{name} = {value}{after.partition('}')[2]}"
    return stage_in(folder, text)


_BUMP = """.spline = {
    bezier,
    1: 420; post curve (0.05, 0),
    1.1: 420; pre (0.05, 0); post curve (0.05, 4000),
    1.2: 420; pre (0.05, -4000); post held,
}"""
_LATE = ".spline = {\n    bezier,\n    0: 420; post held,\n    1.26: 430; post held,\n    1.74: 440; post held,\n}"
_STEP = _LATE.replace("1.26", "1.2")


@pytest.mark.parametrize(
    ("what", "frames", "values"),
    [
        ({"focus": ".timeSamples = {1: 420, 2: 430}"}, "frames 1-2", "420 at the time code, and 422.5 while"),
        (
            {"focus": ".timeSamples = {1: 420, 1.2: 430, 1.21: 420, 1.75: 440}"},
            "frame 1",
            "420 at the time code, and 430",
        ),
        ({"focus": ".timeSamples = {0.74: 410, 0.8: 420, 2: 420}"}, "frame 1", "420 at the time code, and 411.67"),
        (
            {"focus": ".timeSamples = {1: 420, 1.25: 420, 1.74: 420, 2: 430}"},
            "frame 2",
            "430 at the time code, and 420.38",
        ),
        ({"focus": _BUMP}, "frame 1", "420 at the time code"),
        ({"focus": _STEP}, "frame 1", "420 at the time code, and 430 while"),
        (
            {"sensor": f"{_OFFSET}.timeSamples = {{1: (0, 0), 2: (0.1, 0)}}"},
            "frames 1-2",
            "(0, 0) at the time code, and (0.025, 0)",
        ),
        (
            {"stop": f"{_IRIS}.timeSamples = {{0: 4, 2: 3}}"},
            "frames 1-2",
            "3.5 at the time code, and 3.625",
        ),
    ],
)
def test_what_changes_while_a_shutter_is_open_is_refused_at_its_line(tmp_path, what, frames, values):
    path = stage(tmp_path, **what)
    (problem,) = [each for each in load(path).problems if each.is_error]
    name = {"focus": _FOCUS, "sensor": _OFFSET, "stop": _IRIS}[next(iter(what))].split()[1]
    (line,) = (n for n, text in enumerate(path.read_text().splitlines(), 1) if f"{name}." in text)
    assert (problem.code, problem.line) == ("changes-while-open", line)
    assert problem.message.startswith(f'"{name}" does not hold') and f"open in {frames}: {values}" in problem.message
    assert "a state per frame" in (problem.hint or "")


@pytest.mark.parametrize(
    "focus",
    [
        ".timeSamples = {0.75: 420, 1.25: 420, 1.75: 430.1, 2.25: 430.1}",  # up to the very ends
        ".timeSamples = {0.7: 420.1, 1.3: 420.1, 1.5: 30, 1.7: 430, 2.3: 430}",  # out of reach between frames
        _LATE,
    ],
)
def test_a_state_that_holds_during_an_exposure_passes(tmp_path, focus):
    dataset = open_dataset(stage(tmp_path, focus))
    assert [len(dataset.frames_of(entry)) for entry in dataset.cameras] == [1, 1]


def test_without_a_shutter_and_in_the_instant_of_the_time_code_anything_may_change(tmp_path):
    still = "uniform double2 plen:shutter:exposure = (0, 1)\n"
    for number, shutter in enumerate(("", still)):
        (tmp_path / str(number)).mkdir()
        path = stage(tmp_path / str(number), ".timeSamples = {1: 420, 2: 430}", shutter)
        assert len(open_dataset(path).cameras) == 2


def test_value_clips_are_judged_as_usd_resolves_them(tmp_path):
    """A clip that runs faster than its stage changes between the exposures, and faster still in the second one."""
    path, name = stage(tmp_path), _FOCUS.split()[1]
    own, clip = Usd.Stage.Open(str(path)), Usd.Stage.CreateNew(str(tmp_path / "clip.usda"))
    camera = own.GetPrimAtPath("/TinyConventional/Rig/Camera")
    attribute = clip.OverridePrim("/Camera").CreateAttribute(name, Sdf.ValueTypeNames.Double)
    for time, value in ((0.0, 420.0), (2.6, 420.0), (2.8, 430.0), (4.0, 430.0), (6.0, 440.0)):
        attribute.Set(value, time)
    clip.GetRootLayer().Save()
    clips = Usd.ClipsAPI(camera)
    clips.SetClipAssetPaths(["./clip.usda"])
    clips.SetClipPrimPath("/Camera")
    clips.SetClipManifestAssetPath("./clip.usda")
    clips.SetClipActive([(0.0, 0.0)])
    camera.GetAttribute(name).Clear()
    for speed, wrong in ((1.75, []), (2.0, ["changes-while-open"])):
        clips.SetClipTimes([(0.0, 0.0), (10.0, 10.0 * speed)])
        own.GetRootLayer().Save()
        assert [each.code for each in load(path).problems if each.is_error] == wrong
