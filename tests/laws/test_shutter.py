"""Claim: a row of a moving target lies where its own line sees it, and so does the image; stillness needs no time."""

import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from builds import made
from laws import rigs
from laws.meshes import mesh
from laws.solving import planes_of, rig_of, solved
from scipy.interpolate import RegularGridInterpolator
from scipy.spatial.transform import Rotation
from shorter import few, few_cases
from stage_text import stage_in, tiny_text

from pipeline.app.verify import verify
from pipeline.camera.focusing.depth_of_field import focused
from pipeline.camera.focusing.ideal_lens import with_ideal_lens
from pipeline.camera.rig import Rig
from pipeline.files.exr import Part, read_exr
from pipeline.files.tables import Table, read_table
from pipeline.frames import rigid
from pipeline.motion import Motion, Shutter
from pipeline.products.surroundings import surroundings_at, visibility_then
from pipeline.products.views import PlacedOccluder, PlacedTarget, PlacedView
from pipeline.records.plain import to_plain
from pipeline.render.surroundings import Surroundings
from pipeline.targets.patterns.checkerboard import Checkerboard
from pipeline.targets.patterns.circles import CircleGrid
from pipeline.targets.target import AnyTarget, Target
from pipeline.truth.direct.direct_rows import guesses, solve
from pipeline.truth.judging import Rows, differences
from pipeline.truth.moving import solve_points, time_of_rows
from pipeline.truth.planes import Planes, tangent_planes
from pipeline.truth.positions.column_sets import column_set
from pipeline.truth.visibility import PointBundles, visibility

EXACT_PX = 1e-9
BOARD = Checkerboard(columns=4, rows=3, square_mm=2.0)
FLAT = Target(BOARD)
DISTANCE_MM = 434.4
Path_ = Callable[[float], np.ndarray]
"""Place of the board by time [s]."""


@pytest.fixture(scope="module")
def pinhole() -> Rig:
    camera = replace(rigs.conventional(), near_mm=None, far_mm=None)
    return rig_of(focused(with_ideal_lens(camera, "pinhole", ())))


def motion_of(pose: Path_, edges_s: list[float]) -> Motion:
    times = Motion.times_s(np.array(edges_s))
    return Motion(edges_s=tuple(edges_s), poses=tuple([[pose(t).tolist() for t in piece] for piece in times.tolist()]))


def moving(rig: Rig, pose: Path_, shutter: Shutter, *bends_s: float, target: AnyTarget = FLAT) -> Planes:
    size_px = rig.tracer.camera.sensor.size_px
    first, end = shutter.window_s(size_px)
    motion = motion_of(pose, [first - 0.01, *bends_s, end + 0.01])
    return Planes(planes_of(target, np.eye(4)), motion, shutter, size_px)


def shifted(x: float, y: float) -> np.ndarray:
    pose = rigs.facing(DISTANCE_MM)
    pose[:2, 3] += x, y
    return pose


def still(rig: Rig, pose: np.ndarray, accuracy_px: float = 1e-6) -> np.ndarray:
    """Positions of all points of the board, (p, 2)."""
    solutions = solved(rig, BOARD, pose, accuracy_px).solutions
    assert len(solutions.point) == len(BOARD.points_mm())
    return solutions.xy_px


@pytest.mark.parametrize(
    ("order", "axis", "sign"),
    [("topToBottom", 1, 1), ("bottomToTop", 1, -1), ("leftToRight", 0, 1), ("rightToLeft", 0, -1)],
)
def test_uniform_motion_before_a_rolling_shutter_lies_where_its_closed_form_says(pinhole, order, axis, sign):
    shutter = Shutter(scan_order=order, opens_s=0.002, line_s=5e-4)
    rows = solve_points(pinhole, moving(pinhole, lambda t: shifted(30 * t, -40 * t), shutter), slice(None), 1e-6, 0.05)
    # In a pinhole's image of a board across the axis uniform motion is uniform: y = y0 + v (opens + D line).
    first, last_line = still(pinhole, shifted(0, 0)), pinhole.tracer.camera.sensor.size_px[axis] - 1
    v = 100 * (still(pinhole, shifted(0.3, -0.4)) - first)
    start = 0.002 if sign > 0 else 0.002 + 5e-4 * last_line
    y = (first[:, axis] + v[:, axis] * start) / (1 - sign * v[:, axis] * 5e-4)
    time = start + sign * 5e-4 * y
    assert np.abs(v).min() > 20  # px/s: what is to be seen is pixels
    np.testing.assert_allclose(rows.solutions.xy_px, first + v * time[:, None], rtol=0, atol=EXACT_PX)


def test_truth_is_the_mean_over_an_exposure_in_which_the_motion_bends_and_gains_speed(pinhole):
    def pose(t: float) -> np.ndarray:
        return shifted(100 * max(t - 0.004, 0), 20 * t + 2000 * t**2)

    exposed = moving(pinhole, pose, Shutter(exposure_s=0.01), 0.004)
    rows = solve_points(pinhole, exposed, slice(None), 1e-6, 0.05)
    mean = shifted(100 * 0.006**2 / 2 / 0.01, 20 * 0.005 + 2000 * 0.01**2 / 3)
    np.testing.assert_allclose(rows.solutions.xy_px, still(pinhole, mean), rtol=0, atol=EXACT_PX)
    way = still(pinhole, pose(0.01)) - still(pinhole, pose(0.0))
    motion = time_of_rows(pinhole, exposed, rows.solutions).motion_px2
    np.testing.assert_allclose(motion, way[:, :, None] * way[:, None, :] / 12, rtol=1e-6)


def test_a_motion_turns_by_half_a_turn_in_a_piece_as_a_rotation_does():
    def turned(t: float) -> np.ndarray:
        return rigid(
            Rotation.from_rotvec(np.pi * t * np.array([0.36, 0.48, 0.8])).as_matrix(), np.array([t, -t, 400.0])
        )

    motion, times = motion_of(turned, [-1.0, 0.0, 1.0]), np.linspace(-1, 1, 41)
    np.testing.assert_allclose(motion.at(times), [turned(t) for t in times.tolist()], rtol=0, atol=1e-10)
    np.testing.assert_array_equal(motion.at(np.array([-9.0, 9.0])), motion.at(np.array([-1.0, 1.0])))


def turning(t: float) -> np.ndarray:
    turn = Rotation.from_rotvec([0.5 * t, 2.0 * t, -1.0 * t]).as_matrix()
    return rigid(turn @ rigs.facing(DISTANCE_MM)[:3, :3], np.array([40 * t, -25 * t, DISTANCE_MM + 60 * t]))


@pytest.mark.parametrize("kind", ["conventional", "plenoptic"])
def test_each_row_is_that_of_a_still_board_at_its_own_time(kind, request):
    rig = rig_of(request.getfixturevalue(kind))
    shutter = Shutter(scan_order="topToBottom", opens_s=-0.01, line_s=2e-4)
    planes = moving(rig, turning, shutter)
    rows = solve_points(rig, planes, slice(None), 1e-5, 0.05).solutions
    time = time_of_rows(rig, planes, rows).middle_s
    assert len(rows.point) >= len(planes.of_points) and np.ptp(time) > 0.002
    for number in range(0, len(time), 1 + len(time) // 4):
        board = planes_of(FLAT, turning(time[number]))[[rows.point[number]]]
        alone = solve(rig, guesses(rig, board)[0], board, 1e-5, 0.05).solutions
        same = alone.cell == rows.cell[number]
        assert same.sum() == 1
        np.testing.assert_allclose(alone.xy_px[same], rows.xy_px[None, number], rtol=0, atol=2e-5)


@pytest.mark.parametrize(("order", "turn"), [("rightToLeft", 1), ("leftToRight", -1)])
def test_columns_are_the_rows_of_a_camera_that_is_turned_with_all_it_sees(order, turn):
    camera, quarter = rigs.conventional(), np.array([[0.0, -turn], [turn, 0.0]])
    sensor = replace(camera.sensor, width_px=camera.sensor.height_px, height_px=camera.sensor.width_px)
    shutter, world = Shutter(scan_order="topToBottom", opens_s=-0.01, line_s=2e-4, exposure_s=5e-4), np.eye(4)
    world[:2, :2] = quarter
    seen = []
    for rig, pose, scan in (
        (rig_of(camera), turning, shutter),
        (rig_of(replace(camera, sensor=sensor)), lambda t: world @ turning(t), replace(shutter, scan_order=order)),
    ):
        planes = moving(rig, pose, scan)
        rows = solve_points(rig, planes, slice(None), 1e-6, 0.05).solutions
        seen.append(
            (rows.xy_px - (np.array(rig.tracer.camera.sensor.size_px) - 1) / 2, time_of_rows(rig, planes, rows))
        )
    (upright, time), (turned, turned_time) = seen
    np.testing.assert_allclose(turned, upright @ quarter.T, rtol=0, atol=2e-6)
    np.testing.assert_allclose(turned_time.middle_s, time.middle_s, rtol=0, atol=1e-9)
    np.testing.assert_allclose(turned_time.motion_px2, quarter @ time.motion_px2 @ quarter.T, rtol=0, atol=1e-6)
    assert (turned_time.lines == time.lines).all() and np.ptp(time.middle_s) > 0.002


@pytest.mark.parametrize("name", few(["chief"], "saddle", "centroid"))
def test_other_positions_of_a_moving_point_are_those_of_a_still_one_at_their_own_times(name):
    def pose(t: float) -> np.ndarray:
        turn = Rotation.from_rotvec([0.5 * t, 12.0 * t, -10.0 * t]).as_matrix()
        place = np.array([400 * t, -250 * t, DISTANCE_MM + 600 * t])
        return rigid(turn @ rigs.facing(DISTANCE_MM, 0.0, 20.0)[:3, :3], place)

    pattern = CircleGrid(columns=2, rows=1, spacing_mm=3.0, diameter_mm=1.0)
    target = Target(pattern if name == "centroid" else Checkerboard(columns=2, rows=1, square_mm=2.0))
    rig = rig_of(rigs.conventional())
    shutter = Shutter(scan_order="leftToRight", opens_s=-0.01, line_s=2e-4, exposure_s=1e-3)
    planes = moving(rig, pose, shutter, target=target)
    rows = solve_points(rig, planes, slice(None), 1e-5, 0.05).solutions
    x_px = column_set(name, rig, target, np.eye(4), planes, rows).x_px

    def still(t: float) -> np.ndarray:
        return column_set(name, rig, target, pose(t), Planes(planes_of(target, pose(t))), rows).x_px

    size_px = rig.tracer.camera.sensor.size_px
    own_s, that_of_j_s = (shutter.middle_s(x, size_px).tolist() for x in (x_px, rows.xy_px))
    for row in range(len(target.points().kinds)):
        np.testing.assert_allclose(x_px[row], still(own_s[row])[row], rtol=0, atol=1e-6)
        assert np.abs(x_px[row] - still(that_of_j_s[row])[row]).max() > 1e-5


@pytest.mark.parametrize(
    ("order", "other"), [("topToBottom", "bottomToTop"), ("rightToLeft", "leftToRight"), ("none", "none")]
)
def test_a_motion_that_runs_backwards_is_that_before_the_other_scan(pinhole, order, other):
    there = Shutter(scan_order=order, opens_s=0.003, line_s=2e-4 * (order != "none"), exposure_s=2e-3)
    _, end = there.window_s(pinhole.tracer.camera.sensor.size_px)
    back = replace(there, scan_order=other, opens_s=-end)
    one, reverse = (
        solve_points(pinhole, planes, slice(None), 1e-6, 0.05)
        for planes in (moving(pinhole, turning, there), moving(pinhole, lambda t: turning(-t), back))
    )
    np.testing.assert_allclose(one.solutions.xy_px, reverse.solutions.xy_px, rtol=0, atol=EXACT_PX)


def test_an_exposure_becomes_an_instant_by_its_square(pinhole):
    scan = Shutter(scan_order="topToBottom", line_s=2e-4)

    def rows(exposure_s: float) -> np.ndarray:
        shutter = replace(scan, opens_s=0.02 - exposure_s / 2, exposure_s=exposure_s)
        return solve_points(pinhole, moving(pinhole, turning, shutter), slice(None), 1e-6, 0.05).solutions.xy_px

    instant = rows(0.0)
    long, short = (np.linalg.norm(rows(exposure_s) - instant) for exposure_s in (0.04, 0.02))
    assert long > 1e-3 and long / short == pytest.approx(4.0, rel=0.01)
    np.testing.assert_allclose(rows(1e-9), instant, rtol=0, atol=EXACT_PX)


@pytest.mark.parametrize("exposure_s", [0.0, 0.01])
def test_what_moves_hides_a_row_as_if_it_stood_as_in_the_middle_of_the_row_s_exposure(exposure_s):
    """To the nearest of 33 instants: the share lies between those half a step before and after."""
    rig, shutter = rig_of(rigs.conventional()), Shutter(scan_order="topToBottom", line_s=1e-3, exposure_s=exposure_s)
    size_px, board = rig.tracer.camera.sensor.size_px, FLAT
    pose = rigs.facing(DISTANCE_MM) @ rigid(Rotation.from_rotvec([0, 0, 0.4]).as_matrix(), np.zeros(3))
    wall = mesh([(-900, 0, 390), (900, 0, 390), (900, -900, 390), (-900, -900, 390)])

    def fallen(time_s: float) -> np.ndarray:
        return rigid(np.eye(3), np.array([0.0, 60 * (time_s - 0.036), 0.0]))

    first, end = shutter.window_s(size_px)
    plain = {"kind": "checkerboard", "pattern": to_plain(BOARD), "surface": {"kind": "flat"}}
    falling = PlacedOccluder(
        occluder=to_plain(wall), vision_from_occluder=fallen(0).tolist(), motion=motion_of(fallen, [first, end])
    )
    seen = PlacedTarget(name="", target=plain, vision_from_target=pose.tolist())
    view = PlacedView(targets=(seen,), occluders=(falling,))
    planes = tangent_planes(pose, BOARD.points_mm())
    rows = solve(rig, guesses(rig, planes)[0], planes, 1e-4, 0.05).solutions
    bundles = PointBundles(rig.microlens(rows.cell), rows.xy_px, planes[rows.point])
    share = visibility_then(
        rig, surroundings_at(view, shutter, size_px), 0, Planes(planes, None, shutter, size_px), rows
    )
    middle_s, half_s = rows.xy_px[:, 1] * 1e-3 + exposure_s / 2, (end - first) / 64

    def alone(row: int, time_s: float) -> float:
        around = Surroundings([(board, pose)], [(wall, fallen(time_s))])
        return float(visibility(rig, around, 0, *bundles.only(np.array([row])))[0][0])

    ends = [[alone(row, time + sign * half_s) for sign in (-1, 1)] for row, time in enumerate(middle_s)]
    assert (share >= np.min(ends, axis=1) - 1e-12).all() and (share <= np.max(ends, axis=1) + 1e-12).all()
    assert np.ptp(ends, axis=1).max() < 0.5 and np.sum((share > 0) & (share < 1)) > 2


def test_lines_count_how_often_a_law_of_whole_lines_has_the_point(pinhole):
    shutter, counts = Shutter(scan_order="topToBottom", line_s=1e-3), set()
    for speed in (-50.0, 0.1, 50.0):
        planes = moving(pinhole, lambda t, speed=speed: shifted(0, speed * (t - 0.03)), shutter)
        rows = solve_points(pinhole, planes, slice(None), 1e-6, 0.05).solutions
        lines = time_of_rows(pinhole, planes, rows).lines
        for point in range(0, len(rows.point), 5):
            times = 1e-3 * np.arange(pinhole.tracer.camera.sensor.height_px)
            at = np.stack(
                [tangent_planes(shifted(0, speed * (t - 0.03)), BOARD.points_mm())[rows.point[point]] for t in times]
            )
            y = solve(pinhole, guesses(pinhole, at)[0], at, 1e-6, 0.0).solutions
            assert lines[point] == np.sum(np.rint(y.y_px) == y.point)
        counts |= set(lines.tolist())
    assert counts == {0, 1, 2}


def test_the_certificate_judges_rows_at_their_own_times(pinhole):
    rig = rig_of(rigs.conventional())
    planes = moving(rig, turning, Shutter(scan_order="topToBottom", opens_s=-0.01, line_s=2e-4, exposure_s=5e-4))
    rows = solve_points(rig, planes, slice(None), 1e-4, 0.05).solutions
    for shift_px in (0.0, 0.01):
        x_px = rows.xy_px + np.array([0.0, shift_px])
        judged = Rows(planes.exposed(rows.point, x_px), rows.cell, x_px, True)
        apart, sigma, _ = differences(rig, judged, 1e-3)
        np.testing.assert_allclose(apart[:, 1], -shift_px, rtol=0.2, atol=5 * sigma.max() + 1e-4)


SCAN = """
token scanOrder = "topToBottom"
double2 opens = (1, 500)
double2 lineOffset = (1, 1000)
"""
_ORIENTS = (
    "1: (0.9990482215818578, 0, 0, 0.043619387365336),\n            2: (0.9762960071199334, 0, 0.21643961393810288, 0),"
)
_PLACES = "1: (0, 0, -434.4),\n            2: (0.3, -0.2, -432),"


def stage(folder: Path, shutter: str, places: tuple[str, str], *edits: tuple[str, str]) -> Path:
    """The first frame of the tiny dataset with a shutter, whose board moves from one place to another in 1/24 s."""
    lines = "".join(f"            uniform {line.strip()}\n" for line in shutter.strip().splitlines())
    lines = re.sub(r"(token|double2|int) ", r"\1 plen:shutter:", lines)
    text = tiny_text(
        "conventional",
        (_ORIENTS, "1: (1, 0, 0, 0),"),
        (_PLACES, f"1: {places[0]},\n            2: {places[1]},"),
        ("            uniform bool plen:truth:rays = 1\n", lines),
        ("endTimeCode = 2", "endTimeCode = 1"),
        *edits,
    )
    folder.mkdir(parents=True)
    return stage_in(folder, text)


def carried(first: tuple[float, float], end: tuple[float, float]) -> tuple[str, str]:
    """An edit by which the camera moves along x and y."""
    samples = f"{{1: ({first[0]!r}, {first[1]!r}, 0), 2: ({end[0]!r}, {end[1]!r}, 0)}}"
    order = 'uniform token[] xformOpOrder = ["xformOp:translate"]'
    return 'over "Camera"', f'double3 xformOp:translate.timeSamples = {samples}\n        {order}\n        over "Camera"'


def built(path: Path, store: Path) -> tuple[Table, np.ndarray]:
    """The table of a build, and its image."""
    made(path, path.parent / "out", store)
    folder = path.parent / "out/frames/0001/Rig.Camera"
    (channel,) = read_exr(folder / "image.exr")["image"].channels.values()
    return read_table(folder / "correspondences.csv"), np.asarray(channel)


def test_each_line_of_labels_is_that_of_a_still_in_the_middle_of_its_exposure(tmp_path, common_store):
    asked = 'token[] plen:image:labels = ["depth", "position", "targets"]'

    def labels(name: str, shutter: str, first_s: float, end_s: float) -> np.ndarray:
        def at(place: list[float], way_mm: list[float]) -> list[tuple[float, ...]]:
            return [tuple((np.array(place) + 24 * t * np.array(way_mm)).tolist()) for t in (first_s, end_s)]

        places, camera = at([-0.4, 1.2, -434.4], [4.0, -8.0, 10.0]), at([0.0, 0.0], [-2.0, 1.0])
        path = stage(tmp_path / name, f"{shutter}{asked}", tuple(map(str, places)), carried(*camera))
        made(path, tmp_path / name / "out", common_store)
        read = read_exr(tmp_path / name / "out/frames/0001/Rig.Camera/labels.exr")["labels"]
        return np.stack(list(read.channels.values()), axis=-1)

    scanned = labels("scanned", f"{SCAN.replace('topToBottom', 'leftToRight')}double2 exposure = (1, 240)\n", 0, 1 / 24)
    start = labels("start", "", 0, 0)
    line = 17
    time_s = 0.002 + 0.001 * line + 0.5 / 240
    still = labels("still", "", time_s, time_s)[:, line]
    np.testing.assert_allclose(scanned[:, line], still, rtol=1e-6, atol=1e-5)
    assert np.nanmax(np.abs(still - start[:, line])) > 0.2


def test_flow_ends_in_the_line_that_sees_the_point_in_the_next_frame(tmp_path, common_store):
    """Beside the difference of the rows of both frames; at the time of the first line it is 0.1 px from there."""
    asked = 'token[] plen:image:labels = ["flow"]'
    places = "(-0.1, 0.3, -434.4)", "(0.0, 0.2, -434.4),\n            3: (0.1, -0.1, -430.4)"
    upright = "1: (1, 0, 0, 0),", "1: (1, 0, 0, 0), 2: (1, 0, 0, 0),"
    path = stage(tmp_path / "flow", f"{SCAN}{asked}", places, ("endTimeCode = 1", "endTimeCode = 2"), upright)
    made(path, tmp_path / "out", common_store)
    folders = [tmp_path / f"out/frames/{frame:04d}/Rig.Camera" for frame in (1, 2)]
    channels = read_exr(folders[0] / "labels.exr")["labels"].channels
    before, after = (read_table(folder / "correspondences.csv") for folder in folders)
    xy_px = [np.stack([table.numbers("x_px"), table.numbers("y_px")], axis=1) for table in (before, after)]
    start, way = xy_px[0], xy_px[1] - xy_px[0]
    assert len(way) == 6 and np.abs(way).max() > 0.5
    for axis, name in enumerate(("flow.X", "flow.Y")):
        flow = RegularGridInterpolator(tuple(map(np.arange, channels[name].shape)), channels[name].astype(float))
        np.testing.assert_allclose(flow(start[:, ::-1]), way[:, axis], rtol=0, atol=2e-3)


@pytest.mark.heavy
def test_lines_that_are_sampled_to_a_stated_noise_are_the_mean_of_stills_and_have_that_noise(tmp_path, common_store):
    scan = f"{SCAN.replace('topToBottom', 'rightToLeft')}double2 exposure = (1, 240)\nint instants = 2\n"

    def image(name: str, noise: float, still_s: float | None = None) -> Part:
        times_s, shutter = ((0.0, 1 / 24), scan) if still_s is None else ((still_s, still_s), "")
        places = tuple(f"({-0.4 + 192 * t!r}, 1.2, -434.4)" for t in times_s)
        made(
            stage(tmp_path / name, f"{shutter}double plen:image:noise = {noise}", places),
            tmp_path / name / "out",
            common_store,
        )
        return read_exr(tmp_path / name / "out/frames/0001/Rig.Camera/image.exr")["image"]

    rough, fine, finest = image("rough", 0.5), image("fine", 0.03), image("finest", 0.008)
    passes = [int(each.attributes["passes_most"]) for each in (rough, fine, finest)]
    assert passes[0] == 1 < passes[1] < passes[2]
    stills = [image(f"still{share}", 0.5, 0.002 + 0.011 + share / 240).channels["Y"] for share in (0.25, 0.75)]
    column = np.s_[:, -1 - 11]
    np.testing.assert_allclose(rough.channels["Y"][column], np.mean(stills, axis=0)[column], rtol=0, atol=1e-6)
    apart, mean = fine.channels["Y"] - finest.channels["Y"], finest.channels["Y"].mean()
    assert 0 < np.sqrt(np.mean(apart[apart != 0] ** 2)) < 1.5 * 0.03 * mean


def test_frames_that_move_and_frames_that_do_not_are_those_of_builds_alone(tmp_path, common_store):
    place, end = "(-0.4, 1.2, -434.4)", "(3.6, -6.8, -434.4)"
    edits = (
        (f"2: {place}", f"2: {place}, 3: {end}"),
        ("1: (1, 0, 0, 0),", "1: (1, 0, 0, 0), 2: (1, 0, 0, 0),"),
        ("endTimeCode = 1", "endTimeCode = 2"),
    )
    path = stage(tmp_path / "both", SCAN, (place, place), *edits)
    made(path, tmp_path / "out", common_store)

    def image(frame: int) -> np.ndarray:
        (channel,) = read_exr(tmp_path / f"out/frames/{frame:04d}/Rig.Camera/image.exr")["image"].channels.values()
        return np.asarray(channel)

    still = built(stage(tmp_path / "still", "", (place, place)), common_store)[1]
    moved = built(stage(tmp_path / "moved", SCAN, (place, end)), common_store)[1]
    np.testing.assert_array_equal(image(1), still)
    np.testing.assert_allclose(image(2), moved, rtol=0, atol=1e-6)
    assert np.abs(moved - still).max() > 0.1


def test_what_is_still_before_the_camera_is_that_of_an_instant_bit_for_bit(tmp_path, common_store):
    place, other = "(-0.3, 0.2, -434.4)", "(0.7, -0.8, -434.4)"
    instant, image = built(stage(tmp_path / "i", "", (place, place)), common_store)
    still, still_image = built(stage(tmp_path / "s", SCAN, (place, place)), common_store)
    both, both_image = built(stage(tmp_path / "b", SCAN, (place, other), carried((0, 0), (1, -1))), common_store)
    for table, picture in ((still, still_image), (both, both_image)):
        for name in ("x_px", "y_px", "blur_xx_px2", "visibility"):
            atol = 1e-9 if table is both else 0  # two motions that cancel leave rounding
            np.testing.assert_allclose(table.numbers(name), instant.numbers(name), rtol=0, atol=atol)
        assert (picture == image).all()
        assert (table.numbers("lines") == 1).all() and (table.numbers("motion_xx_px2") < 1e-15).all()


@pytest.mark.parametrize(("order", "axis"), few_cases([("rightToLeft", 0)], ("topToBottom", 1)))
def test_each_line_of_an_image_is_the_mean_of_still_images_of_its_instants(order, axis, tmp_path, common_store):
    def place(time_s: float) -> str:  # the board passes half of the image in a frame, and comes nearer
        way = 8.0 * 24 * time_s
        return f"({-0.4 + way * (axis == 0)!r}, {1.2 - way * (axis == 1)!r}, {-434.4 + way / 8!r})"

    ends, exposed = (place(0), place(1 / 24)), "double2 exposure = (1, 240)\nint instants = 2"
    scan = SCAN.replace("topToBottom", order)
    chief = '\ntoken[] plen:truth:columns = ["chief"]'
    rows, scanned = built(stage(tmp_path / "scanned", f"{scan}{exposed}{chief}", ends), common_store)
    assert " dropped_hidden 0, " in "".join(rows.comments)  # none of its points behind itself
    # The board moves by pixels meanwhile, and this lens has little coma.
    assert np.abs(rows.numbers("chief_x_px") - rows.numbers("x_px")).max() < 0.1
    assert np.abs(rows.numbers("chief_y_px") - rows.numbers("y_px")).max() < 0.1
    (times,) = read_exr(tmp_path / "scanned/out/cameras/Rig.Camera/times.exr")["time"].channels.values()
    assert verify(tmp_path / "scanned/out").agrees
    _, global_ = built(stage(tmp_path / "global", exposed, ends), common_store)

    def still(time_s: float) -> np.ndarray:
        return built(stage(tmp_path / f"still{time_s}", "", (place(time_s),) * 2), common_store)[1]

    for line in (6, 17):
        some = line if axis else np.s_[:, -1 - line]
        opens_s = 0.002 + 0.001 * line
        np.testing.assert_allclose(times[some], opens_s + 0.5 / 240, rtol=1e-6)
    instants = [still(opens_s + share / 240)[some] for share in (0.25, 0.75)]
    np.testing.assert_allclose(scanned[some], np.mean(instants, axis=0), rtol=0, atol=1e-6)
    assert np.abs(scanned[some] - global_[some]).max() > 0.1
    np.testing.assert_allclose(global_, np.mean([still(0.25 / 240), still(0.75 / 240)], axis=0), rtol=0, atol=1e-6)


def beside_the_board(bar: str, lamp: str) -> tuple[str, str]:
    """An edit that brings a bar before the board and a lamp, each with its place or the samples of it."""
    things = f"""
    def Mesh "Bar"
    {{
        int[] faceVertexCounts = [4]
        int[] faceVertexIndices = [0, 1, 2, 3]
        point3f[] points = [(-1, -9, 0), (1, -9, 0), (1, 9, 0), (-1, 9, 0)]
        uniform token subdivisionScheme = "none"
        double3 xformOp:translate{bar}
        uniform token[] xformOpOrder = ["xformOp:translate"]
    }}

    def SphereLight "Lamp"
    {{
        float inputs:intensity = 300
        float inputs:radius = 8
        double3 xformOp:translate{lamp}
        uniform token[] xformOpOrder = ["xformOp:translate"]
    }}

    def PlenCheckerboard "Board" ("""
    return '\n    def PlenCheckerboard "Board" (', things


def test_each_line_of_a_lit_image_has_lamps_and_shapes_where_they_are_at_its_time(tmp_path, common_store):
    ends, place = ((-6.0, 0.0, -425.0), (18.0, 0.0, -425.0)), "(-0.3, 0.2, -434.4)"
    lamps = (-60.0, 50.0, -340.0), (120.0, 10.0, -400.0)

    def at(pair, time_s: float) -> str:
        return f" = {tuple((np.array(pair[0]) + 24 * time_s * np.subtract(pair[1], pair[0])).tolist())}"

    def over(pair) -> str:
        return f".timeSamples = {{1: {pair[0]}, 2: {pair[1]}}}"

    moved = beside_the_board(over(ends), over(lamps))
    _, scanned = built(stage(tmp_path / "scanned", SCAN, (place, place), moved), common_store)
    line = 18
    still = beside_the_board(at(ends, 0.002 + 0.001 * line), at(lamps, 0.002 + 0.001 * line))
    _, image = built(stage(tmp_path / "still", "", (place, place), still), common_store)
    np.testing.assert_allclose(scanned[line], image[line], rtol=0, atol=1e-5 * image.max())
    assert np.abs(scanned - image).max() > 0.1 * image.max()
