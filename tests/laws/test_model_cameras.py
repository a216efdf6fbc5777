"""Claim: a model camera is the pinhole, the thin lens or the plenoptic camera that calibrations assume, to rounding."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
from laws import rigs
from laws.solving import rig_of, solved
from shorter import few
from tolerances import ROUNDING_MM

import pipeline
from pipeline.camera.figures.equivalent_pinhole import Pinhole, pinhole
from pipeline.camera.focusing.depth_of_field import foci, focused
from pipeline.camera.focusing.focus_request import FocusRequest
from pipeline.camera.focusing.focus_request import solved as placed
from pipeline.camera.focusing.ideal_lens import with_ideal_lens
from pipeline.camera.integrals import Bundles, integrals
from pipeline.camera.parts.camera import Camera
from pipeline.camera.parts.errors import CameraError
from pipeline.camera.tracer import Tracer, parallel_planes
from pipeline.camera.tracing.moments import WEIGHT
from pipeline.camera.tracing.sampling_bounds import NO_MICROLENS
from pipeline.optics.first_order import first_order
from pipeline.optics.prescription import PrescriptionError
from pipeline.targets.patterns.checkerboard import Checkerboard

BROWN = (-8.0, 100.0, 0.01, -0.02, 300.0)
"""Barrel distortion of two pixels at the corner of the image, and both tangential terms."""
EXACT_PX = 1e-9
"""What the traced truth of a pinhole may differ from its closed form [px]."""
MICRO_PX = 1e-5
"""Discs of 1 µm in place of pinholes [px]: the mean over a disc differs from its middle by its square."""
BOARD = Checkerboard(columns=5, rows=4, square_mm=2.0)
POSES = [rigs.facing(434.4), rigs.facing(390.0, 50.0, 1.0, -2.0), rigs.facing(900.0, -35.0, -3.0, 2.0)]


def model(camera: Camera, name: str, distortion: tuple[float, ...] = ()) -> Camera:
    return focused(with_ideal_lens(replace(camera, near_mm=None, far_mm=None), name, distortion))


def by_opencv(found: Pinhole, points_mm: np.ndarray, vision_from_target: np.ndarray) -> np.ndarray:
    """Image positions as OpenCV projects points with the pinhole that a build states."""
    f, (x, y) = found.distorted.principal_distance_px, found.distorted.principal_point_px
    rvec, pose = cv2.Rodrigues(vision_from_target[:3, :3])[0], vision_from_target[:3, 3] - np.array(found.centre_mm)
    matrix = np.array([[f, 0, x], [0, f, y], [0, 0, 1]])
    return cv2.projectPoints(points_mm, rvec, pose, matrix, np.array(found.distorted.distortion))[0][:, 0]


def undistorted(image: np.ndarray) -> np.ndarray:
    """Directions (n, 2) that OpenCV images to these, by iteration of its own distortion, which is small."""
    direction = image.copy()
    for _ in range(60):
        points = np.column_stack([direction, np.ones(len(direction))])
        there = cv2.projectPoints(points, np.zeros(3), np.zeros(3), np.eye(3), np.array(BROWN))[0][:, 0]
        direction += image - there
    return direction


@pytest.mark.parametrize("distortion", [(), BROWN])
@pytest.mark.parametrize("offset_mm", few([0.4], 0.0))
def test_the_truth_of_a_pinhole_is_what_opencv_projects(distortion: tuple[float, ...], offset_mm: float) -> None:
    """Boards tilted by 50 degrees and far out of focus, too; the sensor may be off the axis."""
    camera = rigs.conventional()
    camera = model(replace(camera, sensor=replace(camera.sensor, offset_x_mm=offset_mm)), "pinhole", distortion)
    found = pinhole(camera)
    assert found is not None
    for pose in POSES:
        rows = solved(rig_of(camera), BOARD, pose).solutions
        assert len(rows.point) >= 6
        expected = by_opencv(found, BOARD.points_mm()[rows.point], pose)
        np.testing.assert_allclose(rows.xy_px, expected, rtol=0, atol=EXACT_PX)


@pytest.mark.parametrize("distortion", [(0.0,) * 5, BROWN])
def test_the_stated_pinhole_is_the_model_itself(distortion: tuple[float, ...]) -> None:
    camera = model(rigs.conventional(), "pinhole", distortion)
    found = pinhole(camera)
    assert found is not None
    assert (found.centre_mm, found.distorted.distortion) == ((0.0, 0.0, 0.0), distortion)
    assert found.distorted.principal_distance_px == pytest.approx(camera.sensor_distance_mm / 0.05, rel=1e-14)
    assert found.distorted.max_px < EXACT_PX


def test_an_image_of_a_pinhole_falls_off_with_the_fourth_power_of_the_cosine() -> None:
    camera = model(rigs.conventional(width_px=900, height_px=700), "pinhole")
    tracer = Tracer(camera)
    corners = tracer.positions_mm(np.array([0.0, 200.0]), np.array([0.0, 600.0]))
    planes = np.tile(parallel_planes(400.0, 500.0), (2, 1, 1, 1))
    x_px = tracer.pixels_at(corners)
    weight = integrals(tracer, Bundles(x_px, np.full(2, NO_MICROLENS), planes), 2).moments[:, WEIGHT]
    cosine = camera.sensor_distance_mm / np.hypot(camera.sensor_distance_mm, np.hypot(*corners.T))
    np.testing.assert_allclose(weight / tracer.reference_weight_sr, cosine**4, rtol=1e-7)


@pytest.mark.parametrize("name", ["pinhole", "thinLens"])
@pytest.mark.parametrize("camera", [rigs.conventional(), rigs.plenoptic()])
def test_the_same_object_plane_is_in_focus(name: str, camera: Camera) -> None:
    """Of the main lens alone: sensor or array is its image; a thin lens has the F-number of the real one, too."""
    ideal = model(camera, name)
    for one in (camera, ideal):
        reach_mm = one.microlenses.reach_mm if one.microlenses else 0.0
        assert first_order(one.prescription).object_mm(reach_mm - one.sensor_distance_mm) == pytest.approx(
            first_order(camera.prescription).object_mm(reach_mm - camera.sensor_distance_mm), rel=1e-12
        )
    real, found = first_order(camera.prescription), first_order(ideal.prescription)
    assert found.efl_mm == real.efl_mm
    if name == "thinLens":
        assert found.f_number == pytest.approx(real.f_number, rel=1e-12)


@pytest.mark.parametrize("distance_mm", [300.0, 434.0, 5000.0])
def test_a_requested_focus_is_that_of_the_model(distance_mm: float) -> None:
    camera = rigs.conventional()
    request = FocusRequest(prescription=camera.prescription, sensor=camera.sensor, focus_distance_mm=distance_mm)
    ideal = focused(placed(with_ideal_lens(request, "thinLens")))
    assert ideal.sensor_distance_mm == pytest.approx(
        1 / (1 / ideal.prescription.stop.focal_length_mm - 1 / distance_mm)
    )
    assert foci(ideal)[0].focus_distance_mm == pytest.approx(distance_mm)


def test_all_rays_of_a_thin_lens_with_distortion_meet_in_focus() -> None:
    """At f/2, in the object plane of the sensor: where OpenCV's undistorted direction meets it."""
    camera = model(rigs.conventional(17.1), "thinLens", BROWN)
    in_focus_mm = first_order(camera.prescription).object_mm(-camera.sensor_distance_mm)
    for x, y in ((3.0, 5.0), (90.0, 60.0)):
        bundle = pipeline.bundle(camera, x, y)
        hits = bundle.origin_mm + bundle.direction * (in_focus_mm / bundle.direction[:, 2:])
        image = -Tracer(camera).positions_mm(x, y) / camera.sensor_distance_mm
        direction = undistorted(image.reshape(1, 2))[0]
        assert len(hits) > 100
        np.testing.assert_allclose(hits[:, :2] - direction * in_focus_mm, 0, rtol=0, atol=ROUNDING_MM)


def test_a_thin_lens_before_pinholes_is_the_camera_of_libpleno() -> None:
    """A point, its image behind the lens, the vertex of the microlens and the image position are on one line.

    With distortion the line goes through the point of the lens from which light that aims at U(m) arrives at m, U the
    inverse of the distortion: solved here on paper, without a ray.
    """
    array = replace(rigs.michels_array(2.0), aperture="disc", disc_diameter_mm=1e-3)
    camera = model(replace(rigs.plenoptic(2.0), microlenses=array), "thinLens", BROWN)
    board, pose = Checkerboard(columns=2, rows=1, square_mm=1.0), rigs.facing(420.0, 20.0, 0.3, 0.2)
    rig = rig_of(camera)
    rows = solved(rig, board, pose, 1e-6).solutions
    assert len(rows.point) > 15
    film_mm = camera.sensor_distance_mm - array.distance_mm
    x, y, z = (pose @ np.column_stack([board.points_mm(), np.ones(len(board.points_mm()))])[rows.point].T)[:3]
    behind_mm = 1 / (1 / camera.prescription.stop.focal_length_mm - 1 / z)
    image = -np.stack([x, y], axis=1) / z[:, None] * behind_mm[:, None]
    vertex = rig.tracer.vertices_mm[rows.cell]
    aims = -film_mm * undistorted(-vertex / film_mm)
    share = (film_mm / behind_mm)[:, None]
    on_lens = (aims - image * share) / (1 - share)
    expected = rig.tracer.pixels_at(vertex + (vertex - on_lens) / film_mm * array.distance_mm)
    np.testing.assert_allclose(rows.xy_px, expected, rtol=0, atol=MICRO_PX)


def test_the_prescription_stays_as_it_is() -> None:
    camera = rigs.conventional()
    assert with_ideal_lens(camera, "prescription") is camera


def test_what_no_model_can_be_is_refused() -> None:
    with pytest.raises(CameraError, match="folds the image: its radius grows to"):
        model(rigs.conventional(), "pinhole", (-2000.0, 0.0, 0.0, 0.0, 0.0))
    with pytest.raises(PrescriptionError, match="afocal"):
        model(replace(rigs.conventional(), prescription=rigs.hole(3.0), sensor_distance_mm=50.0), "pinhole")
