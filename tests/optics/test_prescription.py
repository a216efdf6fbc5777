"""What a prescription says about itself in words, and where an ideal thin lens may stand: in air alone."""

import pytest

from pipeline.optics.prescription import Prescription, PrescriptionError, Surface


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


@pytest.mark.parametrize(("index", "is_right"), [(1.0, True), (1.5, False)])
def test_an_ideal_lens_stands_behind_a_surface_in_air_alone(index: float, is_right: bool) -> None:
    before = Surface(semi_diameter_mm=5.0, thickness_mm=2.0, index=index, is_stop=True)
    surfaces = before, Surface(semi_diameter_mm=5.0, focal_length_mm=50.0)
    if is_right:
        assert Prescription(surfaces=surfaces).vertices_mm == (0.0, 2.0)
        return
    with pytest.raises(PrescriptionError, match=r"medium of index 1\.5"):
        Prescription(surfaces=surfaces)
