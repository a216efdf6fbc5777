"""Claim: a lens or sensor that changes while a shutter is open is at each instant the still camera of that instant."""

from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from builds import made
from stage_text import mesh_text, stage_in, tiny_text

import pipeline
from pipeline.app.verify import verify
from pipeline.camera.focusing.depth_of_field import focused
from pipeline.camera.focusing.focus_request import FocusRequest
from pipeline.camera.integrals import Bundles, Integral, integrals
from pipeline.camera.parts.camera import Camera
from pipeline.camera.rig import Rig
from pipeline.camera.tracer import Tracer, parallel_planes
from pipeline.camera.tracing.moments import COLUMNS, WEIGHT
from pipeline.files.exr import read_exr
from pipeline.files.tables import read_table
from pipeline.graph.variants import preview_of
from pipeline.motion import Motion
from pipeline.scene.load import load, open_dataset
from pipeline.truth.direct.newton import mean_hit, over_exposure
from pipeline.truth.moving import solve_moving, time_of_rows
from pipeline.truth.planes import MovingPlanes, Pairs

_OPENS_S, _LINE_S, _EXPOSURE_S, _CODES_PER_S = -0.016, 5e-4, 0.01, 24
_SCANNED = """uniform token plen:shutter:scanOrder = "topToBottom"
uniform double2 plen:shutter:lineOffset = (1, 2000)
uniform double2 plen:shutter:opens = (-2, 125)
"""
_EXPOSED = f"{_SCANNED}uniform double2 plen:shutter:exposure = (1, 100)\n"
_PULL = {0: 400.0, 1: 420.0, 2: 470.0}
"""Focus distances [mm] by time code: the pull bends in frame 1."""


def stage(folder: Path, kind: str, camera: str, sensor: str = "", lines: int = 24) -> Path:
    """A tiny stage with one frame, the first, and further statements about its camera and its sensor."""
    edits = [
        ('over "Camera"\n        {\n', f'over "Camera"\n        {{\n{camera}\n'),
        ("endTimeCode = 2", "endTimeCode = 1"),
    ]
    edits.append(('over "Sensor"\n        {\n', f'over "Sensor"\n        {{\n{sensor}\n'))
    if kind == "conventional":
        edits += [("            uniform bool plen:truth:rays = true\n", ""), ("= (32, 24)", f"= (32, {lines})")]
    folder.mkdir(exist_ok=True)
    return stage_in(folder, tiny_text(kind, *edits))


def pulled(value: object) -> str:
    return f"double plen:camera:focusDistance{value}\ndouble plen:camera:sensorDistance = None\n"


def focus_mm(time_s: float) -> float:
    """Focus distance of the pull at a time after the code of the frame."""
    return float(np.interp(1 + _CODES_PER_S * time_s, list(_PULL), list(_PULL.values())))


def light_and_hit(camera: Camera, x_px: np.ndarray, microlens: int, z_mm: float) -> np.ndarray:
    """Light of the bundle of a position, and its mean hit on a plane across the axis times that, (3,)."""
    bundle = Bundles(x_px[None], np.array([microlens]), parallel_planes(z_mm, z_mm)[None])
    (moments,) = integrals(Tracer(camera), bundle, 3).moments
    return moments[WEIGHT] * np.array([1.0, *moments[:2]])  # type: ignore[no-any-return]


@pytest.mark.parametrize(("kind", "within_mm"), [("conventional", 1e-8), ("plenoptic", 1e-6)])
def test_a_position_is_that_of_the_mean_over_still_cameras_by_their_light(tmp_path, kind, within_mm):
    path = stage(tmp_path, kind, pulled(f".timeSamples = {_PULL}") + _EXPOSED)
    points = np.array([(x, y, 430.0) for x, y in ((-1.5, -1.2), (0.3, 1.4))])
    asked, seen = open_dataset(path).cameras[0].asked, pipeline.ready(path).project(points, accuracy_px=1e-7)
    assert isinstance(asked, FocusRequest) and set(seen.point) == set(range(len(points)))
    rig = Rig.of(Tracer(focused(asked)))
    cells = np.zeros(len(seen.point), int) if rig.tracer.lattice is None else rig.tracer.lattice.rows(*seen.microlens.T)
    starts_s, (node, share) = _OPENS_S + _LINE_S * seen.y_px, np.polynomial.legendre.leggauss(3)
    crosses = (starts_s < 0) & (starts_s + _EXPOSURE_S > 0)
    for row in (np.argmin(crosses), np.argmax(crosses)):  # one without the bend, and one with it
        x_px, microlens, start = np.array([seen.x_px[row], seen.y_px[row]]), rig.microlens(cells)[row], starts_s[row]
        assert crosses[row] == (row == np.argmax(crosses))
        sums, end = np.zeros(3), start + _EXPOSURE_S
        for first, last in pairwise([start, *([0.0] if crosses[row] else []), end]):
            for time_s, part in zip((first + last + (last - first) * node) / 2, (last - first) * share, strict=True):
                still = focused(replace(asked, focus_distance_mm=focus_mm(float(time_s))))
                sums += part * light_and_hit(still, x_px, microlens, 430.0)
        assert np.abs(sums[1:] / sums[0] - points[seen.point[row], :2]).max() < within_mm


_BOARD = "rel plen:targets = </TinyConventional/Board>\n"
_WALL = [(-90.0, -50.0, -424.0), (0.0, -50.0, -424.0), (0.0, 50.0, -424.0), (-90.0, 50.0, -424.0)]
_WALLED = _BOARD, f"{_BOARD}rel plen:occluders = </TinyConventional/Wall>\n{mesh_text('Wall', _WALL)}"


def test_before_a_shifting_sensor_rows_lie_where_their_closed_form_says(tmp_path, common_store):
    """The image rests behind the lens, and the sensor moves uniformly: y = y0 + v t, t = start + D y."""
    shutter = _EXPOSED.replace("(-2, 125)", "(-3, 100)")  # the board rests until the time code
    tables = {}
    for name, value in (("still", " = (0, 0)"), ("moving", ".timeSamples = {0: (0.3, -0.3), 2: (-0.3, 0.3)}")):
        path = stage(tmp_path / name, "conventional", shutter, f"double2 plen:offset{value}")
        path.write_text(path.read_text().replace(*_WALLED))
        built = made(path, tmp_path / name / "out", common_store, pictures=False)
        assert verify(built.out).agrees
        table = read_table(built.out / "frames/0001/Rig.Camera/correspondences.csv")
        tables[name] = [table.numbers(column) for column in ("x_px", "y_px", "visibility", "t_s", "motion_xy_px2")]
    (x0, y0, share0, *_), (x, y, share, time_s, motion) = tables["still"], tables["moving"]
    v = np.array([-1.0, 1.0]) * 0.3 * _CODES_PER_S / pipeline.ready(path).camera.sensor.pitch_mm  # px/s
    middle_s = (-0.03 + _EXPOSURE_S / 2 + _LINE_S * y0) / (1 - v[1] * _LINE_S)
    np.testing.assert_allclose(time_s, middle_s, rtol=0, atol=1e-9)
    np.testing.assert_allclose([x, y], [x0 + v[0] * middle_s, y0 + v[1] * middle_s], rtol=0, atol=1e-6)
    way = v * _EXPOSURE_S / (1 - v[1] * _LINE_S)  # of a point in the scanned image during an exposure
    np.testing.assert_allclose(motion, np.prod(way) / 12 * np.ones(len(x)), rtol=1e-6)
    assert len(x) == 4 and np.abs(x - x0).min() > 1
    np.testing.assert_allclose(share, share0, rtol=0, atol=0.02)
    assert ((share > 0.2) & (share < 0.8)).any()


def test_an_instant_without_light_has_no_part_in_a_position():
    """Behind the edge of a micro-image that shrinks: all light is of the first of two states, that at one node."""
    states = np.array([[[[1.0, 0.0], [0.25, 0.75]]]])

    def integrate(state: int, rows: slice | np.ndarray, on: np.ndarray) -> Integral:
        moments = np.full((1, COLUMNS), (3.0, np.nan)[state])
        moments[:, WEIGHT] = (2.0, 0.0)[state]
        return Integral(moments, np.full((1, 2), (1e-3, np.nan)[state]), np.zeros(1, bool), 1)

    mean = over_exposure(Pairs(np.zeros((1, 1, 2, 4, 3)), np.ones((1, 1)), states), integrate)
    np.testing.assert_allclose(mean_hit(mean.moments), [[3.0, 3.0]], rtol=1e-12)
    assert mean.moments[0, WEIGHT] == 2.0 * 1.25 / 2 and np.isfinite(mean.error_mm).all()


def test_motion_is_that_of_the_image_however_the_light_changes(tmp_path):
    """The sensor's way from the begin of an exposure to its end, while the iris closes."""
    shutter = "uniform double2 plen:shutter:exposure = (1, 50)\nuniform double2 plen:shutter:opens = (-3, 100)\n"
    path = stage(tmp_path, "conventional", shutter, "double2 plen:offset.timeSamples = {0: (0, 0), 1: (0.6, 0.3)}")
    iris = 'over "Lens"\n{\nover "Stop"\n{\ndouble plen:semiDiameter.timeSamples = {0: 4.5, 1: 1.5}\n}\n}\n'
    path.write_text(path.read_text().replace('over "Sensor"', iris + 'over "Sensor"'))
    ready = pipeline.ready(path)
    assert ready.shutter
    rests = Motion.of(lambda time_s: np.eye(4), ready.shutter.motion_s(ready.size_px))
    facing = parallel_planes(434.4, 434.4)[:1] * [[1], [1], [1], [-1]]
    board = MovingPlanes(facing, rests, ready.shutter, ready.size_px, ready.rig.camera_in_time)
    rows = solve_moving(ready.rig, board, slice(None), 1e-4, 0.05)
    assert rows and len(rows.solutions.point) == 1
    way_px = np.array([0.6, 0.3]) / 0.1 * _CODES_PER_S / 50
    motion_px2 = time_of_rows(ready.rig, board, rows.solutions).motion_px2
    unknown = replace(rows.solutions, jacobian=np.full((1, 2, 2), np.nan))
    assert time_of_rows(ready.rig, board, unknown).lines == [1]
    # Where the iris is another, the image is a little elsewhere.
    np.testing.assert_allclose(motion_px2, [np.outer(way_px, way_px) / 12], rtol=3e-3)


def test_each_line_of_an_image_is_that_of_the_still_camera_of_its_instant(tmp_path, common_store):
    labels = 'uniform token[] plen:image:labels = ["board"]\n'
    files = (("image", "Y"), ("labels", "A"), ("labels", "board.U"))

    def seen(name: str, camera: str) -> tuple[float, list[np.ndarray]]:
        path = stage(tmp_path / name, "conventional", camera + labels, lines=6)
        frame = made(path, tmp_path / name / "out", common_store).out / "frames/0001/Rig.Camera"
        light = pipeline.ready(path).rig.tracer.reference_weight_sr
        return light, [read_exr(frame / f"{kind}.exr")[kind].channels[channel] for kind, channel in files]

    shutter = _SCANNED.replace("(1, 2000)", "(1, 400)")
    of_frame, pull = seen("pull", pulled(f".timeSamples = {_PULL}") + shutter)
    stills = {line: seen(f"{line}", pulled(f" = {focus_mm(_OPENS_S + line / 400)!r}")) for line in (1, 4)}
    for line, (of_line, still) in stills.items():
        # As relative to the white scene of the frame, a camera that is focused nearer has less light.
        for scanned, alone, light, within in zip(
            pull, still, (of_line / of_frame, 1, 1), (1e-4, 1e-6, 1e-3), strict=True
        ):
            off = np.abs(scanned[line] - light * alone[line])
            # A line sees a focus a 128th of the frame beside its own, and one of the 64 rays of a pixel another square.
            assert np.nanquantile(off, 0.9) < within and np.nanmax(off) < 2 / 64
    apart = [
        np.nanmax(np.abs(one[1] - other[1]))
        for one, other in zip(*(still for _, still in stills.values()), strict=True)
    ]
    assert min(apart) > 0.01


@pytest.mark.parametrize(
    "wish",
    [
        "uniform double plen:image:noise = 0.01",
        'uniform token[] plen:truth:columns = ["chief"]',
        'uniform token[] plen:image:labels = ["flow"]',
        "rel plen:truth:derivatives = <../Lens/S1.plen:thickness>",
    ],
)
def test_what_a_changing_camera_cannot_do_is_refused(tmp_path, wish):
    samples = pulled(f".timeSamples = {_PULL}")
    assert not load(stage(tmp_path / "wished", "conventional", samples + wish)).errors
    (problem,) = load(stage(tmp_path / "both", "conventional", samples + _SCANNED + wish)).errors
    assert problem.code == "not-yet-supported" and wish.split()[-3].split(".")[0] in str(problem)


def test_a_preview_of_a_changing_camera_has_its_few_pixels_in_all_states(tmp_path):
    path = stage(tmp_path, "conventional", pulled(f".timeSamples = {_PULL}") + _SCANNED)
    (entry,) = preview_of(open_dataset(path)).cameras
    assert entry.in_time and entry.asked.sensor.size_px == (8, 6)
    assert {state.sensor for state in entry.in_time.states} == {entry.asked.sensor}
