"""A fisheye before a sensor larger than its image circle: drawing and table end where the light does, and chief rays,
one smooth function of the height, come from wherever there is light.
"""

import dataclasses
import math
from pathlib import Path

import numpy as np
import pytest
from laws import rigs

import pipeline
from pipeline.app.pages import text
from pipeline.camera.figures.field_curves import field_curves
from pipeline.camera.parts.camera import Camera, Sensor
from pipeline.camera.parts.errors import CameraError
from pipeline.camera.pupil.chief_ray import chief_heights, chief_slopes
from pipeline.camera.pupil.outlines import passes
from pipeline.camera.tracer import Tracer, parallel_planes
from pipeline.camera.tracing.moments import WEIGHT
from pipeline.camera.tracing.sampling_bounds import NO_MICROLENS, SKIP
from pipeline.optics.first_order import first_order
from pipeline.optics.kernels import trace_rays
from pipeline.optics.table import VERTEX, towards_scene, unbounded
from pipeline.results.drawing import bundle
from pipeline.scene.load import load

LENSES = Path(__file__).resolve().parents[2] / "stages/lenses"
LEFT_MM = -60.0


@pytest.fixture(scope="module")
def fisheye() -> Camera:
    """The Muller fisheye of 10 mm, focused at about 0.6 m; its sensor's corner lies 28 mm off the axis."""
    lens = load(LENSES / "fisheye_10mm_muller.usda").lens
    sensor = Sensor(width_px=2000, height_px=2000, pitch_mm=0.02)
    return Camera(prescription=lens.prescription, sensor=sensor, sensor_distance_mm=28.916)


@pytest.fixture(scope="module")
def circle_mm(fisheye) -> float:
    return float(field_curves(fisheye, 600.0).height_mm[-1])


def light_from(camera: Camera, height_mm: float) -> int:
    """How many of 200,000 random rays from a place on the sensor leave the lens."""
    table = towards_scene(camera.prescription)
    reach = camera.prescription.surfaces[-1].semi_diameter_mm
    aim = np.random.default_rng(3).uniform(-reach, reach, (200_000, 2))
    start = np.tile([height_mm, 0.0, -camera.sensor_distance_mm], (len(aim), 1))
    return int(passes(table, start, aim).sum())


@pytest.mark.parametrize("width_mm", [1.0, 0.01])
def test_the_table_of_a_narrow_stop_reaches_as_far_as_that_of_a_wide_one(width_mm):
    """Through the double Gauss, whose light ends 60 mm off the axis: beyond its image circle and within."""
    wide = rigs.conventional(width_px=400, height_px=300)
    for camera in (wide, dataclasses.replace(wide, sensor=dataclasses.replace(wide.sensor, pitch_mm=0.4))):
        narrow = dataclasses.replace(camera, prescription=rigs.tronnier(width_mm / 2))
        reached = [field_curves(one, 434.0).height_mm[-1] for one in (camera, narrow)]
        assert 0.9 * reached[0] < reached[1] <= reached[0]


@pytest.mark.parametrize("height_mm", [61.5, 100.0, 150.0])
def test_the_chief_ray_of_a_fisheye_is_found_wherever_there_is_one(height_mm):
    """Of 171 degrees: the ray that is found, traced by itself, meets the centre of the stop."""
    table = towards_scene(load(LENSES / "fisheye_100mm_miyamoto.usda").lens.prescription)
    stop_row = int(np.argmin(np.abs(table[:, VERTEX])))
    position = np.array([[height_mm, 0.0, -601.0]])
    slope = chief_slopes(table, stop_row, position)[0]
    direction = np.array([[*slope, 1.0]]) / np.linalg.norm([*slope, 1.0])
    trace_rays(table[: stop_row + 1], position, direction, np.ones(1))

    assert np.abs(position).max() < 1e-9


def test_the_table_ends_where_random_rays_end(fisheye, circle_mm):
    assert light_from(fisheye, 0.995 * circle_mm) > 0
    assert light_from(fisheye, 1.005 * circle_mm) == 0


def test_the_page_says_that_the_corner_is_dark_and_has_no_row_beyond_the_circle(fisheye, circle_mm):
    """The lens is published with a field of 155.9 degrees."""
    curves = field_curves(fisheye, 600.0)
    page = list(text._curves(curves))

    assert 75 < curves.angle_deg[-1] < 78
    assert (np.diff(curves.relative_illumination) < 0).all() and curves.relative_illumination[-2] > 0.1
    assert (np.diff(curves.distortion) < 0).all()
    ends, dark = page[-1].split(": ")
    assert ends == f"light ends {circle_mm:.3f} mm from the axis, the image circle"
    assert dark == "the corner of the sensor, 28.284 mm off, is dark"


def test_a_sensor_within_the_circle_is_shown_to_its_corner():
    lens = load(LENSES / "fisheye_10mm_muller.usda").lens
    sensor = Sensor(width_px=800, height_px=600, pitch_mm=0.02)
    curves = field_curves(
        Camera(prescription=lens.prescription, sensor=sensor, sensor_distance_mm=28.916), 600.0, rows=3
    )

    assert curves.height_mm.tolist() == [0, 5, 10] and not curves.is_dark_in_the_corner


def test_the_outermost_bundle_of_the_drawing_reaches_the_image_circle(fisheye, circle_mm):
    rays = bundle(fisheye, 1.0, LEFT_MM)

    assert len(rays) == 7
    for ray in rays:
        assert 0.98 * circle_mm < ray[-1][1] < circle_mm


@pytest.mark.parametrize("field", [0.0, 0.4, 0.7, 0.9])
def test_drawn_bundles_are_as_wide_as_those_of_real_rays(fisheye, circle_mm, field):
    """Across their direction in the scene. Sampled rays leave out the last percent at the rim of the pupil."""
    rays = bundle(fisheye, field, LEFT_MM, count=2)
    height = rays[0][-1][1]
    assert height == pytest.approx(0.99 * field * circle_mm, abs=0.1)
    small = dataclasses.replace(fisheye, sensor=Sensor(width_px=1400, height_px=1400, pitch_mm=0.02))
    real = pipeline.bundle(
        small, 699.5, 699.5 + height / 0.02, samples=1 << 17
    )  # up on the sensor is down in the image
    near_plane = np.abs(real.origin_mm[:, 0]) < 0.1  # in the plane of the drawing, nearly
    # Vision y is the drawing's height with the other sign, and so is z its length.
    slope = np.median(real.direction[:, 1] / real.direction[:, 2])
    across = np.array([-slope, 1.0]) / math.hypot(1, slope)
    places = np.stack([-real.origin_mm[near_plane, 2], -real.origin_mm[near_plane, 1]], axis=1) @ across
    drawn = [np.array(ray[1]) @ across for ray in rays]

    assert max(drawn) - min(drawn) == pytest.approx(np.ptp(places), rel=0.05)
    assert np.mean(drawn) == pytest.approx((places.max() + places.min()) / 2, abs=0.05 * np.ptp(places))


def test_steep_bundles_start_within_the_drawing():
    """Of a fisheye of 171 degrees; a ray at 85 degrees would start metres below it."""
    from pipeline.app.show import show
    from pipeline.results.drawing import with_full_field

    camera = with_full_field(show(LENSES / "fisheye_100mm_miyamoto.usda")[0].camera)
    limit = 1.12 * camera.prescription.surfaces[0].semi_diameter_mm
    (x, y), (next_x, next_y) = bundle(camera, 1.0, -900.0)[3][:2]

    assert math.degrees(math.atan2(next_y - y, next_x - x)) > 75
    assert abs(y) <= limit * 1.0001


def test_a_bundle_of_nothing_weighs_nothing():
    """In the corner beyond the image circle, and where no position is asked for; in the middle it weighs something."""
    wide = rigs.conventional(width_px=400, height_px=300)
    tracer = Tracer(dataclasses.replace(wide, sensor=dataclasses.replace(wide.sensor, pitch_mm=0.3)))
    places, lens = np.array([[0.0, 0.0], [59.0, 44.0], [0.0, 0.0]]), np.array([NO_MICROLENS, NO_MICROLENS, SKIP])
    found = tracer.moments(places, lens, parallel_planes(400.0, 500.0), 64, np.zeros((3, 2), np.int64))
    assert found[0, WEIGHT] > 0
    assert found[1:, WEIGHT].tolist() == [0.0, 0.0]


@pytest.mark.parametrize(
    "name", ["wide_22mm_nakamura", "double_gauss_100mm_mandler", "double_gauss_100mm_mills", "macro_100mm_canon"]
)
def test_every_height_that_is_lit_has_a_chief_ray(name: str) -> None:
    """Up to the end of the image circle; steep rays near the axis of the rear surface once led the search astray."""
    prescription = load(LENSES / f"{name}.usda").lens.prescription
    table, film = towards_scene(prescription), first_order(prescription).rear_focus_mm
    stop_row = len(prescription.surfaces) - 1 - prescription.stop_index
    u = np.linspace(-1, 1, 61) * prescription.surfaces[-1].semi_diameter_mm
    grid = np.stack(np.meshgrid(u, u), axis=-1).reshape(-1, 2)
    heights = np.linspace(0.02, 1.0, 50) * first_order(prescription).efl_mm
    lit = [passes(table, np.broadcast_to([h, 0.0, film], (len(grid), 3)), grid).any() for h in heights]
    heights = heights[: lit.index(False) if False in lit else None]
    assert len(heights) > 12

    crossings = chief_heights(table, stop_row, film, heights)

    start = np.column_stack([heights, 0 * heights, np.full(len(heights), film)])
    way = np.column_stack([crossings, 0 * heights, np.full(len(heights), table[0, 0])]) - start
    alive = np.ones(len(heights))
    trace_rays(unbounded(table[: stop_row + 1]), start, way / np.linalg.norm(way, axis=1, keepdims=True), alive)
    assert alive.all() and np.abs(start[:, 0]).max() < 1e-9
    steps = np.diff(crossings)
    assert (steps[1:] / steps[:-1] > 2 / 3).all() and (steps[1:] / steps[:-1] < 3 / 2).all()  # no jump to another ray


def test_a_height_without_one_is_refused_with_a_number_and_a_hint() -> None:
    prescription = load(LENSES / "double_gauss_100mm_tronnier.usda").lens.prescription
    table, film = towards_scene(prescription), first_order(prescription).rear_focus_mm
    with pytest.raises(CameraError, match=r"no ray from 400 mm off the axis") as caught:
        chief_slopes(table, 5, np.array([[1.0, 0.0, film], [0.0, 400.0, film], [300.0, 0.0, film]]))
    assert "pixel pitch in mm" in caught.value.hint
