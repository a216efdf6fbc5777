"""Claim: a lens may have a pupil at infinity: what is parallel there keeps its size, and figures stay numbers.

Two ideal thin lenses and a stop between them, by the closed forms of its chief rays.
"""

import dataclasses
import math

import numpy as np
import pytest
from laws import rigs
from laws.solving import rig_of, solved

import pipeline
from pipeline.camera.figures.equivalent_pinhole import pinhole
from pipeline.camera.figures.field_curves import field_curves
from pipeline.camera.figures.first_order_figures import report, viewfinder
from pipeline.camera.figures.outlook import Fate, covered_mm, outlook
from pipeline.camera.focusing.depth_of_field import focused
from pipeline.camera.focusing.focus_request import stopped_down
from pipeline.camera.focusing.ideal_lens import with_ideal_lens
from pipeline.camera.parts.camera import Camera, Sensor
from pipeline.camera.parts.errors import CameraError
from pipeline.frames import apply
from pipeline.optics.first_order import first_order
from pipeline.optics.prescription import Prescription, Surface
from pipeline.targets.patterns.checkerboard import Checkerboard

FRONT_MM, REAR_MM, OBJECT_MM, SEMI_MM = 100.0, 60.0, 250.0, 0.001
BOARD = Checkerboard(columns=4, rows=3, square_mm=4.0)


def between(ahead_mm: float, behind_mm: float, semi_mm: float = SEMI_MM) -> Camera:
    """A stop between ideal lenses of 100 and 60 mm, in focus at 250 mm."""
    lens = Prescription(
        surfaces=(
            Surface(focal_length_mm=FRONT_MM, semi_diameter_mm=30.0, thickness_mm=ahead_mm),
            Surface(semi_diameter_mm=semi_mm, is_stop=True, thickness_mm=behind_mm),
            Surface(focal_length_mm=REAR_MM, semi_diameter_mm=20.0),
        )
    )
    sensor = Sensor(width_px=200, height_px=150, pitch_mm=0.1)
    return focused(Camera(prescription=lens, sensor=sensor, sensor_distance_mm=-first_order(lens).image_mm(OBJECT_MM)))


def test_an_object_keeps_its_size_before_a_lens_that_is_telecentric_there() -> None:
    """The chief ray of the height y crosses the stop, in the focus of the front lens, at the slope -y / f: its image is
    as high at any distance, out of focus, too."""
    camera = between(FRONT_MM, 30.0)
    to_film_mm = 30.0 + (1 - 30.0 / REAR_MM) * (camera.sensor_distance_mm - 30.0)
    for distance_mm in (150.0, OBJECT_MM, 400.0):
        pose = rigs.facing(distance_mm, 15.0)
        rows = solved(rig_of(camera), BOARD, pose, 1e-6).solutions
        points = apply(pose, BOARD.points_mm())[rows.point]
        assert len(points) == len(BOARD.points_mm())
        expected = points[:, :2] * (to_film_mm / FRONT_MM / camera.sensor.pitch_mm) + [99.5, 74.5]
        np.testing.assert_allclose(rows.xy_px, expected, rtol=0, atol=1e-6)
    assert (
        np.abs(pipeline.ready(camera).rays(np.array([0.0, 150.0]), np.array([0.0, 30.0])).direction[:, :2]).max() < 1e-9
    )


def test_figures_of_a_pupil_at_infinity_are_infinite_or_numbers() -> None:
    camera = between(FRONT_MM, 30.0, 3.0)
    figures = report(camera)
    lens, to_film_mm = figures["lens"], camera.sensor_distance_mm - 30.0
    assert lens["entrance_pupil"] == {"z_mm": -math.inf, "diameter_mm": math.inf}
    assert figures["principal_distance_mm"] == math.inf and lens["f_number"] == 0
    # The stop is 30 mm before the rear lens: half a focal length, so its image is as far before it, and twice as wide.
    assert lens["working_f_number"] == pytest.approx((to_film_mm + 60.0) / 12.0)
    near, far = figures["depth_of_field_mm"]
    assert OBJECT_MM - near == pytest.approx(far - OBJECT_MM), "the blur grows alike on both sides"
    size_mm = 20.0 / abs(lens["magnification"]), 15.0 / abs(lens["magnification"])
    assert covered_mm(camera, 300.0) == pytest.approx(size_mm)
    curves = field_curves(camera, OBJECT_MM)
    assert np.abs(curves.distortion).max() < 1e-8 and np.abs(curves.angle_deg).max() < 1e-9
    points = apply(rigs.facing(OBJECT_MM), BOARD.points_mm())[None]
    seen = outlook(camera, points, np.broadcast_to([0.0, 0.0, -1.0], points.shape))
    assert (seen.fate == Fate.SEEN).all() and seen.blur_px.max() < 1e-3


def test_no_pinhole_and_no_f_number_is_made_up_for_it() -> None:
    camera = between(FRONT_MM, 30.0, 3.0)
    assert pinhole(camera) is None
    for ask in (viewfinder, lambda of: stopped_down(of, 8.0), lambda of: with_ideal_lens(of, "thinLens")):
        with pytest.raises(CameraError, match="telecentric lens has"):
            ask(camera)


def test_an_image_keeps_its_size_behind_a_lens_that_is_telecentric_there() -> None:
    """The stop lies in the front focus of the rear lens: moving the sensor changes focus, and no position."""
    camera = between(80.0, REAR_MM)
    lens = first_order(camera.prescription)
    moved = dataclasses.replace(camera, sensor_distance_mm=camera.sensor_distance_mm + 3.0)
    one, other = (solved(rig_of(of), BOARD, rigs.facing(OBJECT_MM, 10.0), 1e-6).solutions for of in (camera, moved))
    np.testing.assert_allclose(one.xy_px, other.xy_px, rtol=0, atol=1e-6)
    wide = report(between(80.0, REAR_MM, 3.0))
    assert wide["lens"]["exit_pupil"] == {"z_mm": math.inf, "diameter_mm": math.inf}
    assert wide["lens"]["working_f_number"] == pytest.approx(lens.efl_mm / 30.0, rel=1e-8)
    assert wide["principal_distance_mm"] == pytest.approx(lens.efl_mm, rel=1e-8)
    found = pinhole(camera)
    assert found is not None and found.distorted.max_px < 1e-6
    assert found.plain.principal_distance_px == pytest.approx(lens.efl_mm / camera.sensor.pitch_mm, rel=1e-6)
