"""Claim: visibility is the share of a bundle's weight that reaches the surface at its point: closed forms for edges and
holes before an ideal lens, plain projection for a pinhole, textbook rays behind microlenses, and the light in images.
"""

import dataclasses
import math

import numpy as np
import pytest
from laws import rigs
from laws.meshes import mesh
from laws.rigs import thin
from laws.solving import planes_of, rig_of
from naive import brute
from scipy.integrate import quad
from shorter import few
from tolerances import HONEST, LIT_SHARE, SIGMAS, VISIBLE_SHARE

from pipeline.camera.parts.camera import Sensor
from pipeline.camera.rig import Rig
from pipeline.frames import apply
from pipeline.optics.rays import traced
from pipeline.optics.table import VERTEX
from pipeline.render.glow import TargetLight
from pipeline.render.imaging import irradiance_and_crosstalk
from pipeline.render.surroundings import Surroundings
from pipeline.targets.mesh import MeshTarget, Occluder
from pipeline.targets.patterns.checkerboard import Checkerboard
from pipeline.targets.patterns.tags import Charuco
from pipeline.targets.surfaces import Cube, Cylinder, HeightMap, Stairs, Warped
from pipeline.targets.target import Target
from pipeline.truth.direct.direct_rows import guesses, solve
from pipeline.truth.planes import faces_camera
from pipeline.truth.rows import Correspondences
from pipeline.truth.settings import LOOK_RAYS, RAYS
from pipeline.truth.visibility import PointBundles, shares, visibility, visible_rows

RADIUS_MM, FOCAL_MM, BEHIND_MM = 6.0, 14.9, 15.9
FOCUS_MM = 1 / (1 / FOCAL_MM - 1 / BEHIND_MM)
PINHOLE_MM = 60.0
"""An ideal lens so fast that the weight at its edge is three quarters of that in its middle; and a pinhole camera."""
BOARD = Checkerboard(columns=6, rows=5, square_mm=4.0, white=1.0, black=1.0)
HERE = np.eye(4)


def ideal(seed: int = 0) -> Rig:
    """An ideal thin lens that is its own stop, focused at FOCUS_MM."""
    sensor = Sensor(width_px=5, height_px=5, pitch_mm=0.002)
    return rig_of(rigs.bare(thin(FOCAL_MM, RADIUS_MM), sensor, BEHIND_MM, (200.0, 400.0)), seed)


def pinhole() -> Rig:
    sensor = Sensor(width_px=400, height_px=400, pitch_mm=0.1)
    return rig_of(rigs.bare(rigs.hole(1e-4), sensor, PINHOLE_MM, (300.0, 500.0)))


def half_plane(edge_mm: float, angle_rad: float, z_mm: float) -> Occluder:
    c, s = math.cos(angle_rad), math.sin(angle_rad)
    flat = np.array([[edge_mm, -900.0], [900.0, -900.0], [900.0, 900.0], [edge_mm, 900.0]])
    return mesh([(x, y, z_mm) for x, y in flat @ np.array([[c, s], [-s, c]])])


def ring(inner_mm: float, z_mm: float, corners: int = 256) -> Occluder:
    """A wall with a hole whose edge is a regular polygon around a circle."""
    angle = 2 * np.pi * np.arange(corners) / corners
    around = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    both = np.concatenate([around * inner_mm / math.cos(math.pi / corners), 500.0 * around])
    i, j = np.arange(corners), (np.arange(corners) + 1) % corners
    triangles = np.concatenate([np.stack(t, axis=1) for t in ((i, j, j + corners), (i, j + corners, i + corners))])
    return mesh([(x, y, z_mm) for x, y in both], triangles)


def facing_planes(points_mm: np.ndarray) -> np.ndarray:
    """Planes of points, of which visibility asks nothing but their normals."""
    planes = np.zeros((len(points_mm), 4, 3))
    planes[:, 0], planes[:, 3] = points_mm, [0.0, 0.0, -1.0]
    return planes


def at(rig: Rig, surroundings: Surroundings, points_mm: np.ndarray, x_px: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    return visibility(rig, surroundings, 0, np.full(len(points_mm), -1), x_px, facing_planes(points_mm))


def share_of_segment(cut_mm: float) -> float:
    """Weight of the part x < cut of the pupil over that of all, seen from the axis: the weight is (1 + r^2/h^2)^-2."""

    def strip(x: float) -> float:
        # Closed form of the integral of (a^2 + y^2)^-2 over the strip, lengths in units of h.
        a, y = math.sqrt(1 + (x / BEHIND_MM) ** 2), math.sqrt(RADIUS_MM**2 - x**2) / BEHIND_MM
        return y / (a**2 * (a**2 + y**2)) + math.atan(y / a) / a**3

    return quad(strip, -RADIUS_MM, cut_mm)[0] / quad(strip, -RADIUS_MM, RADIUS_MM)[0]


@pytest.mark.parametrize("distance_mm", [FOCUS_MM, 320.0])
def test_an_edge_cuts_the_share_of_the_pupil_that_a_segment_has(distance_mm: float) -> None:
    """On the axis, in focus and far out of it: at a depth z the bundle is the pupil times 1 - z / focus.

    32 cuts; their errors are as large as stated."""
    rng, error, stated = np.random.default_rng(6), [], []
    lenses = [ideal(seed) for seed in range(4)]
    for number in range(32):
        z_mm, cut_mm = rng.uniform(100.0, 200.0), rng.uniform(-0.9, 0.9) * RADIUS_MM
        wall = half_plane(cut_mm * (1 - z_mm / FOCUS_MM), rng.uniform(0, 2 * np.pi), z_mm)
        around = Surroundings([(Target(BOARD), rigs.facing(distance_mm))], [(wall, HERE)])
        share, sigma = at(lenses[number % 4], around, np.array([[0.0, 0.0, distance_mm]]), np.array([[2.0, 2.0]]))
        error.append(share[0] - share_of_segment(cut_mm))
        stated.append(sigma[0])
    assert np.abs(error).max() < VISIBLE_SHARE
    assert HONEST[0] < np.sqrt(np.mean(np.square(error)) / np.mean(np.square(stated))) < HONEST[1]
    assert np.abs(error).max() < SIGMAS * np.sqrt(np.mean(np.square(stated)))


def test_a_hole_as_large_as_the_bundle_takes_nothing_and_a_smaller_one_its_share() -> None:
    """A cone of radius r at h holds pi r^2 h^2 / (r^2 + h^2) of the integral of (1 + r^2/h^2)^-2."""
    z_mm = 150.0
    narrowed = RADIUS_MM * (1 - z_mm / FOCUS_MM)
    point, x_px = np.array([[0.0, 0.0, FOCUS_MM]]), np.array([[2.0, 2.0]])
    targets = [(Target(BOARD), rigs.facing(FOCUS_MM))]
    share, sigma = at(ideal(), Surroundings(targets, [(ring(narrowed + 1e-4, z_mm), HERE)]), point, x_px)
    assert share.tolist() == [1.0] and sigma.tolist() == [0.0]
    for part in (0.3, 0.7, 0.95):
        share, _ = at(ideal(), Surroundings(targets, [(ring(part * narrowed, z_mm), HERE)]), point, x_px)
        r, whole = part * RADIUS_MM, RADIUS_MM
        expected = (r**2 / (r**2 + BEHIND_MM**2)) / (whole**2 / (whole**2 + BEHIND_MM**2))
        assert share[0] == pytest.approx(expected, abs=VISIBLE_SHARE)


def test_what_stands_behind_the_plane_or_beside_the_bundle_hides_nothing() -> None:
    point, x_px = np.array([[0.0, 0.0, FOCUS_MM]]), np.array([[2.0, 2.0]])
    targets = [(Target(BOARD), rigs.facing(FOCUS_MM))]
    behind = Surroundings(targets, [(half_plane(-99.0, 0.0, FOCUS_MM + 1e-3), HERE)])
    beside = Surroundings(targets, [(half_plane(RADIUS_MM, 0.0, 100.0), HERE)])
    front = np.array([[0.0, 0.0, -1.0]])
    assert not behind.may_hide(point, front).any() and beside.may_hide(point, front).all()
    for around in (behind, beside):
        assert at(ideal(), around, point, x_px)[0].tolist() == [1.0]
    wall = Surroundings(targets, [(half_plane(-99.0, 0.0, FOCUS_MM - 1e-3), HERE)])
    assert at(ideal(), wall, point, x_px)[0].tolist() == [0.0]


def through_pinhole(rig: Rig, points_mm: np.ndarray) -> np.ndarray:
    return rig.tracer.pixels_at(-points_mm[:, :2] / points_mm[:, 2:] * PINHOLE_MM)


def seen_of(rig: Rig, target, pose: np.ndarray, others=()) -> tuple[np.ndarray, np.ndarray]:
    """Visibility of all points of a target that face a pinhole, and their numbers."""
    planes = planes_of(target, pose)
    facing = np.flatnonzero(faces_camera(planes))
    planes = planes[facing]
    around = Surroundings([(target, pose), *others])
    x_px = through_pinhole(rig, planes[:, 0])
    return visibility(rig, around, 0, np.full(len(planes), -1), x_px, planes)[0], facing


def test_a_board_hides_the_points_of_another_that_project_onto_it() -> None:
    """Both tilted; without the near board no ray is needed."""
    rig, near, far = pinhole(), rigs.facing(330.0, 20.0, 12.0, -5.0), rigs.facing(420.0, -15.0)
    small, large = (
        Target(Checkerboard(columns=2, rows=3, square_mm=5.0)),
        Target(Checkerboard(columns=16, rows=15, square_mm=4.0)),
    )
    share, facing = seen_of(rig, large, far, [(small, near)])
    points = apply(far, large.points().position_mm[facing])
    # Where the line from the pinhole to the point meets the near board, in its frame.
    scale = (near[:3, 3] @ near[:3, 2]) / (points @ near[:3, 2])
    hit = (points * scale[:, None] - near[:3, 3]) @ near[:3, :2]
    half = np.array([small.pattern.drawing.half_x_mm, small.pattern.drawing.half_y_mm])
    beyond = (np.abs(hit) - half).max(axis=1)
    clear = np.abs(beyond) > 1e-2
    assert np.array_equal(share[clear], (beyond[clear] > 0).astype(float))
    assert 20 < np.sum(share == 0) < len(share) - 20 and clear.sum() > len(share) - 5
    assert (seen_of(rig, large, far)[0] == 1).all()


def test_of_a_cube_no_face_hides_another_and_the_far_ones_face_away() -> None:
    """A convex body: every face that turns its front is seen as a whole, without a ray."""
    cube = Target(Charuco(columns=3, rows=3, square_mm=5.0, marker_mm=4.0, dictionary="4x4_50"), Cube(edge_mm=32.0))
    pose = rigs.facing(400.0, 30.0) @ np.array([[1, 0, 0, 0], [0, 0.8, -0.6, 0], [0, 0.6, 0.8, 0], [0, 0, 0, 1.0]])
    share, facing = seen_of(pinhole(), cube, pose)
    assert len(set(facing // 9)) == 3 and len(facing) == 27
    assert (share == 1).all()
    planes = planes_of(cube, pose)[facing]
    assert not Surroundings([(cube, pose)]).may_hide(planes[:, 0], planes[:, 3]).any()


@pytest.mark.parametrize("up_mm", [-60.0, 40.0])
def test_treads_hide_the_feet_of_the_steps_behind_them_from_an_eye_below(up_mm: float) -> None:
    """The eye sees a point of step n over the edge of the tread before it, or not."""
    stairs = Target(BOARD, Stairs(steps=3, depth_mm=60.0))
    pose = rigs.facing(400.0, 0.0, 0.0, up_mm)
    share, facing = seen_of(pinhole(), stairs, pose)
    points = stairs.points().position_mm[facing]
    eye_y, eye_z, half = up_mm, 400.0, BOARD.drawing.half_y_mm  # y is up in the target frame, down in the pose
    hidden = np.zeros(len(points), bool)
    for front in (1, 2):
        # The line from the eye at the depth of all fronts before.
        of = np.isclose(points[:, 2], -60.0 * front)
        for before in range(front):
            share_of_way = (eye_z + 60.0 * before) / (eye_z + 60.0 * front)
            y = eye_y + share_of_way * (points[:, 1] - eye_y)
            hidden |= of & (y < (2 * before + 1) * half)
    assert np.array_equal(share, (~hidden).astype(float))
    assert hidden.any() == (up_mm < 0)


def test_steps_hide_each_other_as_occluders_of_their_shape_do() -> None:
    """A wide lens far out of focus, seen from below: feet of the upper step, against that step alone behind meshes."""
    board = Checkerboard(columns=6, rows=5, square_mm=0.8)
    stairs, pose = Target(board, Stairs(steps=2, depth_mm=20.0)), rigs.facing(380.0, 0.0, 0.0, -14.0)
    rig, planes = rig_of(rigs.conventional(17.1)), planes_of(stairs, pose)[30:]
    lens, x_px = np.full(30, -1), positions_of(rig, planes[:, 0], 400.0)
    lower, upper, tread = stairs.patches()
    others = []
    for patch in (lower, tread):
        corners = apply(patch.target_from_patch, patch.mesh().reshape(-1, 3))
        others.append((mesh(corners, np.arange(len(corners)).reshape(-1, 3)), pose))
    alone = Surroundings([(Target(board), pose @ upper.target_from_patch)], others)
    expected, _ = visibility(rig, alone, 0, lens, x_px, planes)
    share, _ = visibility(rig, Surroundings([(stairs, pose)]), 0, lens, x_px, planes)
    assert share.tolist() == expected.tolist()
    assert np.sum((share > 0) & (share < 1)) > 5


@pytest.mark.parametrize(
    "surface",
    [
        Warped(deflection_mm=(2.0, 1.0)),
        Warped(deflection_mm=(-2.0, 1.0)),
        Cylinder(radius_mm=30.0),
        Cylinder(radius_mm=-30.0),
    ],
    ids=["bow", "saddle", "roll", "hollow"],
)
def test_a_bent_sheet_does_not_hide_its_own_points(surface) -> None:
    """Seen as a whole by a wide lens, up to 25 mm out of focus: also hollows, which stand before their tangent planes.

    J and its tangent planes are all that a bundle knows: positions need not be solutions here.
    """
    camera = rigs.conventional(17.1, 96, 72)
    rig, target = rig_of(camera), Target(BOARD, surface)
    for distance_mm in (415.0, 460.0):
        pose = rigs.facing(distance_mm, 20.0)
        planes = planes_of(target, pose)
        x_px = positions_of(rig, planes[:, 0], distance_mm)
        share, _ = visibility(rig, Surroundings([(target, pose)]), 0, np.full(len(planes), -1), x_px, planes)
        assert share.tolist() == [1.0] * len(planes)


def positions_of(rig: Rig, points_mm: np.ndarray, distance_mm: float) -> np.ndarray:
    """About where a camera sees points near the axis, by the scale of its image there."""
    places = np.array([[0.0, 0.0], [1.0, 0.0]])
    planes = np.zeros((2, 4, 3))
    planes[:, 0, 2] = distance_mm, distance_mm + 1.0
    planes[:, 1, 0] = planes[:, 2, 1] = planes[:, 3, 2] = 1.0
    mean = rig.tracer.moments(places, np.full(2, -1), planes, 4096, np.zeros((2, 2)))[:, 0]
    return rig.tracer.pixels_at(points_mm[:, :2] / (mean[1] - mean[0]))


def test_the_rim_of_a_hollow_hides_the_wall_behind_it() -> None:
    """A sheet of 1.2 turns of a half circle seen from outside its mouth: a point is hidden if the line to it crosses
    the sheet before, which a fine search along the line finds."""
    board = Checkerboard(columns=29, rows=2, square_mm=4.0)
    target, radius = Target(board, Cylinder(radius_mm=-30.0)), 30.0
    pose, rig = rigs.facing(400.0, 25.0), pinhole()
    share, facing = seen_of(rig, target, pose)
    points = target.points().position_mm[facing]
    eye = np.linalg.inv(pose)[:3, 3]
    along = np.linspace(0.8, 1 - 1e-4, 200_000)
    for point, found in zip(points, share, strict=True):
        line = eye + along[:, None] * (point - eye)
        from_axis = np.hypot(line[:, 0], line[:, 2] - radius)
        crossed = np.flatnonzero(np.diff(np.sign(from_axis - radius)))
        arc = -radius * np.arctan2(line[crossed, 0] / -radius, (line[crossed, 2] - radius) / -radius)
        hidden = (np.abs(arc) < board.drawing.half_x_mm) & (np.abs(line[crossed, 1]) < board.drawing.half_y_mm)
        assert found == float(not hidden.any())
    assert 0 < np.sum(share == 0) < len(share)


def test_a_bump_of_a_measured_board_hides_what_lies_behind_it() -> None:
    """Seen at 75 degrees: a point is hidden where the line to the eye dips below the board's heights."""
    board = Checkerboard(columns=14, rows=5, square_mm=4.0)
    x = np.linspace(-1, 1, 31)
    heights = np.tile(6.0 * np.exp(-((x / 0.4) ** 2)), 5)
    target = Target(board, HeightMap(resolution=(31, 5), heights_mm=tuple(heights.tolist())))
    pose, rig = rigs.facing(400.0, 75.0), pinhole()
    share, facing = seen_of(rig, target, pose)
    (patch,), eye = target.patches(), np.linalg.inv(pose)[:3, 3]
    gaps = []
    for point in target.points().position_mm[facing]:
        line = point + np.linspace(1e-3, 0.2, 400)[:, None] * (eye - point)
        line = line[(np.abs(line[:, :2]) < [30.0, 12.0]).all(axis=1)]
        gaps.append((line[:, 2] - patch.surface_at(line[:, :2])[0][:, 2]).min())
    clear = np.abs(gaps) > 1e-2  # the line is sampled every 0.2 mm
    assert np.array_equal(share[clear], (np.array(gaps) > 0)[clear].astype(float))
    assert np.sum(share == 0) > 5 < np.sum(share == 1) and clear.sum() > len(clear) - 5


def test_a_tip_that_is_marked_on_a_mesh_is_seen_from_the_front_and_not_through_a_wall() -> None:
    """Its tangent plane touches no face; a second pyramid of the same mesh stands before it or not."""
    one = np.array([[-5, -5, 0], [5, -5, 0], [5, 5, 0], [-5, 5, 0], [0, 0, 6]], float)
    faces = np.array([[0, 1, 4], [1, 2, 4], [2, 3, 4], [3, 0, 4]])
    for beside, expected in ((12.0, 1.0), (0.0, 0.0)):
        both = mesh([*one, *(one + np.array([beside, 0, 20]))], [*faces, *(faces + 5)])
        target = MeshTarget(
            vertices_mm=both.vertices_mm,
            triangles=both.triangles,
            albedo=((1.0, 1.0, 1.0),) * 8,
            points_mm=((0.0, 0.0, 6.0),),
            normals=((0.0, 0.0, 1.0),),
        )
        assert seen_of(pinhole(), target, rigs.facing(400.0))[0].tolist() == [expected]


def test_a_marked_point_beside_its_mesh_is_not_hidden_by_it() -> None:
    """`check` warns; the truth believes the point, a quarter of a millimetre behind its face, seen at 60 degrees."""
    face = MeshTarget(
        vertices_mm=((-9.0, -9.0, 0.0), (9.0, -9.0, 0.0), (0.0, 9.0, 0.0)),
        triangles=((0, 1, 2),),
        albedo=((1.0, 1.0, 1.0),),
        points_mm=((0.0, 0.0, -0.25),),
        normals=((0.0, 0.0, 1.0),),
    )
    assert seen_of(pinhole(), face, rigs.facing(400.0, 60.0))[0].tolist() == [1.0]


def test_a_fully_hidden_row_goes_and_is_counted() -> None:
    """Of a ring of rows found by `direct`, those behind a wall; what is not known is not hidden."""
    rig, pose = rig_of(rigs.conventional(4.5)), rigs.facing(434.0)
    board = Target(Checkerboard(columns=4, rows=3, square_mm=4.0))
    rows, planes = solved_rows(rig, board, pose)
    wall = half_plane(0.0, 0.0, 430.0)
    around = Surroundings([(board, pose)], [(wall, HERE)])

    def among(rows: Correspondences) -> tuple[Correspondences, np.ndarray]:
        solutions = rows.solutions
        place = rig.microlens(solutions.cell), solutions.xy_px, planes[solutions.point]
        return visible_rows(rows, visibility(rig, around, 0, *place)[0])

    found, share = among(rows)
    left = planes[rows.solutions.point, 0, 0] < 0
    assert np.array_equal(found.solutions.point, rows.solutions.point[left]) and (share == 1).all()
    assert found.counts["dropped_hidden"] == np.sum(~left) == 6
    assert found.counts["partly_hidden"] == 0 and found.counts["rows"] == 6 == len(share)
    before = {name: count for name, count in rows.counts.items() if name != "rows"}
    assert before and before.items() <= found.counts.items()  # the fate of the other points stays known
    dark = dataclasses.replace(rows, solutions=dataclasses.replace(rows.solutions, x_px=rows.solutions.x_px + 1e4))
    unknown, share = among(dark)
    assert np.isnan(share).all() and len(share) == 12 and unknown.counts["dropped_hidden"] == 0


def solved_rows(rig: Rig, target, pose: np.ndarray):
    planes = planes_of(target, pose)
    return solve(rig, guesses(rig, planes)[0], planes, 1e-3, 0.05), planes


WALLS = ((0.3, 0.4, 80.0), (-1.0, 2.0, 100.0))
"""Distance from the axis, direction and depth of two edges."""


def test_behind_microlenses_the_share_is_that_of_textbook_rays() -> None:
    """Rows of one corner in many micro-images of all types, partly hidden by two edges; 15,000 uniform rays each."""
    camera, pose = rigs.plenoptic(3.0), rigs.facing(440.0, 15.0)
    rig, target = rig_of(camera), Target(Checkerboard(columns=2, rows=1, square_mm=1.5, white=1.0))
    rows, planes = solved_rows(rig, target, pose)
    walls = [(half_plane(*wall), HERE) for wall in WALLS]
    x_px = rows.solutions.xy_px
    around = Surroundings([(target, pose)], walls)
    share, sigma = visibility(rig, around, 0, rig.microlens(rows.solutions.cell), x_px, planes[rows.solutions.point])
    partly = np.flatnonzero((share > 0.02) & (share < 0.98))
    types = rig.tracer.lattice.type[rows.solutions.cell]
    assert set(types[partly]) == {0, 1, 2} and len(partly) > 9
    rng, ratio = np.random.default_rng(8), []
    for row in partly:
        cell = rows.solutions.cell[row]
        start, focal = rig.tracer.positions_mm(*x_px[row]), camera.microlenses.focal_lengths_mm[types[row]]
        vertex = rig.tracer.vertices_mm[cell]
        position, direction, weight = brute.rays_through(camera, start, vertex, focal, 15_000, rng)
        alive = weight > 0
        position, direction, weight = position[alive], direction[alive], weight[alive]
        free = np.ones(len(weight), bool)
        for edge, angle, z_mm in WALLS:
            hit = position + direction * ((z_mm - position[:, 2]) / direction[:, 2])[:, None]
            free &= hit[:, 0] * math.cos(angle) + hit[:, 1] * math.sin(angle) < edge
        expected = np.sum(weight * free) / np.sum(weight)
        spread = math.sqrt(expected * (1 - expected) / len(weight))
        ratio.append((share[row] - expected) / np.hypot(spread, sigma[row]))
    assert np.abs(ratio).max() < SIGMAS


def test_small_bundles_behind_obstructions_are_seen_by_as_many_rays_as_it_takes() -> None:
    """A large obstruction and three blades leave slivers of the bundles, before which a card stands, against uniform
    rays over all of the rear surface. None that has light is unknown, and none that light reaches is hidden.
    """
    shapes = {5: {"blades": 3, "aperture_rotation_deg": 20.0}, 0: {"inner_semi_diameter_mm": 16.0}}
    camera = rigs.reshaped(rigs.conventional(12.0, 400, 300, 0.02), shapes)
    rig, pose, card_mm = rig_of(camera), rigs.facing(440.0, 25.0), 330.0
    rows, planes = solved_rows(rig, Target(Checkerboard(columns=4, rows=3, square_mm=5.0, white=1.0)), pose)
    x_px, on = rows.solutions.xy_px, planes[rows.solutions.point]
    around = Surroundings([(Target(BOARD), pose)], [(half_plane(0.0, 0.3, card_mm), HERE)])
    share, _ = visibility(rig, around, 0, np.full(len(x_px), -1), x_px, on)
    assert len(x_px) == 12 and not np.isnan(share).any()
    judged = [2, 4, 7, 9]  # two that the card hides in part, one that is free, one that is hidden
    share, x_px = share[judged], x_px[judged]
    rear, expected = camera.prescription.surfaces[-1].semi_diameter_mm, np.empty((2, len(judged)))
    points = np.random.default_rng(4).uniform(-rear, rear, (1 << 18, 2))
    for number, start in enumerate(rig.tracer.positions_mm(*x_px.T)):
        way = np.column_stack(
            [points - start, np.full(len(points), rig.tracer.table[0, VERTEX] - rig.tracer.sensor_z_mm)]
        )
        way /= np.linalg.norm(way, axis=1, keepdims=True)
        begin = np.tile([*start, rig.tracer.sensor_z_mm], (len(points), 1))
        position, direction, passes = traced(rig.tracer.table, begin, way)
        position, direction, weight = position[passes], direction[passes], way[passes, 2] ** 4
        hit = position + direction * ((card_mm - position[:, 2]) / direction[:, 2])[:, None]
        free = hit[:, 0] * math.cos(0.3) + hit[:, 1] * math.sin(0.3) < 0.0
        expected[:, number] = np.sum(weight * free) / np.sum(weight), len(weight)
    likely, count = expected[0], np.minimum(expected[1], 256)
    # Of nothing that arrives neither trace knows more than one ray in all.
    spread = np.sqrt(2 * np.maximum(likely * (1 - likely), 1 / count) / count)
    assert (np.abs(share - likely) < SIGMAS * spread).all()
    assert np.any((likely > 0.01) & (likely < 0.2) & (share > 0)) and expected[1].min() < 1000


def test_more_rays_go_where_a_row_is_partly_hidden() -> None:
    """A look decides between all, nothing and partly; only then are there sixteen times as many rays."""
    around = Surroundings([(Target(BOARD), rigs.facing(FOCUS_MM))], [(half_plane(0.7, 0.3, 150.0), HERE)])
    point, x_px = np.array([[0.0, 0.0, FOCUS_MM]]), np.array([[2.0, 2.0]])
    errors = {rays: [] for rays in (LOOK_RAYS, RAYS)}
    expected = share_of_segment(0.7 / (1 - 150.0 / FOCUS_MM))
    bundle = PointBundles(np.array([-1]), x_px, facing_planes(point))
    for seed in range(10):
        rig = ideal(seed)
        assert at(rig, around, point, x_px)[0] == shares(rig, around, 0, bundle, RAYS)[0]
        for rays, found in errors.items():
            found.append(shares(rig, around, 0, bundle, rays)[0][0] - expected)
    look, whole = (np.sqrt(np.mean(np.square(found))) for found in errors.values())
    assert whole < look / 4


@pytest.mark.parametrize("kind", few(["plenoptic"], "conventional"))
def test_the_light_in_an_image_falls_as_the_visibility(kind: str) -> None:
    """A white card that fills the bundles, with a dark and with a bright edge before it: I / I0 of every pixel.

    I0 is the white card alone; of a plenoptic camera the light through a pixel's own microlens. Pixels are small, and
    across them the share is linear but for little.
    """
    rig = rig_of(rigs.plenoptic(1.0, 8, 8, 0.001)) if kind == "plenoptic" else ideal()
    distance_mm = 440.0 if rig.images else FOCUS_MM
    pose, samples = rigs.facing(distance_mm), 1 << 14
    card = Target(Checkerboard(columns=20, rows=19, square_mm=4.0, white=1.0, black=1.0))
    wall, sensor = half_plane(0.1, 0.3, 100.0), rig.tracer.camera.sensor

    def own_light(*occluders) -> np.ndarray:
        light = TargetLight([(card, pose)], 0.0, occluders)
        whole, foreign = irradiance_and_crosstalk(rig, samples, light.radiance)
        return whole - foreign

    free = own_light()
    dark = own_light((wall, HERE)) / free
    bright = own_light((dataclasses.replace(wall, radiance=0.25), HERE)) / free
    across, down = np.arange(float(sensor.width_px)), np.arange(float(sensor.height_px))
    x_px = np.stack(np.meshgrid(across, down), axis=-1).reshape(-1, 2)
    planes = facing_planes(np.tile([0.0, 0.0, distance_mm], (len(x_px), 1)))
    lens = rig.microlens_at(rig.tracer.positions_mm(*x_px.T))
    share, _ = visibility(rig, Surroundings([(card, pose)], [(wall, HERE)]), 0, lens, x_px, planes)
    assert share.min() > 0.3 and share.max() < 0.9
    np.testing.assert_allclose(dark.ravel(), share, rtol=0, atol=LIT_SHARE)
    np.testing.assert_allclose(bright.ravel(), share + 0.25 * (1 - share), rtol=0, atol=LIT_SHARE)
