"""First-order figures against closed forms."""

import dataclasses
import math

import numpy as np
import pytest

from pipeline.camera.figures.field_curves import field_curves
from pipeline.camera.figures.first_order_figures import gaps_mm, report
from pipeline.camera.focusing.depth_of_field import foci, middle_focus
from pipeline.camera.parts.camera import Camera, Sensor
from pipeline.optics.first_order import first_order
from pipeline.optics.prescription import Prescription, Surface


def test_gaps_are_what_no_range_covers():
    assert gaps_mm([(1, 2)]) == []
    assert gaps_mm([(3, 4), (1, 2), (5, math.inf)]) == [[2, 3], [4, 5]]
    assert gaps_mm([(1, 5), (2, 3), (4, 6), (7, 8)]) == [[6, 7]]


def test_magnification_through_a_microlens_is_the_product_of_both_lenses(plenoptic: Camera):
    """Main lens times virtual depth: the microlens reduces an image behind it by 1 / v."""
    for entry in report(plenoptic)["mla"]["types"]:
        product = entry["magnification"] / entry["virtual_depth"]
        assert entry["micro_image_magnification"] == pytest.approx(product, rel=1e-12)


def test_microlenses_one_focal_length_before_the_sensor_have_a_finite_magnification(plenoptic: Camera):
    """The main lens acts as a collimator: the product of focal lengths' ratio, f / EFL, inverted. What a view has in
    focus it images onto the array, magnified by (F' - image) / EFL.
    """
    array = dataclasses.replace(plenoptic.microlenses, focal_lengths_mm=(1.7,))
    (entry,) = report(dataclasses.replace(plenoptic, microlenses=array))["mla"]["types"]
    lens = first_order(plenoptic.prescription)
    assert entry["micro_image_magnification"] == pytest.approx(-1.7 / lens.efl_mm, rel=1e-12)
    array_z_mm = 1.7 - plenoptic.sensor_distance_mm
    assert entry["magnification"] == pytest.approx(-(lens.rear_focus_mm - array_z_mm) / lens.efl_mm, rel=1e-12)


def test_the_depth_of_field_of_a_type_contains_its_focus(plenoptic: Camera):
    """Also where the circle of confusion is so large that the image of its near end lies at infinity."""
    for pixels in (0.1, 1.0, 3.0, 10.0):
        for focus in foci(dataclasses.replace(plenoptic, circle_of_confusion_px=pixels)):
            near, far = focus.depth_of_field_mm
            assert near < focus.focus_distance_mm < far


@pytest.mark.parametrize("offset_mm", [(0.0, 0.0), (0.4, -0.3), (9.0, 7.0)])
def test_the_field_of_view_of_a_thin_lens_is_that_of_its_centre(offset_mm: tuple[float, float]):
    """Angles between the lines from its middle to ends of the image's middle row, column and diagonal."""
    width, height = 6.4, 4.8
    sensor = Sensor(width_px=64, height_px=48, pitch_mm=0.1, offset_x_mm=offset_mm[0], offset_y_mm=offset_mm[1])
    lens = Prescription(surfaces=(Surface(focal_length_mm=8.0, semi_diameter_mm=1.0, is_stop=True),))
    camera = Camera(prescription=lens, sensor=sensor, sensor_distance_mm=8.2, near_mm=200.0, far_mm=400.0)
    for half, found in zip(
        [(width, 0), (0, height), (width, height)], report(camera)["field_of_view_deg"], strict=True
    ):
        ends = [np.array([*(offset_mm + side * np.array(half) / 2), 8.2]) for side in (-1, 1)]
        cosine = ends[0] @ ends[1] / np.linalg.norm(ends[0]) / np.linalg.norm(ends[1])
        assert found == pytest.approx(math.degrees(math.acos(cosine)), rel=1e-9)


def test_distortion_vanishes_as_the_square_of_the_field(conventional: Camera):
    """Third-order distortion: half the height, a quarter of the relative error."""
    curves = field_curves(conventional, middle_focus(conventional), rows=5)
    assert curves.distortion[4] / curves.distortion[2] == pytest.approx(4, rel=0.02)
    assert curves.distortion[0] == 0 and curves.relative_illumination[0] == 1
    assert np.all(np.diff(curves.relative_illumination) < 0)
