"""Claim: an ideal thin lens maps every object point to one image point, where the thin-lens equation says."""

import numpy as np
import pytest
from laws.ideal_lens import F_MM, thin
from laws.surfaces import assert_returned
from tolerances import REVERSED_MM, ROUNDING_MM

import pipeline
from pipeline.camera.focusing.depth_of_field import foci
from pipeline.camera.parts.camera import Camera, Sensor
from pipeline.optics.first_order import first_order
from pipeline.optics.kernels import trace_rays
from pipeline.optics.prescription import Prescription, PrescriptionError, Surface
from pipeline.optics.table import towards_sensor


def through(table: np.ndarray, start: np.ndarray, aims: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Rays from one point through points (n, 2) of the plane z = 0."""
    direction = np.column_stack([aims, np.zeros(len(aims))]) - start
    direction /= np.linalg.norm(direction, axis=1)[:, None]
    position, alive = np.tile(start, (len(aims), 1)), np.ones(len(aims))
    trace_rays(table, position, direction, alive)
    return position, direction, alive


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


def test_a_ray_traced_back_returns_to_where_it_came_from() -> None:
    start, aims = np.tile([11.0, -4.0, -90.0], (100, 1)), np.random.default_rng(5).uniform(-4, 4, (100, 2))
    way = np.column_stack([aims, np.zeros(100)]) - start
    way /= np.linalg.norm(way, axis=1)[:, None]
    assert assert_returned(thin(), start, way, 100 * REVERSED_MM) == 100


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
