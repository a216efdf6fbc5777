"""A sensor that is shifted carries its microlens array along, and the optical axis moves across both."""

import dataclasses
import math

import numpy as np
import pytest
from laws import rigs

from pipeline.camera.figures.first_order_figures import report
from pipeline.camera.micro_images.centres import micro_images
from pipeline.camera.parts.camera import Camera
from pipeline.camera.tracer import Tracer
from pipeline.optics.kernels import trace_rays
from pipeline.optics.table import VERTEX, towards_scene, towards_sensor


def shifted(camera: Camera, x_mm: float, y_mm: float) -> Camera:
    """With its sensor, and its array, moved across the axis."""
    return dataclasses.replace(camera, sensor=dataclasses.replace(camera.sensor, offset_x_mm=x_mm, offset_y_mm=y_mm))


@pytest.mark.parametrize("k, l", [(1, 0), (0, 1), (-2, 1)])
def test_the_microlens_on_the_axis_has_its_micro_image_on_the_axis(k: int, l: int) -> None:
    """Chosen so that the axis meets the vertex of lens (k, l): by symmetry its centre lies exactly there."""
    camera = rigs.plenoptic(extent_mm=3.0)
    pitch, pixel = camera.microlenses.pitch_mm, camera.sensor.pitch_mm
    x_mm, y_mm = pitch * (k + l / 2), pitch * l * math.sqrt(3) / 2
    moved = shifted(camera, x_mm, y_mm)
    tracer = Tracer(moved)
    row = int(np.flatnonzero((tracer.lattice.k == k) & (tracer.lattice.l == l))[0])
    centre = tracer.pixels_at(micro_images(tracer).centre_mm)[row]
    assert centre == pytest.approx(report(moved)["optical_axis_px"], abs=1e-9)
    middle = (camera.sensor.width_px - 1) / 2, (camera.sensor.height_px - 1) / 2
    assert centre == pytest.approx([middle[0] + x_mm / pixel, middle[1] + y_mm / pixel], abs=1e-9)


@pytest.mark.parametrize("steps", [(3, 0), (0, 3), (2, -5)])
def test_a_shift_moves_what_a_pixel_sees_by_the_shifted_field(steps: tuple[int, int]) -> None:
    """A pixel of a conventional camera sees what the pixel at the same place across the axis saw before the shift."""
    camera = rigs.conventional()
    pitch = camera.sensor.pitch_mm
    moved = shifted(camera, steps[0] * pitch, steps[1] * pitch)
    here, before = np.array([13.0, 17.0]), np.array([13.0 - steps[0], 17.0 - steps[1]])
    np.testing.assert_allclose(
        Tracer(moved).positions_mm(*here[:, None]), Tracer(camera).positions_mm(*before[:, None]), rtol=0, atol=1e-12
    )


def test_the_principal_distance_scales_an_image_that_is_far_away() -> None:
    """The chief ray of a point at the height x on the sensor leaves the lens under x / c: real rays from the centre of
    the stop, close to the axis, both ways."""
    camera = rigs.conventional(1.0)
    lens, start = camera.prescription, np.zeros((1, 3))
    slope = 1e-4
    rays = []
    for table in (towards_sensor(lens), towards_scene(lens)):
        stop = next(i for i, row in enumerate(table) if row[VERTEX] == 0.0)
        way = np.array([[slope, 0.0, 1.0 if table[-1, VERTEX] > 0 else -1.0]])
        way /= np.linalg.norm(way)
        place = start.copy()
        trace_rays(table[stop + 1 :], place, way, np.ones(1))
        rays.append((place[0], way[0]))
    (at_rear, to_sensor), (_, to_scene) = rays
    image = at_rear[0] + to_sensor[0] / to_sensor[2] * (camera.sensor_distance_mm - at_rear[2])
    angle = to_scene[0] / to_scene[2]
    assert abs(image / angle) == pytest.approx(report(camera)["principal_distance_mm"], rel=1e-6)
