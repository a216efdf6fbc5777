"""Lenses that see 90 degrees off their axis and farther, and a ball, through whose centre light goes straight.

A plane sensor behind a ball sees less than 90 degrees, so its law ends at 85; beyond, random rays judge a fisheye.
"""

import dataclasses

import numpy as np
import pytest
from naive.brute import rays_through
from published.library import prescription
from shorter import few
from tolerances import SIGMAS

from pipeline.app.authoring.poses import CameraField, Wish, poses_that_fill
from pipeline.camera.figures import point_images
from pipeline.camera.figures.doubts import doubts
from pipeline.camera.figures.equivalent_pinhole import pinhole
from pipeline.camera.figures.field_curves import field_of_view_deg
from pipeline.camera.figures.outlook import Fate, outlook
from pipeline.camera.focusing.depth_of_field import focused
from pipeline.camera.parts.camera import Camera, Sensor
from pipeline.camera.parts.errors import CameraError
from pipeline.camera.pupil.from_stop import depths_mm, pupil_fan
from pipeline.camera.rig import Rig
from pipeline.camera.tracer import Tracer
from pipeline.fits.field import FitError, field_rays
from pipeline.fits.fitting import fitted, rms
from pipeline.frames import apply
from pipeline.results import answers
from pipeline.results.drawing import bundle
from pipeline.results.ready_camera import ReadyCamera
from pipeline.targets.patterns.checkerboard import Checkerboard
from pipeline.targets.target import Target
from pipeline.truth.planes import axes_across

PIN_MM = 1e-3
"""Semi-diameter of a stop so narrow that its bundle is one ray: blur of some 1e-3 mm is centred to its square."""


def ready(name: str, distance_mm: float, width_px: int, pitch_mm: float, stop_mm: float | None = None) -> ReadyCamera:
    lens = prescription(name)
    if stop_mm is not None:
        surfaces = (dataclasses.replace(s, semi_diameter_mm=stop_mm) if s.is_stop else s for s in lens.surfaces)
        lens = dataclasses.replace(lens, surfaces=tuple(surfaces))
    sensor = Sensor(width_px=width_px, height_px=width_px, pitch_mm=pitch_mm)
    camera = Camera(prescription=lens, sensor=sensor, sensor_distance_mm=distance_mm)
    return ReadyCamera(name=name, rig=Rig.of(Tracer(camera)), min_hit_fraction=0.0, accuracy_px=1e-4)


def at_angles(angles_deg: list[float], from_mm: float, distance_mm: float) -> tuple[np.ndarray, np.ndarray]:
    """Points in these directions from a place on the axis, at azimuths of their own, and normals that face it."""
    angle, azimuth = np.radians(angles_deg), 2.4 * np.arange(len(angles_deg))
    way = np.stack([np.sin(angle) * np.cos(azimuth), np.sin(angle) * np.sin(azimuth), np.cos(angle)], axis=1)
    return distance_mm * way + np.array([0.0, 0.0, from_mm]), -way


@pytest.fixture(scope="module")
def nikkor() -> ReadyCamera:
    """The fisheye of 220 degrees, focused near 120 mm before its first vertices."""
    return ready("fisheye_6mm_nikkor", 49.6, 480, 0.05)


ANGLES_DEG = [60.0, 85.0, 89.0, 90.0, 95.0, 105.0]


def test_light_of_a_position_meets_its_point_on_average_also_from_behind(nikkor):
    """Random rays of a textbook's trace from the row's position, all over the rear surface."""
    points, normals = at_angles(ANGLES_DEG, 30.0, 120.0)
    rows = nikkor.project(points, normals)
    assert rows.point.tolist() == list(range(len(points)))
    rng, tracer = np.random.default_rng(4), nikkor.rig.tracer
    starts = tracer.positions_mm(rows.x_px, rows.y_px)
    planes = axes_across(normals)
    for start, point, axes in zip(starts, points, planes, strict=True):
        position, way, weight = rays_through(nikkor.camera, start, None, None, 60_000, rng)
        kept = weight > 0
        position, way, share = position[kept], way[kept], weight[kept] / weight[kept].sum()
        assert len(share) > 200
        along = (point - position) @ axes[2] / (way @ axes[2])
        assert (along > 0).all()
        off = (position + along[:, None] * way - point) @ axes[:2].T
        error = np.sqrt(share**2 @ (off - share @ off) ** 2)
        assert (np.abs(share @ off) < SIGMAS * error).all()
        assert error.max() < 0.02  # mm, a tenth of what a pixel sees of it


def test_the_ray_of_a_position_meets_the_point_whose_position_it_is(nikkor):
    """On a plane across the ray the mean of the bundle is the ray's own point; beyond the field there is none."""
    points, normals = at_angles([0.0, *ANGLES_DEG], 30.0, 120.0)
    rows = nikkor.project(points, normals)
    rays = nikkor.rays(rows.x_px, rows.y_px)
    along = np.sum((points - rays.origin_mm) * rays.direction, axis=1)
    assert (along > 80).all()
    assert np.abs(rays.origin_mm + along[:, None] * rays.direction - points).max() < 2e-3
    assert (np.degrees(np.arccos(rays.direction[:, 2])) > np.array([-1, *ANGLES_DEG]) - 3).all()
    assert np.isnan(nikkor.rays([0.0], [0.0]).direction).all()
    assert np.isnan(rays.at_distance(100.0)[-1]).all() and np.isfinite(rays.at_distance(100.0)[0]).all()


def test_what_lies_beyond_the_field_is_not_seen_and_the_check_agrees(nikkor):
    points, normals = at_angles([0.0, 70.0, 100.0, 112.0, 130.0, 180.0], 30.0, 120.0)
    fates = nikkor.project(points, normals).fates
    assert fates[:3] == (answers.Fate.SEEN,) * 3
    assert answers.Fate.SEEN not in fates[4:]
    assert fates[5] is answers.Fate.BEHIND
    tried = outlook(nikkor.camera, points[None], normals[None]).fate[0]
    assert [fate == Fate.SEEN for fate in tried] == [fate is answers.Fate.SEEN for fate in fates]


def test_the_field_of_view_is_that_of_its_rays_also_behind_90_degrees_and_where_the_image_circle_ends():
    """One ray of each position, because the stop is a pin. In the diagonal light ends with the fan from the stop."""
    pin = ready("fisheye_6mm_nikkor", 49.6, 480, 20.8 / 480, PIN_MM)
    across, down, diagonal = field_of_view_deg(pin.camera)
    ends = pin.rays([-0.5, 479.5], [239.5, 239.5]).direction
    assert across == pytest.approx(np.degrees(np.arccos(ends[:, 2])).sum(), abs=1e-5)
    assert down == pytest.approx(across, abs=1e-9)
    assert diagonal / 2 == pytest.approx(np.degrees(pupil_fan(pin.camera.prescription).widest_rad), abs=0.1)
    assert across > 200 and diagonal >= FISHEYES["fisheye_6mm_nikkor"][0]


@pytest.mark.parametrize("pitch_mm", few([0.055, 0.08], 0.03, 0.04, 0.05, 0.06, 0.065, 0.07, 0.075, 0.09, 0.1))
def test_no_pinhole_stands_for_a_camera_that_sees_behind_90_degrees(nikkor, pitch_mm):
    """Its image circle may end inside the sensor; below 75 degrees there is one, which explains the image."""
    sensor = Sensor(width_px=260, height_px=260, pitch_mm=pitch_mm)
    camera = focused(dataclasses.replace(nikkor.camera, sensor=sensor, near_mm=None, far_mm=None))
    found, widest_deg = pinhole(camera), field_of_view_deg(camera)[2] / 2
    assert widest_deg < 75 or widest_deg > 90
    assert (found is not None) == (widest_deg < 75)
    assert found is None or found.distorted.max_px < 0.01 * np.hypot(*sensor.size_px)


FISHEYES = {
    # Stated field, distance of the sensor, half of one that holds the image. The Muller is stated to have 155.9, but
    # the clear apertures of its source end chief rays at 149.3, and all light at 150.8.
    "fisheye_6mm_nikkor": (220.0, 49.6, 11.5),
    "fisheye_100mm_miyamoto": (170.8, 602.9, 160.0),
    "fisheye_10mm_muller": (149.2, 28.9, 14.0),
}


@pytest.mark.parametrize("half_mm, codes", [(12.0, []), (24.0, ["image-circle"])])
def test_the_circle_of_a_fisheye_may_lie_inside_the_sensor_but_not_be_lost_on_it(nikkor, half_mm, codes):
    sensor = Sensor(width_px=480, height_px=480, pitch_mm=half_mm / 240)
    assert [doubt.code for doubt in doubts(dataclasses.replace(nikkor.camera, sensor=sensor))] == codes


@pytest.mark.parametrize("name", FISHEYES)
def test_fisheyes_reach_their_stated_field(name):
    stated_deg, distance_mm, half_mm = FISHEYES[name]
    camera = ready(name, distance_mm, 400, half_mm / 200)
    pupil_mm = pupil_fan(camera.camera.prescription).z_mm[-1]
    points, normals = at_angles([0.499 * stated_deg], pupil_mm, 1e5)
    assert camera.project(points, normals).fates == (answers.Fate.SEEN,)


def test_blur_behind_microlenses_counts_along_rays_beside_a_lens(nikkor):
    """Points as far from the first vertex, on the axis and 96 degrees off it, have one depth of field."""
    front_mm = pupil_fan(nikkor.camera.prescription).z_mm[0]
    points, _ = at_angles([0.0, 96.0], front_mm, 180.0)
    np.testing.assert_allclose(depths_mm(nikkor.camera.prescription, points), front_mm + 180.0, rtol=1e-12)


def test_new_poses_stand_around_a_fisheye_and_face_it(nikkor):
    """Their tilt is from the chief ray of their middle; some points are farther than 90 degrees off the axis."""
    board = Target(Checkerboard(columns=4, rows=3, square_mm=20.0))
    wish = Wish(count=6, blur_px=4.0, least_seen=0.6)
    field = CameraField(camera=nikkor.camera, target=board, wish=wish, vision_from_first=np.eye(4))
    fan, angles, (near, far) = pupil_fan(nikkor.camera.prescription), [], field.depth_mm
    for pose in poses_that_fill([field]):
        centre, front = pose.vision_from_target[:3, 3], pose.vision_from_target[:3, 2]
        angle = fan.angle_rad[np.argmax(fan.past_mm(centre[None])[0] <= 0)]
        way = np.append(np.sin(angle) * centre[:2] / np.hypot(*centre[:2]), np.cos(angle))
        assert np.degrees(np.arccos(-front @ way)) == pytest.approx(pose.tilt_deg, abs=0.5)
        assert near < pose.away_mm < far
        points = apply(pose.vision_from_target, board.points().position_mm)[np.isfinite(pose.seen_px[0, :, 0])]
        angles.extend(np.degrees(fan.angle_rad[np.argmax(fan.past_mm(points) <= 0, axis=1)]))
    assert max(angles) > 95 and min(angles) < 30


def test_point_images_end_where_planes_in_focus_do(nikkor):
    """The outermost default place is 78 degrees off the axis, by its own mean ray; beyond, they are refused."""
    words, position_mm = list(point_images._default_positions_mm(nikkor.rig).items())[-1]
    assert words == "78 degrees off the axis"
    rays = nikkor.rays(*nikkor.rig.tracer.pixels_at(position_mm[None]).T)
    assert np.degrees(np.arccos(rays.direction[0, 2])) == pytest.approx(78.0, abs=0.6)
    points, normals = at_angles([105.0], 30.0, 120.0)
    rows = nikkor.project(points, normals)
    with pytest.raises(CameraError, match="no plane in focus"):
        point_images.point_images(nikkor.camera, 587.56, at_px=(rows.x_px[0], rows.y_px[0]))


def test_drawings_show_light_that_comes_from_behind(nikkor):
    """The outermost bundle comes as the ray of its position does."""
    ray = bundle(nikkor.camera, 1.0, -100.0)[3]
    (x, y), (further_x, further_y), height_mm = ray[0], ray[1], ray[-1][1]
    real = nikkor.rays([239.5], [239.5 + height_mm / 0.05])  # up on the sensor is down in the image
    angle = np.degrees(np.arctan2(further_y - y, further_x - x))
    assert angle == pytest.approx(np.degrees(np.arccos(real.direction[0, 2])), abs=2.0) and angle > 100


def test_through_the_centre_of_a_ball_light_goes_straight():
    """The truth at 60 and 85 degrees is that on the axis, turned about the centre: on a line through it."""
    distance_mm, width, pitch = 15.2, 7000, 0.06
    ball = ready("ball_15mm", distance_mm, width, pitch, PIN_MM)
    points, normals = at_angles([0.0, 60.0, 85.0], 0.0, 500.0)
    rows = ball.project(points, normals)
    assert rows.is_seen.all()
    seen_mm = ball.rig.tracer.positions_mm(rows.x_px, rows.y_px)
    np.testing.assert_allclose(seen_mm, -distance_mm * points[:, :2] / points[:, 2:], rtol=0, atol=PIN_MM**2)


def test_a_model_of_wide_fields_fits_where_a_pinhole_is_refused(nikkor):
    field = field_rays(nikkor)
    assert fitted(field, "kannala-brandt").rms_px < 2.0  # of an image of 450 px: its rays meet in no centre
    with pytest.raises(FitError, match="behind") as refused:
        fitted(field, "brown")
    assert "kannala-brandt" in str(refused.value.hint)


def test_all_models_that_fit_a_fisheye_leave_what_its_wandering_pupil_leaves(nikkor):
    """At one distance their coefficients explain nearly all of it; a pinhole is none of them."""
    field = field_rays(nikkor)
    wide = ("fisheye", "kannala-brandt", "ftheta", "eucm", "double-sphere")
    fits = [fitted(field, name) for name in wide]
    assert all(3 * rms(fit.at_distance(field, field.between_mm[2])) < fit.rms_px for fit in fits)
