"""A stage fitted to a camera: what was planted comes back, with stated deviations, and mistakes are named."""

import json
import os
import re
from dataclasses import replace
from functools import cache
from pathlib import Path

import cv2
import numpy as np
import pytest
from plugins.fits.planted import (
    INNER,
    OFF,
    centres,
    fitted,
    narrow_stage,
    only,
    plenoptic_stage,
    seen,
    stopped_down,
    table,
    white_image,
    wide_stage,
)
from scipy.spatial.transform import Rotation
from scipy.stats import chi2

from pipeline.camera.figures.equivalent_pinhole import pinhole
from pipeline.errors import UsageError
from pipeline.plugins.fits import predicted_rows
from pipeline.plugins.fits.association import associated
from pipeline.plugins.fits.calibration import calibrate
from pipeline.plugins.fits.first_poses import _pinhole_poses
from pipeline.plugins.fits.free_numbers import FreeStage
from pipeline.plugins.fits.observations import Observations, Stated, read_observations
from pipeline.plugins.fits.predicted_rows import Predictor, Views, moved, points_of
from pipeline.plugins.fits.twin import document
from pipeline.plugins.fits.twin_page import page
from pipeline.scene.load import load, open_dataset
from pipeline.truth.direct.direct_rows import solve

RADIUS = "Rig/Lens/S3.plen:radius"
TOLERANCES = """def PlenTolerance "Made"
{
rel plen:tolerance:of = [</Scene/Rig/Lens/S3.plen:radius>, </Scene/Rig/Sensor.plen:offset>]
uniform double plen:tolerance:spread = 0.02
}
def PlenTolerance "Sure"
{
rel plen:tolerance:of = </Scene/Rig/Lens/S5.plen:radius>
uniform double plen:tolerance:spread = 0
}
"""


@pytest.fixture(scope="module")
def narrow(tmp_path_factory) -> FreeStage:
    return FreeStage(narrow_stage(tmp_path_factory.mktemp("narrow"), TOLERANCES), ["Made"])


@pytest.fixture(scope="module")
def wide(tmp_path_factory) -> FreeStage:
    return FreeStage(wide_stage(tmp_path_factory.mktemp("wide"), frames=4), INNER)


@pytest.fixture(scope="module")
def exact(narrow) -> Observations:
    return seen(narrow, np.array([0.02, 0.01, -0.02]), 1e-5)


def test_a_planted_camera_comes_back_and_its_stage_makes_the_same_rows(tmp_path, narrow, exact):
    stage = FreeStage(narrow.path, [RADIUS, "Rig/Sensor.plen:offset"])
    stage.numbers = tuple(replace(number, prior=None) for number in stage.numbers)  # nothing pulls it back
    twin = fitted(stage, exact, tmp_path)
    assert twin.solution.converged and twin.doubts == []
    np.testing.assert_allclose(twin.solution.correction, [0.02, 0.01, -0.02], rtol=0, atol=1e-6)
    layer, beside = twin.write(tmp_path / "fitted.usda")
    (tmp_path / "flat.usda").write_text(load(layer, [narrow.path.parent]).flattened)
    assert load(tmp_path / "flat.usda").problems == []  # what a build of it delivers is a dataset again
    again = FreeStage(layer, [], [narrow.path.parent])
    same = fitted(again, exact, tmp_path, known_poses=True)
    assert np.abs(same.solution.residual_px).max() < 1e-7
    told = json.loads(beside.read_text())
    assert told["converged"] and told["numbers"][0]["after"] == open_radius(layer, narrow.path.parent)


def open_radius(layer: Path, folder: Path) -> float:
    return float(open_dataset(layer, [folder]).cameras[0].camera.prescription.surfaces[2].radius_mm)


def test_positions_that_a_detector_looks_for_are_those_that_are_fitted(tmp_path, narrow, exact, monkeypatch):
    """Chief rays, here 0.08 px off: of the planted camera they have no residual, as those of J they would."""
    stage, off = FreeStage(narrow.path, [RADIUS, "Rig/Sensor.plen:offset"]), np.array([0.02, 0.01, -0.02])
    stage.numbers = tuple(replace(number, prior=None) for number in stage.numbers)
    found = associated(exact, narrow.nominal)
    dataset = stage.at(off)
    predictor = Predictor(replace(found, position=np.full(len(found), "chief")), Views.of(found))
    poses = predictor.views.poses(dataset)
    chief = replace(exact, x_px=exact.x_px + predictor.offsets(dataset, poses, exact.x_px))
    assert np.abs(chief.x_px - exact.x_px).max() > 0.05
    file = table(chief, tmp_path / "seen.csv", ["pixel_origin: 0", "position: chief"])
    twin = calibrate(stage, [file], Stated(), known_poses=True)
    assert twin.solution.converged and np.abs(twin.solution.residual_px).max() < 1e-6
    np.testing.assert_allclose(twin.solution.correction, off, rtol=0, atol=1e-3)  # a micrometre of a radius of 39 mm
    monkeypatch.setattr("pipeline.plugins.fits.calibration._ROUNDS", 1)
    assert "did not settle" in calibrate(stage, [file], Stated(), known_poses=True).doubts[0]


def test_derivatives_by_poses_are_those_of_rows_that_are_solved_again(narrow, exact):
    """Means over bundles of ways and slopes, beside differences of solutions."""
    found = associated(exact, narrow.nominal)
    predictor, dataset = Predictor(found, Views.of(found)), narrow.nominal
    poses = predictor.views.poses(dataset)
    here = predictor.positions(dataset, poses, found.x_px)
    slopes = predictor.slopes(dataset, [], [], poses, here).by_pose
    for axis, step in enumerate((1e-4,) * 3 + (1e-2,) * 3):
        by = np.zeros((len(poses), 6))
        by[:, axis] = step
        more, less = (predictor.positions(dataset, moved(poses, sign * by), here) for sign in (1, -1))
        expected = (more - less) / (2 * step)
        np.testing.assert_allclose(slopes[:, :, axis], expected, rtol=0, atol=1e-7 * np.abs(expected).max())


def test_a_curved_board_has_a_first_pose_in_a_field_of_any_width():
    angle, y_mm = (axis.ravel() for axis in np.meshgrid(np.linspace(-0.6, 0.6, 8), np.linspace(-1.0, 1.0, 6)))
    board_mm = np.stack([1.8 * np.sin(angle), y_mm, 1.8 * np.cos(angle)], axis=1)
    pose = np.array([2.9, 0.1, 0.2, 0.1, -0.2, 0.0])  # a turn and a shift
    for distance_mm in (10.0, 400.0):
        placed_mm = Rotation.from_rotvec(pose[:3]).apply(board_mm) + pose[3:] + (0.0, 0.0, distance_mm)
        (found,) = _pinhole_poses(board_mm, placed_mm[:, :2] / placed_mm[:, 2:])
        np.testing.assert_allclose(found, pose + distance_mm * np.eye(6)[5], atol=1e-5 * distance_mm)


def test_a_tolerance_without_width_is_a_fixed_number_to_the_byte(tmp_path, narrow, exact):
    layers, first = [], only(exact, exact.frame == 1)
    for name, free in (("one", ["Made"]), ("two", ["Made", "Rig/Lens/S5.plen:radius"])):
        (tmp_path / name).mkdir()
        stage = FreeStage(narrow.path, free)
        layers.append(fitted(stage, first, tmp_path / name).write(tmp_path / name / "fitted.usda")[0].read_bytes())
    assert layers[0].replace(b"/one/", b"/two/") == layers[1]
    assert stage.fixed == ["/Scene/Rig/Lens/S5.plen:radius"] and b"S5" not in layers[1]


def test_opencv_finds_the_same_camera_of_the_same_corners(tmp_path, wide):
    found = seen(wide, OFF, 0.01, seed=1)
    views = Views.of(found)
    points = points_of(wide.nominal)["Board"].position_mm.astype(np.float32)
    of_view = [views.of_rows == view for view in range(len(views.keys))]
    rounded = found.x_px.astype(np.float32)  # OpenCV reads single precision
    twin = fitted(wide, replace(found, x_px=rounded.astype(float)), tmp_path)
    start = np.array([[700.0, 0, 320], [0, 700, 240], [0, 0, 1]])
    flags = cv2.CALIB_FIX_ASPECT_RATIO | cv2.CALIB_USE_INTRINSIC_GUESS
    boards, images = ([each[rows] for rows in of_view] for each in (points[found.point_id], rounded))
    _, matrix, distortion, _, _ = cv2.calibrateCamera(
        boards, images, (640, 480), start, None, flags=flags, criteria=(3, 500, 1e-16)
    )
    ours = pinhole(wide.at(twin.solution.correction).cameras[0].camera).distorted
    assert twin.solution.converged and twin.solution.steps <= 5  # near exact rows Gauss-Newton needs no more
    np.testing.assert_allclose(ours.principal_distance_px, matrix[0, 0], rtol=1e-6)
    np.testing.assert_allclose(ours.principal_point_px, matrix[:2, 2], rtol=1e-6)
    np.testing.assert_allclose(ours.distortion, distortion.ravel(), rtol=0, atol=1e-6 * np.abs(distortion).max())


@cache
def scattered(folder: Path, seeds: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Errors over deviations (s, m), chi squared and what is expected of it (s,), of calibrations with noise."""
    stage, errors, sums = FreeStage(wide_stage(folder, frames=8), INNER), [], []
    exact = seen(stage, OFF, 0.05)
    for seed in range(seeds):
        noise_px = np.random.default_rng(seed).normal(scale=0.05, size=exact.x_px.shape)
        twin = fitted(stage, replace(exact, x_px=exact.x_px + noise_px), folder)
        values, axes = np.linalg.eigh(twin.solution.covariance)
        errors.append(axes.T @ (twin.solution.correction - OFF) / np.sqrt(values))  # independent, each of variance 1
        all_of_it = twin.group("all", np.ones(len(twin.observations), bool))
        sums.append((all_of_it.chi2, all_of_it.expected))
    chi, expected = np.array(sums).T
    return np.array(errors), chi, expected


@pytest.mark.heavy(minutes=3)
def test_numbers_scatter_by_the_stated_covariance_and_so_does_chi_squared(tmp_path):
    """Of twelve fits, with errors of 8 numbers each: stated deviations that are 1.3 times too small or too large fail.
    TWIN_SEEDS=100 takes a quarter of an hour, and tells a tenth: docs/evidence.md."""
    errors, chi, expected = scattered(tmp_path, seeds=int(os.environ.get("TWIN_SEEDS", 12)))
    of_each = ", ".join(f"{each:.2f}" for each in (errors**2).mean(axis=0))
    print(f"{len(chi)} fits: squares of errors over deviations are {(errors**2).mean():.3f} in the mean: {of_each}")
    print(
        f"chi squared {chi.sum():.1f}, expected {expected.sum():.1f}; of one fit it scatters by {chi.std():.1f}", end=""
    )
    print(f", expected {np.sqrt(2 * expected.mean()):.1f}")
    for sum_of_squares, count in ((errors**2).sum(), errors.size), (chi.sum(), expected.sum()):
        assert chi2.ppf(1e-4, count) < sum_of_squares < chi2.ppf(1 - 1e-4, count)


ARRAY = "Rig/Microlenses.plen:"
WHITE = [f"{ARRAY}pitch", f"{ARRAY}rotation", "Rig/Camera.plen:camera:microlensDistance", f"{ARRAY}offset"]
OFF_WHITE = np.array([2e-5, 0.1, 2e-3, 0.002, -0.003])


OFF_PLENOPTIC = np.array([0.01, *OFF_WHITE])
"""Errors of a focal length, and of the numbers of `WHITE`."""


@pytest.fixture(scope="module")
def plenoptic(tmp_path_factory) -> FreeStage:
    stage = plenoptic_stage(tmp_path_factory.mktemp("plenoptic"))
    return FreeStage(stage, [f"{ARRAY}focalLengths[0]", *WHITE])


@pytest.fixture(scope="module")
def corners(plenoptic) -> Observations:
    return seen(plenoptic, OFF_PLENOPTIC, 1e-3)


@pytest.mark.parametrize("position", ["centroid", "chief"])
def test_a_plenoptic_camera_comes_back_from_corners_and_its_white_image(tmp_path, plenoptic, corners, position):
    white = centres(plenoptic, OFF_PLENOPTIC, position, 1e-3)
    twin = fitted(plenoptic, only(corners, slice(None, None, 4)), tmp_path, white)
    assert twin.solution.converged and twin.doubts == [] and twin.notes == []
    np.testing.assert_allclose(twin.solution.correction, OFF_PLENOPTIC, rtol=0, atol=1e-6)


def test_a_noisy_plenoptic_fit_converges_in_few_steps(tmp_path, plenoptic, corners):
    """Rows near the rims of their micro-images bend: straight steps overshoot there, and end without a fit."""
    random, few = np.random.default_rng(1), only(corners, slice(None, None, 3))
    rows, white = (
        replace(each, x_px=each.x_px + random.normal(size=each.x_px.shape) * each.sigma_px[:, None])
        for each in (replace(few, sigma_px=20 * few.sigma_px), centres(plenoptic, OFF_PLENOPTIC, "chief", 0.01))
    )
    twin = fitted(plenoptic, rows, tmp_path, white)
    assert twin.solution.converged and twin.solution.steps < 8 and twin.doubts == []
    errors = np.linalg.solve(np.linalg.cholesky(twin.solution.covariance), twin.solution.correction - OFF_PLENOPTIC)
    assert (errors**2).sum() < chi2.ppf(1 - 1e-4, len(errors))


def test_a_white_image_alone_tells_where_the_array_is(tmp_path):
    """Centroids of the pixels of each island of light in a rendered image."""
    stage = FreeStage(stopped_down(tmp_path), WHITE[:2] + WHITE[3:])
    off = np.delete(OFF_WHITE, 2)
    found = white_image(stage, off, sigma_px=2e-3)
    twin = calibrate(stage, [table(found, tmp_path / "white.csv")], Stated())
    assert len(found) > 20 and twin.solution.converged and twin.doubts == []
    assert np.abs((twin.solution.correction - off) / twin.solution.deviation).max() < 5
    assert np.hypot(*twin.solution.residual_px.T).max() < 5e-3


@pytest.mark.parametrize(
    ("mistake", "said"),
    [
        (lambda found: replace(found, microlens=found.microlens * (1, -1)), "numbered otherwise"),
        (lambda found: replace(found, microlens=found.microlens[:, ::-1]), "numbered otherwise"),
        (
            lambda found: replace(found, microlens=np.add(found.microlens, (1, 0))),
            "their numbers begin at another microlens",
        ),
        (lambda found: replace(found, microlens=np.add(found.microlens, (900, 0))), "has no microlens"),
        (lambda found: replace(found, x_px=found.x_px[[1, 0, *range(2, len(found))]]), "px from where others put it"),
        (lambda found: replace(found, microlens=0 * found.microlens), "is there twice"),
        (lambda found: replace(found, microlens=None, x_px=24 + 0.75 * (found.x_px - 24)), "show prints their pitch"),
        (lambda found: replace(found, camera=np.full(len(found), "Rig.Right")), "has no camera"),
    ],
)
def test_a_centre_of_another_microlens_is_refused(tmp_path, plenoptic, mistake, said):
    found = centres(plenoptic, 0 * OFF_PLENOPTIC, "chief", 0.01)
    with pytest.raises(UsageError, match=said):
        calibrate(plenoptic, [table(mistake(found), tmp_path / "white.csv")], Stated())


def test_centres_that_count_from_another_pixel_than_corners_are_named(tmp_path, plenoptic, corners):
    white = centres(plenoptic, OFF_PLENOPTIC, "chief", 0.01)
    shifted, rows = replace(white, x_px=white.x_px + 0.5), only(corners, slice(None, None, 4))
    rows = replace(rows, sigma_px=10 * rows.sigma_px)
    twin = fitted(plenoptic, rows, tmp_path, shifted, known_poses=True)
    assert any("centres that are (" in doubt and "pixel origin" in doubt for doubt in twin.doubts)


def swapped(found: Observations) -> Observations:
    x_px = found.x_px.copy()
    x_px[[3, 11]] = x_px[[11, 3]]
    return replace(found, x_px=x_px)


def mirrored(found: Observations) -> Observations:
    row, column = np.divmod(found.point_id, 4)
    return replace(found, point_id=row * 4 + 3 - column)


def of_another_frame(found: Observations) -> Observations:
    first, second = (np.flatnonzero(found.frame == frame) for frame in (1, 2))
    x_px = found.x_px.copy()
    x_px[second] = x_px[first[: len(second)]]
    return replace(found, x_px=x_px)


def few_points(found: Observations) -> Observations:
    return only(found, found.point_id < 3)


@pytest.mark.parametrize(
    ("mistake", "said"),
    [
        (swapped, "points are .* px off, but 3, 11 up to"),
        (mirrored, "its ids run mirrored"),
        (of_another_frame, r"seen\.csv:16: frame 2 has the positions of frame 1 again"),
        (lambda found: replace(found, frame=found.frame + 40), "the dataset has no frame 41"),
        (lambda found: replace(found, point_id=found.point_id + 9), "Board has no point 12"),
        (lambda found: replace(found, target=np.full(len(found), "Bord")), 'did you mean "Board"'),
        (lambda found: replace(found, x_px=found.x_px + 1000), "lies outside of the image"),
        (
            lambda found: replace(found, sigma_px=0 * found.sigma_px),
            r"seen\.csv:4: the sigma of point 0 in frame 1 of Rig\.Camera is not above 0",
        ),
        (few_points, "a pose needs 4"),
        (lambda found: only(found, found.point_id < 4), "no pose fits its positions"),  # on one line
    ],
)
def test_a_mistake_that_no_camera_explains_is_refused(tmp_path, narrow, exact, mistake, said):
    with pytest.raises(UsageError) as refused:
        fitted(narrow, mistake(exact), tmp_path)
    assert refused.match(said)


def test_a_row_whose_search_says_that_it_ended_astray_is_none(monkeypatch, narrow, exact):
    """Near rims of micro-images searches end up to pixels from any solution, and state an error of that size."""
    seen_by = associated(exact, narrow.nominal)
    views = Views.of(seen_by)

    def strayed(*arguments):
        rows = solve(*arguments)
        rows.sigma_px[5] = 0.5
        return rows

    monkeypatch.setattr(predicted_rows, "solve", strayed)
    x_px = Predictor(seen_by, views).positions(narrow.nominal, views.poses(narrow.nominal), seen_by.x_px)
    assert np.flatnonzero(np.isnan(x_px[:, 0])).tolist() == [5]


def test_half_a_pixel_is_named_where_rows_tell_it_and_elsewhere_that_they_do_not(tmp_path, narrow):
    exact = seen(narrow, np.zeros(3), 0.02, seed=4)
    off, stage = replace(exact, x_px=exact.x_px + 0.5), FreeStage(narrow.path, ["Rig/Lens/S4.plen:radius"])
    told = fitted(stage, off, tmp_path, known_poses=True)
    assert any("is the pixel origin right?" in doubt for doubt in told.doubts)
    np.testing.assert_allclose(told.mistakes[0][:2], -0.5, atol=0.02)
    two = only(off, off.frame < 3)
    untold = fitted(FreeStage(narrow.path, []), two, tmp_path)
    astray = fitted(stage, two, tmp_path)  # a radius that a narrow field does not tell
    hardly_told = "rows hardly tell /Scene/Rig/Lens/S4.plen:radius: hold"
    assert f"did not converge: {hardly_told}" in astray.doubts[0]
    led_out = replace(astray, solution=replace(astray.solution, refusal="it folds"))
    assert f"steps led to a camera that cannot be: it folds; {hardly_told}" in led_out.doubts[0]
    assert untold.doubts == [] and any("do not tell the pixel origin" in note for note in untold.notes)


@pytest.mark.heavy
def test_a_few_wrong_positions_are_named_and_a_robust_loss_bears_them(tmp_path, wide):
    exact = seen(wide, OFF, 0.05, seed=2)
    x_px = exact.x_px.copy()
    x_px[11] += (8.0, -6.0)
    wrong = replace(exact, x_px=x_px)
    named = f"point {exact.point_id[11]} in frame {exact.frame[11]}"
    plain, robust = fitted(wide, wrong, tmp_path), fitted(wide, wrong, tmp_path, loss_scale=3.0)
    assert any(named in doubt for doubt in plain.doubts) and any(named in doubt for doubt in robust.doubts)
    pulls = [np.abs((twin.solution.correction - OFF) / twin.solution.deviation).max() for twin in (plain, robust)]
    assert pulls[1] < 4 < pulls[0]


def test_what_rows_leave_open_is_named_in_its_units_and_not_moved(tmp_path, wide):
    """A pinhole's board of unknown size at an unknown distance; and its principal distance and pixels, which take each
    other's part.
    """
    stage = FreeStage(wide.path, ["Board.plen:squareSize", "Rig/Sensor.plen:offset"])
    twin = fitted(stage, seen(stage, np.array([0.0, 0.5, 0.2]), 0.05), tmp_path)
    assert np.isinf(twin.solution.deviation[0]) and abs(twin.solution.correction[0]) < 1e-6
    np.testing.assert_allclose(twin.solution.correction[1:], [0.5, 0.2], atol=1e-6)
    (component,) = twin.solution.open_components
    assert abs(component[0]) > 1 - 1e-6
    lines = "\n".join(page(document(twin)))
    assert re.search(r"\nopen: .*; not moved\n  /Scene/Board\.plen:squareSize +\+\S+ mm\n\n", lines)

    stage = FreeStage(wide.path, ["Rig/Camera.plen:camera:sensorDistance", "Rig/Sensor.plen:pixelPitch"])
    twin = fitted(stage, seen(stage, np.zeros(2), 0.05), tmp_path, known_poses=True)
    lines = "\n".join(page(document(twin)))
    distance_mm, pitch_mm = (10 * float(step) for step in re.findall(r"([+-]\S+) mm\n", lines))
    before_px, pitch_px, together_px = (
        pinhole(stage.at(np.array(steps)).cameras[0].camera).distorted.principal_distance_px
        for steps in ([0.0, 0.0], [0.0, pitch_mm], [distance_mm, pitch_mm])
    )
    assert abs(together_px - before_px) < 0.01 * abs(pitch_px - before_px)  # steps are printed to three digits


def test_files_of_others_are_read_alike_and_a_board_of_another_size_is_refused(tmp_path, narrow, exact):
    plain = read_observations(table(exact, tmp_path / "seen.csv"), Stated())
    points = points_of(narrow.nominal)["Board"].position_mm
    image = np.full((3, len(points), 2), np.nan)
    image[exact.frame - 1, exact.point_id] = exact.x_px + 0.5
    stated = Stated(pixel_origin="0.5", position="exact", sigma_px=1e-5)
    arrays = {"image_points": image, "object_points": points + 7.0}
    np.savez(tmp_path / "seen.npz", **arrays)
    lines = [
        f"images/{frame:04d}.png " + ("- - -" if np.isnan(x) else f"{x - 0.5!r} {y - 0.5!r} 1")
        for frame, of_frame in enumerate(image.tolist(), 1)
        for x, y in of_frame
    ]
    (tmp_path / "corners.vnl").write_text("\n".join(["# filename x y level", *lines]))
    by_opencv = read_observations(tmp_path / "seen.npz", stated)
    by_mrcal = read_observations(tmp_path / "corners.vnl", replace(stated, pixel_origin=None))
    for found, sigma_px in ((by_opencv, 1e-5), (by_mrcal, 2e-5)):
        assert (found.frame == plain.frame).all() and (found.point_id == plain.point_id).all()
        np.testing.assert_allclose(found.x_px, plain.x_px, rtol=0, atol=1e-9)
        assert (found.sigma_px == sigma_px).all()
    np.savez(tmp_path / "seen.npz", **{**arrays, "object_points": points[:5]})
    with pytest.raises(UsageError, match="arrays that do not fit together"):
        calibrate(narrow, [tmp_path / "seen.npz"], stated)
    (tmp_path / "bytes.vnl").write_bytes(b"\xff\xfe")
    with pytest.raises(UsageError, match="UTF-8"):
        calibrate(narrow, [tmp_path / "bytes.vnl"], replace(stated, pixel_origin=None))
    np.savez(tmp_path / "seen.npz", **{**arrays, "object_points": points * 1.2})
    with pytest.raises(UsageError, match=r"points 3 mm apart, that of the stage 2\.5 mm"):
        calibrate(narrow, [tmp_path / "seen.npz"], stated)


@pytest.mark.parametrize(
    ("remarks", "options", "said"),
    [
        (["position: exact"], [], "does not say its pixel_origin"),
        (["pixel_origin: 0"], [], "does not say its position"),
        (["pixel_origin: 0", "position: exact"], ["--pixel-origin", "0.5"], "--pixel-origin says 0.5"),
        (["pixel_origin: 2", "position: exact"], [], "says pixel_origin: 2"),
        (["pixel_origin: 0", "position: exact"], ["--free", "Rig/Lens/S3.plen:radios"], "did you mean"),
        (["pixel_origin: 0", "position: exact"], ["--free", "Rig/Lens/S3"], "name one of /Scene/Rig/Lens/S3.plen:"),
        (["pixel_origin: 0", "position: exact"], ["--free", "Board.plen:rows"], "no-derivative"),
        (["pixel_origin: 0", "position: exact"], ["--free", "Board.xformOp:translate"], "or say --poses known"),
    ],
)
def test_what_a_command_leaves_open_is_never_guessed(run, tmp_path, narrow, exact, remarks, options, said):
    file = table(exact, tmp_path / "seen.csv", remarks)
    code, output, log = run("calibrate", narrow.path, file, "-o", "fitted.usda", *options)
    assert (code, output) == (2, "") and said in log and not (tmp_path / "fitted.usda").exists()


def test_the_command_prints_a_table_and_writes_two_files(run, tmp_path, narrow, exact):
    file = table(exact, tmp_path / "seen.csv")
    code, output, log = run("calibrate", narrow.path, file, "-o", "fitted.usda", "--free", "Made", "--plot", "off.svg")
    assert "36 positions" in output and (tmp_path / "off.svg").read_text().startswith("<?xml")
    assert code == 0 and "wrote fitted.usda" in log and (tmp_path / "fitted.json").exists()
    assert "/Scene/Rig/Lens/S3.plen:radius" in output and "chi squared over what noise leaves" in output
    code, _, log = run("calibrate", narrow.path, file, "-o", "fitted.usda")
    assert code == 2 and "exists" in log
