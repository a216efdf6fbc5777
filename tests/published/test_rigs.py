"""Claim: every rig of the library has what its source states of it.

The numbers are those of the calibrations in comsee-research/compote and blade (intrinsics.js) and of the simulation
input in comsee-research/prism (camera.js). In-focus distances are thin-lens values, 1/a = 1/f - 1/B behind the array.
"""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from laws import rigs
from tolerances import (
    CALIBRATED_FOCUS_MM,
    FOCUS_PAIR_MM,
    GRID_PX,
    GRID_RMS_PX,
    NODE_MM,
    PRINTED_2_MM,
    PRINTED_3_MM,
    PRINTED_4_MM,
    PRINTED_6_RATIO,
)

from pipeline.camera.figures.first_order_figures import report
from pipeline.camera.focusing.depth_of_field import middle_focus
from pipeline.camera.micro_images.centres import micro_images
from pipeline.camera.parts.lattice import lattice
from pipeline.camera.tracer import Tracer
from pipeline.optics.first_order import first_order
from pipeline.scene.load import load

RIGS = Path(__file__).resolve().parents[2] / "stages/rigs"
R12 = {
    "plenoptic_r12_a": {
        "focal_mm": (0.5826696686550624, 0.5240249316658897, 0.5605736155334103),
        "distance_mm": 0.337126,
        "in_focus_mm": (369.968, 364.099, 368.095),
        "virtual_depth": (2.3730, 2.8038, 2.5087),
        "scale": 1.005929,
        "principal_point_px": (2078.3473, 1591.0025),
        "grid_px": ((-13.288367249582958, 4.84564257269724), (23.31265239636227, 23.314579536228166)),
    },
    "plenoptic_r12_b": {
        "focal_mm": (0.5663889909505797, 0.5070873361097464, 0.5424685020176635),
        "distance_mm": 0.326717,
        "in_focus_mm": (912.074, 870.656, 897.648),
        "virtual_depth": (2.3632, 2.8114, 2.5143),
        "scale": 1.006266,
        "principal_point_px": (1855.7852, 1926.1983),
        "grid_px": ((-14.300210014235569, 3.947051843828546), (23.32412319595749, 23.32610559401216)),
    },
}


def camera_of(name: str):
    (entry,) = load(RIGS / f"{name}.usda").cameras
    return entry.camera


def upright_at_the_first_node(name: str):
    """The camera as the derived figures have it: all of the array as far from the sensor as libpleno's first node.

    libpleno's D and d are those of the node (0, 0), which is our lens at the largest x and y.
    """
    camera = camera_of(name)
    array, vertices = camera.microlenses, lattice(camera.microlenses)
    first = np.lexsort((vertices.x_mm, vertices.l))[-2]  # the last one stands at the other end of its row
    distance_mm = array.distance_mm + vertices.z_mm[first]
    assert distance_mm == pytest.approx(R12[name]["distance_mm"], rel=0, abs=NODE_MM)
    upright = replace(array, distance_mm=R12[name]["distance_mm"], tilt_x_deg=0.0, tilt_y_deg=0.0)
    return replace(camera, microlenses=upright)


@pytest.mark.parametrize("name", R12)
def test_each_type_is_in_focus_where_the_calibration_has_it(name):
    stated, figures = R12[name], report(upright_at_the_first_node(name))
    types = {kind["focal_length_mm"]: kind for kind in figures["mla"]["types"]}
    for focal, distance, depth in zip(stated["focal_mm"], stated["in_focus_mm"], stated["virtual_depth"], strict=True):
        assert types[focal]["focus_distance_mm"] == pytest.approx(distance, rel=0, abs=CALIBRATED_FOCUS_MM)
        assert types[focal]["virtual_depth"] == pytest.approx(depth, rel=0, abs=0.5001e-4)


@pytest.mark.parametrize("name", R12)
def test_scale_of_micro_images_and_principal_point(name):
    stated, camera = R12[name], upright_at_the_first_node(name)
    figures = report(camera)
    scale = figures["mla"]["micro_image_pitch_px"] * camera.sensor.pitch_mm / camera.microlenses.pitch_mm
    assert scale == pytest.approx(stated["scale"], rel=0, abs=PRINTED_6_RATIO)
    assert figures["optical_axis_px"] == pytest.approx(stated["principal_point_px"], rel=0, abs=1e-6)
    assert figures["lens"]["f_number"] == pytest.approx(4.0, rel=1e-12)


@pytest.mark.parametrize("name", R12)
def test_micro_images_lie_on_the_measured_grid_and_have_the_types_of_the_calibration(name):
    """Its grid of micro-image centres was fitted to white images, apart from the model of the array.

    Hexagonal rows, even ones half a pitch to the right; the type of a micro-image is ((l mod 2) + k) mod 3.
    """
    stated, camera = R12[name], camera_of(name)
    (origin_x, origin_y), (pitch_x, pitch_y) = stated["grid_px"]
    array, sensor, vertices = camera.microlenses, camera.sensor, lattice(camera.microlenses)
    # Straight lines from the centre of the thin lens, through vertices at their own depths.
    scale = camera.sensor_distance_mm / (camera.sensor_distance_mm - array.distance_mm - vertices.z_mm)
    x_mm = (vertices.x_mm - sensor.offset_x_mm) * scale + sensor.offset_x_mm
    y_mm = (vertices.y_mm - sensor.offset_y_mm) * scale + sensor.offset_y_mm
    x_px = x_mm / sensor.pitch_mm + (sensor.width_px - 1) / 2
    y_px = y_mm / sensor.pitch_mm + (sensor.height_px - 1) / 2
    row = (y_px - origin_y) / (pitch_y * np.sin(np.pi / 3))
    line = np.round(row)
    column = (x_px - origin_x) / pitch_x - 0.5 * (line % 2 == 0)
    off = np.hypot((column - np.round(column)) * pitch_x, (row - line) * pitch_y * np.sin(np.pi / 3))
    assert off.max() < GRID_PX
    assert np.sqrt((off**2).mean()) < GRID_RMS_PX
    assert len(line) == 176 * 152
    focal = np.array(array.focal_lengths_mm)[vertices.type]
    expected = np.array(stated["focal_mm"])[((line % 2 + np.round(column)) % 3).astype(int)]
    assert np.array_equal(focal, expected)


def test_the_unfocused_rig_has_the_pitch_of_its_simulation():
    camera = camera_of("plenoptic_upc_s")
    figures = report(camera)
    assert figures["mla"]["micro_image_pitch_px"] == pytest.approx(14.343866357, rel=0, abs=1e-8)
    assert figures["lens"]["efl_mm"] == pytest.approx(9.98445, rel=1e-12)
    assert figures["lens"]["f_number"] == pytest.approx(2.0, rel=1e-12)
    assert camera.microlenses.focal_lengths_mm == (camera.microlenses.distance_mm,)
    assert np.count_nonzero(lattice(camera.microlenses).y_mm == 0) == 541
    assert len(lattice(camera.microlenses).k) == 541 * 434


def test_the_microscopy_rig_has_the_focus_pair_of_its_file():
    """EFL.csv pairs an object 188.76 mm before the stop with a sensor 203.3 mm behind it, by the lens alone."""
    camera = camera_of("plenoptic_lipilian")
    array, sensor = camera.microlenses, camera.sensor
    lens_alone = middle_focus(replace(camera, microlenses=None))
    assert lens_alone == pytest.approx(188.76, rel=0, abs=FOCUS_PAIR_MM)
    assert (array.layout, array.pitch_mm, array.focal_lengths_mm) == ("square", 0.125, (array.distance_mm,))
    assert (sensor.width_px * sensor.pitch_mm, sensor.height_px * sensor.pitch_mm) == pytest.approx((25.6, 16.0))
    assert (camera.prescription.stop.semi_diameter_mm, camera.prescription.stop.blades) == (1.75, 12)


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
    grid = lattice(rigs.michels_array())
    rows, lenses = np.unique(grid.l, return_counts=True)
    assert len(rows) == 115
    assert set(lenses) == {100}
    assert len(grid.k) == 11_500


def test_half_illumination_at_a_stop_of_10_mm_is_2053_wide() -> None:
    """The contour of a micro-image measures 0.2053 mm, 93 per cent of the pitch of the micro-images."""
    assert 2 * micro_images(Tracer(rigs.plenoptic())).radius_mm == pytest.approx(0.2053, rel=0, abs=PRINTED_4_MM)
