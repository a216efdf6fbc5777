"""Claim: bent surfaces are what their formulas say, and a ray that is aimed at a point of one sees the colour there."""

import numpy as np
import pytest
from laws import rigs
from places import ROOT
from scipy.interpolate import RegularGridInterpolator
from targets.examples import name_of
from tolerances import ROUNDING_MM

from pipeline.frames import apply
from pipeline.render.glow import TargetLight
from pipeline.render.surroundings import MeshScene
from pipeline.scene.load import load
from pipeline.targets.mesh import MeshTarget, Occluder
from pipeline.targets.patterns.checkerboard import Checkerboard
from pipeline.targets.patterns.lines import Lines
from pipeline.targets.patterns.pattern import TargetError
from pipeline.targets.patterns.tags import Charuco
from pipeline.targets.preview import preview_faces, preview_picture
from pipeline.targets.surfaces import Cube, Cylinder, Flat, HeightMap, Stairs, Warped
from pipeline.targets.target import Target

BOARD = Checkerboard(columns=6, rows=5, square_mm=4.0, white=0.9, black=0.2)
RNG = np.random.default_rng(3)
MAP = HeightMap(resolution=(6, 5), heights_mm=tuple(RNG.uniform(-0.5, 0.5, 30)))
SINGLE = [Flat(), Warped(deflection_mm=(1.5, -0.7)), MAP, Cylinder(radius_mm=21.0), Cylinder(radius_mm=-40.0)]


@pytest.mark.parametrize("surface", SINGLE, ids=name_of)
def test_axes_lie_along_the_surface(surface) -> None:
    """Central differences of the surface by the chart span the tangent plane; the normal is out of the front."""
    (patch,) = Target(BOARD, surface).patches()
    xy = RNG.uniform(-1, 1, (50, 2)) * [12.0, 10.0]
    _, axes, _ = patch.surface_at(xy)
    assert np.abs(axes.transpose(0, 2, 1) @ axes - np.eye(3)).max() < 1e-14
    h = 1e-5
    for step in ([h, 0.0], [0.0, h]):
        along = (patch.surface_at(xy + step)[0] - patch.surface_at(xy - step)[0]) / (2 * h)
        assert np.abs(np.sum(along * axes[:, :, 2], axis=1)).max() < 1e-9
    assert (np.linalg.det(axes) > 0).all()
    assert (axes[:, 2, 2] > 0).all()


def test_a_warp_is_the_printed_parabola_over_the_whole_sheet() -> None:
    target = Target(BOARD, Warped(deflection_mm=(1.5, -0.7)))
    points = target.points()
    x, y, z = points.position_mm.T
    assert z == pytest.approx(1.5 * (1 - (x / 18.0) ** 2) - 0.7 * (1 - (y / 16.0) ** 2), abs=1e-14)
    assert points.nominal_mm[:, 2].tolist() == [0.0] * 30
    # Curvature of the vertex of a parabola, from its two coefficients.
    (patch,) = target.patches()
    assert patch.surface_at(np.zeros((1, 2)))[2][0] == pytest.approx(2 * 1.5 / 18.0**2, rel=1e-12)


def test_the_preview_of_a_bent_board_has_the_parabola_and_straight_lines_between_heights() -> None:
    """The printed formula, and SciPy's interpolation: all that viewers see of a bent sheet are such points."""
    x, y, z = preview_faces(Target(BOARD, Warped(deflection_mm=(1.5, -0.7)))).points_mm.T
    assert z == pytest.approx(1.5 * (1 - (x / 18.0) ** 2) - 0.7 * (1 - (y / 16.0) ** 2), abs=1e-12)
    assert (np.abs(x).max(), np.abs(y).max()) == pytest.approx((18.0, 16.0), rel=1e-12)
    x, y, z = preview_faces(Target(BOARD, MAP)).points_mm.T
    from_below = np.reshape(MAP.heights_mm, (5, 6))[::-1]
    measured = RegularGridInterpolator((np.linspace(-16, 16, 5), np.linspace(-18, 18, 6)), from_below)
    assert z == pytest.approx(measured(np.clip(np.stack([y, x], axis=1), [-16, -18], [16, 18])), abs=1e-12)


def test_a_height_map_passes_through_its_heights_and_is_exact_for_parabolas() -> None:
    (patch,) = Target(BOARD, MAP).patches()
    x, y = np.meshgrid(np.linspace(-18, 18, 6), np.linspace(16, -16, 5))
    points, _, _ = patch.surface_at(np.stack([x.ravel(), y.ravel()], axis=1))
    assert points[:, 2] == pytest.approx(MAP.heights_mm, abs=1e-12)

    def bowl(x, y):
        return 0.01 * x**2 - 0.02 * x * y + 0.005 * y**2 + 0.1 * x - 0.3

    (patch,) = Target(BOARD, HeightMap(resolution=(6, 5), heights_mm=tuple(bowl(x, y).ravel()))).patches()
    # One cell from the edge on, where all sixteen heights are measured ones.
    inner = RNG.uniform(-1, 1, (200, 2)) * [18 * 3 / 5, 16 / 2]
    points, axes, curvature = patch.surface_at(inner)
    assert points[:, 2] == pytest.approx(bowl(*inner.T), abs=1e-12)
    slope = np.stack([0.02 * inner[:, 0] - 0.02 * inner[:, 1] + 0.1, -0.02 * inner[:, 0] + 0.01 * inner[:, 1]], axis=1)
    assert -axes[:, :2, 2] / axes[:, 2:, 2] == pytest.approx(slope, abs=1e-12)
    flat = np.argmin(np.linalg.norm(slope, axis=1))
    largest = np.abs(np.linalg.eigvalsh([[0.02, -0.02], [-0.02, 0.01]])).max()
    assert curvature[flat] == pytest.approx(largest, rel=0.05)


def test_a_cylinder_keeps_lengths_and_its_points_are_one_radius_from_the_axis() -> None:
    for radius in (21.0, -40.0):
        points = Target(BOARD, Cylinder(radius_mm=radius)).points()
        from_axis = points.position_mm + np.array([0, 0, radius])
        assert np.hypot(from_axis[:, 0], from_axis[:, 2]) == pytest.approx(abs(radius), rel=1e-14)
        angles = np.arctan2(from_axis[:, 0] / radius, from_axis[:, 2] / radius) * radius
        assert angles == pytest.approx(BOARD.marks().xy_mm[:, 0], abs=1e-12)
        assert points.curvature_per_mm == pytest.approx(1 / abs(radius))


@pytest.mark.parametrize("surface", [*SINGLE, Cube(edge_mm=40.0), Stairs(steps=3, depth_mm=7.0)], ids=name_of)
@pytest.mark.parametrize("tilt_deg", [pytest.param(0.0, marks=pytest.mark.heavy), 25.0])
def test_a_ray_sees_the_colour_of_the_point_that_it_is_aimed_at(surface, tilt_deg: float) -> None:
    """Random points of all patches, and points a nanometre to either side of an edge; away from the ends of patches,
    and where nothing else of the target stands before them. Backs are black."""
    target, pose = Target(BOARD, surface), rigs.facing(400.0, tilt_deg)
    light, seen = TargetLight([(target, pose)], 0.5), 0
    for patch, pattern in surface.patches(BOARD):
        half = np.array([patch.drawing.half_x_mm, patch.drawing.half_y_mm]) - 1e-3
        xy = RNG.uniform(-1, 1, (4000, 2)) * half
        if pattern:
            # Beside the upright edges of squares: columns are 4 mm wide about the centre.
            xy[:2000, 0] = 4.0 * RNG.integers(-3, 4, 2000) + 2.0 * (pattern.columns % 2 - 1)
            xy[:2000, 0] += np.where(RNG.uniform(size=2000) < 0.5, -1e-6, 1e-6)
        xy = xy[(np.abs(xy) < half).all(axis=1)]
        points, axes, _ = patch.surface_at(xy)
        aims = apply(pose @ patch.target_from_patch, points)
        normals = axes[:, :, 2] @ (pose @ patch.target_from_patch)[:3, :3].T
        start = np.column_stack([RNG.uniform(-5, 5, (len(xy), 2)), np.zeros(len(xy))])
        way = aims - start
        facing = np.sum(way * normals, axis=1) < -1e-2 * np.linalg.norm(way, axis=1)
        free = facing & _nothing_before(light, start, way)
        found = light.radiance(start[free], way[free])
        expected = np.where(patch.drawing.whiteness(*xy[free].T) == 1, 0.9, 0.2)
        assert np.array_equal(found, expected)
        seen += free.sum()
        # From behind: the same points along the same lines, the other way.
        behind = light.radiance(start[free] + 1.5 * way[free], -way[free])
        assert set(behind) <= {0.0, 0.2, 0.9}
    assert seen > 3000


def _nothing_before(light: TargetLight, start: np.ndarray, way: np.ndarray) -> np.ndarray:
    """Rays that stop a tenth of a millimetre before their aim meet nothing: by the meshes, triangle by triangle."""
    corners = np.concatenate([one.mesh_in_vision() for one in light._lights])
    hit = MeshScene([corners]).first_hit(start, way)
    distance = np.full(len(way), np.inf)
    some = hit >= 0
    a, b, c = corners[hit[some]].transpose(1, 0, 2)
    normal = np.cross(b - a, c - a)
    distance[some] = np.sum((a - start[some]) * normal, axis=1) / np.sum(way[some] * normal, axis=1)
    return distance > 1 - 0.1 / np.linalg.norm(way, axis=1)


def test_a_flat_board_is_black_from_behind_and_hides_what_stands_behind_it() -> None:
    near, far = rigs.facing(400.0), rigs.facing(420.0)
    white = Target(Lines(columns=1, rows=0, spacing_mm=40.0, width_mm=1.0, white=0.8))
    light = TargetLight([(white, far), (Target(BOARD), near)], 0.3)
    rays = np.array([[-12.0, 0.0, 400.0], [-28.5, 0.0, 420.0], [100.0, 0.0, 400.0]])
    assert light.radiance(np.zeros((3, 3)), rays).tolist() == [
        float(BOARD.radiance(np.array([-12.0]), np.array([0.0]))[0]),
        0.8,
        0.3,
    ]
    away = near @ np.diag([-1.0, 1.0, -1.0, 1.0])
    assert TargetLight([(Target(BOARD), away)], 0.3).radiance(np.zeros((1, 3)), rays[:1]).tolist() == [0.0]


def test_points_of_a_cube_count_on_from_face_to_face_and_face_outwards() -> None:
    board = Charuco(columns=3, rows=3, square_mm=5.0, marker_mm=4.0, dictionary="4x4_50")
    target = Target(board, Cube(edge_mm=32.0))
    points = target.points()
    assert len(points.frames) == 6
    assert points.plane.tolist() == np.repeat(np.arange(6), 9).tolist()
    outwards = points.axes[:, :, 2]
    assert np.sum(points.position_mm * outwards, axis=1) == pytest.approx(np.full(54, 16.0), abs=ROUNDING_MM)
    first = points.position_mm[:9] - [0, 0, 16.0]
    assert first == pytest.approx(np.pad(board.marks().xy_mm, ((0, 0), (0, 1))), abs=1e-14)
    tags = [pattern.first_tag for _, pattern in target.surface.patches(board)]
    assert tags == [0, 8, 16, 24, 32, 40]
    # Turning the right face to the front turns its points to where those of the front are.
    turn = np.array([[0.0, 0, -1], [0, 1, 0], [1, 0, 0]])
    assert points.position_mm[9:18] @ turn.T == pytest.approx(points.position_mm[:9], abs=1e-14)


def test_steps_are_the_pattern_moved_up_and_back() -> None:
    points = Target(BOARD, Stairs(steps=3, depth_mm=7.0)).points()
    assert len(points.frames) == 3
    expected = points.position_mm[:30] + np.array([[[0, 32.0 * i, -7.0 * i]] for i in range(3)])
    assert points.position_mm == pytest.approx(expected.reshape(-1, 3), abs=1e-13)


def test_a_mesh_shows_its_colours_and_its_points_know_their_distance() -> None:
    target = MeshTarget(
        vertices_mm=((-10.0, -10.0, 0.0), (10.0, -10.0, 0.0), (10.0, 10.0, 4.0), (-10.0, 10.0, 4.0)),
        triangles=((0, 1, 2), (0, 2, 3)),
        albedo=((0.2, 0.4, 0.6), (0.5, 0.5, 0.5)),
        points_mm=((5.0, 0.0, 2.0), (-5.0, 0.0, 2.0), (0.0, 0.0, 3.0), (12.0, -10.0, 0.0)),
        normals=((0.0, -2.0, 10.0),) * 4,
    )
    # Height 2 + y / 5: a plane that leans back; a millimetre above it counts along its normal, 10 / sqrt(104).
    assert target.distances_mm() == pytest.approx([0, 0, 10 / 104**0.5, 2.0], abs=1e-12)
    light = TargetLight([(target, rigs.facing(400.0))], 0.1)
    aim = np.array([[10 / 3, -10 / 3, 4 / 3], [-5.0, 5.0, 3.0], [0.0, 11.0, 4.2]])
    way = apply(rigs.facing(400.0), aim)
    found = light.radiance(np.zeros((3, 3)), way)
    assert found == pytest.approx([0.4, 0.5, 0.1], abs=1e-12)
    axes = target.points().axes
    assert np.abs(axes.transpose(0, 2, 1) @ axes - np.eye(3)).max() < 1e-15
    assert axes[0, :, 2] == pytest.approx(np.array([0.0, -2.0, 10.0]) / 104**0.5)


@pytest.mark.parametrize(
    ("surface", "words"),
    [
        (Cylinder(radius_mm=5.0), "around"),
        (Cube(edge_mm=20.0), "too short"),
    ],
)
def test_what_does_not_fit_is_refused(surface, words: str) -> None:
    with pytest.raises(TargetError, match=words):
        Target(BOARD, surface)


def test_meshes_are_as_near_to_their_surfaces_as_they_say() -> None:
    """Middles of triangles' edges against the surface there."""
    for surface in SINGLE[1:]:
        (patch,) = Target(BOARD, surface).patches()
        corners = patch.mesh()
        middle = (corners[:, 0] + corners[:, 1]) / 2
        if isinstance(surface, Cylinder):
            off = np.abs(np.hypot(middle[:, 0], middle[:, 2] + surface.radius_mm) - abs(surface.radius_mm))
        else:
            off = np.abs(patch.surface_at(middle[:, :2])[0][:, 2] - middle[:, 2])
        assert off.max() <= patch.mesh_sag_mm() * (1 + 1e-6) + 1e-12
        assert patch.mesh_sag_mm() <= 1e-4


VERTICES = ((0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0))


@pytest.mark.parametrize("face", [(0, 1, 3), (0, 1, -1)], ids=["behind the last", "before the first"])
def test_a_face_that_names_a_vertex_beyond_the_mesh_is_refused_also_among_others(face) -> None:
    for faces in (((0, 1, 2), face), (face, (0, 1, 2))):
        for rest in ({}, {"albedo": VERTICES[:2], "points_mm": VERTICES[:1], "normals": VERTICES[1:2]}):
            with pytest.raises(TargetError, match="beyond the 3 of the mesh") as error:
                (MeshTarget if rest else Occluder)(vertices_mm=VERTICES, triangles=faces, **rest)
            assert error.value.code == "bad-mesh"


SMALL = Checkerboard(columns=4, rows=3, square_mm=2.0, white=0.9, black=0.1)


FLAT = [
    *("aprilgrid_6x6", "charuco_8x5", "checkerboard_4x7", "circles_7x5", "circles_asymmetric_4x11", "deltille_7x5"),
    *("lines_7x5", "siemens_star_36", "slanted_edge_5deg", "stars_7x5"),
]


@pytest.mark.parametrize("name", FLAT)
def test_the_picture_of_a_target_has_the_colours_of_its_pattern(name):
    """In all pixels but those whose middle lies on an edge; the first row is the top."""
    target, share = load(ROOT / f"stages/targets/{name}.usda").targets[0].target, (2 * np.arange(300) + 1) / 300 - 1
    drawing = target.pattern.drawing
    x, y = np.meshgrid(drawing.half_x_mm * share, -drawing.half_y_mm * share)
    expected = target.pattern.radiance(x.ravel(), y.ravel()).reshape(x.shape)
    assert np.mean(preview_picture(target, 300) == expected) > 0.999 and np.ptp(expected) > 0.5


@pytest.mark.parametrize("surface", [Flat(), Cube(edge_mm=20.0), Cylinder(radius_mm=20.0)], ids=name_of)
def test_points_of_a_preview_lie_on_the_picture_where_they_lie_on_their_sheet(surface):
    """Pictures of patches stand side by side."""
    target = Target(SMALL, surface)
    faces, patches = preview_faces(target), target.patches()
    points, sheets = (rows.reshape(len(patches), -1, rows.shape[1]) for rows in (faces.points_mm, faces.sheet))
    for number, patch in enumerate(patches):
        half = np.array([patch.drawing.half_x_mm, patch.drawing.half_y_mm])
        chart = (2 * (sheets[number] * [len(patches), 1] - [number, 0]) - 1) * half
        there = apply(patch.target_from_patch, patch.surface_at(chart)[0])
        np.testing.assert_allclose(points[number], there, rtol=0, atol=1e-9)
        assert np.array_equal(np.unique(chart.round(9), axis=0)[[0, -1]], [-half, half])


def test_the_picture_of_very_many_faces_has_a_width_that_viewers_show():
    target = Target(SMALL, Stairs(steps=3000, depth_mm=0.1))
    picture = preview_picture(target, 1024)
    assert picture.shape[1] == picture.shape[0] * len(target.patches()) <= 1 << 14


def test_the_first_square_of_a_board_is_black_at_the_top_left_of_its_picture():
    picture = preview_picture(Target(SMALL), 7 * 100)  # four columns of corners make five squares and two margins
    assert picture[7 * 100 // 6 + 10, 100 + 10] == 0.1
    assert picture[-1, 0] == 0.9 == picture[0, 0]
