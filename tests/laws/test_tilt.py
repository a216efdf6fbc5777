"""Claim: a tilted sensor sees what a sensor of that tilt sees, in the camera frame of the lens.

Ideal lenses by Scheimpflug's line and OpenCV's projection; others by a twin: an upright sensor behind a lens that is
turned back as a whole.
"""

import dataclasses

import cv2
import numpy as np
import pytest
from laws import rigs
from laws.solving import rig_of, solved
from laws.surfaces import whole
from scipy.spatial.transform import Rotation
from tolerances import REFOUND_MM, SAME_GEOMETRY_PX

import pipeline
from pipeline.camera.bundle import bundle
from pipeline.camera.figures.equivalent_pinhole import pinhole
from pipeline.camera.figures.first_order_figures import report
from pipeline.camera.figures.outlook import Fate, outlook
from pipeline.camera.integrals import Bundles, integrals
from pipeline.camera.parts.camera import Camera, Sensor
from pipeline.camera.parts.errors import CameraError
from pipeline.camera.tracing.sampling_bounds import NO_MICROLENS
from pipeline.camera.wave.wavefront import View, wavefront
from pipeline.fits.field import field_rays
from pipeline.fits.fitting import fitted
from pipeline.frames import apply, rigid
from pipeline.optics.prescription import Prescription, Surface
from pipeline.results.records import BuiltPinhole
from pipeline.targets.patterns.checkerboard import Checkerboard
from pipeline.truth.planes import tangent_planes

FOCAL_MM, FILM_MM, PITCH_MM = 50.0, 60.0, 0.05
IN_FOCUS_MM = 1 / (1 / FOCAL_MM - 1 / FILM_MM)
BENT = (-0.2, 0.1, 1e-3, -2e-3, 0.02)
BOARD = Checkerboard(columns=4, rows=3, square_mm=12.0)


def thin(
    tilt_deg: tuple[float, float],
    semi_mm: float = 4.0,
    distortion: tuple[float, ...] = (),
    pitch_mm: float = PITCH_MM,
) -> Camera:
    """An ideal thin lens that is its stop, before 400 x 300 pixels whose axis is off their middle."""
    distorting = {"distortion": distortion, "image_distance_mm": FILM_MM} if distortion else {}
    lens = Surface(focal_length_mm=FOCAL_MM, semi_diameter_mm=semi_mm, is_stop=True, **distorting)
    sensor = Sensor(width_px=400, height_px=300, pitch_mm=pitch_mm, offset_x_mm=1.0, tilt_deg=tilt_deg)
    return rigs.bare(Prescription(surfaces=(lens,)), sensor, FILM_MM, (200.0, 400.0))


def by_opencv(camera: Camera, points_mm: np.ndarray, distortion: tuple[float, ...] = (0.0,) * 5) -> np.ndarray:
    """Images of points by the 14 coefficients of OpenCV, a pinhole in the middle of the lens."""
    f, none = FILM_MM / PITCH_MM, np.zeros(3)
    matrix = np.array([[f, 0, 199.5 + 1.0 / PITCH_MM], [0, f, 149.5], [0, 0, 1]])
    coefficients = np.array([*distortion, *(0.0,) * 7, *np.radians(camera.sensor.tilt_deg)])
    return cv2.projectPoints(np.ascontiguousarray(points_mm), none, none, matrix, coefficients)[0][:, 0]


def scheimpflug(tilt_deg: tuple[float, float]) -> np.ndarray:
    """vision_from_target of a board in the plane through the point in focus and Scheimpflug's line, where the planes of
    the sensor and of the lens meet."""
    across = Rotation.from_euler("XY", tilt_deg, degrees=True).as_matrix()[:, 2]
    along = np.cross(across, [0.0, 0.0, 1.0])  # the line, on which across . (x, y, FILM_MM) = 0
    foot = -across[2] * FILM_MM * np.array([*across[:2], 0.0]) / (across[:2] @ across[:2])
    normal = np.cross(along, np.array([0.0, 0.0, IN_FOCUS_MM]) - foot)
    normal *= -np.sign(normal[2]) / np.linalg.norm(normal)
    right = np.cross([0.0, -1.0, 0.0], normal)
    right /= np.linalg.norm(right)
    return rigid(np.column_stack([right, np.cross(normal, right), normal]), np.array([0.0, 0.0, IN_FOCUS_MM]))


@pytest.mark.parametrize("tilt_deg", [(0.0, 7.0), (8.0, -5.0), (-30.0, 10.0)])
def test_the_plane_of_sharp_focus_is_scheimpflugs_and_its_image_is_a_homography(tilt_deg) -> None:
    camera, pose = thin(tilt_deg), scheimpflug(tilt_deg)
    rows = solved(rig_of(camera), BOARD, pose).solutions
    points = apply(pose, BOARD.points_mm())
    assert len(rows.xy_px) == len(points)
    np.testing.assert_allclose(rows.xy_px, by_opencv(camera, points[rows.point]), rtol=0, atol=SAME_GEOMETRY_PX)
    rays = bundle(camera, 350.0, 40.0)
    t = (pose[:3, 2] @ (pose[:3, 3] - rays.origin_mm).T) / (rays.direction @ pose[:3, 2])
    meeting = rays.origin_mm + t[:, None] * rays.direction
    assert np.ptp(meeting, axis=0).max() < 1e-10, "all rays of a position meet in that plane"
    turned = Rotation.from_euler("XY", report(camera)["lens"]["focus_plane_tilt_deg"], degrees=True).as_matrix()[:, 2]
    np.testing.assert_allclose(turned, -pose[:3, 2], rtol=0, atol=1e-12)


@pytest.mark.parametrize("tilt_deg", [(6.0, 0.0), (0.0, -5.0)])
@pytest.mark.parametrize("upright", [rigs.conventional(), rigs.plenoptic(2.0)], ids=["double Gauss", "plenoptic"])
def test_a_lens_that_is_turned_back_before_an_upright_sensor_sees_the_same(upright: Camera, tilt_deg) -> None:
    """About the point where the axis meets the sensor; the frame of the twin is turned, and so are its rays."""
    lens, distance_mm = upright.prescription, upright.sensor_distance_mm
    tilted = dataclasses.replace(upright, sensor=dataclasses.replace(upright.sensor, tilt_deg=tilt_deg))
    back = {"tilt_deg": (-tilt_deg[0], tilt_deg[1]), "pivot_mm": distance_mm - lens.vertices_from_stop_mm[0]}
    twin = dataclasses.replace(upright, prescription=whole(lens, **back))
    turn, pivot = Rotation.from_euler("XY", tilt_deg, degrees=True).as_matrix(), np.array([0.0, 0.0, -distance_mm])
    vision_from_twin = rigid(turn, pivot - turn @ pivot)
    ours, theirs = bundle(tilted, 20.0, 30.0), bundle(twin, 20.0, 30.0)
    assert len(ours.weight_sr) == len(theirs.weight_sr) > 100
    np.testing.assert_allclose(ours.weight_sr, theirs.weight_sr, rtol=1e-12)
    np.testing.assert_allclose(ours.direction, theirs.direction @ turn.T, rtol=0, atol=1e-12)
    np.testing.assert_allclose(ours.origin_mm, apply(vision_from_twin, theirs.origin_mm), rtol=0, atol=1e-10)
    pose, board = rigs.facing(430.0, 20.0), Checkerboard(columns=3, rows=2, square_mm=1.5)
    ours, theirs = rig_of(tilted), rig_of(twin)
    rows = solved(ours, board, pose).solutions
    assert len(rows.point) >= 6
    means = []
    for rig, its in ((ours, pose), (theirs, np.linalg.inv(vision_from_twin) @ pose)):
        planes = tangent_planes(its, board.points_mm())[rows.point]
        bundles = Bundles(rows.xy_px, rig.microlens(rows.cell), np.stack([planes, planes], axis=1))
        means.append(integrals(rig.tracer, bundles, 2).moments[:, :2])
    np.testing.assert_allclose(*means, rtol=0, atol=REFOUND_MM)


def test_the_pinhole_of_a_tilted_camera_has_the_tilt_of_opencv() -> None:
    camera = thin((8.0, -5.0), 0.01, BENT)
    found = pinhole(camera)
    assert found is not None and found.distorted.max_px < 1e-4
    assert found.distorted.distortion == (*BENT, *(0.0,) * 7, *np.radians(camera.sensor.tilt_deg))
    assert found.plain.max_px > 1, "which no camera without a tilt is"
    points = np.array([[30.0, -20.0, 300.0], [-25.0, 10.0, 250.0]])
    built = BuiltPinhole(
        centre_mm=np.zeros(3),
        principal_distance_px=FILM_MM / PITCH_MM,
        principal_point_px=np.array([219.5, 149.5]),
        distortion=np.array(found.distorted.distortion),
        rms_px=0.0,
        max_px=0.0,
    )
    np.testing.assert_allclose(built.projected(points), by_opencv(camera, points, BENT), rtol=0, atol=1e-10)


def test_a_fit_of_opencvs_fourteen_coefficients_to_rays_finds_the_tilt() -> None:
    found = fitted(field_rays(pipeline.ready(thin((8.0, -5.0), 0.01, BENT, 0.15))), "tilted")
    assert found.max_px < 1e-5
    np.testing.assert_allclose(np.degrees(found.parameters[-2:]), (8.0, -5.0), rtol=0, atol=1e-4)


def test_a_pinhole_sees_a_tilt_by_the_magnification_of_the_pupils() -> None:
    """A stop behind an ideal lens is its own exit pupil, and m times as wide as the entrance pupil. Slopes before the
    lens are m times those behind it: tan tau = tan theta / m, and what is foreshortened by cos theta makes fx and fy
    differ. All of it by OpenCV's 14 coefficients; the tau of the equivalent pinhole, which has one f, comes near."""
    ahead_mm, pitch_mm, theta = 15.0, 0.15, np.radians(8.0)
    lens = Surface(focal_length_mm=80.0, semi_diameter_mm=30.0, thickness_mm=ahead_mm)
    stop = Surface(semi_diameter_mm=0.001, is_stop=True)
    sensor = Sensor(width_px=400, height_px=300, pitch_mm=pitch_mm, tilt_deg=(8.0, 0.0))
    camera = rigs.bare(Prescription(surfaces=(lens, stop)), sensor, FILM_MM, (200.0, 400.0))
    m = 1 - ahead_mm / 80.0
    tau, f, none = np.arctan(np.tan(theta) / m), FILM_MM / m / pitch_mm, np.zeros(3)
    matrix = np.array([[f, 0, 199.5], [0, f * np.cos(tau) / np.cos(theta), 149.5], [0, 0, 1]])
    x_px = np.stack(np.meshgrid(np.linspace(0, 399, 5), np.linspace(0, 299, 4)), axis=-1).reshape(-1, 2)
    rays = pipeline.ready(camera).rays(*x_px.T)
    points = rays.origin_mm + 300.0 * rays.direction - (0.0, 0.0, ahead_mm - ahead_mm / m)
    seen = cv2.projectPoints(points, none, none, matrix, np.array([*(0.0,) * 12, tau, 0.0]))[0][:, 0]
    np.testing.assert_allclose(seen, x_px, rtol=0, atol=1e-5)
    near = pinhole(camera)
    assert near is not None and near.distorted.distortion[12] == pytest.approx(tau, abs=0.01)


def test_light_is_found_and_its_wavefront_is_plane_where_the_tilted_image_is_sharp() -> None:
    camera, pose = thin((8.0, -5.0)), scheimpflug((8.0, -5.0))
    points = apply(pose, BOARD.points_mm())
    seen = outlook(camera, points[None], np.broadcast_to(pose[:3, 2], points[None].shape))
    assert (seen.fate == Fate.SEEN).all() and seen.blur_px.max() < 1e-9
    tracer = rig_of(camera).tracer
    x_px = by_opencv(camera, points[:1])
    front = wavefront(tracer, View(tracer.positions_mm(*x_px.T)[0], NO_MICROLENS, float(points[0, 2])), 550.0)
    assert np.abs(front.path_mm).max() < 1e-3 * front.wavelength_mm


@pytest.mark.parametrize("tilt_deg", [(90.0, 0.0), (0.0, float("nan")), (80.0, 0.0), (0.0, -86.5)])
def test_a_sensor_that_faces_away_or_whose_plane_cuts_the_lens_is_refused(tilt_deg) -> None:
    with pytest.raises(CameraError, match=r"less than 90 deg|cuts the last surface|each a number"):
        thin(tilt_deg, semi_mm=12.0)


@pytest.mark.heavy
def test_vision_calibration_finds_the_tilt_in_exact_rows() -> None:
    """By its own solver, which stops early: with zero tilt as with others, and so it does on images by OpenCV."""
    package = pytest.importorskip("vision_calibration")
    models, tilt_deg = package.models, (5.0, -3.0)
    rig = rig_of(thin(tilt_deg, 0.01, (-0.1, 0.0, 0.0, 0.0, 0.0), 0.15))
    board, views = Checkerboard(columns=9, rows=6, square_mm=12.0), []
    for turn_deg in [(0, 0, 0), (25, 0, 0), (0, 25, 30), (0, -25, 60), (18, 18, 10), (-18, 18, 120), (30, 10, 45)]:
        facing = Rotation.from_euler("XYZ", turn_deg, degrees=True).as_matrix() @ np.diag([1.0, -1.0, -1.0])
        rows = solved(rig, board, rigid(facing, np.array([0.0, 0.0, 200.0])), 1e-6).solutions
        points = board.points_mm()[rows.point] * (1e-3, -1e-3, -1e-3)
        seen = package.Observation.from_payload({"points_3d": points.tolist(), "points_2d": rows.xy_px.tolist()})
        views.append(models.PlanarView(seen))
    asked = models.ScheimpflugIntrinsicsCalibrationConfig(
        init=models.IntrinsicsInitConfig(init_iterations=20, fix_tangential=True)
    )
    sensor = package.run_scheimpflug_intrinsics(models.PlanarDataset(views), asked).camera.sensor
    np.testing.assert_allclose(np.degrees([sensor.tilt_x, sensor.tilt_y]), tilt_deg, rtol=0, atol=0.5)
