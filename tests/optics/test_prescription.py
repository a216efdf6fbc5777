"""What a prescription says about itself in words."""

import pytest

from pipeline.optics.prescription import Surface


@pytest.mark.parametrize(
    ("shape", "words"),
    [
        ({}, "circular, diameter 10.0 mm"),
        ({"inner_semi_diameter_mm": 2.0}, "annular, diameter 10.0 mm, obstruction 4.0 mm"),
        ({"half_widths_mm": (3.0, 2.0)}, "rectangular, 6.0 x 4.0 mm"),
        ({"blades": 6}, "polygonal, 6 blades, diameter 10.0 mm from corner to corner of its circle"),
    ],
    ids=["circle", "ring", "rectangle", "polygon"],
)
def test_the_aperture_is_named_by_its_shape(shape: dict, words: str) -> None:
    assert Surface(semi_diameter_mm=5.0, **shape).aperture == words
