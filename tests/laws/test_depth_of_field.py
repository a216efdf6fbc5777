"""Claim: objects at the ends of the depth of field blur to the circle of confusion, as real rays through ideal lenses
show; near and far planes leave none of it out, and their bounds are those that are documented.
"""

import dataclasses
import math

import numpy as np
import pytest
from laws import rigs
from tolerances import ROUNDING_MM

from pipeline.camera.focusing.depth_of_field import foci, focused, middle_focus
from pipeline.camera.parts.camera import Camera, Sensor
from pipeline.camera.parts.microlens_array import MicrolensArray
from pipeline.optics.kernels import trace_rays
from pipeline.optics.prescription import Prescription, Surface
from pipeline.optics.table import towards_sensor

IDEAL = Surface(focal_length_mm=50.0, semi_diameter_mm=40.0, thickness_mm=12.0)
CONFUSION_PX, PITCH_MM = 2.0, 0.005


def camera_with(stop_semi_mm: float = 3.0, sensor_mm: float = 41.0, **others: object) -> Camera:
    """An ideal lens, a stop behind it, and a sensor; objects at about 800 mm are in focus."""
    lens = Prescription(surfaces=(IDEAL, Surface(semi_diameter_mm=stop_semi_mm, is_stop=True)))
    sensor = Sensor(width_px=64, height_px=48, pitch_mm=PITCH_MM)
    parts = {"prescription": lens, "sensor": sensor, "sensor_distance_mm": sensor_mm}
    return Camera(**parts, circle_of_confusion_px=CONFUSION_PX, **others)


def behind_lens(camera: Camera, object_mm: float) -> tuple[float, float]:
    """Height and slope at the stop, in its plane, of a ray from the axis at a distance before the stop, at slope 1e-3.

    A trace of real rays; through an ideal lens both are linear in the slope.
    """
    slope = 1e-3
    position, direction = np.array([[0.0, 0.0, -object_mm]]), np.array([[0.0, slope, 1.0]])
    direction /= np.linalg.norm(direction)
    trace_rays(towards_sensor(camera.prescription), position, direction, np.ones(1))
    return position[0, 1] / slope, direction[0, 1] / direction[0, 2] / slope


@pytest.mark.parametrize("stop_semi_mm", [1.0, 3.0, 8.0])
def test_at_the_ends_the_sensor_sees_the_circle_of_confusion(stop_semi_mm: float) -> None:
    """The rays through the rim of the stop; in between less, outside more."""
    camera = camera_with(stop_semi_mm)
    near, far = foci(camera)[0].depth_of_field_mm

    def blur_px(object_mm: float) -> float:
        height, slope = behind_lens(camera, object_mm)
        return 2 * stop_semi_mm * abs(1 + camera.sensor_distance_mm * slope / height) / PITCH_MM

    assert near < middle_focus(camera) < far < math.inf
    assert blur_px(near) == pytest.approx(CONFUSION_PX, rel=1e-9)
    assert blur_px(far) == pytest.approx(CONFUSION_PX, rel=1e-9)
    assert blur_px(middle_focus(camera)) == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize("stop_semi_mm", [0.01, 0.005, 0.004, 0.001])
def test_a_narrow_stop_sees_everything_sharply_from_an_end_on(stop_semi_mm: float) -> None:
    """Twice as wide as the circle of confusion, as wide, and narrower, where images are virtual."""
    camera = camera_with(stop_semi_mm)
    near, far = foci(camera)[0].depth_of_field_mm
    height, slope = behind_lens(camera, near)
    blur_px = 2 * stop_semi_mm * abs(1 + camera.sensor_distance_mm * slope / height) / PITCH_MM
    assert near < middle_focus(camera) and far == math.inf
    assert blur_px == pytest.approx(CONFUSION_PX, rel=1e-9)


@pytest.mark.parametrize("kind", [0, 1, 2])
def test_at_the_ends_a_micro_image_has_the_circle_of_confusion(kind: int) -> None:
    """The rays of one object point through the rim of a microlens, which adds offset / f to their slopes."""
    array = MicrolensArray(
        pitch_mm=0.1, focal_lengths_mm=(0.5, 0.6, 0.7), width_mm=1.0, height_mm=1.0, distance_mm=0.45
    )
    camera = camera_with(microlenses=array, sensor_mm=40.0)
    near, far = foci(camera)[kind].depth_of_field_mm

    def blur_px(object_mm: float) -> float:
        height, slope = behind_lens(camera, object_mm)
        before = slope / (height + (camera.sensor_distance_mm - array.distance_mm) * slope)  # slope per height
        return array.pitch_mm * abs(1 + array.distance_mm * (before - 1 / array.focal_lengths_mm[kind])) / PITCH_MM

    assert near < far
    for end in (near, far):
        if math.isfinite(end):
            assert blur_px(end) == pytest.approx(CONFUSION_PX, rel=1e-9)
    assert blur_px(foci(camera)[kind].focus_distance_mm) == pytest.approx(0.0, abs=1e-9)


def planes_of(camera: Camera) -> tuple[float, float]:
    found = focused(dataclasses.replace(camera, near_mm=None, far_mm=None))
    assert found.near_mm is not None and found.far_mm is not None
    return found.near_mm, found.far_mm


def test_a_shallow_depth_of_field_lies_within_a_tenth_of_the_focus_distance() -> None:
    camera = camera_with(8.0)
    focus, (first, last) = middle_focus(camera), foci(camera)[0].depth_of_field_mm
    assert 0.95 * focus < first < last < 1.05 * focus
    np.testing.assert_allclose(planes_of(camera), [0.9 * focus, 1.1 * focus], rtol=0, atol=ROUNDING_MM)


def test_a_deep_one_is_spanned_whole() -> None:
    camera = camera_with(0.25)
    focus, ends = middle_focus(camera), foci(camera)[0].depth_of_field_mm
    assert ends[0] < 0.88 * focus and 1.12 * focus < ends[1] < 1.9 * focus
    np.testing.assert_allclose(planes_of(camera), ends, rtol=0, atol=ROUNDING_MM)


def test_one_up_to_infinity_ends_at_twice_the_focus_distance() -> None:
    camera = camera_with(0.04)
    assert foci(camera)[0].depth_of_field_mm[1] == math.inf
    near, far = planes_of(camera)
    assert near < middle_focus(camera)
    assert far == pytest.approx(2 * middle_focus(camera), rel=1e-12)


def test_the_near_plane_stays_before_the_lens() -> None:
    """A macro lens in a tube with a window, 1 mm behind its focus: a tenth of the distance nearer lies inside."""
    camera = camera_with(sensor_mm=400.0)
    window = Surface(semi_diameter_mm=40.0, thickness_mm=56.0)
    lens = dataclasses.replace(camera.prescription, surfaces=(window, *camera.prescription.surfaces))
    camera = dataclasses.replace(camera, prescription=lens)
    front, focus = -lens.vertices_from_stop_mm[0], middle_focus(camera)
    assert 0.9 * focus < front < focus
    assert planes_of(camera)[0] == pytest.approx((front + focus) / 2, rel=1e-12)


def test_several_types_share_planes_that_hold_all_of_their_depths() -> None:
    camera = dataclasses.replace(rigs.plenoptic(2.0), circle_of_confusion_px=1.0)
    ends = [focus.depth_of_field_mm for focus in foci(camera)]
    middle, (near, far) = middle_focus(camera), planes_of(camera)
    assert near == pytest.approx(min(min(first for first, _ in ends), 0.9 * middle), rel=1e-12)
    assert far == pytest.approx(max(max(last for _, last in ends), 1.1 * middle), rel=1e-12)
    assert min(first for first, _ in ends) < 0.9 * middle or max(last for _, last in ends) > 1.1 * middle
