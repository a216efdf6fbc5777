"""The arena of example 06: laws of its judge, and its exchange of files."""

import itertools
import json
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from shorter import few
from tolerances import SIGMAS

import pipeline
from pipeline.camera.figures import equivalent_pinhole
from pipeline.scene.load import load

EXAMPLE = Path(__file__).resolve().parents[2] / "examples/06_arena"
sys.path[:0] = [str(EXAMPLE), str(EXAMPLE / "plenoptic")]  # its modules lie beside the script that imports them

import calibrating  # noqa: E402
import conditions  # noqa: E402
import judge  # noqa: E402
import scenes  # noqa: E402
from contestants import calibrate_twin, exchange  # noqa: E402
from rows import board_from_opencv  # noqa: E402

BIAS_PX, F_PX, CENTRE_MM = np.array([0.03, -0.02]), 700.0, np.array([0.4, -0.3, 9.0])
SPREAD_PX2 = np.array([[4e-4, 1e-4], [1e-4, 2e-4]])
NOISE_PX2 = np.array([[1e-4, -6e-5], [-6e-5, 9e-5]])


def test_a_detector_that_errs_by_a_known_law_is_judged_by_it():
    """Bias, spread over points and noise over repeats, each within its own standard error; lost points stay lost."""
    random, repeats, points = np.random.default_rng(1), 40, 900
    own = random.multivariate_normal(BIAS_PX, SPREAD_PX2, points)
    error = own + random.multivariate_normal(np.zeros(2), NOISE_PX2, (repeats, points))
    error[:, :90] = np.nan

    found = judge.detection(error)

    assert found is not None and found.found == pytest.approx(0.9)
    bias_sigma = np.sqrt(np.diag(SPREAD_PX2 + NOISE_PX2 / repeats) / 810)
    assert (np.abs(found.bias_px - BIAS_PX) < SIGMAS * bias_sigma).all()
    for covariance, true, count in ((found.spread_px2, SPREAD_PX2, 810), (found.noise_px2, NOISE_PX2, 810 * 39)):
        # Standard error of a sample covariance of a Gaussian.
        error_of = np.sqrt((np.outer(np.diag(true), np.diag(true)) + true**2) / count)
        assert (np.abs(covariance - true) < SIGMAS * error_of).all()
    assert found.lasting_px == pytest.approx(np.sqrt(BIAS_PX @ BIAS_PX + np.trace(SPREAD_PX2)), rel=0.1)


def test_few_repeats_do_not_pass_noise_off_as_spread():
    """Two repeats leave half of the noise in the means of points: the judge takes it off."""
    random = np.random.default_rng(2)
    found = judge.detection(random.normal(0, 0.1, (2, 4000, 2)))

    assert found is not None
    assert np.abs(found.spread_px2).max() < SIGMAS * 0.01 / np.sqrt(4000)


def test_a_detection_serves_one_point_and_only_near_ones():
    truth = np.array([[10.0, 10.0], [20.0, 10.0], [30.0, 10.0]])

    assert judge.matched(truth, np.array([[30.5, 10.0], [10.0, 11.0], [50.0, 50.0]])).tolist() == [1, -1, 0]
    assert judge.matched(truth, np.array([[15.0, 10.0]])).tolist() == [-1, -1, -1]  # half way between two
    assert judge.matched(truth, np.empty((0, 2))).tolist() == [-1, -1, -1]


def test_true_covariances_hold_their_share_and_halved_ones_less():
    random = np.random.default_rng(3)
    error = random.multivariate_normal(np.zeros(2), NOISE_PX2, 20_000)
    share_sigma = np.sqrt(judge.ONE_SIGMA * (1 - judge.ONE_SIGMA) / len(error))

    assert (
        abs(judge.inside_ellipse(error, np.tile(NOISE_PX2, (len(error), 1, 1))) - judge.ONE_SIGMA)
        < SIGMAS * share_sigma
    )
    # The share within k sigma is 1 - exp(-k^2 / 2) in two dimensions, so that of half the variance:
    halved = judge.inside_ellipse(error, np.tile(NOISE_PX2 / 2, (len(error), 1, 1)))
    assert abs(halved - (1 - np.sqrt(1 - judge.ONE_SIGMA))) < SIGMAS * share_sigma


def test_honest_sigmas_cover_and_boasted_ones_do_not():
    random, true, sigma = np.random.default_rng(4), np.array([700.0, 320.0]), np.array([0.5, 0.2])
    values = random.normal(true, sigma, (5000, 2))

    share, ratio = judge.coverage(values, np.tile(sigma, (5000, 1)), true)
    assert abs(share - judge.ONE_SIGMA) < SIGMAS * np.sqrt(0.25 / 10_000) and ratio == pytest.approx(1, rel=0.05)
    share, ratio = judge.coverage(values, np.tile(sigma / 3, (5000, 1)), true)
    assert share < 0.3 and ratio == pytest.approx(1 / 3, rel=0.05)


def pinhole(bend: float = 0.0) -> judge.ExactRays:
    """Rays of a pinhole at CENTRE_MM whose images are magnified by 1 + bend * r^2, r in principal distances."""
    grid = np.stack(np.meshgrid(np.linspace(-0.5, 639.5, 17), np.linspace(-0.5, 479.5, 13)), axis=-1)
    slope = (grid - [319.5, 239.5]) / F_PX
    slope = slope * (1 + bend * (slope**2).sum(axis=-1, keepdims=True))
    direction = np.concatenate([slope, np.ones((13, 17, 1))], axis=-1)
    origin = CENTRE_MM - direction * CENTRE_MM[2]
    return judge.ExactRays(
        query_px=grid, origin_mm=origin, direction=direction, fitted_mm=(400.0, 900.0), distances_mm=(300.0, 5000.0)
    )


EVERYWHERE = np.ones((13, 17), bool)


def slopes(rays):
    return rays[:, :2] / rays[:, 2:]


def test_the_exact_camera_has_no_error_in_whatever_frame():
    """Its own rays, turned by some degrees: the field vanishes, and its centre is found."""
    exact = pinhole(bend=-0.1)
    rays = exact.direction.reshape(-1, 3) @ Rotation.from_rotvec([0.05, -0.03, 0.2]).as_matrix().T
    unturned = judge.error_field(exact, slopes(exact.direction.reshape(-1, 3)), EVERYWHERE)
    turned = judge.error_field(exact, slopes(rays), EVERYWHERE)

    assert np.abs(unturned.error_px).max() < 1e-9
    np.testing.assert_allclose(unturned.centre_mm, CENTRE_MM, rtol=0, atol=1e-8)
    assert np.abs(turned.error_px).max() < 1e-6  # the solver ends at a relative change of 1e-8
    np.testing.assert_allclose(turned.centre_mm, CENTRE_MM, rtol=0, atol=1e-5)


def test_rays_that_meet_in_no_centre_are_judged_by_where_they_run():
    """A camera whose rays pass half a millimetre beside each other has no error, turned and moved; without the offsets
    of its rays it is a pinhole, and off by them.
    """
    central, random = pinhole(bend=-0.1), np.random.default_rng(7)
    exact = replace(central, origin_mm=central.origin_mm + random.normal(scale=0.5, size=(13, 17, 3)) * (1, 1, 0))
    turn = Rotation.from_rotvec([0.05, -0.03, 0.2]).as_matrix()
    origin, direction = ((each.reshape(-1, 3) @ turn.T) for each in (exact.origin_mm - CENTRE_MM, exact.direction))
    offsets = origin[:, :2] - slopes(direction) * origin[:, 2:]
    true = judge.error_field(exact, slopes(direction), EVERYWHERE, offsets)
    without = judge.error_field(exact, slopes(direction), EVERYWHERE)

    assert np.abs(true.error_px).max() < 1e-6
    np.testing.assert_allclose(true.centre_mm, CENTRE_MM, rtol=0, atol=1e-5)
    # Of both axes half a millimetre, at 291 mm from the centre, in units of the principal distance:
    assert without.rms_px(EVERYWHERE)[0] == pytest.approx(0.5 * np.sqrt(2) / 291 * F_PX, rel=0.2)


def test_a_wrong_principal_distance_is_an_error_of_the_known_size():
    """A pinhole of 1.001 times the principal distance projects every point 0.001 times its radius too far out.

    Moving the camera makes good for that on one plane, by 0.001 of the distance; with two it cannot. What is left on a
    plane at depth d, moved by m, is r (1.001 (1 + m / d) - 1). By similar triangles such a pinhole triangulates depths
    that are 1.001 times as large, from where it stands. If 1.001 is one sigma, the same error is that of projections.
    """
    exact = pinhole()
    rays = exact.direction.reshape(-1, 3) / [1.001, 1.001, 1.0]
    field = judge.error_field(exact, slopes(rays), EVERYWHERE)

    moved_mm = field.centre_mm[2] - CENTRE_MM[2]
    radius = exact.query_px - [319.5, 239.5]
    depths = np.array(exact.distances_mm) - CENTRE_MM[2]
    for error, depth in zip(field.error_px, depths, strict=True):
        np.testing.assert_allclose(error, radius * (1.001 / (1 - moved_mm / depth) - 1), rtol=0, atol=1e-4)
    # Least squares over the planes: the sum of (0.001 + m / d) / d over them vanishes, to first order.
    inverse = 1 / (np.array(exact.fitted_mm) - CENTRE_MM[2])
    assert moved_mm == pytest.approx(-0.001 * inverse.sum() / (inverse**2).sum(), rel=0.01)
    deep = judge.depth_errors_mm(exact, field, EVERYWHERE, 60.0)
    np.testing.assert_allclose(deep, np.abs(0.001 * (depths - moved_mm) + moved_mm), rtol=0.01, atol=1e-3)
    at_stop = exact.origin_mm[..., :2].reshape(-1, 2)
    said = {"slopes": slopes(exact.direction.reshape(-1, 3)), "offsets_mm": at_stop}
    said |= {"moved_slopes": slopes(rays)[None]}
    said |= {"moved_offsets_mm": CENTRE_MM[:2] - CENTRE_MM[2] * said["moved_slopes"]}
    stated_px2 = judge.stated_covariance(exact, said, EVERYWHERE)
    np.testing.assert_allclose(stated_px2, field.error_px[..., None] * field.error_px[..., None, :], 1e-3, 1e-5)


def test_the_hull_of_the_points_is_what_a_calibration_covers():
    grid = pinhole().query_px
    inside = judge.covered(grid, np.array([[100.0, 100.0], [500.0, 100.0], [300.0, 400.0]]))

    assert inside[6, 8] and not inside[0, 0] and not inside[-1, 2]


def test_poses_tell_where_the_centre_of_projection_is():
    """Perfect poses of a camera whose frame stands CENTRE_MM before the stop and is turned; and poses 1 mm too near."""
    random = np.random.default_rng(5)
    true, frame = np.tile(np.eye(4), (6, 1, 1)), np.eye(4)
    true[:, :3, :3] = Rotation.random(6, random_state=random).as_matrix()
    true[:, :3, 3] = random.uniform([-100, -100, 400], [100, 100, 900], (6, 3))
    frame[:3, :3] = Rotation.from_rotvec([0.02, -0.01, 0.03]).as_matrix()
    frame[:3, 3] = -frame[:3, :3] @ CENTRE_MM
    mean, scatter = judge.pupil_errors(true, frame @ true, CENTRE_MM)
    assert np.abs([mean, scatter]).max() < 1e-10

    near = true.copy()
    near[:, 2, 3] -= 1.0
    mean, _ = judge.pupil_errors(true, near, np.zeros(3))
    np.testing.assert_allclose(mean, [0, 0, 1], rtol=0, atol=1e-10)  # nearer boards: the camera stands farther in front


def test_a_contestant_that_fails_says_so_and_the_others_go_on(tmp_path):
    """One image of two breaks the script: its error is kept, the other image is answered."""
    script, images = tmp_path / "detect.py", tmp_path / "in/sharp"
    script.write_text(
        "def detect(image, board, option):\n"
        "    if image[0, 0]:\n        raise ValueError('too bright')\n"
        "    return {'xy': [[board['columns'], image.shape[0]]]}\n"
    )
    images.mkdir(parents=True)
    (images / "board.json").write_text(json.dumps({"columns": 8}))
    for name, grey in (("a", 0), ("b", 9)):
        exchange.write_pgm(images / f"{name}.pgm", np.full((5, 7), grey, np.uint8))
    command = [sys.executable, EXAMPLE / "contestants/exchange.py", script, tmp_path / "in", tmp_path / "out", ""]
    subprocess.run(command, check=True)

    assert np.load(tmp_path / "out/sharp/a.npz")["xy"].tolist() == [[8, 5]]
    assert (tmp_path / "out/sharp/b.txt").read_text() == "ValueError: too bright\n"


@pytest.mark.parametrize("step", few([len(conditions.BOARDS) + 1], 1))
def test_all_stages_of_the_arena_are_flawless(tmp_path, step):
    """In `make test` with boards that take turns."""
    pairs = list(itertools.product(conditions.CONDITIONS, conditions.BOARDS))[::step]
    stages = [*EXAMPLE.glob("calibration*.usda")]
    for number, (condition, board) in enumerate(pairs):
        stages.append(tmp_path / f"{number}.usda")
        conditions.write_stage(condition, board, stages[-1])
    problems = {stage.name: load(stage, allow_roots=(EXAMPLE,)).problems for stage in stages}

    assert len(stages) > 3 and {name: found for name, found in problems.items() if found} == {}


@pytest.mark.heavy(minutes=2)
def test_a_small_arena_runs_and_its_best_calibration_is_near_the_truth(tmp_path):
    command = [sys.executable, EXAMPLE / "arena.py", "conventional", "--small", "--out", tmp_path]
    subprocess.run([*command, "--only", "OpenCV SB", "Brown"], check=True, cwd=EXAMPLE.parents[1])
    results = json.loads((tmp_path / "results.json").read_text())

    assert results["missing"] == {} and (tmp_path / "page.html").stat().st_size > 10_000
    sharp = results["detectors"]["OpenCV SB"]["conditions"]["sharp"]
    assert sharp["found"] == 1 and sharp["against"]["J"]["lasting_px"] < 0.1
    exact = results["calibrators"]["OpenCV Brown"]["cases"]["exact"]
    assert 0.05 < max(exact["rms_px"]) < 0.2 and exact["own_rms_px"] < 0.01


@pytest.mark.heavy
def test_a_twin_that_is_the_camera_answers_with_its_rays_and_boards(monkeypatch):
    """No fit: its numbers are those of the stage, and its poses, too. What one sigma of them moves is stated."""
    path = EXAMPLE / "calibration.usda"
    stage, dataset, ready = (
        calibrate_twin.FreeStage(path, ["Made"], [EXAMPLE]),
        pipeline.open_dataset(path),
        pipeline.ready(path),
    )
    deviation = np.array([number.deviation for number in stage.numbers])
    poses = np.array([frame.world_from_target["Board"] for frame in dataset.frames])
    solution = SimpleNamespace(
        correction=np.zeros(len(deviation)),
        covariance=np.diag(deviation**2),
        deviation=deviation,
        poses=poses,
        residual_px=np.zeros((4, 2)),
    )
    monkeypatch.setattr(calibrate_twin, "fitted", lambda *_: SimpleNamespace(stage=stage, solution=solution))
    exact = scenes.exact_rays(ready, calibrating.FITTED_MM, calibrating.DISTANCES_MM)
    case = {"drawings": path, "view": np.zeros(4, int), "point": np.arange(4), "image_px": np.zeros((4, 2))}
    answer = calibrate_twin.calibrate(case | {"position": "exact", "query_px": exact.query_px.reshape(-1, 2)}, "")
    inside = np.isfinite(exact.direction[..., 0])
    field = judge.error_field(exact, answer["slopes"], inside, answer["offsets_mm"])
    stated_px2 = judge.stated_covariance(exact, answer, inside)
    centre_mm = equivalent_pinhole.pinhole(ready.camera).centre_mm
    turn = board_from_opencv(scenes.BOARD_COLUMNS, scenes.BOARD_ROWS, scenes.SQUARE_MM)
    true = np.array([frame.vision_from_target(ready.name, "Board") @ turn for frame in dataset.frames])
    true[:, :3, 3] -= centre_mm

    assert np.nanmax(np.abs(field.error_px)) < 0.001
    np.testing.assert_allclose(answer["poses"], true, rtol=0, atol=1e-9)
    assert np.trace(stated_px2, axis1=-2, axis2=-1)[:, inside].min() > 0
