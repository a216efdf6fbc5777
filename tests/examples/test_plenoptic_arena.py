"""The plenoptic half of the arena of example 06: laws of its judge and of the models that it writes down."""

import json
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

EXAMPLE = Path(__file__).resolve().parents[2] / "examples/06_arena"
sys.path[:0] = [str(EXAMPLE / "plenoptic"), str(EXAMPLE)]  # its modules lie beside the script that imports them

import baseline  # noqa: E402
import cameras  # noqa: E402
import compete  # noqa: E402
import judging  # noqa: E402
import models  # noqa: E402
import refocus  # noqa: E402
from truth import Rows  # noqa: E402

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


def test_the_model_of_nousias_is_a_thin_lens_before_pinholes(truth):
    values, centre_px = pinholes_as_projective(truth)
    p, field = np.array([*values.values()]), truth.field
    model = models.Projective(p[0], p[1], p[2:4], p[4:6], centre_px)

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
        lambda p: models.Projective(p[0], p[1], p[2:4], p[4:6], centre_px),
        0.0,
    )
    fit = baseline.calibrate(SimpleNamespace(poses=poses), floor, rows)

    assert fit.rms_px < MISSED_PX
    assert [*fit.parameters.values()] == pytest.approx(exact, rel=1e-6, abs=1e-4)
    assert np.abs(fit.poses - poses).max() < 1e-3


@pytest.mark.parametrize("rig", cameras.RIGS, ids=lambda rig: rig.name)
def test_all_cameras_of_the_arena_are_flawless_stages(rig, tmp_path):
    for flaw in cameras.FLAWS:
        stage = tmp_path / f"{flaw.name}.usda"
        stage.write_text(cameras.stage_text(cameras.with_flaw(rig, flaw.name)), encoding="utf-8")

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


@pytest.mark.heavy
def test_a_small_arena_of_plenoptic_cameras_runs(tmp_path):
    """With what package indexes have: the thin lens of our own, and plenopticam, which finds centroids."""
    command = [sys.executable, EXAMPLE / "plenoptic/compete.py", "--small", "--out", tmp_path]
    subprocess.run(command, check=True, cwd=EXAMPLE.parents[1])
    (case,) = json.loads((tmp_path / "plenoptic/results.json").read_text())["cases"].values()
    baseline, centres = case["contestants"]["baseline"], case["contestants"]["plenopticam"]["centres"]

    assert baseline["exact"]["own_rms_px"] < 0.05 < max(baseline["exact"]["field_px"])
    assert 0.1 < baseline["noise"]["own_rms_px"] < 0.2
    assert centres["centroid"]["found"] > 0.9 and centres["centroid"]["rms_px"] < 0.5
    assert "plenopticam" in (tmp_path / "page.html").read_text()


def test_detected_corners_score_their_bias_and_exact_ones_zero(tmp_path):
    """Two frames of corners in three micro-images: one as they are, one with the fractions of the centres on top."""
    centres = [(0, 0, 10.25, 10.5), (1, 0, 33.5, 10.25), (0, 1, 21.75, 30.0)]
    table = np.array(centres, [(name, float) for name in ("k", "l", "u", "v")])
    corners = {(0, 0): (12.0, 9.0), (1, 0): (31.0, 13.0), (0, 1): (22.0, 28.5)}
    lines = [f"{k},{l},{u},{v},0,0,{frame}" for frame in (1, 2) for (k, l), (u, v) in corners.items()]
    (tmp_path / "features.csv").write_text("\n".join(["# pixels", "k,l,u,v,rho,cluster,frame", *lines]))
    exact = [(1, k, l, u, v) for (k, l), (u, v) in corners.items()]
    moved = [(2, k, l, corners[k, l][0] + u % 1, corners[k, l][1] + v % 1) for k, l, u, v in centres]

    scores = compete.corners_judged(np.array(exact + moved), tmp_path, table)

    assert scores["1"]["corner"]["rms_px"] == 0 and scores["1"]["corner"]["found"] == 1
    assert scores["2"]["with fraction"]["rms_px"] == 0
    assert scores["2"]["corner"]["bias_x_px"] == 0.5 and scores["2"]["corner"]["bias_y_px"] == 0.25
