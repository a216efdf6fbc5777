"""Claim: the equivalent pinhole projects a camera's mean rays to their pixels, and is the one that closed forms give.

Pupils of ideal thin lenses by the thin-lens equation, images by OpenCV, mean rays by random rays.
"""

import dataclasses
import math

import cv2
import numpy as np
import pytest
from laws import rigs

from pipeline.camera.figures.equivalent_pinhole import Pinhole, Projection, pinhole
from pipeline.camera.parts.camera import Camera, Sensor
from pipeline.camera.tracer import Tracer, parallel_planes
from pipeline.camera.tracing.sampling_bounds import NO_MICROLENS
from pipeline.optics.prescription import Group, Prescription, Surface

FINE = 1e-6
"""A stop of 0.02 mm seen over 50 mm: across it the weight of rays and their tangents change by 1e-7 [relative]."""
SENSOR = Sensor(width_px=64, height_px=48, pitch_mm=0.2)
FILM_MM, AHEAD_MM, FOCAL_MM = 60.0, 15.0, 80.0
TUBE = (
    Surface(focal_length_mm=50.0, semi_diameter_mm=0.01, is_stop=True, thickness_mm=20.0),
    Surface(semi_diameter_mm=2.0),
)


def camera(*surfaces: Surface, **others) -> Camera:
    """Focus does not matter: planes of the fit are given."""
    parts = {"sensor": SENSOR, "sensor_distance_mm": FILM_MM, "near_mm": 400.0, "far_mm": 600.0, **others}
    return Camera(prescription=Prescription(surfaces=surfaces), **parts)


def lens_before_the_stop(**stop) -> Camera:
    """An ideal thin lens that shows its stop enlarged and farther away."""
    stop = Surface(semi_diameter_mm=0.01, is_stop=True, **stop)
    return camera(Surface(focal_length_mm=FOCAL_MM, semi_diameter_mm=30.0, thickness_mm=AHEAD_MM), stop)


def of(asked: Camera) -> Pinhole:
    found = pinhole(asked)
    assert found is not None
    return found


def projected(found: Pinhole, projection: Projection, points_mm: np.ndarray) -> np.ndarray:
    """By OpenCV: points of the vision frame in the image."""
    f, (x, y) = projection.principal_distance_px, projection.principal_point_px
    matrix = np.array([[f, 0, x], [0, f, y], [0, 0, 1]])
    shift = -np.array(found.centre_mm)
    return cv2.projectPoints(points_mm, np.zeros(3), shift, matrix, np.array(projection.distortion))[0][:, 0]


def test_a_thin_lens_at_its_stop_is_a_pinhole_in_its_middle() -> None:
    found = of(camera(Surface(focal_length_mm=50.0, semi_diameter_mm=0.01, is_stop=True)))
    assert found.centre_mm == pytest.approx((0, 0, 0), abs=FILM_MM * FINE)
    assert found.plain.principal_distance_px == pytest.approx(FILM_MM / SENSOR.pitch_mm, rel=FINE)
    assert found.plain.principal_point_px == (31.5, 23.5)
    assert found.plain.max_px < 100 * FINE
    assert found.distorted.distortion == (0, 0, 0, 0, 0) and found.lit_share == 1


@pytest.mark.parametrize("wide_mm", [1.0, 4.0])
def test_the_pinhole_of_a_wide_thin_lens_stands_before_it(wide_mm: float) -> None:
    """By cos^4 of angles at the sensor, d behind the lens, the mean of the rays of x passes the lens at -x R^2 / d^2.

    All meet at x z / d in focus, at z: to first order it is a line through the axis at z R^2 / (z d + R^2).
    """
    focus_mm = 1 / (1 / 50.0 - 1 / FILM_MM)
    found = of(
        camera(Surface(focal_length_mm=50.0, semi_diameter_mm=wide_mm, is_stop=True), near_mm=290.0, far_mm=310.0)
    )
    ahead_mm = focus_mm * wide_mm**2 / (focus_mm * FILM_MM + wide_mm**2)
    assert found.centre_mm == pytest.approx((0, 0, ahead_mm), rel=0.03)
    through_focus = FILM_MM * (1 - found.centre_mm[2] / focus_mm)
    assert found.plain.principal_distance_px == pytest.approx(through_focus / SENSOR.pitch_mm, rel=FINE)
    assert found.plain == found.distorted and found.plain.max_px < 1e-4 * wide_mm


def test_a_stop_behind_a_thin_lens_is_seen_where_the_lens_equation_says() -> None:
    """1/s' = 1/f - 1/s puts the pupil s' behind the lens; a chief ray's slope shrinks by s / s' as it leaves."""
    found, pupil_mm = of(lens_before_the_stop()), 1 / (1 / AHEAD_MM - 1 / FOCAL_MM)
    assert found.centre_mm == pytest.approx((0, 0, AHEAD_MM - pupil_mm), abs=FILM_MM * FINE)
    principal_mm = FILM_MM * pupil_mm / AHEAD_MM
    assert found.plain.principal_distance_px == pytest.approx(principal_mm / SENSOR.pitch_mm, rel=FINE)


@pytest.mark.parametrize("asked", [lens_before_the_stop(), rigs.conventional()], ids=["thin", "double Gauss"])
def test_a_shifted_sensor_moves_the_principal_point_alone(asked: Camera) -> None:
    """It sees another part of the field, which may change what a pinhole leaves, but not the pinhole of a thin lens."""
    sensor = dataclasses.replace(asked.sensor, offset_x_mm=0.6, offset_y_mm=-0.3)
    old, new = of(asked), of(dataclasses.replace(asked, sensor=sensor))
    moved = np.subtract(new.plain.principal_point_px, old.plain.principal_point_px)
    np.testing.assert_allclose(moved, np.array([0.6, -0.3]) / sensor.pitch_mm, rtol=0, atol=1e-12)
    assert new.centre_mm == pytest.approx(old.centre_mm, abs=5e-3)
    assert new.distorted.principal_distance_px == pytest.approx(old.distorted.principal_distance_px, rel=1e-5)


@pytest.mark.parametrize("asked", [lens_before_the_stop(), rigs.conventional()], ids=["thin", "double Gauss"])
def test_a_lens_that_is_off_as_a_whole_takes_its_pinhole_along(asked: Camera) -> None:
    """0.3 mm right and 0.2 mm up: y of the vision frame points down, and the sensor sees its image upside down."""
    surfaces = asked.prescription.surfaces
    group = Group(name="all", first=0, count=len(surfaces), decentre_mm=(0.3, 0.2))
    off = of(dataclasses.replace(asked, prescription=Prescription(surfaces=surfaces, groups=(group,))))
    centred = of(asked)
    np.testing.assert_allclose(np.subtract(off.centre_mm, centred.centre_mm), [0.3, -0.2, 0.0], rtol=0, atol=5e-4)
    moved = np.subtract(off.distorted.principal_point_px, centred.distorted.principal_point_px)
    np.testing.assert_allclose(moved, np.array([-0.3, 0.2]) / asked.sensor.pitch_mm, rtol=0, atol=0.01)
    assert off.distorted.max_px < 2 * max(centred.distorted.max_px, 100 * FINE)


@pytest.mark.parametrize("kind", ["centred", "displaced"])
def test_random_mean_rays_lie_off_its_images_by_no_more_than_it_says(kind: str) -> None:
    """Anywhere in the image and between the planes; a pinhole in the stop instead would be off by a pixel."""
    wide = rigs.conventional(width_px=600, height_px=400, pitch_mm=0.06)
    asked = wide if kind == "centred" else rigs.displaced(wide)
    found, random = of(asked), np.random.default_rng(8)
    places, distances = random.uniform((0, 0), (599, 399), (24, 2)), random.uniform(*found.planes_mm, 24)
    points = np.column_stack([mean_rays(asked, places, distances), distances])
    for projection in (found.plain, found.distorted):
        off = np.hypot(*(projected(found, projection, points) - places).T)
        assert off.max() < 1.1 * projection.max_px + 0.01  # the grid of positions, and sampling
        assert math.sqrt(np.mean(off**2)) > projection.rms_px / 3
    in_stop = dataclasses.replace(found, centre_mm=(0.0, 0.0, 0.0))
    assert np.hypot(*(projected(in_stop, found.distorted, points) - places).T).max() > 1
    assert found.distorted.rms_px < found.plain.rms_px / 2


def mean_rays(asked: Camera, places_px: np.ndarray, distances_mm: np.ndarray) -> np.ndarray:
    """Where the bundles of image positions meet a plane each, on average, by 16,384 random rays."""
    tracer = Tracer(asked)
    planes = np.stack([parallel_planes(z, z + 10) for z in distances_mm])
    where = tracer.positions_mm(*places_px.T), np.full(len(places_px), NO_MICROLENS), planes
    return tracer.moments(*where, 1 << 14, np.rint(places_px).astype(np.int64))[:, :2]


def test_a_sensor_beyond_the_image_circle_says_how_much_of_it_is_lit() -> None:
    """A tube of 2 mm, 20 mm behind the stop, shades all that lies farther than 6 mm from the axis."""
    found = of(camera(*TUBE))
    beyond_mm2 = 6**2 * math.acos(4.8 / 6) - 4.8 * math.sqrt(6**2 - 4.8**2)  # circle beyond the sensor's edge
    assert found.lit_share == pytest.approx((math.pi * 6**2 - 2 * beyond_mm2) / (12.8 * 9.6), abs=0.01)
    assert found.plain.principal_distance_px == pytest.approx(FILM_MM / SENSOR.pitch_mm, rel=FINE)


def test_without_light_there_is_none() -> None:
    assert pinhole(camera(*TUBE, sensor=dataclasses.replace(SENSOR, offset_x_mm=15.0))) is None
