"""Claim: a check sees what a camera sees: points in the view of paraxial optics, no others, and the reason why not.

Points are put well inside the paraxial view and well outside of it: behind microlenses, before which images are out of
focus on purpose, a point beside the view still lights some of them.
"""

import dataclasses

import numpy as np
import pytest
from laws import rigs

from pipeline.camera.figures.outlook import Fate, outlook
from pipeline.camera.focusing.depth_of_field import focused, middle_focus
from pipeline.camera.parts.camera import Camera, Sensor
from pipeline.optics.first_order import first_order
from pipeline.optics.prescription import Prescription, Surface

TOWARDS = np.array([0.0, 0.0, -1.0])
CAMERAS = {"conventional": focused(rigs.conventional()), "plenoptic": focused(rigs.plenoptic(extent_mm=3.0))}


def half_view_mm(camera: Camera, z_mm: float) -> np.ndarray:
    """Half of what the image shows at vision z: by similar triangles through the pupils, magnified as they are."""
    lens = first_order(camera.prescription)
    behind_mm = (lens.exit_pupil.z_mm + camera.sensor_distance_mm) / lens.pupil_magnification
    half_mm = np.array([camera.sensor.width_px, camera.sensor.height_px]) * camera.sensor.pitch_mm / 2
    return half_mm * (z_mm - lens.entrance_pupil.z_mm) / behind_mm


def fates(camera: Camera, points_mm: list, front: np.ndarray = TOWARDS) -> list[Fate]:
    points = np.array(points_mm, float)[None]
    return [Fate(fate) for fate in outlook(camera, points, np.broadcast_to(front, points.shape)).fate[0]]


@pytest.mark.parametrize("camera", CAMERAS.values(), ids=CAMERAS)
def test_points_in_view_are_seen_and_others_are_not(camera: Camera) -> None:
    z_mm = middle_focus(camera)
    half = half_view_mm(camera, z_mm)
    directions = np.array([(x, y) for x in (-1, 0, 1) for y in (-1, 0, 1)])
    inside = [(*(0.85 * half * direction), z_mm) for direction in directions]
    outside = [(*(4 * half * direction), z_mm) for direction in directions if direction.any()]

    assert set(fates(camera, inside)) == {Fate.SEEN}
    assert set(fates(camera, outside)) <= {Fate.OUTSIDE, Fate.NO_LIGHT}
    assert set(fates(camera, inside, -TOWARDS)) == {Fate.AWAY}


def test_a_point_in_focus_far_beside_the_field_is_outside_and_not_out_of_focus() -> None:
    """At 45 degrees a singlet spreads it over more than the image; on the axis it would be seen."""
    surfaces = (
        Surface(radius_mm=50.0, thickness_mm=6.0, semi_diameter_mm=12.0, index=1.5168),
        Surface(radius_mm=-50.0, thickness_mm=3.0, semi_diameter_mm=12.0),
        Surface(semi_diameter_mm=4.0, is_stop=True),
    )
    sensor = Sensor(width_px=160, height_px=120, pitch_mm=0.02)
    camera = Camera(prescription=Prescription(surfaces=surfaces), sensor=sensor, sensor_distance_mm=51.0)
    points = np.array([[[500.0, 0.0, 500.0], [0.0, 0.0, 500.0]]])

    found = outlook(camera, points, np.broadcast_to(TOWARDS, points.shape))

    assert found.blur_px[0, 0] > 160
    assert list(found.fate[0]) == [Fate.OUTSIDE, Fate.SEEN]


def test_a_point_before_the_front_focus_is_a_blur() -> None:
    """Its image is virtual: by similar triangles its light is wider on the sensor than the pupil that it left."""
    camera = CAMERAS["conventional"]
    lens = first_order(camera.prescription)
    z_mm = lens.front_focus_mm - 20.0
    found = outlook(camera, np.array([[[0.0, 0.0, z_mm]]]), np.array([[TOWARDS]]))

    image_mm = lens.image_mm(z_mm)
    wide_mm = lens.exit_pupil.diameter_mm * (image_mm + camera.sensor_distance_mm) / (image_mm - lens.exit_pupil.z_mm)
    assert found.fate[0, 0] == Fate.BLURRED
    assert found.blur_px[0, 0] * camera.sensor.pitch_mm == pytest.approx(wide_mm, rel=0.15)


@pytest.mark.parametrize("camera", CAMERAS.values(), ids=CAMERAS)
def test_a_point_very_far_away_has_the_fate_of_one_that_is_far_away(camera: Camera) -> None:
    """A kilometre, and as far as the moon: the light of both is parallel."""
    lens = first_order(camera.prescription)
    at_infinity = dataclasses.replace(camera, sensor_distance_mm=-lens.rear_focus_mm, microlenses=None)
    for z_mm in (1e6, 4e7, 4e11):
        assert fates(at_infinity, [(0.0, 0.0, z_mm), (1e-3 * z_mm, 0.0, z_mm)]) == [Fate.SEEN] * 2
        assert fates(at_infinity, [(0.5 * z_mm, 0.0, z_mm)])[0] in (Fate.OUTSIDE, Fate.NO_LIGHT)
    assert fates(camera, [(0.0, 0.0, 4e11)]) == fates(camera, [(0.0, 0.0, 1e6)])


def test_a_lens_that_bends_no_ray_into_the_camera_gives_no_light() -> None:
    camera = CAMERAS["conventional"]
    assert fates(camera, [(5000.0, 0.0, 100.0)]) == [Fate.NO_LIGHT]


def test_where_no_microlens_is_there_is_no_light() -> None:
    camera = CAMERAS["plenoptic"]
    middle = (0.0, 0.0, middle_focus(camera))
    beside = dataclasses.replace(camera.microlenses, offset_x_mm=10.0)

    assert fates(camera, [middle]) == [Fate.SEEN]
    assert fates(dataclasses.replace(camera, microlenses=beside), [middle]) == [Fate.NO_LIGHT]
