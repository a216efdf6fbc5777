"""Claim: microlenses stand on the lattice that CONVENTIONS.md describes, image like ideal thin lenses, and their
micro-images lie where the exit pupil puts them.
"""

import dataclasses
import math

import numpy as np
import pytest
from laws import rigs
from laws.rigs import behind_a_hole
from tolerances import ORDER, ROUNDING_MM

from pipeline.camera.bundle import bundle
from pipeline.camera.figures.first_order_figures import report
from pipeline.camera.micro_images.centres import micro_images
from pipeline.camera.parts.camera import Camera, Sensor
from pipeline.camera.parts.lattice import lattice
from pipeline.camera.parts.microlens_array import MicrolensArray
from pipeline.camera.tracer import Tracer
from pipeline.optics.first_order import first_order
from pipeline.optics.kernels import trace_rays
from pipeline.optics.table import VERTEX, towards_scene, towards_sensor

pytestmark = pytest.mark.filterwarnings("ignore:divide by zero:RuntimeWarning")
"""A stop alone has no focal length."""


def microlenses(focal_mm: float, rotation_deg: float = 0.0) -> Tracer:
    """Of one focal length 1.7 mm before the sensor, and no main lens."""
    array = MicrolensArray(
        pitch_mm=0.5,
        focal_lengths_mm=(focal_mm,),
        width_mm=3.0,
        height_mm=3.0,
        distance_mm=1.7,
        rotation_deg=rotation_deg,
    )
    return behind_a_hole(array, 100, 0.03)


@pytest.mark.parametrize("focal_mm", [1.9, 1.2])
@pytest.mark.parametrize("x_px", [49.5, 52.2, 71.0])
def test_rays_from_a_sensor_point_meet_in_its_conjugate_point(focal_mm: float, x_px: float) -> None:
    """1/b = 1/f - 1/B: behind the array for f > B (a virtual object), before it for f < B; sharp without exception."""
    tracer = microlenses(focal_mm)
    distance_mm = 1 / (1 / focal_mm - 1 / 1.7)
    rays = bundle(tracer.camera, x_px, 40.0, samples=256)
    points = rays.at_distance(-18.3 + distance_mm)
    assert np.ptp(rays.at_distance(-18.3), axis=0).min() > 0.3
    np.testing.assert_allclose(points, np.tile(points[0], (256, 1)), rtol=0, atol=ROUNDING_MM)
    position = tracer.positions_mm(np.array([x_px]), np.array([40.0]))
    images = micro_images(tracer)
    vertex = -np.array([tracer.lattice.x_mm, tracer.lattice.y_mm]).T[images.owner(position)[0]]
    expected = vertex + (vertex - position[0]) * distance_mm / 1.7
    np.testing.assert_allclose(points[0], expected, rtol=0, atol=ROUNDING_MM)


@pytest.mark.parametrize("rotation_deg", [0.0, 13.0])
def test_a_microlens_aperture_is_its_hexagonal_cell(rotation_deg: float) -> None:
    """No point of a bundle in the array's plane is nearer to another vertex, and corners are filled."""
    tracer = microlenses(1.9, rotation_deg)
    vertices = -np.stack([tracer.lattice.x_mm, tracer.lattice.y_mm], axis=1)
    points = bundle(tracer.camera, 49.5, 49.5, samples=4096).at_distance(-18.3)
    distance = np.linalg.norm(points[:, None] - vertices, axis=2)
    assert np.all(distance.min(axis=1) >= np.linalg.norm(points, axis=1) - 1e-9)
    assert np.linalg.norm(points, axis=1).max() > 0.98 * 0.5 / math.sqrt(3)


def test_micro_image_centres_are_vertices_scaled_by_the_exit_pupil() -> None:
    """(P + B) / P on the axis: halve the height of the vertex, and the difference falls fourfold."""
    lens = rigs.tronnier(5.0)
    to_array = first_order(lens).exit_pupil.z_mm + 123.3
    errors = []
    for pitch in (3.2, 1.6, 0.8, 0.4):
        array = MicrolensArray(
            pitch_mm=pitch, focal_lengths_mm=(2.1,), width_mm=2.1 * pitch, height_mm=pitch, distance_mm=1.7
        )
        tracer = Tracer(
            Camera(
                prescription=lens,
                sensor=Sensor(width_px=2, height_px=2, pitch_mm=1.0),
                sensor_distance_mm=125.0,
                microlenses=array,
            )
        )
        row = int(np.flatnonzero((tracer.lattice.k == 1) & (tracer.lattice.l == 0))[0])
        errors.append(-micro_images(tracer).centre_mm[row, 0] / pitch - (to_array + 1.7) / to_array)
    assert np.all(np.abs(np.log2(np.array(errors[:-1]) / errors[1:]) - 2) < ORDER)


def test_no_two_neighbours_are_of_one_type() -> None:
    """Six neighbours each, three of either other type, over all 11,500 lenses; every third lens has each type."""
    grid = lattice(rigs.michels_array())
    kinds = dict(zip(zip(grid.k.tolist(), grid.l.tolist(), strict=True), grid.type.tolist(), strict=True))
    positions = dict(zip(kinds, zip(grid.x_mm, grid.y_mm, strict=True), strict=True))
    inner = 0
    for (k, l), kind in kinds.items():
        steps = [(1, 0), (-1, 0), (0, 1), (0, -1), (1, -1), (-1, 1)]
        neighbours = [(k + i, l + j) for i, j in steps if (k + i, l + j) in kinds]
        for neighbour in neighbours:
            assert math.dist(positions[k, l], positions[neighbour]) == pytest.approx(0.2173, rel=1e-9)
        types = sorted((kinds[n] - kind) % 3 for n in neighbours)
        assert 0 not in types
        if len(neighbours) == 6:
            inner += 1
            assert types == [1, 1, 1, 2, 2, 2]
    assert inner > 11_000
    assert np.ptp(np.bincount(grid.type)) < 120
    assert kinds[0, 0] == 0
    assert kinds[1, 0] == 1
    assert kinds[0, 1] == 2


def test_lattice_directions_are_those_of_the_sensor_frame() -> None:
    """k along x, l at 60 degrees towards +y; a rotation turns +x towards +y; the offset moves all of it."""
    turned = MicrolensArray(
        pitch_mm=1.0,
        focal_lengths_mm=(2.0,),
        width_mm=9.0,
        height_mm=9.0,
        distance_mm=1.0,
        rotation_deg=30.0,
        offset_x_mm=0.25,
        offset_y_mm=-0.5,
    )
    grid = lattice(turned)
    for k, l, x, y in ((0, 0, 0.0, 0.0), (1, 0, math.sqrt(3) / 2, 0.5), (0, 1, 0.0, 1.0)):
        row = np.flatnonzero((grid.k == k) & (grid.l == l))[0]
        assert grid.x_mm[row] == pytest.approx(x + 0.25, abs=1e-12)
        assert grid.y_mm[row] == pytest.approx(y - 0.5, abs=1e-12)
    assert np.all((grid.x_mm - 0.25 >= -4.5 - 1e-9) & (grid.x_mm - 0.25 < 4.5))


def test_image_positions_and_sensor_points_are_inverse_and_turned_upright() -> None:
    """Right in the image is left on the sensor as the vision frame has it; the axis may miss the image centre."""
    sensor = Sensor(width_px=10, height_px=6, pitch_mm=0.1, offset_x_mm=0.02, offset_y_mm=-0.03)
    tracer = Tracer(rigs.bare(rigs.hole(1.0), sensor, 50.0, (100.0, 200.0)))
    x, y = np.array([0.0, 4.7, 9.0]), np.array([5.0, 2.2, 0.0])
    points = tracer.positions_mm(x, y)
    np.testing.assert_allclose(points[0], [0.45 + 0.02, -0.25 - 0.03], atol=1e-12)
    np.testing.assert_allclose(tracer.pixels_at(points), np.stack([x, y], axis=1), atol=1e-12)
    np.testing.assert_allclose(tracer.pixels_at(np.zeros((1, 2))), [[4.5 + 0.2, 2.5 - 0.3]], atol=1e-12)


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
