"""Claim: the plenoptic rig of Michels, Petersen and Koch (3DV 2019) has its known first-order figures.

Published there: microlenses of 1.9, 2.1 and 2.3 mm in about 100 x 115 places, 1.7 mm before the sensor and 123.3 mm
behind the main lens, a 100 mm double Gauss. The figures below belong to the Tronnier prescription with its listed n_d
and were computed independently of this code from the same published numbers, distances counted from the stop.
"""

import numpy as np
import pytest
from laws import rigs
from tolerances import PRINTED_2_MM, PRINTED_3_MM, PRINTED_4_MM

from pipeline.camera.figures.first_order_figures import report
from pipeline.camera.micro_images.centres import micro_images
from pipeline.camera.parts.lattice import lattice
from pipeline.camera.tracer import Tracer
from pipeline.optics.first_order import first_order


def test_the_lens_has_its_known_focal_lengths_and_pupils() -> None:
    """EFL 100.7163, back focus 72.2118, pupils at vision z -6.123 and 5.2327 mm, magnified 1.4506 and 1.5520."""
    found = first_order(rigs.tronnier())
    assert found.efl_mm == pytest.approx(100.7163, rel=0, abs=PRINTED_4_MM)
    assert found.bfd_mm == pytest.approx(72.2118, rel=0, abs=PRINTED_4_MM)
    assert found.rear_focus_mm == pytest.approx(-102.5218, rel=0, abs=PRINTED_4_MM)
    assert found.front_focus_mm == pytest.approx(88.0149, rel=0, abs=PRINTED_4_MM)
    assert found.entrance_pupil.z_mm == pytest.approx(-6.123, rel=0, abs=PRINTED_3_MM)
    assert found.exit_pupil.z_mm == pytest.approx(5.2327, rel=0, abs=PRINTED_4_MM)
    assert found.entrance_pupil.diameter_mm / 34.2 == pytest.approx(1.45059, rel=0, abs=0.5001e-5)
    assert found.exit_pupil.diameter_mm / 34.2 == pytest.approx(1.55196, rel=0, abs=0.5001e-5)
    assert found.f_number == pytest.approx(2.0302, rel=0, abs=PRINTED_4_MM)


def test_each_microlens_type_focuses_where_it_is_known_to() -> None:
    """Objects 362.70, 429.52 and 459.65 mm before the stop, virtual depths 9.5, 5.25 and 3.83."""
    types = report(rigs.plenoptic())["mla"]["types"]
    distances, depths = ([entry[name] for entry in types] for name in ("focus_distance_mm", "virtual_depth"))
    np.testing.assert_allclose(distances, [362.704, 429.520, 459.652], rtol=0, atol=PRINTED_3_MM)
    np.testing.assert_allclose(depths, [9.5, 5.25, 3.8333], rtol=0, atol=PRINTED_4_MM)


def test_matched_stop_principal_distance_and_micro_images_are_the_known_ones() -> None:
    """Stop 10.586 mm; exit pupil 128.5327 mm before the array; micro-images 1.013226 times the pitch of the lenses."""
    camera = rigs.plenoptic()
    figures = report(camera)
    assert figures["lens"]["matched_stop_diameter_mm"] == pytest.approx(10.586, rel=0, abs=PRINTED_3_MM)
    assert figures["principal_distance_mm"] == pytest.approx(121.7, rel=0, abs=0.05)
    to_array = figures["lens"]["exit_pupil"]["z_mm"] + 123.3
    assert to_array == pytest.approx(128.5327, rel=0, abs=PRINTED_4_MM)
    scale = figures["mla"]["micro_image_pitch_px"] * 0.01 / 0.2173
    assert scale == pytest.approx(1.013226, rel=0, abs=0.5001e-6)


def test_without_microlenses_the_sensor_sees_539_29_mm() -> None:
    """The image of the main lens alone at the sensor, 125.0 mm behind the stop; magnification -0.223183."""
    lens = report(rigs.plenoptic())["lens"]
    assert lens["focus_distance_mm"] == pytest.approx(539.287, rel=0, abs=PRINTED_3_MM)
    assert lens["magnification"] == pytest.approx(-0.223183, rel=0, abs=0.5001e-6)
    assert lens["focus_distance_mm"] == pytest.approx(539.29, rel=0, abs=PRINTED_2_MM)


def test_the_array_has_100_by_115_microlenses() -> None:
    """100 in every row, 115 rows, 11,500 in all."""
    grid = lattice(rigs.michels_array())
    rows, lenses = np.unique(grid.l, return_counts=True)
    assert len(rows) == 115
    assert set(lenses) == {100}
    assert len(grid.k) == 11_500


def test_half_illumination_at_a_stop_of_10_mm_is_2053_wide() -> None:
    """The contour of a micro-image measures 0.2053 mm, 93 per cent of the pitch of the micro-images."""
    assert 2 * micro_images(Tracer(rigs.plenoptic())).radius_mm == pytest.approx(0.2053, rel=0, abs=PRINTED_4_MM)
