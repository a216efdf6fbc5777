"""The plenoptic half of the arena of example 06: laws of its judge and of the models that it writes down."""

import gzip
import json
import sys
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from tolerances import SIGMAS

EXAMPLE = Path(__file__).resolve().parents[2] / "examples/06_arena"
sys.path[:0] = [str(EXAMPLE), str(EXAMPLE / "plenoptic")]  # its modules lie beside the script that imports them

import arena  # noqa: E402
import baseline  # noqa: E402
import cameras  # noqa: E402
import compete  # noqa: E402
import judging  # noqa: E402
import libpleno  # noqa: E402
import models  # noqa: E402
import refocus  # noqa: E402
import twin  # noqa: E402
from rows import Rows  # noqa: E402

from pipeline.scene.load import load  # noqa: E402

FOCAL_MM, ARRAY_MM, GAP_MM, PIXEL_MM = 50.0, 57.0, 0.4, 0.01
MISSED_PX = 1e-6
"""What the judge's search for the frame of a model may leave [px]."""


def through_pinholes(points_mm, vertex_mm):
    """Where rays through pinholes behind an ideal thin lens meet the sensor: by similar triangles, step by step."""
    places = []
    for (x, y, z), vertex in zip(points_mm, vertex_mm, strict=True):
        behind = z * FOCAL_MM / (z - FOCAL_MM)
        image = np.array([-x, -y]) * behind / z
        slope = (image - vertex) / (behind - ARRAY_MM)
        places.append(vertex + slope * GAP_MM)
    return -np.array(places) / PIXEL_MM


@pytest.fixture(scope="module")
def truth():
    """A camera of pinholes behind a thin lens; its field at five distances, each point behind seven of them."""
    random = np.random.default_rng(1)
    distances = np.array([350.0, 380.0, 430.0, 500.0, 580.0])
    vertex_mm = random.uniform(-3, 3, (60, 2))
    points = np.repeat(
        [[x * z / 8, y * z / 8, z] for z in distances for x in (-0.3, 0.1, 0.4) for y in (-0.2, 0.3)], 7, 0
    )
    microlens = random.integers(0, len(vertex_mm), len(points))
    view, point = np.repeat(np.arange(5), 42), np.repeat(np.arange(30), 7)
    field = Rows(points, view, point, microlens, through_pinholes(points, vertex_mm[microlens]))
    return SimpleNamespace(field=field, boards=field, distances_mm=distances, vertex_mm=vertex_mm)


class Moved:
    """The true camera in a frame of its own, and off by a number of pixels behind every other microlens."""

    def __init__(self, truth, off_px=0.0):
        self.vertex_mm, self.off_px = truth.vertex_mm, off_px
        self.turn = Rotation.from_rotvec([0.01, -0.02, 0.03])
        self.shift = np.array([3.0, -2.0, 5.0])

    def project(self, points_mm, microlens):
        true = self.turn.inv().apply(points_mm - self.shift)
        return (
            through_pinholes(true, self.vertex_mm[microlens])
            + self.off_px * np.array([1.0, 0]) * (-1.0) ** microlens[:, None]
        )


def test_who_knows_the_camera_scores_zero_in_whatever_frame(truth):
    field = judging.error_field(truth, Moved(truth))

    assert np.abs(field.error_px).max() < MISSED_PX
    assert np.abs(judging.depth_errors_mm(truth, Moved(truth), field)).max() < MISSED_PX


def test_a_planted_bias_is_the_score(truth):
    field = judging.error_field(truth, Moved(truth, off_px=0.1))

    assert field.rms_px(field.rows.view >= 0) == pytest.approx(0.1, rel=0.05)


def test_a_wrong_focal_length_is_no_matter_of_the_frame(truth):
    """The judge may move a camera, not scale it: one that sees everything a hundredth larger is wrong."""
    scaled = SimpleNamespace(
        project=lambda points, microlens: through_pinholes(points * [1.01, 1.01, 1.0], truth.vertex_mm[microlens])
    )

    assert judging.error_field(truth, scaled).rms_px(truth.field.view == 2) > 0.2


def test_poses_count_relative_to_the_first():
    turn = Rotation.from_rotvec([[0.1, 0.2, 0.3], [0.3, -0.1, 0.0], [-0.2, 0.1, 0.4]])
    poses = np.tile(np.eye(4), (3, 1, 1))
    poses[:, :3, :3], poses[:, :3, 3] = turn.as_matrix(), [[1, 2, 400], [3, -2, 420], [0, 5, 450]]
    frame, off = np.eye(4), poses.copy()
    frame[:3, :3], frame[:3, 3] = Rotation.from_rotvec([0.3, 0.1, -0.2]).as_matrix(), [10, 20, 30]
    off[1:, 2, 3] += [3.0, -4.0]
    truth, views = SimpleNamespace(poses=poses), np.arange(3)

    assert judging.pose_errors(truth, frame @ poses, views) == pytest.approx((0.0, 0.0), abs=1e-9)
    assert judging.pose_errors(truth, frame @ off, views)[1] == pytest.approx(np.sqrt((9 + 16) / 2))


def test_centres_are_judged_by_what_they_stand_for():
    grid = np.stack(np.meshgrid(np.arange(10.0), np.arange(10.0)), axis=-1).reshape(-1, 2) * 20
    moved = grid + np.array([0.3, -0.4])
    judged = judging.centre_errors(moved[5:], {"centre": grid, "centroid": moved}, 8.0)

    assert judged["centre"]["rms_px"] == pytest.approx(0.5) and judged["centre"]["found"] == pytest.approx(0.95)
    assert judged["centroid"]["rms_px"] == pytest.approx(0.0, abs=1e-9)


def pinholes_as_projective(truth):
    """The model of Bok and Nousias of the fixture's camera: parameters, and centres of the micro-images."""
    centre_px = -truth.vertex_mm * (ARRAY_MM + GAP_MM) / ARRAY_MM / PIXEL_MM
    return models.projective_of_thin_lens(np.array([FOCAL_MM, ARRAY_MM, GAP_MM]), np.zeros(2), PIXEL_MM), centre_px


def test_the_twin_asks_its_camera_once_for_points_that_are_near(truth):
    """A camera of pinholes, of which every microlens but the last sees each point, and whose own list of microlenses
    starts with one that the true camera lacks; the judge's small moves follow derivatives, and larger ones are solved
    again.
    """
    index, asked = np.stack([np.arange(60), np.zeros(60, int)], axis=1), []

    def project(points_mm, accuracy_px, derivatives):
        asked.append(len(points_mm))
        point, lens = (each.ravel() for each in np.mgrid[: len(points_mm), :59])

        def x_px(shift):
            return through_pinholes(points_mm[point] + shift, truth.vertex_mm[lens])

        steps = 1e-4 * np.eye(3)
        slopes = np.stack([(x_px(step) - x_px(-step)) / 2e-4 for step in steps], axis=-1)
        x, y = x_px(np.zeros(3)).T
        return SimpleNamespace(point=point, microlens=index[lens], x_px=x, y_px=y, derivatives={"point": slopes})

    own = np.concatenate([[[-1, 0]], index])
    model = twin.Solved(SimpleNamespace(rig=SimpleNamespace(axial=own), project=project), index)
    points, lens = truth.field.points_mm[::7], truth.field.microlens[::7] % 59
    for shift, calls in (([0, 0, 0], 1), ([5e-3, -5e-3, 0.018], 1), ([0, 0, 20.0], 2)):
        moved = points + shift
        off = model.project(moved, lens) - through_pinholes(moved, truth.vertex_mm[lens])
        assert np.abs(off).max() < 1e-3 and len(asked) == calls
    assert np.isnan(model.project(points[:1], np.array([59]))).all()


def test_the_model_of_nousias_is_a_thin_lens_before_pinholes(truth):
    values, centre_px = pinholes_as_projective(truth)
    field, model = truth.field, models.projective(np.array([*values.values()]), centre_px)

    assert np.abs(model.project(field.points_mm, field.microlens) - field.image_px).max() < MISSED_PX


def test_a_floor_finds_the_camera_that_made_the_rows(truth):
    """From parameters two per cent off, with boards that are as unknown as in a calibration."""
    values, centre_px = pinholes_as_projective(truth)
    exact, random = np.array([*values.values()]), np.random.default_rng(2)
    poses = np.tile(np.eye(4), (6, 1, 1))
    poses[:, :3, :3] = Rotation.from_rotvec(random.uniform(-0.5, 0.5, (6, 3))).as_matrix()
    poses[:, 2, 3] = [300, 315, 330, 345, 360, 330]  # all on one side of what is imaged onto the array
    view, microlens = np.repeat(np.arange(6), 200), random.integers(0, len(truth.vertex_mm), 1200)
    board_mm = np.concatenate([random.uniform(-20, 20, (1200, 2)), np.zeros((1200, 1))], axis=1)
    seen_mm = np.einsum("nij,nj->ni", poses[view, :3, :3], board_mm) + poses[view, :3, 3]
    rows = Rows(board_mm, view, np.arange(1200), microlens, through_pinholes(seen_mm, truth.vertex_mm[microlens]))
    floor = baseline.Floor(
        tuple(values),
        exact * [1.02, 0.98, 1.02, 1.02, 1, 1] + [0, 0, 0, 0, 3, -3],
        np.array([0.1, 10, 10, 10, 1, 1]),
        lambda p: models.projective(p, centre_px),
        0.0,
    )
    fit = baseline.calibrate(SimpleNamespace(poses=poses), floor, rows)
    noisy = baseline.calibrate(SimpleNamespace(poses=poses), floor, rows.noisy(0.1, random))
    left = 2 - (6 + 6 * len(poses)) / len(rows.view)  # coordinates of a row, less its part of the unknowns

    assert fit.rms_px < MISSED_PX
    assert [*fit.parameters.values()] == pytest.approx(exact, rel=1e-6, abs=1e-4)
    assert np.abs(fit.poses - poses).max() < 1e-3
    assert noisy.rms_px == pytest.approx(0.1 * np.sqrt(left), rel=SIGMAS / np.sqrt(2 * left * len(rows.view)))


@pytest.mark.parametrize("rig", cameras.RIGS, ids=lambda rig: rig.name)
def test_all_cameras_of_the_arena_are_flawless_stages(rig, tmp_path):
    for flaw in cameras.FLAWS:
        stage = tmp_path / f"{flaw}.usda"
        cameras.write_stage(cameras.with_flaw(rig, flaw), stage)

        assert not load(stage).problems


def test_an_ideal_lens_with_its_pupil_in_itself_refocuses_where_it_images():
    bench = refocus.Bench(FOCAL_MM, 0.0, 0.0, ARRAY_MM, ARRAY_MM, ARRAY_MM, GAP_MM, 0.1, PIXEL_MM)
    z = np.array([300.0, 500.0, 900.0])
    behind = z * FOCAL_MM / (z - FOCAL_MM)
    moved = (
        ARRAY_MM - behind
    ) / behind  # of a microlens in the array for a step of 1 in the pupil, seen from the image
    shift = moved * (PIXEL_MM * ARRAY_MM / GAP_MM) / 0.1

    assert bench.distance_mm(shift, ARRAY_MM) == pytest.approx(z)


@pytest.mark.heavy(minutes=2)
def test_a_small_arena_of_plenoptic_cameras_runs(tmp_path, monkeypatch):
    """By the command, from exact rows before a camera with a ninth of its sensor: floors of our own, plenopticam of a
    package index, which finds centroids, and the twin, which is right where its truth is among its models.
    """

    def smaller(rig):
        (width_mm, height_mm), (width_px, height_px) = rig.array_mm, rig.size_px
        return replace(rig, array_mm=(width_mm / 3, height_mm / 3), size_px=(width_px // 3, height_px // 3))

    monkeypatch.setattr(arena, "small", smaller)
    monkeypatch.setattr(arena, "PLENOPTIC_NOISY", 0)
    monkeypatch.setattr(twin, "MOST", 200)
    command = ["arena.py", "plenoptic", "--small", "--only", "plenopticam", "twin", "--out", str(tmp_path)]
    monkeypatch.setattr(sys, "argv", command)
    arena.main()
    (case,) = json.loads((tmp_path / "plenoptic/results.json").read_text())["cases"].values()
    baseline, fitted = case["contestants"]["baseline"]["exact"], case["contestants"]["twin"]["exact"]
    centres = case["contestants"]["plenopticam"]["centres"]

    assert baseline["own_rms_px"] < 0.05 < max(baseline["field_px"])
    assert fitted["own_rms_px"] < 0.001 and max(fitted["field_px"]) < 0.005
    assert max(np.abs(fitted["depth_mm"])) < 0.02 < max(np.abs(baseline["depth_mm"]))
    assert centres["centroid"]["found"] > 0.9 and centres["centroid"]["rms_px"] < 0.5
    assert "plenopticam" in (tmp_path / "page.html").read_text()


def test_detected_corners_score_their_bias_and_exact_ones_zero():
    """Two frames of corners in three micro-images: one as they are, one with the fractions of the centres on top."""
    centres = [(0, 0, 10.25, 10.5), (1, 0, 33.5, 10.25), (0, 1, 21.75, 30.0)]
    table = np.array(centres, [(name, float) for name in ("k", "l", "u", "v")])
    corners = {(0, 0): (12.0, 9.0), (1, 0): (31.0, 13.0), (0, 1): (22.0, 28.5)}
    rows = [(k, l, u, v, frame) for frame in (1, 2) for (k, l), (u, v) in corners.items()]
    features = np.array(rows, [(name, float) for name in ("k", "l", "u", "v", "frame")])
    exact = [(1, k, l, u, v) for (k, l), (u, v) in corners.items()]
    moved = [(2, k, l, corners[k, l][0] + u % 1, corners[k, l][1] + v % 1) for k, l, u, v in centres]

    scores = compete.corners_judged(np.array(exact + moved), features, table)

    assert scores["1"]["corner"]["rms_px"] == 0 and scores["1"]["corner"]["found"] == 1
    assert scores["2"]["with fraction"]["rms_px"] == 0
    assert scores["2"]["corner"]["bias_x_px"] == 0.5 and scores["2"]["corner"]["bias_y_px"] == 0.25


@pytest.mark.parametrize(("off_px", "wrong"), [(0.0, 0.0), (0.3, 0.0), (-1.5, 1.0)])
def test_disparities_score_what_they_are_off_by(off_px, wrong):
    """Points whose images move by 0.3 of a pitch from one micro-image to the next, and one that two microlenses see."""
    pitch_px, count = 20.0, 21
    centre_px = np.stack(np.meshgrid(np.arange(6.0), np.arange(5.0)), axis=-1).reshape(-1, 2) * pitch_px
    point = np.repeat([0, 1, 2], [9, 9, 2])
    microlens = np.array([0, 1, 2, 6, 7, 8, 12, 13, 14, 9, 10, 11, 15, 16, 17, 21, 22, 23, 3, 4])
    middle = np.array([centre_px[microlens[point == number]].mean(axis=0) for number in point])
    image_px = centre_px[microlens] - 0.3 * (centre_px[microlens] - middle)
    rows = Rows(np.zeros((20, 3)), np.zeros(20, int), point, microlens, image_px)
    found = np.full((len(centre_px), count, count), 0.3 * pitch_px + off_px)

    judged = judging.disparity_errors(rows, centre_px, pitch_px, centre_px + 0.2, found)

    assert judged["corners"] == 10  # those in corners of the 3 x 3 are out of reach
    assert judged["bias_px"] == pytest.approx(off_px) and judged["median_px"] == pytest.approx(abs(off_px))
    assert judged["wrong"] == wrong


def test_disparities_are_read_where_the_corner_is():
    """A map that says its own column and row: what is read is the place of the corner in the micro-image."""
    pitch_px, count = 20.0, 21
    centre_px = np.array([[0.0, 0.0], [20.0, 0.0], [0.0, 20.0]])
    rows = Rows(np.zeros((3, 3)), np.zeros(3, int), np.zeros(3, int), np.arange(3), centre_px + np.array([3.0, -5.0]))
    row, column = np.mgrid[:count, :count]

    judged = judging.disparity_errors(rows, centre_px, pitch_px, centre_px, np.tile(100.0 * row + column, (3, 1, 1)))

    assert judged["bias_px"] == 100 * (10 - 5) + 10 + 3


def test_boards_that_start_mirrored_are_named_and_left_out(tmp_path):
    """Of three boards tilted by 22 degrees one starts tilted the other way, one 5 degrees off."""

    def written(tilts_deg):
        turns = [Rotation.from_euler("x", tilt, degrees=True).as_matrix() for tilt in tilts_deg]
        poses = [{"rotation": turn.T.tolist(), "translation": [[0.0, 0.0, -300.0]]} for turn in turns]
        return json.dumps({"poses": [{"frame": 1 + n, "pose": pose} for n, pose in enumerate(poses)]})

    (tmp_path / "initial-poses-7.js").write_text(written([22, -21, 17]))
    (tmp_path / "poses.js").write_text(written([22, 22, 22]))
    features = np.zeros(4, libpleno._KINDS[2])
    features["f6"], features["f2"] = [1, 2, 2, 3], [0.5, 1.5, 2.5, 3.5]
    sections = [np.ones(2, libpleno._KINDS[0]), np.ones(0, libpleno._KINDS[1]), features]
    rows = tmp_path / "observations.bin.gz"
    rows.write_bytes(gzip.compress(b"".join(len(one).to_bytes(8, "little") + one.tobytes() for one in sections)))

    mirrored = libpleno._mirrored(tmp_path, tmp_path / "poses.js")
    libpleno._write_without(mirrored, rows, tmp_path / "kept.bin.gz")
    centres, corners, kept = libpleno._sections(tmp_path / "kept.bin.gz")

    assert mirrored == [2]
    assert (len(centres), len(corners), kept["f6"].tolist(), kept["f2"].tolist()) == (2, 0, [1, 3], [0.5, 3.5])


def test_who_mixes_types_or_their_order_is_wrong_about_them():
    true_mm = np.tile([1.9, 2.1, 2.3], 20)
    swapped = np.tile([0.5, 0.7, 0.6], 20)
    mixed = np.where(np.arange(60) < 6, np.roll(true_mm, 1), true_mm)
    unknown = np.where(np.arange(60) < 30, np.nan, true_mm)

    assert judging.types_right(0.3 * true_mm, true_mm) == judging.types_right(unknown, true_mm) == 1.0
    assert judging.types_right(swapped, true_mm) == pytest.approx(1 / 3)
    assert judging.types_right(mixed, true_mm) == pytest.approx(0.9)
