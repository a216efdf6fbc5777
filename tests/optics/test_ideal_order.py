"""Claim: an ideal thin lens may stand anywhere in air, and nowhere else."""

import pytest

from pipeline.optics.prescription import Prescription, PrescriptionError, Surface


@pytest.mark.parametrize(("index", "is_right"), [(1.0, True), (1.5, False)])
def test_an_ideal_lens_stands_behind_a_surface_in_air_alone(index: float, is_right: bool) -> None:
    before = Surface(semi_diameter_mm=5.0, thickness_mm=2.0, index=index, is_stop=True)
    surfaces = before, Surface(semi_diameter_mm=5.0, focal_length_mm=50.0)
    if is_right:
        assert Prescription(surfaces=surfaces).vertices_mm == (0.0, 2.0)
        return
    with pytest.raises(PrescriptionError, match=r"medium of index 1\.5"):
        Prescription(surfaces=surfaces)
