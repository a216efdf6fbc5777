"""Claim: a motion is what USD says of it, in whatever way it is written, for cameras, targets, shapes and lamps."""

from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
from builds import cells, made
from scipy.optimize import brentq
from stage_text import head, in_the_library, stage_in, tiny_text

from pipeline.motion import Motion
from pipeline.scene.dataset import Dataset
from pipeline.scene.load import load

EXACT = 1e-9
"""Difference of poses [mm]: in images of these scenes a thousandth of it in pixels."""
PLACES = {"Rig": (0, 0, 0), "Board": (0, 0, -434.4), "Ball": (5, 5, -300), "Lamp": (0, 40, -200)}
SHARES = {"Rig": 0.25, "Board": 1.0, "Ball": -0.5, "Lamp": 2.0}
"""What of the motion each of them takes."""
TIMES, X = (0.0, 1.0, 1.125, 2.0, 3.0), (-4.0, 0.0, 1.0, 4.0, 4.5)
ORDER = 'uniform token[] xformOpOrder = ["xformOp:translate", "xformOp:translateX"]'
RAYS = "            uniform bool plen:truth:rays = 1\n"
SHUTTER = """over "Camera" {
uniform double2 plen:shutter:lineOffset = (1, 24000)
uniform double2 plen:shutter:exposure = (1, 500)
uniform token plen:shutter:scanOrder = "topToBottom"
}"""
ATTRIBUTE = "double xformOp:translateX"


def samples(share: float, times: Callable[[float], float] = float) -> str:
    entries = ", ".join(f"{times(t)!r}: {x * share!r}" for t, x in zip(TIMES, X, strict=True))
    return f"{ATTRIBUTE}.timeSamples = {{ {entries} }}"


def knots(share: float, times: Callable[[float], float] = float) -> str:
    entries = ", ".join(f"{times(t)!r}: {x * share!r}; post linear" for t, x in zip(TIMES, X, strict=True))
    return f"{ATTRIBUTE}.spline = {{ {entries} }}"


def curve(share: float) -> str:
    """From -4 to 4 with tangents of half and of a whole frame, so that time is no polynomial of the place."""
    first, last = f"0: {-4 * share!r}; post curve (0.5, {3 * share!r})", f"3: {4 * share!r}; pre (1, {-share!r})"
    return f"{ATTRIBUTE}.spline = {{ bezier, {first}, {last} }}"


def overs(motion: Callable[[float], str], clip: str = "") -> str:
    return "".join(
        f'over "{name}"{clip.replace("NAME", name)}\n{{\n{motion(share)}\n}}\n' for name, share in SHARES.items()
    )


def stage(folder: Path, way: str, camera: str) -> Path:
    """A scene whose parts move in one of the ways that USD has."""
    clip, other, motion = "", "", ""
    if way in ("samples", "knots", "curve"):
        motion = overs({"samples": samples, "knots": knots, "curve": curve}[way])
    elif way == "clips":
        files = "asset[] assetPaths = [@./other.usda@]\nasset manifestAssetPath = @./other.usda@"
        active = "double2[] active = [(0, 0)]\ndouble2[] times = [(0, 10), (3, 13)]"
        clip = (
            f' (\nclips = {{\ndictionary default = {{\n{files}\nstring primPath = "/Scene/NAME"\n{active}\n}}\n}}\n)\n'
        )
        other, motion = overs(lambda share: samples(share, lambda t: t + 10)), overs(lambda _: "", clip)
    else:
        kind = knots if way == "knots below an offset" else samples
        other = overs(lambda share: kind(share, lambda t: (t - 0.5) / 2))
    lines = {name: f"double3 xformOp:translate = {place}\n{ATTRIBUTE}\n{ORDER}" for name, place in PLACES.items()}
    things = f'def Sphere "Ball" {{\n{lines["Ball"]}\n}}\ndef SphereLight "Lamp" {{\n{lines["Lamp"]}\n}}'
    rig = f"{lines['Rig']}\n{camera}"
    text = in_the_library(things, board=lines["Board"], rig=rig, occluders="/Scene/Ball", end=2)
    (folder / "still.usda").write_text(text)
    (folder / "other.usda").write_text(f'{head("Scene", end=2)}over "Scene"\n{{\n{other}\n}}\n')
    below = "@./other.usda@ (offset = 0.5; scale = 2), " if "below" in way else ""
    top = head("Scene", end=2).replace(")\n", f"    subLayers = [{below}@./still.usda@]\n)\n")
    return stage_in(folder, f'{top}over "Scene"\n{{\n{motion}\n}}\n')


def read(path: Path) -> Dataset:
    loaded = load(path)
    assert not loaded.errors, loaded.errors
    return loaded.dataset


def line(code: float) -> float:
    return float(np.interp(code, TIMES, X))


def bezier(code: float) -> float:
    """The curve by its control points: the parameter at which the time is that, and the place there."""
    t, x = np.array([0, 0.5, 2, 3]), np.array([-4, -4 + 0.5 * 3, 4 + 1 * 1, 4])

    def at(u: float, points: np.ndarray) -> float:
        return float(points @ [(1 - u) ** 3, 3 * u * (1 - u) ** 2, 3 * u**2 * (1 - u), u**3])

    return at(brentq(lambda u: at(u, t) - code, 0, 1, xtol=1e-16), x)


def ways_of(dataset: Dataset) -> Iterator[tuple[str, int, Motion]]:
    """Motions before the camera, and its own, by the names above."""
    for frame in dataset.frames:
        (motions,) = frame.motions.values()
        yield "Rig", frame.number, motions.camera
        yield "Board", frame.number, motions.targets["Board"]
        for path, motion in motions.things.items():
            yield path.rpartition("/")[2], frame.number, motion


@pytest.mark.parametrize(
    "way", ["samples", "knots", "clips", "samples below an offset", "knots below an offset", "curve"]
)
def test_a_motion_written_in_any_way_is_the_same_before_a_shutter_and_without(way, tmp_path):
    place = bezier if way == "curve" else line
    for frame in read(stage(tmp_path, way, "")).frames:
        (camera,), (target,) = frame.camera_from_world.values(), frame.world_from_target.values()
        (ball,), (lamp,) = frame.world_from_occluder.values(), frame.world_from_lamp.values()
        found = [-camera[0][3], target[0][3], ball[0][3] - 5, lamp[0][3]]
        expected = [share * place(frame.number) for share in SHARES.values()]
        np.testing.assert_allclose(found, expected, rtol=0, atol=EXACT)
    dataset = read(stage(tmp_path, way, SHUTTER))
    moved, seen = list(ways_of(dataset)), dataset.cameras[0].shutter.motion_s(dataset.cameras[0].camera.sensor.size_px)
    assert sorted({name for name, _, _ in moved}) == sorted(SHARES) and len(moved) == 2 * len(SHARES)
    for name, number, motion in moved:
        for time in np.linspace(*seen, 57).tolist():
            x = place(number + 24 * time)
            of_camera = SHARES["Rig"] * (1 if name == "Rig" else -1) * x
            own = 0 if name == "Rig" else SHARES[name] * x + PLACES[name][0]
            assert motion.at(np.array([time]))[0, 0, 3] == pytest.approx(own + of_camera, abs=EXACT), (name, time)


@pytest.mark.heavy
def test_rows_of_a_board_that_a_spline_moves_are_those_of_time_samples(tmp_path, common_store):
    tables = []
    order = 'uniform token[] xformOpOrder = ["xformOp:translate", "xformOp:orient"]'
    moved = order.replace('["', '["xformOp:translateX", "')
    for motion in (samples(1.0), knots(1.0)):
        lines = "\n".join(SHUTTER.splitlines()[1:-1])
        text = tiny_text("conventional", (order, f"{motion}\n{moved}"), (RAYS, f"{lines}\n"))
        folder = tmp_path / str(len(tables))
        folder.mkdir()
        files = sorted(made(stage_in(folder, text), folder / "out", common_store).out.rglob("correspondences.csv"))
        tables.append([[float(row[x]) for row in cells(file) for x in ("x_px", "y_px")] for file in files])
    assert sum(map(len, tables[0])) > 8
    for one, other in zip(*tables, strict=True):
        np.testing.assert_allclose(one, other, rtol=0, atol=EXACT)
