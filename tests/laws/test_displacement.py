"""Claim: surfaces off their places are met where they stand, and nothing else has moved.

Frames, closed forms, bounds, chief rays, and the truth of a badly assembled lens.
"""

import dataclasses
import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from laws import rigs
from laws.rigs import HEXAGON, inside
from laws.solving import rig_of, solved
from laws.surfaces import BENT, beam, oblique, traced, whole
from naive import brute, textbook
from scipy.optimize import root
from scipy.spatial.transform import Rotation
from shorter import few_cases
from tolerances import BORESIGHT_MM, MOVED_MM, REVERSED_MM, SIGMAS

from pipeline.camera.figures.field_curves import field_curves
from pipeline.camera.focusing.focus_request import with_matched_stop
from pipeline.camera.micro_images.centres import micro_images
from pipeline.camera.parts.camera import Camera
from pipeline.camera.parts.errors import CameraError
from pipeline.camera.pupil.chief_ray import chief_crossings, chief_heights, chief_slopes
from pipeline.camera.tracer import Tracer, parallel_planes
from pipeline.camera.tracing.moments import WEIGHT
from pipeline.camera.tracing.sampling_bounds import NO_MICROLENS
from pipeline.frames import VISION_FROM_CAMERA
from pipeline.optics.first_order import first_order
from pipeline.optics.prescription import Group, Prescription, PrescriptionError, Surface
from pipeline.optics.table import towards_scene, towards_sensor
from pipeline.targets.patterns.checkerboard import Checkerboard
from pipeline.truth.grid.position_image import on_target

TURN = VISION_FROM_CAMERA[:3, :3]


def assert_same_rays(one: list[np.ndarray], other: list[np.ndarray], atol: float) -> None:
    """Also on which rays pass."""
    np.testing.assert_array_equal(one[2], other[2])
    kept = one[2] > 0
    assert 100 < kept.sum() < len(kept)
    for a, b in zip(one[:2], other[:2], strict=True):
        np.testing.assert_allclose(a[kept], b[kept], rtol=0, atol=atol)


@pytest.mark.parametrize("lens", [BENT, rigs.tronnier()], ids=["aspheres", "double Gauss"])
@pytest.mark.parametrize("tilt_deg", [(0.0, 0.0), (4.0, 0.0), (0.0, -4.0), (5.0, -8.0)])
def test_a_lens_that_is_moved_as_a_whole_sees_moved_rays(lens: Prescription, tilt_deg: tuple[float, float]) -> None:
    """Rays carried along by SciPy's rotation, about the pivot, first about x and then about the turned y, in the camera
    frame; towards the sensor and, with y and z reversed, towards the scene."""
    shift, pivot = np.array([0.7, -1.1, 0.0]), np.array([0.0, 0.0, lens.vertices_from_stop_mm[0] + 7.0])
    turn = Rotation.from_euler("XY", tilt_deg, degrees=True).as_matrix()
    moved = whole(lens, decentre_mm=(0.7, -1.1), tilt_deg=tilt_deg, pivot_mm=7.0)
    position, direction = oblique(4000, 12.0, 0.3, -45.0)
    for make, frame in ((towards_sensor, np.eye(3)), (towards_scene, TURN)):
        still = traced(make(lens), position, direction)
        carried = [(points @ frame - pivot) @ turn.T + pivot + shift for points in (position, still[0])]
        ways = [way @ frame @ turn.T @ frame for way in (direction, still[1])]
        found = traced(make(moved), carried[0] @ frame, ways[0])
        assert_same_rays([carried[1] @ frame, ways[1], still[2]], found, MOVED_MM)


def test_surfaces_displaced_alike_are_a_group_decentred() -> None:
    """A group's decentre is that of each of its surfaces; an undisplaced group is none, bit for bit."""
    lens, position, direction = rigs.tronnier(), *oblique(4000, 12.0, 0.3, -45.0)
    singly = [dataclasses.replace(s, decentre_mm=(0.3, 0.2)) for s in lens.surfaces[:5]]
    one = dataclasses.replace(lens, surfaces=(*singly, *lens.surfaces[5:]))
    other = dataclasses.replace(lens, groups=(Group(name="front", first=0, count=5, decentre_mm=(0.3, 0.2)),))
    assert_same_rays(*(traced(towards_scene(p), position, direction) for p in (one, other)), REVERSED_MM)
    np.testing.assert_array_equal(towards_scene(whole(lens)), towards_scene(lens))


def test_a_surface_displaced_within_its_group_counts_in_the_axes_of_the_group() -> None:
    """The same lens, its group turned by 30 deg: the decentre of a surface within turns along."""
    turn = Rotation.from_euler("X", 30.0, degrees=True).as_matrix()
    stop = Surface(semi_diameter_mm=2.0, is_stop=True, decentre_mm=(0.0, 1.0))
    lens = whole(Prescription(surfaces=(stop,)), tilt_deg=(30.0, 0.0))
    edge = turn @ [0.0, 3.0, 0.0]
    for share, passes in ((0.999, 1.0), (1.001, 0.0)):
        *_, alive = traced(towards_sensor(lens), np.array([[0.0, share * edge[1], -5.0]]), np.array([[0.0, 0.0, 1.0]]))
        assert alive[0] == passes


def test_a_sphere_turned_about_its_centre_of_curvature_is_the_same_sphere() -> None:
    """Only its aperture moves."""
    sphere = Surface(radius_mm=20.0, index=1.6, semi_diameter_mm=16.0, is_stop=True)
    turned = whole(Prescription(surfaces=(sphere,)), tilt_deg=(9.0, -7.0), pivot_mm=20.0)
    position, direction = oblique(2000, 8.0, 0.2, -5.0)
    one, other = (traced(towards_sensor(p), position, direction) for p in (Prescription(surfaces=(sphere,)), turned))
    assert one[2].all() and other[2].all()
    for a, b in zip(one[:2], other[:2], strict=True):
        np.testing.assert_allclose(a, b, rtol=0, atol=MOVED_MM)


def plate(index: float, tilts_deg: tuple[float, float], group_tilt_deg: float = 0.0) -> Prescription:
    """10 mm of glass between two planes, each turned about x, and a stop far behind."""
    front, rear = (
        Surface(index=n, thickness_mm=10.0, semi_diameter_mm=50.0, tilt_deg=(tilt, 0.0))
        for n, tilt in zip((index, 1.0), tilts_deg, strict=True)
    )
    group = Group(name="plate", first=0, count=2, tilt_deg=(group_tilt_deg, 0.0), pivot_mm=5.0)
    return Prescription(surfaces=(front, rear, Surface(semi_diameter_mm=50.0, is_stop=True)), groups=(group,))


@pytest.mark.parametrize("angle_deg", [1.0, 20.0, -45.0, 70.0])
def test_a_tilted_plate_shifts_a_beam_by_the_closed_form(angle_deg: float) -> None:
    """t sin a (1 - cos a / sqrt(n^2 - sin^2 a)), to the side to which the normal in the beam's wake leans; directions
    stay. Hecht, Optics, chapter 4."""
    a, n = math.radians(angle_deg), 1.6
    position, direction = beam(np.array([0.0, 1.0, 3.0]), -60.0)
    found = traced(towards_sensor(plate(n, (0.0, 0.0), angle_deg)), position, direction)
    shift = 10.0 * math.sin(a) * (1 - math.cos(a) / math.sqrt(n * n - math.sin(a) ** 2))
    assert found[2].all()
    # A turn about x takes +z towards -y: the beam is carried that way.
    np.testing.assert_allclose(found[0][:, :2], position[:, :2] + [0.0, -shift], rtol=0, atol=MOVED_MM)
    np.testing.assert_allclose(found[1], direction, rtol=0, atol=REVERSED_MM)


def test_a_wedge_deviates_by_the_closed_form_of_least_deviation() -> None:
    """2 arcsin(n sin(A / 2)) - A for a ray that crosses it symmetrically, and more for any other."""
    apex, n = math.radians(24.0), 1.6
    wedge = plate(n, (12.0, -12.0))
    least = 2 * math.asin(n * math.sin(apex / 2)) - apex

    def deviation(angle: float) -> float:
        way = np.array([[0.0, math.sin(angle), math.cos(angle)]])
        _, out, alive = traced(towards_sensor(wedge), -40.0 * way, way)
        assert alive[0] == 1
        return math.acos(float(np.clip(out[0] @ way[0], -1, 1)))

    sides = [side for side in (-1.0, 1.0) if abs(deviation(side * least / 2) - least) < 1e-12]
    assert len(sides) == 1
    for off in (-0.02, 0.02):
        assert deviation(sides[0] * least / 2 + off) > least + 1e-6


@pytest.mark.parametrize("radius_mm", [math.inf, 60.0])
def test_the_back_of_a_surface_blocks(radius_mm: float) -> None:
    """A steep tilt turns a surface away from oblique rays: they are blocked, and meet no far side of a sphere."""
    stop = Surface(radius_mm=radius_mm, semi_diameter_mm=50.0, is_stop=True, tilt_deg=(60.0, 0.0))
    for angle_deg, passes in ((28.0, 1.0), (32.0, 0.0)):
        angle = math.radians(angle_deg)
        way = np.array([[0.0, math.sin(angle), math.cos(angle)]])
        *_, alive = traced(towards_sensor(Prescription(surfaces=(stop,))), [[1.0, 0.0, 0.0]] - 5.0 * way, way)
        assert alive[0] == passes


# --- chief rays


def rear_of(camera: Camera) -> tuple[np.ndarray, int]:
    tracer = Tracer(camera)
    return tracer.table, tracer.stop_row


def film_points(count: int, z_mm: float = -131.81) -> np.ndarray:
    """Points behind the lens, not all at one z."""
    rng = np.random.default_rng(4)
    return np.column_stack([rng.uniform(-18, 18, (count, 2)), z_mm + rng.uniform(-2, 2, count)])


def test_chief_rays_in_two_dimensions_are_those_of_one_in_a_centred_lens() -> None:
    """Newton's method and the secant method share no line."""
    (table, stop), points = rear_of(rigs.conventional()), film_points(200)
    heights = np.hypot(*points[:, :2].T)
    expected = chief_heights(table, stop, points[:, 2], heights) / heights
    found = chief_crossings(table, stop, points)
    np.testing.assert_allclose(found, expected[:, None] * points[:, :2], rtol=0, atol=MOVED_MM)
    ahead = table[0, 0] - points[:, 2:]
    np.testing.assert_allclose(chief_slopes(table, stop, points), (found - points[:, :2]) / ahead, rtol=0, atol=1e-12)


def with_stop_alone_displaced(camera: Camera) -> Camera:
    return rigs.reshaped(camera, {5: {"decentre_mm": (0.6, 0.3)}})


@pytest.mark.parametrize("displace", [rigs.displaced, with_stop_alone_displaced])
def test_chief_rays_meet_the_vertex_of_a_stop_off_its_place(displace: Callable[[Camera], Camera]) -> None:
    """By the textbook's trace of what lies behind the stop; the stop in this lens stands in air."""
    camera = displace(rigs.conventional(17.1))
    lens, points = camera.prescription, film_points(100)
    behind = Prescription(
        surfaces=lens.surfaces[5:],
        groups=tuple(dataclasses.replace(group, first=group.first - 5) for group in lens.groups if group.first >= 5),
    )
    slopes = chief_slopes(*rear_of(camera), points)
    at_stop, _, _ = textbook.trace(behind, points, np.column_stack([slopes, np.ones(100)]))
    vertex = np.array([0.6, -0.3, 0.0])  # vision frame
    np.testing.assert_allclose(at_stop, np.tile(vertex, (100, 1)), rtol=0, atol=1e-9)


def test_micro_image_centres_of_a_stop_displaced_alone_are_where_light_through_its_centre_falls() -> None:
    """Every lens surface is centred, and still no micro-image centre is that of the centred lens."""
    camera = with_stop_alone_displaced(rigs.plenoptic(2.0))
    tracer = Tracer(camera)
    centre = micro_images(tracer).centre_mm
    start = np.column_stack([centre, np.full(len(centre), tracer.sensor_z_mm)])
    vertex = np.column_stack([tracer.vertices_mm, np.full(len(centre), tracer.film_z_mm)])
    behind = Prescription(surfaces=camera.prescription.surfaces[5:])
    # A ray through the vertex of a thin microlens is not bent.
    at_stop, _, _ = textbook.trace(behind, vertex, vertex - start)
    np.testing.assert_allclose(at_stop[:, :2], np.tile([0.6, -0.3], (len(centre), 1)), rtol=0, atol=1e-8)
    still = micro_images(Tracer(rigs.plenoptic(2.0))).centre_mm
    assert np.hypot(*(centre - still).T).min() > 0.005


def test_micro_images_of_a_lens_shifted_as_a_whole_shift_along() -> None:
    """The centre of microlens v behind a lens shifted by d lies where that of v - d lies behind the centred lens."""
    camera = rigs.plenoptic(3.0)
    lens, shift = camera.prescription, np.array([0.25, -0.4])  # vision frame
    moved = dataclasses.replace(camera, prescription=whole(lens, decentre_mm=(0.25, 0.4)))
    tracer = Tracer(moved)
    points = np.column_stack([tracer.vertices_mm - shift, np.full(len(tracer.vertices_mm), tracer.film_z_mm)])
    slopes = chief_slopes(*rear_of(camera), points)
    expected = tracer.vertices_mm - slopes * camera.microlenses.distance_mm
    np.testing.assert_allclose(micro_images(tracer).centre_mm, expected, rtol=0, atol=MOVED_MM)


def test_a_point_without_a_chief_ray_is_an_error_with_its_place() -> None:
    """Behind a lens that a steep group shuts off."""
    lens = dataclasses.replace(rigs.tronnier(), groups=(Group(name="rear", first=7, count=4, tilt_deg=(80.0, 0.0)),))
    with pytest.raises(CameraError, match="reaches the centre of the aperture stop"):
        chief_slopes(towards_scene(lens), 5, film_points(3))


# --- what a camera makes of it


def test_the_weight_of_reference_of_a_lens_shifted_as_a_whole_is_that_of_a_point_off_the_axis() -> None:
    """W_ref leaves from the place where the nominal axis meets the sensor."""
    camera = rigs.conventional(17.1, 400, 300)
    moved = dataclasses.replace(camera, prescription=whole(camera.prescription, decentre_mm=(3.0, 0.0)))
    one = Tracer(moved).reference_weight_sr
    other = [
        Tracer(camera, seed).moments(
            np.array([[-3.0, 0.0]]), np.array([NO_MICROLENS]), parallel_planes(1.0, 2.0), 1 << 16, np.zeros((1, 2))
        )[0, WEIGHT]
        for seed in range(4)
    ]
    assert one == pytest.approx(np.mean(other), rel=2e-4)


@pytest.mark.parametrize("object_mm", [434.36, math.inf])
def test_the_boresight_of_a_lens_shifted_as_a_whole_is_that_of_first_order_optics(object_mm: float) -> None:
    """The image of a point on the nominal axis moves by d (1 - m), to the right as the camera frame has it and so to
    the left in the image; halve the shift, and what is left of distortion falls eightfold."""
    camera, left = rigs.conventional(17.1, 400, 300), []
    lens = first_order(camera.prescription)
    magnification = 0.0 if math.isinf(object_mm) else lens.magnification(lens.object_mm(-camera.sensor_distance_mm))
    object_mm = object_mm if math.isinf(object_mm) else lens.object_mm(-camera.sensor_distance_mm)
    for shift in (2.0, 1.0, 0.5):
        moved = dataclasses.replace(camera, prescription=whole(camera.prescription, decentre_mm=(shift, -shift / 2)))
        x, y = field_curves(moved, object_mm, 2).boresight_px
        assert y == pytest.approx(x / 2, rel=1e-6)
        left.append(-x * 0.05 - shift * (1 - magnification))
    if math.isinf(object_mm):
        np.testing.assert_allclose(left, 0, atol=BORESIGHT_MM)
    else:
        assert left[0] / left[1] == pytest.approx(8, rel=0.05) and left[1] / left[2] == pytest.approx(8, rel=0.05)
    assert field_curves(camera, object_mm, 2).boresight_px is None


def test_the_boresight_of_displaced_groups_is_that_of_a_direct_search() -> None:
    """The textbook tracer and SciPy's root finder: the sensor position and direction whose ray meets the vertex of the
    stop and the point on the axis at 434 mm. The displaced stop and the tilted rear group count, too."""
    camera = rigs.displaced(rigs.conventional(17.1, 400, 300))
    lens = camera.prescription
    behind = Prescription(
        surfaces=lens.surfaces[5:], groups=(dataclasses.replace(lens.groups[1], first=lens.groups[1].first - 5),)
    )

    def misses(unknown: np.ndarray) -> np.ndarray:
        start = np.array([[unknown[0], unknown[1], -camera.sensor_distance_mm]])
        way = np.array([[unknown[2], unknown[3], 1.0]])
        stop, _, _ = textbook.trace(behind, start, way)
        position, direction, _ = textbook.trace(lens, start, way)
        point = position[0] + (434.0 - position[0, 2]) / direction[0, 2] * direction[0]
        return np.array([*(stop[0, :2] - [0.6, -0.3]), *point[:2]])

    solution = root(misses, np.zeros(4), tol=1e-13)
    expected = -solution.x[:2] / camera.sensor.pitch_mm
    np.testing.assert_allclose(field_curves(camera, 434.0, 2).boresight_px, expected, rtol=0, atol=1e-6)
    assert np.hypot(*expected) > 5


def test_the_curves_of_a_lens_shifted_as_a_whole_are_its_own_also_beyond_the_sensor() -> None:
    """An object at infinity: the image of the axis lies 6 mm to the side, off a sensor of 4 mm, and the curves from
    there to its corner are those of the centred lens at the same heights."""
    small = rigs.conventional(17.1, 80, 80)
    moved = dataclasses.replace(small, prescription=whole(small.prescription, decentre_mm=(-6.0, 0.0)))
    found = field_curves(moved, math.inf, 3)
    assert found.boresight_px == pytest.approx((6.0 / 0.05, 0.0), abs=1e-6)
    end = math.hypot(6.0 + 2.0, 2.0)
    large = dataclasses.replace(small.sensor, width_px=round(2 * end / 0.05 / math.sqrt(2)), height_px=1)
    large = dataclasses.replace(large, height_px=large.width_px, pitch_mm=2 * end / math.sqrt(2) / large.width_px)
    expected = field_curves(dataclasses.replace(small, sensor=large), math.inf, 3)
    np.testing.assert_allclose(found.height_mm, expected.height_mm, rtol=1e-12)
    np.testing.assert_allclose(found.angle_deg, expected.angle_deg, rtol=0, atol=1e-9)
    np.testing.assert_allclose(found.distortion, expected.distortion, rtol=0, atol=1e-9)
    np.testing.assert_allclose(found.relative_illumination, expected.relative_illumination, rtol=2e-3)


@pytest.mark.parametrize("table", [towards_sensor, towards_scene], ids=["towards sensor", "towards scene"])
def test_an_aperture_of_any_shape_moves_with_its_surface(table) -> None:
    """Parallel rays through a decentred hexagon: those that pass the centred one, shifted. Turned by 60 deg about x it
    looks half as high."""
    points = np.random.default_rng(2).uniform(-7, 7, (20_000, 2))
    sign = 1.0 if table is towards_sensor else -1.0
    for tilt_deg, height in ((0.0, 1.0), (60.0, 0.5)):
        stop = Surface(semi_diameter_mm=5.0, is_stop=True, decentre_mm=(1.0, -0.5), tilt_deg=(tilt_deg, 0.0), **HEXAGON)
        position = np.column_stack([points[:, 0], sign * points[:, 1], np.full(len(points), -20.0)])
        *_, alive = traced(table(Prescription(surfaces=(stop,))), position, np.tile([0.0, 0.0, 1.0], (len(points), 1)))
        expected = inside("hexagon", points[:, 0] - 1.0, (points[:, 1] + 0.5) / height)
        assert 0.1 < expected.mean() < 0.5
        np.testing.assert_array_equal(alive > 0, expected)


def test_a_matched_stop_keeps_the_groups_of_its_lens() -> None:
    camera = rigs.displaced(rigs.plenoptic())
    assert with_matched_stop(camera).prescription.groups == camera.prescription.groups
    assert not with_matched_stop(camera).prescription.is_centred


@pytest.mark.parametrize(
    "wrong", [{"tilt_deg": (90.0, 0.0)}, {"tilt_deg": (0.0, math.nan)}, {"decentre_mm": (math.inf, 0.0)}]
)
def test_displacements_that_cannot_be_are_refused(wrong: dict[str, object]) -> None:
    with pytest.raises(PrescriptionError):
        Surface(semi_diameter_mm=5.0, **wrong)
    with pytest.raises(PrescriptionError):
        Group(name="all", first=0, count=1, **wrong)


# --- the truth


def brute_j(camera: Camera, start: np.ndarray, cell: int, pose: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """J of a sensor position by the textbook, and its standard error over 16 groups of rays [mm]."""
    rng, vertex, focal, tracer = np.random.default_rng(21), None, None, Tracer(camera)
    if camera.microlenses and tracer.lattice is not None:
        vertex = tracer.vertices_mm[cell]
        focal = camera.microlenses.focal_lengths_mm[tracer.lattice.type[cell]]
    means = []
    for _ in range(16):
        position, direction, weight = brute.rays_through(camera, start, vertex, focal, 4000, rng)
        kept = weight > 0
        means.append(np.average(textbook.at_plane(position[kept], direction[kept], pose), axis=0, weights=weight[kept]))
    return np.mean(means, axis=0), np.std(means, axis=0, ddof=1) / 4


def deviations_of(camera: Camera, board: Checkerboard, pose: np.ndarray, count: int) -> np.ndarray:
    """Deviations of brute-force J at about so many found positions from the points, over its standard error and sigma,
    (n, 2).
    """
    truth = solved(rig_of(camera), board, pose)
    rows, found = truth.solutions, []
    positions = Tracer(camera).positions_mm(rows.x_px, rows.y_px)
    bright = np.flatnonzero(truth.hit_fraction > 0.9)
    for i in bright[:: max(1, len(bright) // count)]:
        mean, error = brute_j(camera, positions[i], int(rows.cell[i]), pose)
        mapped = np.abs(rows.jacobian[i]) @ truth.sigma_px[i]
        found.append((mean - board.points_mm()[rows.point[i], :2]) / np.hypot(error, mapped))
    return np.array(found)


@pytest.mark.parametrize(("kind", "count"), few_cases([("plenoptic", 2)], ("conventional", 8), ("plenoptic", 8)))
def test_the_truth_of_a_displaced_lens_is_where_brute_force_sees_the_points(
    kind: str, count: int, tmp_path: Path
) -> None:
    if kind == "conventional":
        camera = rigs.displaced(rigs.conventional(8.0, 64, 48))
        grid, board = rigs.ray_grid(tmp_path, camera, 1, 64), Checkerboard(columns=4, rows=3, square_mm=1.5)
    else:
        camera = rigs.displaced(rigs.plenoptic(1.6, 96, 72))
        grid, board = rigs.ray_grid(tmp_path, camera, 2, 64), Checkerboard(columns=2, rows=3, square_mm=0.6)
    # In front of the camera, which looks to the side.
    middle = tuple(np.array(grid.near.shape[:2]) // 2)
    seen = on_target(grid.near[middle], grid.far[middle], grid.near_mm, grid.far_mm, rigs.facing(434.0))
    pose = rigs.facing(434.0, 0.0, float(seen[0]), float(-seen[1]))
    deviations = deviations_of(camera, board, pose, count)
    assert len(deviations) >= count
    assert np.abs(deviations).max() < SIGMAS
