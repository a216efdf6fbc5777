"""Claim: what physics cannot tell apart, the tracer does not: directions of travel, mirror images, the world."""

import math

import numpy as np
import pytest
from laws import rigs
from laws.bounds import SHAPES, moments, with_shapes
from laws.rigs import inside, thin
from laws.surfaces import BENT, assert_returned, oblique, traced, whole
from laws.test_model_cameras import BROWN, model
from scipy.spatial.transform import Rotation
from tolerances import HONEST, MOVED_MM, REVERSED_MM, ROUNDING_MM

from pipeline.camera.tracer import Tracer, parallel_planes
from pipeline.camera.tracing.moments import VARIANCE
from pipeline.camera.tracing.sampling_bounds import NO_MICROLENS
from pipeline.frames import inverse, rigid
from pipeline.optics.prescription import Prescription, PrescriptionError, Surface
from pipeline.optics.table import towards_scene, towards_sensor
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
