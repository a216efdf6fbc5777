"""First-order figures against closed forms."""

import dataclasses
import math

import numpy as np
import pytest

from pipeline.camera.figures.field_curves import field_curves
from pipeline.camera.figures.first_order_figures import gaps_mm, report
from pipeline.camera.focusing.depth_of_field import foci, middle_focus
from pipeline.camera.parts.camera import Camera
from pipeline.optics.first_order import first_order


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


def test_field_of_view_of_a_centred_sensor_is_that_of_its_pinhole(conventional: Camera):
    figures = report(conventional)
    c = figures["principal_distance_mm"]
    half = [figures["sensor_mm"][0] / 2, figures["sensor_mm"][1] / 2, math.hypot(*figures["sensor_mm"]) / 2]
    np.testing.assert_allclose(figures["field_of_view_deg"], [2 * math.degrees(math.atan(h / c)) for h in half])


def test_distortion_vanishes_as_the_square_of_the_field(conventional: Camera):
    """Third-order distortion: half the height, a quarter of the relative error."""
    curves = field_curves(conventional, middle_focus(conventional), rows=5)
    assert curves.distortion[4] / curves.distortion[2] == pytest.approx(4, rel=0.02)
    assert curves.distortion[0] == 0 and curves.relative_illumination[0] == 1
    assert np.all(np.diff(curves.relative_illumination) < 0)
