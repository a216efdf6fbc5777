"""Claim: where geometry has a closed form, rays and position images have it, too.

Pinhole: central projection. Thin lens: the lens equation, by order of convergence. Axis: first-order optics, likewise.
"""

import math
from pathlib import Path

import numpy as np
import pytest
from laws import rigs
from laws.rigs import F_MM, thin
from laws.solving import truth_of
from laws.surfaces import orders, traced
from tolerances import ORDER, ROUNDING_MM, STORED_PX

import pipeline
from pipeline.camera.focusing.depth_of_field import foci
from pipeline.camera.parts.camera import Camera, Sensor
from pipeline.camera.tracer import Tracer, parallel_planes, target_plane
from pipeline.camera.tracing.sampling_bounds import NO_MICROLENS
from pipeline.optics.first_order import first_order
from pipeline.optics.kernels import trace_rays
from pipeline.optics.prescription import Prescription, PrescriptionError, Surface
from pipeline.optics.table import towards_scene, towards_sensor
from pipeline.targets.patterns.checkerboard import Checkerboard
from pipeline.truth.settings import TruthSettings

PINHOLE_MM = 1e-6


@pytest.mark.parametrize("tilt_deg", [0.0, 35.0])
def test_a_pinhole_camera_projects_centrally(tilt_deg: float) -> None:
    """J of every position lies within the hole's own projection of the line through its centre."""
    camera = rigs.bare(rigs.hole(PINHOLE_MM), Sensor(width_px=9, height_px=7, pitch_mm=3.0), 50.0, (300.0, 500.0))
    tracer, pose = Tracer(camera), rigs.facing(400.0, tilt_deg, 5.0, -3.0)
    y_px, x_px = np.mgrid[:7, :9].reshape(2, -1)
    planes = np.stack([target_plane(pose), parallel_planes(300.0, 500.0)[1]])
    positions = tracer.positions_mm(x_px, y_px)
    found = tracer.moments(positions, np.full(63, NO_MICROLENS), planes, 256, np.stack([x_px, y_px], axis=1))
    # The image is upright: what lies right of the axis (vision x > 0) is seen right of the image centre.
    way = np.stack([(x_px - 4) * 3.0 / 50.0, (y_px - 3) * 3.0 / 50.0, np.ones(63)], axis=1)
    share = pose[:3, 3] @ pose[:3, 2] / (way @ pose[:3, 2])
    expected = (share[:, None] * way - pose[:3, 3]) @ pose[:3, :2]
    slant = np.linalg.norm(way, axis=1) * np.abs(share) / np.abs(way @ pose[:3, 2])
    reach_mm = PINHOLE_MM * (1 + slant / 50.0)
    assert np.all(np.abs(found[:, :2] - expected) <= 2 * reach_mm[:, None])


def test_a_pinhole_camera_sees_points_where_central_projection_puts_them(tmp_path: Path) -> None:
    """The whole way of ground truth: position images, search, half-pixel rule; x_px = c + f X / Z, y down."""
    camera = rigs.bare(rigs.hole(PINHOLE_MM), Sensor(width_px=48, height_px=40, pitch_mm=0.5), 50.0, (380.0, 420.0))
    board, pose = Checkerboard(columns=4, rows=3, square_mm=20.0), rigs.facing(400.0, 0.0, 5.0, -3.0)
    for k in (1, 2, 3):
        grid = rigs.ray_grid(tmp_path / str(k), camera, k, 64)
        found = truth_of(grid, board.points_mm(), pose, TruthSettings(method="two-plane")).solutions
        assert list(found.point) == list(range(12))
        column, row = np.arange(12) % 4, np.arange(12) // 4
        x_mm, y_mm = 5.0 + 20.0 * (column - 1.5), -3.0 + 20.0 * (row - 1)
        np.testing.assert_allclose(found.x_px, 23.5 + x_mm * 50 / 400 / 0.5, rtol=0, atol=STORED_PX)
        np.testing.assert_allclose(found.y_px, 19.5 + y_mm * 50 / 400 / 0.5, rtol=0, atol=STORED_PX)


def biconvex(thickness_mm: float) -> Prescription:
    """f = 1 / ((n - 1) (2 / R)) = 50 mm when thin; the stop touches it in front."""
    return Prescription(
        surfaces=(
            Surface(semi_diameter_mm=10.0, is_stop=True),
            Surface(radius_mm=50.0, thickness_mm=thickness_mm, index=1.5, semi_diameter_mm=20.0),
            Surface(radius_mm=-50.0, semi_diameter_mm=20.0),
        )
    )


def axis_crossing_mm(lens: Prescription, start_mm: float, slope: float) -> float:
    """Vision z where the ray from the axis at `start_mm` with a slope meets the axis again."""
    length = math.hypot(slope, 1.0)
    way = [[slope / length, 0.0, 1.0 / length]]
    position, direction, _ = traced(towards_scene(lens), [[0.0, 0.0, start_mm]], way)
    return float(position[0, 2] - position[0, 0] * direction[0, 2] / direction[0, 0])


def test_a_lens_that_grows_thin_obeys_the_lens_equation() -> None:
    """From 75 mm behind f = 50 mm to 150 mm before it: halve the thickness, and the error halves. In rays and first
    order."""
    thicknesses = [0.1 / 2**i for i in range(5)]
    rays = [axis_crossing_mm(biconvex(t), -75.0, 1e-6) - 150.0 for t in thicknesses]
    paraxial = [first_order(biconvex(t)).object_mm(-75.0) - 150.0 for t in thicknesses]
    focal = [first_order(biconvex(t)).efl_mm - 50.0 for t in thicknesses]
    for errors in (rays, paraxial, focal):
        assert np.all(np.abs(orders(errors) - 1) < ORDER)
        assert np.all(np.diff(np.abs(orders(errors) - 1)) < 0)


def test_rays_near_the_axis_obey_first_order_optics() -> None:
    """Halve the slope of the ray, and its focus error falls fourfold: conjugates, both foci, both pupils."""
    lens, slopes = rigs.tronnier(), [0.04 / 2**i for i in range(5)]
    constants = first_order(lens)
    for image_mm in (-125.0, -131.81):
        expected = constants.object_mm(image_mm)
        errors = [axis_crossing_mm(lens, image_mm, slope) - expected for slope in slopes]
        assert np.all(np.abs(orders(errors)[1:] - 2) < ORDER)
        assert constants.image_mm(expected) == pytest.approx(image_mm, rel=1e-12)


def test_rays_through_the_centre_of_the_stop_seem_to_come_from_the_pupils() -> None:
    """Halve the slope, and the error falls fourfold; the entrance pupil forwards, the exit pupil backwards."""
    lens = rigs.tronnier()
    constants, table = first_order(lens), towards_scene(lens)
    front = table[6:]
    assert len(front) == lens.stop_index
    errors = []
    for slope in (0.08, 0.04, 0.02, 0.01, 0.005):
        position, direction = np.zeros((1, 3)), np.array([[slope, 0.0, 1.0]]) / math.hypot(slope, 1.0)
        trace_rays(front, position, direction, np.ones(1))
        crossing = position[0, 2] - position[0, 0] * direction[0, 2] / direction[0, 0]
        errors.append(crossing - constants.entrance_pupil.z_mm)
    assert np.all(np.abs(orders(errors)[1:] - 2) < ORDER)
    rear, errors = table[:6], []
    for offset in (0.08, 0.04, 0.02, 0.01, 0.005):
        # Aim at the exit pupil's centre: the stop is met at a height that falls with the cube of the slope.
        way = np.array([[offset, 0.0, 1.0]]) / math.hypot(offset, 1.0)
        position = np.array([[0.0, 0.0, constants.exit_pupil.z_mm]]) - 120.0 * way
        trace_rays(rear, position, way, np.ones(1))
        errors.append(position[0, 0])
    assert np.all(np.abs(orders(errors)[1:] - 3) < ORDER)


def through(table: np.ndarray, start: np.ndarray, aims: np.ndarray) -> list[np.ndarray]:
    """Rays from one point through points (n, 2) of the plane z = 0."""
    direction = np.column_stack([aims, np.zeros(len(aims))]) - start
    return traced(table, np.tile(start, (len(aims), 1)), direction / np.linalg.norm(direction, axis=1)[:, None])


@pytest.mark.parametrize("point", [(0.0, 0.0, -70.0), (30.0, -20.0, -450.0), (5.0, 9.0, -30.0)])
@pytest.mark.parametrize("focal_mm", [F_MM, -35.0])
def test_all_rays_of_a_point_meet_in_its_image(point, focal_mm) -> None:
    """Also wide off the axis, and virtual images: 1/s' = 1/f - 1/s, magnification -s'/s."""
    aims = np.random.default_rng(3).uniform(-6, 6, (300, 2))
    position, direction, alive = through(towards_sensor(thin(focal_mm)), np.array(point), aims)
    assert np.array_equal(alive == 1, np.hypot(*aims.T) <= 6) and 0 < alive.sum() < 300
    image_mm = 1 / (1 / focal_mm + 1 / point[2])
    expected = np.array(point[:2]) * image_mm / point[2]
    hits = position[:, :2] + direction[:, :2] / direction[:, 2:] * image_mm
    np.testing.assert_allclose(hits[alive == 1], np.tile(expected, (int(alive.sum()), 1)), rtol=0, atol=ROUNDING_MM)


def test_its_first_order_figures_are_those_of_a_thin_lens() -> None:
    found = first_order(thin())
    assert (found.efl_mm, found.bfd_mm) == pytest.approx((F_MM, F_MM), rel=1e-14)
    assert (found.front_principal_mm, found.rear_principal_mm) == pytest.approx((0, 0), abs=1e-12)
    assert found.entrance_pupil == found.exit_pupil


def test_two_of_them_add_their_powers_less_the_product_with_their_distance() -> None:
    two = Prescription(
        surfaces=(
            Surface(focal_length_mm=80.0, thickness_mm=15.0, semi_diameter_mm=9.0),
            Surface(focal_length_mm=-60.0, semi_diameter_mm=6.0, is_stop=True),
        )
    )
    assert 1 / first_order(two).efl_mm == pytest.approx(1 / 80 - 1 / 60 + 15 / 80 / 60, rel=1e-13)


def test_every_ray_of_a_pixel_meets_the_plane_in_focus_in_one_point() -> None:
    """The whole camera: image position to the object plane, scaled by the magnification, without distortion."""
    sensor = Sensor(width_px=400, height_px=300, pitch_mm=0.05)
    camera = Camera(prescription=thin(), sensor=sensor, sensor_distance_mm=56.0)
    focus_mm = foci(camera)[0].focus_distance_mm
    bundle = pipeline.bundle(camera, 20.0, 250.0, samples=64)
    image = np.array([20.0 - 199.5, 250.0 - 149.5]) * 0.05
    expected = image * focus_mm / 56.0
    np.testing.assert_allclose(bundle.mean_at(focus_mm)[:2], expected, rtol=0, atol=1e-9)


@pytest.mark.parametrize("other", [{"radius_mm": 50.0}, {"index": 1.5}, {"even_coefficients": (1e-3,)}])
def test_it_has_neither_shape_nor_index(other) -> None:
    with pytest.raises(PrescriptionError, match="a shape or an index"):
        Surface(focal_length_mm=F_MM, semi_diameter_mm=5.0, **other)
