"""What views tell a calibration, against programs that calibrate, and against what nobody can know."""

import json

import cv2
import numpy as np
import pytest
from builds import made
from debian_mrcal import by_mrcal
from places import TINY
from scipy.spatial.transform import Rotation

from pipeline.errors import UsageError
from pipeline.fits.field import FitError
from pipeline.fits.fitting import MODELS
from pipeline.frames import apply, rigid
from pipeline.plugins.fits.information import Information, View, information
from pipeline.plugins.fits.informing import document, drawing, inform, page
from pipeline.plugins.fits.knowledge import Knowledge
from pipeline.plugins.fits.splined import EXAMPLE, Splined

OWN = np.array([800.0, 810.0, 321.0, 242.0, -0.12, 0.06, 1e-3, -5e-4, 0.01])
NAMES = MODELS["brown"].parameters[3:]
BOARD_MM = np.array([[20.0 * i, 20.0 * j, 0.0] for j in range(6) for i in range(8)]) - (70.0, 50.0, 0.0)
NOISE_PX = 0.1


def poses(count: int = 8, seed: int = 1) -> list[np.ndarray]:
    """A board all over the image, tilted."""
    rng = np.random.default_rng(seed)
    turns = Rotation.from_rotvec(rng.uniform(-0.6, 0.6, (count, 3))).as_matrix()
    places = np.column_stack([rng.uniform(-60, 60, (count, 2)), rng.uniform(350, 500, count)])
    return [rigid(turn, place) for turn, place in zip(turns, places, strict=True)]


def views(of: list[np.ndarray]) -> list[View]:
    project, none = MODELS["brown"].of_rows, np.zeros((len(BOARD_MM), 0))
    return [View(pose, BOARD_MM, none, project(OWN, apply(pose, BOARD_MM), none)) for pose in of]


def told(of: list[np.ndarray] | None = None) -> Information:
    return Information.of(NAMES, MODELS["brown"].of_rows, OWN, views(of or poses()), NOISE_PX)


def calibrated(noise_px: float, seed: int) -> tuple[np.ndarray, np.ndarray, float]:
    """Parameters in our order, their deviations as OpenCV states them, and its rms per coordinate."""
    rng, seen = np.random.default_rng(seed), views(poses())
    corners = [(view.x_px + rng.normal(0, noise_px, view.x_px.shape)).astype(np.float32) for view in seen]
    guess = np.array([[OWN[0], 0, OWN[2]], [0, OWN[1], OWN[3]], [0, 0, 1.0]])
    flags, stop = cv2.CALIB_USE_INTRINSIC_GUESS, (cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, 200, 1e-14)
    boards, size = [BOARD_MM.astype(np.float32)] * len(seen), (640, 480)
    rms, matrix, bent, _, _, deviations, *_ = cv2.calibrateCameraExtended(
        boards, corners, size, guess, OWN[4:].copy(), flags=flags, criteria=stop
    )
    own = np.array([matrix[0, 0], matrix[1, 1], matrix[0, 2], matrix[1, 2], *bent.ravel()[:5]])
    return own, deviations.ravel()[:9], rms / np.sqrt(2)


def test_deviations_are_those_that_opencv_states_of_the_same_corners():
    """OpenCV scales by the residual that it finds, we by the noise that is given; corners are in single precision."""
    rows, unknowns = 2 * 8 * len(BOARD_MM), len(OWN) + 6 * 8
    _, deviations, rms = calibrated(0.005, 3)  # so small that its derivatives are those of the truth
    noise_px = rms * np.sqrt(rows / (rows - unknowns))

    np.testing.assert_allclose(told().deviations * noise_px / NOISE_PX, deviations, rtol=5e-3)


@pytest.mark.heavy
def test_calibrations_of_noisy_corners_scatter_by_the_predicted_covariance():
    """Within four errors of a deviation of so many tries, and whitened as a chi-square of all parameters."""
    tries, known = 400, told()
    off = np.array([calibrated(NOISE_PX, seed)[0] - OWN for seed in range(tries)])
    whole = np.einsum("ni,ij,nj->n", off, np.linalg.inv(known.covariance), off)

    np.testing.assert_allclose(off.std(axis=0), known.deviations, rtol=4 / np.sqrt(2 * tries))
    assert whole.mean() == pytest.approx(len(OWN), abs=4 * np.sqrt(2 * len(OWN) / tries))


def test_a_fit_from_elsewhere_ends_where_the_rows_were_made():
    start = OWN * (1.02, 0.98, 1.01, 0.99, 0, 0, 0, 0, 0)
    moved = [View(pose, *view) for pose, view in zip(poses(), _rest(views(poses())), strict=True)]
    shift = rigid(Rotation.from_rotvec([0.01, -0.02, 0.01]).as_matrix(), np.array([2.0, -1.0, 5.0]))
    moved = [View(view.model_from_target @ shift, view.points_mm, view.row_numbers, view.x_px) for view in moved]
    known = information(NAMES, MODELS["brown"].of_rows, start, moved, NOISE_PX)

    np.testing.assert_allclose(known.parameters, OWN, rtol=1e-9, atol=1e-9)
    assert np.abs(known.residual_px).max() < 1e-9


def _rest(of: list[View]) -> list[tuple[np.ndarray, ...]]:
    return [(view.points_mm, view.row_numbers, view.x_px) for view in of]


def test_one_board_that_faces_a_pinhole_leaves_its_distance_open_and_says_so():
    """Without distortion f and the distance are one number, and the centre and the place of the board are, too."""
    facing = rigid(np.diag([1.0, -1.0, -1.0]), np.array([5.0, 3.0, 400.0]))
    pinhole = MODELS["pinhole"]
    project, none = pinhole.of_rows, np.zeros((len(BOARD_MM), 0))
    own = np.array([800.0, 800.0, 320.0, 240.0])
    view = View(facing, BOARD_MM, none, project(own, apply(facing, BOARD_MM), none))
    known = Information.of(pinhole.parameters[3:], project, own, [view], NOISE_PX)

    assert known.rank == 1  # fx over fy alone
    assert not np.isfinite(known.deviations).any()
    again = Information.of(pinhole.parameters[3:], project, own, [view, *_tilted(project, own)], NOISE_PX)
    assert again.rank == 4


def _tilted(project, own) -> list[View]:
    none = np.zeros((len(BOARD_MM), 0))
    return [View(pose, BOARD_MM, none, project(own, apply(pose, BOARD_MM), none)) for pose in poses(3)]


def test_projections_that_poses_take_over_are_known_and_others_scatter_by_calibrations():
    """A point before every board is carried along by calibrated poses: 60 of these, deviations within four errors."""
    known, tries = told(), 60
    points = np.array([[0.0, 0.0, 420.0], [150.0, 100.0, 420.0], [-80.0, 60.0, 900.0]])
    predicted = known.of_projections(points, np.zeros((3, 0)))
    rng, project, none = np.random.default_rng(7), MODELS["brown"].of_rows, np.zeros((3, 0))
    projected = []
    for _ in range(tries):
        noisy = [
            View(view.model_from_target, *rest[:2], rest[2] + rng.normal(0, NOISE_PX, rest[2].shape))
            for view, rest in zip(known.views, _rest(list(known.views)), strict=True)
        ]
        fit = information(NAMES, project, OWN, noisy, NOISE_PX)
        carried = [
            apply(after.model_from_target @ np.linalg.inv(before.model_from_target), points)
            for before, after in zip(known.views, fit.views, strict=True)
        ]
        projected.append(project(fit.parameters, np.mean(carried, axis=0), none))
    found = np.std(projected, axis=0)

    np.testing.assert_allclose(found, np.sqrt(np.diagonal(predicted, axis1=1, axis2=2)), rtol=4 / np.sqrt(2 * tries))


MRCAL = """
board = np.array(given["corners"])  # views, rows, columns, 2
own, rt = np.array([given["own"]]), np.array(given["rt"])
weights = np.ones(board.shape[:3] + (1,))
inputs = dict(
    intrinsics=own, frames_rt_toref=rt, extrinsics_rt_fromref=np.zeros((0, 6)), points=None,
    observations_board=np.concatenate([board, weights], axis=-1),
    indices_frame_camintrinsics_camextrinsics=np.array([[i, 0, -1] for i in range(len(rt))], np.int32),
    observations_point=None, indices_point_camintrinsics_camextrinsics=None,
    lensmodel=given["model"], imagersizes=np.array([[640, 480]], np.int32),
    calibration_object_spacing=given["spacing"], do_optimize_calobject_warp=False,
    do_optimize_extrinsics=True, do_optimize_frames=True, do_optimize_intrinsics_core="SPLINED" not in given["model"],
    do_optimize_intrinsics_distortions=True,
    calobject_warp=None,
    do_apply_regularization=False, do_apply_outlier_rejection=False, verbose=False,
)
mrcal.optimize(**inputs)
model = mrcal.cameramodel(optimization_inputs=inputs, icam_intrinsics=0)
points = np.array(given["points"])
print(json.dumps(mrcal.projection_uncertainty(
    points, model, what="covariance", observed_pixel_uncertainty=given["noise"]).tolist()))
"""


SPLINED = Splined.named(
    "LENSMODEL_SPLINED_STEREOGRAPHIC_order=3_Nx=5_Ny=5_fov_x_deg=36", np.array([800, 810, 321, 242.0])
)


def bent() -> Information:
    """A splined camera before boards that reach all its control points."""
    rng, views = np.random.default_rng(4), []
    own = rng.uniform(-0.01, 0.01, len(SPLINED.parameters))
    for place in [(x, y, 350.0) for x in (-70.0, 0.0, 70.0) for y in (-55.0, 0.0, 55.0)]:
        pose = rigid(Rotation.from_rotvec(rng.uniform(-0.5, 0.5, 3)).as_matrix(), np.array(place))
        none = np.zeros((len(BOARD_MM), 0))
        views.append(View(pose, BOARD_MM, none, SPLINED.project(own, apply(pose, BOARD_MM), none)))
    return Information.of(SPLINED.parameters, SPLINED.project, own, views, NOISE_PX)


def test_steps_that_go_astray_along_control_points_that_views_hardly_tell_are_damped():
    middle, start = bent().views[4:5], np.zeros(len(SPLINED.parameters))
    known = information(SPLINED.parameters, SPLINED.project, start, middle, NOISE_PX)
    told = Knowledge(camera="A", model=SPLINED.name, size_px=(640, 480), information=known, predictions=())

    assert np.abs(known.residual_px).max() < 1e-4  # of 4 px, and rows are exact
    assert len(list(page(told))) < 10


@pytest.mark.heavy
@pytest.mark.parametrize(
    ("model", "known", "core"),
    [("LENSMODEL_OPENCV5", told, []), (SPLINED.name, bent, SPLINED.core)],
    ids=["opencv", "splined"],
)
def test_mrcal_predicts_the_same_covariance_of_projections(model, known, core):
    """Debian's python3-mrcal, by its own optimization of the same exact corners."""
    known = known()
    first = np.eye(4)
    first[:3, 3] = BOARD_MM[0]  # mrcal counts from the first corner
    turned = [view.model_from_target @ first for view in known.views]
    points = np.array([[0.0, 0.0, 420.0], [100.0, 70.0, 420.0], [-80.0, 60.0, 900.0]])
    given = {
        "model": model,
        "corners": [view.x_px.reshape(6, 8, 2).tolist() for view in known.views],
        "own": [*core, *known.parameters],
        "rt": [[*Rotation.from_matrix(pose[:3, :3]).as_rotvec(), *pose[:3, 3]] for pose in turned],
        "spacing": 20.0,
        "points": points.tolist(),
        "noise": NOISE_PX,
    }
    expected = np.array(by_mrcal(MRCAL, given))

    np.testing.assert_allclose(known.of_projections(points, np.zeros((3, 0))), expected, rtol=1e-4, atol=1e-7)


def test_a_plenoptic_build_tells_a_thin_lens_all_but_where_it_stands_before_boards_of_unknown_poses(plenoptic_build):
    """A shift of the lens along the axis and one of all boards are the same: the one gauge."""
    known = inform(plenoptic_build, None, None, 0.05)
    told = known.information
    place = told.names.index("lens_z_mm")
    alone = sum(block.parameters[place, place] for block in told.blocks) / told.noise_px**2

    assert known.model == "thin-lens-plenoptic" and told.rank == len(told.names) - 1
    assert abs(told.matrix[place, place]) < 1e-12 * alone
    assert "lens_z_mm" in "\n".join(page(known)) and np.isinf(told.deviations[place])
    assert "<svg" in drawing(known)


def test_two_small_boards_leave_projections_open_which_is_null_in_json_and_no_picture(conventional_build):
    known = inform(conventional_build, None, "pinhole", 0.05)
    plain = document(known)

    assert json.loads(json.dumps(plain)) == plain
    assert [row["name"] for row in plain["parameters"]] == ["fx", "fy", "cx", "cy"]
    assert plain["rank"] == 3 and None in [row["deviation"] for row in plain["parameters"]]
    with pytest.raises(FitError, match="nothing to draw"):
        drawing(known)


@pytest.mark.heavy
def test_the_report_shows_what_was_said_if_asked(tmp_path, common_store, monkeypatch, in_this_process):
    monkeypatch.setenv("PIPELINE_CACHE", str(common_store))
    out = made(TINY, tmp_path / "shown", common_store).out
    code, lines, log = in_this_process("inform", out, "-m", "pinhole", "--report")
    (script,) = (tmp_path / "shown.report/data").glob("information.Rig.Camera.*.js")

    assert code == 0 and str(tmp_path / "shown.report/index.html") in log
    assert json.dumps(lines.splitlines(), separators=(",", ":")) in script.read_text()


@pytest.mark.parametrize(
    ("model", "words"),
    [
        ("browm", 'did you mean "brown"'),
        ("thin-lens-plenoptic", "models for it"),
        ("thin-prism", "too few points"),
        (EXAMPLE, "too few points"),
        (EXAMPLE.replace("Nx=12_Ny=9", "Nx=4000_Ny=4000"), "too few points"),
    ],
)
def test_models_that_cannot_stand_for_a_camera_are_refused(conventional_build, model, words):
    with pytest.raises(FitError, match=words):
        inform(conventional_build, None, model, 0.05)


def test_a_folder_that_is_no_build_and_a_camera_that_it_does_not_have_are_refused(conventional_build):
    with pytest.raises(UsageError, match='did you mean "Rig'):
        inform(conventional_build, "Rig.Camra", None, 0.05)
    with pytest.raises(UsageError, match="no output folder"):
        inform(TINY, None, None, 0.05)
