"""Claim: what physics cannot tell apart, the tracer does not: directions of travel, mirror images, places in the world,
and the bounds within which it happens to sample.
"""

import dataclasses
import math

import numpy as np
import pytest
from laws import rigs
from laws.bounds import (
    assert_bounds_hold,
    assert_bounds_hold_behind_microlenses,
    assert_independent_of_bounds,
    moments,
    plenoptic_positions,
)
from laws.rigs import HEXAGON, inside, thin
from laws.surfaces import BENT, assert_returned, oblique, traced, whole
from laws.test_model_cameras import BROWN, model
from scipy.spatial.transform import Rotation
from shorter import few, few_cases
from tolerances import HONEST, MOVED_MM, REVERSED_MM, ROUNDING_MM, SIGMAS

from pipeline.camera.parts.camera import Camera
from pipeline.camera.rig import Rig
from pipeline.camera.tracer import Tracer, parallel_planes
from pipeline.camera.tracing.moments import VARIANCE
from pipeline.camera.tracing.sampling_bounds import NO_MICROLENS
from pipeline.frames import apply, inverse, rigid
from pipeline.optics.prescription import Prescription, PrescriptionError, Surface
from pipeline.optics.table import towards_scene, towards_sensor
from pipeline.render.imaging import irradiance
from pipeline.scene.dataset import Frame
from pipeline.truth.grid.position_image import on_target

BEHIND, SLOPES = (4000, 9.0, 0.3, -45.0), (4000, 2.4, 0.08, -131.81)
"""Rays from a square behind the lens, and from the sensor."""
DISTORTING = model(rigs.conventional(17.1), "thinLens", BROWN)


@pytest.mark.parametrize(
    ("lens", "rays", "atol"),
    [
        pytest.param(rigs.tronnier(), BEHIND, REVERSED_MM, id="double Gauss"),
        pytest.param(BENT, (3000, 9.0, 0.3, -12.0), REVERSED_MM, id="aspheres"),
        pytest.param(rigs.displaced(rigs.conventional(17.1)).prescription, BEHIND, MOVED_MM, id="displaced"),
        pytest.param(whole(BENT, tilt_deg=(3.0, 2.0), decentre_mm=(0.2, 0.4)), BEHIND, MOVED_MM, id="turned aspheres"),
        pytest.param(thin(), (4000, 4.0, 0.1, -90.0), 100 * REVERSED_MM, id="ideal"),
        pytest.param(DISTORTING.prescription, SLOPES, 100 * REVERSED_MM, id="ideal that distorts"),
    ],
)
def test_a_ray_sent_back_returns_to_its_start(lens: Prescription, rays: tuple[float, ...], atol: float) -> None:
    """A lens that distorts does so towards the sensor, and undoes it towards the scene."""
    assert assert_returned(lens, *oblique(*rays), atol) > 300


@pytest.mark.parametrize("mirror", [(-1, 1, 1), (1, -1, 1), (-1, -1, 1)])
def test_mirrored_rays_stay_mirrored_to_the_last_bit(mirror: tuple[int, int, int]) -> None:
    """A centred lens cannot tell left from right; changing signs rounds nothing."""
    start, way = oblique(*BEHIND)
    table = towards_scene(rigs.tronnier())
    one, other = traced(table, start, way), traced(table, start * mirror, way * mirror)
    np.testing.assert_array_equal(one[0] * mirror, other[0])
    np.testing.assert_array_equal(one[1] * mirror, other[1])
    np.testing.assert_array_equal(one[2], other[2])


def test_the_position_image_of_a_centred_rig_is_odd() -> None:
    """J(-x) = -J(x) within the stated errors of both, at f/2; random numbers differ."""
    tracer, rng = Tracer(rigs.conventional(17.1, 640, 480)), np.random.default_rng(4)
    positions = rng.uniform(-12, 12, (200, 2))
    lens = np.full(200, NO_MICROLENS)
    one, other = moments(tracer, positions, lens, 1024), moments(tracer, -positions, lens, 1024, 5000)
    difference = one[:, :4] + other[:, :4]
    variance = one[:, VARIANCE:] + other[:, VARIANCE:]
    assert np.sqrt(np.mean(difference**2) / np.mean(variance)) < HONEST[1]


def test_moving_rig_and_board_together_changes_no_position_image() -> None:
    """Any rigid motion of the world cancels in vision_from_target."""
    rng, tracer = np.random.default_rng(5), Tracer(rigs.conventional())
    world_from_camera = rigid(Rotation.from_rotvec([0.2, -0.1, 0.4]).as_matrix(), np.array([30.0, 8.0, -120.0]))
    camera_from_world = inverse(world_from_camera)
    world_from_board = world_from_camera @ rigs.facing(430.0, 25.0, 4.0, 2.0)
    positions = tracer.positions_mm(np.array([10.0, 50.0, 90.0]), np.array([5.0, 30.0, 70.0]))
    values = moments(tracer, positions, np.full(3, NO_MICROLENS), 256)
    images = []
    for _ in range(5):
        moved_from_world = rigid(Rotation.random(random_state=rng).as_matrix(), rng.uniform(-500, 500, 3))
        frame = Frame(
            number=1,
            camera_from_world={"rig": camera_from_world @ inverse(moved_from_world)},
            world_from_target={"board": moved_from_world @ world_from_board},
        )
        pose = frame.vision_from_target("rig", "board")
        images.append(on_target(values[:, :2], values[:, 2:4], 374.0, 494.0, pose))
    still = on_target(values[:, :2], values[:, 2:4], 374.0, 494.0, rigs.facing(430.0, 25.0, 4.0, 2.0))
    for image in images:
        np.testing.assert_allclose(image, still, rtol=0, atol=ROUNDING_MM)


def test_near_and_far_planes_are_a_matter_of_conditioning_only() -> None:
    """Two planes elsewhere give the same J, because crossings with them are linear in one another."""
    tracer, pose = Tracer(rigs.conventional(17.1)), rigs.facing(440.0, 40.0, 4.0, 2.0)
    positions, lens = tracer.positions_mm(np.array([10.0, 90.0]), np.array([5.0, 70.0])), np.full(2, -1)
    found = []
    for near, far in ((374.0, 494.0), (100.0, 1000.0), (434.0, 435.0)):
        row = tracer.moments(positions, lens, parallel_planes(near, far), 256, np.zeros((2, 2)))
        found.append(on_target(row[:, :2], row[:, 2:4], near, far, pose))
    np.testing.assert_allclose(found[1], found[0], rtol=0, atol=ROUNDING_MM)
    np.testing.assert_allclose(found[2], found[0], rtol=0, atol=ROUNDING_MM)


@pytest.mark.parametrize("kind", ["conventional", "plenoptic"])
def test_results_do_not_depend_on_the_sampling_bounds(kind: str) -> None:
    """Bounds inflated by 30 instead of 2 per cent: same hit fraction, J and second moments within their errors.

    Each value is the mean over 16 seeds, which also give its standard error.
    """
    if kind == "conventional":
        camera = rigs.conventional(17.1, 800, 600)
        heights = np.array([0.0, 5.0, 12.0, 18.0, 21.0, 24.0])
        azimuth = np.array([0.0, 0.3, 1.2, 2.5, 4.0, 5.5])
        positions = heights[:, None] * np.stack([np.cos(azimuth), np.sin(azimuth)], axis=1)
        lens = np.full(6, NO_MICROLENS)
    else:
        camera = rigs.plenoptic()
        positions, lens = plenoptic_positions(Tracer(camera), 40)
    assert_independent_of_bounds(camera, positions, lens, least_lit=6)


@pytest.mark.parametrize("stop_semi_mm", few([8.0], 2.0, 17.1))
def test_no_ray_outside_the_bounds_passes_a_conventional_camera(stop_semi_mm: float) -> None:
    """Trial rays all over the rear surface, from the axis to the corner, where the pupil is a pointed sliver."""
    tracer, rng = Tracer(rigs.conventional(stop_semi_mm, 1200, 900)), np.random.default_rng(6)
    heights = np.array([0.0, 0.317, 4.0, 9.5, 15.3, 20.0, 22.7, 24.2, 26.9, 28.4, 31.4, 34.5, 36.5, 37.4])
    azimuth = rng.uniform(0, 2 * np.pi, len(heights))
    positions = heights[:, None] * np.stack([np.cos(azimuth), np.sin(azimuth)], axis=1)
    assert assert_bounds_hold(tracer, positions, rng, 20.0, 100_000).sum() > 1000


def test_no_ray_outside_the_bounds_passes_a_plenoptic_camera() -> None:
    assert_bounds_hold_behind_microlenses(Tracer(rigs.plenoptic()))


def test_apply_and_inverse_agree_with_the_textbook() -> None:
    quarter = rigid(Rotation.from_rotvec([0.0, 0.0, np.pi / 2]).as_matrix(), np.array([10.0, 0.0, 0.0]))
    points = np.array([[1.0, 0.0, 0.0], [0.0, 2.0, 3.0]])
    np.testing.assert_allclose(apply(quarter, points), [[10.0, 1.0, 0.0], [8.0, 0.0, 3.0]], atol=1e-14)
    np.testing.assert_allclose(apply(inverse(quarter), apply(quarter, points)), points, atol=1e-14)


@pytest.mark.parametrize(("stop_semi_mm", "pitch_mm"), few_cases([(0.2, 0.2)], (0.1, 0.05), (0.5, 0.2)))
def test_a_tiny_stop_before_coarse_pixels_loses_no_light(stop_semi_mm: float, pitch_mm: float) -> None:
    """Rays start all over a pixel, and what passes moves along: a bound for the centre alone loses several per cent."""
    camera = rigs.conventional(stop_semi_mm, 16, 12, pitch_mm)
    tight, wide = (
        np.array([irradiance(Rig.of(Tracer(camera, seed, margin)), 256, None).mean() for seed in range(8)])
        for margin in (0.02, 0.5)
    )
    error = np.hypot(tight.std(ddof=1), wide.std(ddof=1)) / np.sqrt(8)
    assert abs(tight.mean() - wide.mean()) < SIGMAS * error
    assert error < 1e-3


RECTANGLE = {"half_widths_mm": (4.0, 2.5), "aperture_rotation_deg": 20.0}
RING = {"inner_semi_diameter_mm": 2.0}
SHAPES = {"hexagon": HEXAGON, "rectangle": RECTANGLE, "ring": RING, "triangle": {"blades": 3}}


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("bend", [{}, {"radius_mm": 30.0, "conic": -0.5}], ids=["plane", "conic"])
def test_parallel_rays_pass_where_the_shape_says_so(shape: str, bend: dict[str, float]) -> None:
    """In the lens frame, x right and y up; the vision frame has y down. Every shape lies within its circle."""
    stop = Surface(semi_diameter_mm=5.0, is_stop=True, **SHAPES[shape], **bend)
    points = np.random.default_rng(2).uniform(-6, 6, (20_000, 2))
    for table, y in ((towards_sensor, points[:, 1]), (towards_scene, -points[:, 1])):
        position = np.column_stack([points[:, 0], y, np.full(len(points), -5.0)])
        *_, alive = traced(table(Prescription(surfaces=(stop,))), position, np.tile([0.0, 0.0, 1.0], (len(points), 1)))
        expected = inside(shape, *points.T)
        assert 0.1 < expected.mean() < 0.6
        np.testing.assert_array_equal(alive > 0, expected)
        assert not np.any((alive > 0) & (np.hypot(*points.T) > 5.0))


def with_shapes(camera: Camera, stop: dict[str, object], front: dict[str, object]) -> Camera:
    lens = camera.prescription
    surfaces = [dataclasses.replace(surface, **(stop if surface.is_stop else {})) for surface in lens.surfaces]
    surfaces[0] = dataclasses.replace(surfaces[0], **front)
    return dataclasses.replace(camera, prescription=Prescription(surfaces=tuple(surfaces)))


def shaped(kind: str, shape: str) -> tuple[Camera, np.ndarray, np.ndarray]:
    """A camera with a shaped stop and a slot in front, positions all over its sensor, and the microlens of each."""
    front = {"half_widths_mm": (22.0, 14.0), "aperture_rotation_deg": -35.0}
    if kind == "plenoptic":
        camera = with_shapes(rigs.plenoptic(), SHAPES[shape], front)
        return camera, *plenoptic_positions(Tracer(camera), 40)
    camera = with_shapes(rigs.conventional(5.0, 800, 600), SHAPES[shape], front)
    heights, azimuth = np.array([0.0, 5.0, 12.0, 18.0, 21.0, 24.0]), np.array([0.0, 0.3, 1.2, 2.5, 4.0, 5.5])
    return camera, heights[:, None] * np.stack([np.cos(azimuth), np.sin(azimuth)], axis=1), np.full(6, NO_MICROLENS)


@pytest.mark.parametrize(
    ("kind", "shape"),
    few_cases([("conventional", "ring"), ("plenoptic", "hexagon")], ("conventional", "hexagon"), ("plenoptic", "ring")),
)
def test_results_with_shaped_apertures_do_not_depend_on_bounds(kind: str, shape: str) -> None:
    camera, positions, lens = shaped(kind, shape)
    assert_independent_of_bounds(camera, positions, lens, least_lit=5)


@pytest.mark.parametrize("shape", SHAPES)
def test_no_ray_outside_the_bounds_passes_a_shaped_aperture(shape: str) -> None:
    """Trial rays all over the rear surface, at azimuths that favour no corner."""
    camera, positions, _ = shaped("conventional", shape)
    assert assert_bounds_hold(Tracer(camera), positions, np.random.default_rng(6), 20.0, 30_000).sum() > 500


def test_a_polygon_of_many_blades_becomes_its_circle() -> None:
    """Twice the blades, a quarter of the missing light: the order of convergence of an inscribed polygon is 2."""
    missing = []
    circle = Tracer(rigs.conventional(4.5)).reference_weight_sr
    for blades in (4, 8, 16):
        camera = with_shapes(rigs.conventional(4.5), {"blades": blades}, {})
        missing.append(1 - Tracer(camera).reference_weight_sr / circle)
        area = blades / (2 * math.pi) * math.sin(2 * math.pi / blades)
        assert missing[-1] == pytest.approx(1 - area, rel=0.02)
    assert np.all(np.diff(missing) < 0)


@pytest.mark.parametrize("wrong", [{"inner_semi_diameter_mm": 5.0}, {"half_widths_mm": (0.0, 1.0)}, {"blades": 2}])
def test_apertures_that_cannot_exist_are_refused(wrong: dict[str, object]) -> None:
    with pytest.raises(PrescriptionError):
        Surface(semi_diameter_mm=5.0, **wrong)
