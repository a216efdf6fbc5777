"""Laws of the optional columns: the chief ray, the saddle of a corner, the centroid of a disc."""

import dataclasses

import numpy as np
import pytest
from laws import rigs
from laws.solving import Case, board, case_of, off_axis, saddles
from naive import dense_corner, textbook
from scipy.optimize import root
from tolerances import (
    CENTROID_PX,
    DENSE_CENTROID_PX,
    DENSE_SADDLE_F2_PX,
    DENSE_SADDLE_PX,
    HOMED_PX,
    SADDLE_PX,
    TEXTBOOK_MM,
)

from pipeline.camera.parts.camera import Sensor
from pipeline.camera.rig import Rig
from pipeline.camera.tracer import Tracer
from pipeline.frames import apply, inverse
from pipeline.optics.kernels import trace_rays
from pipeline.optics.prescription import Prescription, Surface
from pipeline.optics.table import motion_of, towards_sensor, unbounded
from pipeline.targets.patterns.checkerboard import Checkerboard
from pipeline.targets.patterns.circles import CircleGrid
from pipeline.targets.target import Target
from pipeline.truth.direct.candidates import chief_points
from pipeline.truth.planes import Planes, tangent_planes
from pipeline.truth.positions import centroid as centroids
from pipeline.truth.positions.centroid import centroid
from pipeline.truth.positions.column_sets import column_set, corners_of
from pipeline.truth.positions.saddle import corner_plane, saddle

FLIP = np.array([1.0, -1.0, -1.0])


@pytest.mark.parametrize("is_displaced", [False, True])
def test_chief_positions_are_where_forward_chief_rays_land(is_displaced: bool) -> None:
    """From the point through the lens in the other direction, aimed at the stop's centre by SciPy."""
    camera = off_axis(8.0)
    camera = rigs.displaced(camera) if is_displaced else camera
    case = case_of(camera, board(), rigs.facing(440.0, 20.0, 27.0, 5.0))
    positions = chief_points(
        case.rig.tracer, case.rig.microlens(case.solutions.cell), case.j_px, case.planes[case.solutions.point]
    )
    table, stop = unbounded(towards_sensor(camera.prescription)), camera.prescription.stop_index

    def ray(rows: np.ndarray, start: np.ndarray, aim: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        position, way = start[None].copy(), np.array([*aim, table[0, 0]])[None] - start
        way /= np.linalg.norm(way)
        trace_rays(rows, position, way, np.ones(1))
        return position[0], way[0]

    def beside(aim: np.ndarray, start: np.ndarray) -> np.ndarray:
        """Where the ray meets the stop, from its centre."""
        reached, _ = ray(table[: stop + 1], start, aim)
        return apply(inverse(motion_of(table[stop])), reached[None])[0, :2]

    for point, x in zip(case.solutions.point, positions, strict=True):
        start = case.planes[point, 0] * FLIP
        position, way = ray(table, start, root(beside, np.zeros(2), args=(start,)).x)
        landed = (position + (camera.sensor_distance_mm - position[2]) / way[2] * way) * FLIP
        assert case.rig.tracer.pixels_at(landed[None, :2])[0] == pytest.approx(x, abs=HOMED_PX)
    assert np.hypot(*(positions - case.j_px).T).min() > 1  # 2.3 px of coma at this stop: Tronnier, 8 mm off the axis


def test_behind_a_thin_microlens_the_ray_through_its_vertex_meets_the_point() -> None:
    camera = rigs.plenoptic(1.0, 64, 64)
    case = case_of(camera, board(0.5), rigs.facing(420.0, 20.0))
    lens = case.rig.microlens(case.solutions.cell)
    x = chief_points(case.rig.tracer, lens, case.j_px, case.planes[case.solutions.point])
    assert len(x) > 10
    start, vertex = case.rig.tracer.positions_mm(*x.T), case.rig.tracer.vertices_mm[lens]
    position, way, *_ = textbook.sent(camera, start, vertex)
    missed = textbook.at_plane(position, way, case.pose) - case.target.points().position_mm[case.solutions.point, :2]
    assert np.abs(missed).max() < 1e4 * TEXTBOOK_MM  # Newton's steps end at 1e-10 px, of 0.2 mm each


def test_on_the_axis_all_positions_are_one() -> None:
    """A centred lens, an upright target, a point on the axis: by symmetry the coma is gone, whatever the blur."""
    camera = dataclasses.replace(off_axis(8.0), sensor_distance_mm=131.0)
    case = case_of(camera, Target(Checkerboard(columns=1, rows=2, square_mm=1.5)), rigs.facing(434.4, 0.0, 0.0, 0.75))
    case = rows_of(case, int(np.argmin(np.hypot(*(case.j_px - 2000).T))))
    assert saddles(case)[0] == pytest.approx(case.j_px[0], abs=SADDLE_PX)
    assert case.j_px[0] == pytest.approx([2000, 2000], abs=HOMED_PX)


def test_a_sharp_bundles_saddle_is_j() -> None:
    """Stop down: bundle and coma shrink with it, and the pixel alone smooths the corner."""
    apart = []
    for stop in (2.0, 1.0, 0.5):
        case = rows_of(case_of(off_axis(stop), board(), rigs.facing(434.4, 0.0, 27.0)), 0)
        apart.append(float(np.abs(saddles(case) - case.j_px).max()))
    assert apart[2] < apart[1] < apart[0]
    assert apart[2] < 0.01


def test_white_and_black_may_change_places() -> None:
    """Without fall-off of light over a pixel, the saddle of the opposite corner is the same."""
    case = case_of(off_axis(4.0), board(), rigs.facing(436.0, 0.0, 27.0))
    point = case.solutions.point[0]
    edges = corners_of(case.target).edges[point] @ case.pose[:3, :3].T
    both = [
        saddle(case.rig.tracer, -1, case.j_px[0], corner_plane(case.planes[point], e), 1.0).x_px
        for e in (edges, np.stack([edges[1], -edges[0]]))
    ]
    assert both[0] == pytest.approx(both[1], abs=SADDLE_PX)


def rows_of(case: Case, *rows: int) -> Case:
    """A case with some of its rows alone: the saddle of each takes half a second."""
    return dataclasses.replace(case, solutions=case.solutions.only(np.array(rows)))


def dense_saddle(case: Case, i: int, found: np.ndarray, reach_px: float, rays: int) -> np.ndarray:
    """The saddle of a corner that is rendered about the saddle found of row i."""
    point, cell, camera, lens = case.solutions.point[i], case.solutions.cell[i], case.rig.tracer.camera, None
    if camera.microlenses:
        focal = camera.microlenses.focal_lengths_mm[case.rig.tracer.lattice.type[cell]]
        lens = case.rig.tracer.vertices_mm[cell], focal
    edges, middle = corners_of(case.target).edges[point], case.target.points().position_mm[point, :2]
    along = np.linalg.inv(edges[:, :2].T)

    def colour(hit: np.ndarray) -> np.ndarray:
        return ((hit - middle) @ along.T).prod(axis=1) > 0

    near = np.round(found * dense_corner.SQUARES) / dense_corner.SQUARES
    light = dense_corner.rendered(camera, near, np.full(2, 2), case.pose, colour, rays, lens)
    return near + dense_corner.saddle_of(light, reach_px)


def test_the_saddle_is_that_of_a_rendered_corner() -> None:
    """f/7.7, 25 degrees, 4 mm out of focus: blur of 1 px, saddle 0.2 px from J."""
    camera = rigs.bare(rigs.tronnier(4.5), Sensor(width_px=641, height_px=641, pitch_mm=0.01), 131.81, (400.0, 480.0))
    case = rows_of(case_of(camera, board(0.5), rigs.facing(430.0, 25.0, -6.0, 4.0)), 0)
    found = saddles(case)[0]
    assert np.hypot(*(found - case.j_px[0])) > 10 * DENSE_SADDLE_PX
    assert found == pytest.approx(dense_saddle(case, 0, found, 0.6, 1 << 18), abs=DENSE_SADDLE_PX)


@pytest.mark.heavy
def test_at_f2_the_saddle_is_that_of_a_rendered_corner() -> None:
    """8 mm off the axis coma spreads over 12 px, and the saddle lies 10 px from J."""
    case = rows_of(case_of(off_axis(17.1), board(0.5), rigs.facing(434.4, 0.0, 27.0)), 0)
    found = saddles(case)[0]
    assert np.hypot(*(found - case.j_px[0])) > 9
    assert found == pytest.approx(dense_saddle(case, 0, found, 1.0, 1 << 21), abs=DENSE_SADDLE_F2_PX)


@pytest.mark.heavy
def test_at_the_edge_of_a_micro_image_the_saddle_is_that_of_a_rendered_corner() -> None:
    """There light falls off within pixels, and moves the saddle of white and black corners to different sides."""
    case = rows_of(case_of(rigs.plenoptic(2.0), board(0.8), rigs.facing(420.0, 30.0)), 16, 54)  # they move farthest
    found = saddles(case)
    for i in range(2):
        assert np.hypot(*(found[i] - case.j_px[i])) > 10 * DENSE_SADDLE_PX
        dense = dense_saddle(case, i, found[i], 0.5, 1 << 20)  # few rays pass near the edge
        assert found[i] == pytest.approx(dense, abs=DENSE_SADDLE_PX)


def discs(radius_mm: float) -> Target:
    return Target(CircleGrid(columns=2, rows=1, spacing_mm=3 * radius_mm, diameter_mm=2 * radius_mm))


def test_through_a_small_hole_the_centroid_is_that_of_an_ellipse() -> None:
    """Perspective maps a circle to a conic; its centre is the polar of the vanishing line. The hole's cos^4 adds its
    gradient times the ellipse's second moments, a quarter of its squared semi-axes."""
    pitch, h = 0.005, 50.0
    hole = Prescription(surfaces=(Surface(semi_diameter_mm=1e-4, is_stop=True),))
    camera = rigs.bare(hole, Sensor(width_px=2001, height_px=2001, pitch_mm=pitch), h, (50.0, 150.0))
    radius, pose = 1.0, rigs.facing(100.0, 40.0, 3.0, 2.0)
    planes = tangent_planes(pose, discs(radius).points().position_mm)
    for origin, first, second, normal in planes:
        centre_px = h * origin[:2] / origin[2] / pitch + 1000
        found = centroid(Rig(Tracer(camera), None), 0, centre_px, np.stack([origin, first, second, normal]), radius)
        homography = h * np.stack([first, second, origin], axis=1) * [[1], [1], [1 / h]]  # sensor mm, upright
        conic = np.linalg.inv(homography).T @ np.diag([1.0, 1.0, -(radius**2)]) @ np.linalg.inv(homography)
        centre = -np.linalg.solve(conic[:2, :2], conic[:2, 2])
        level = centre @ conic[:2, :2] @ centre - conic[2, 2]
        moments = np.linalg.inv(conic[:2, :2] / level) / 4
        shifted = centre + moments @ (-4 * centre / (h**2 + centre @ centre))
        assert found.x_px == pytest.approx(shifted / pitch + 1000, abs=CENTROID_PX)
        assert np.hypot(*(found.x_px - centre_px)) > 0.3


@pytest.mark.parametrize(("stop", "radius"), [(4.0, 5.0), pytest.param(17.1, 1.0, marks=pytest.mark.heavy)])
def test_the_centroid_is_that_of_a_rendered_disc(stop: float, radius: float) -> None:
    """Discs of 30 px and of 6 px; the second is blurred by defocus and coma."""
    sensor = Sensor(width_px=401, height_px=401, pitch_mm=0.05)
    camera = rigs.bare(rigs.tronnier(stop), sensor, 131.81, (400.0, 480.0))
    case = case_of(camera, discs(radius), rigs.facing(438.0, 30.0, 27.0, 3.0))
    point, x = case.solutions.point[0], case.j_px[0]
    found = centroid(case.rig, 0, x, case.planes[point], radius)
    middle = case.target.points().position_mm[point, :2]
    near, half = np.round(x), np.full(2, 36 if radius == 5 else 12)

    def colour(hit: np.ndarray) -> np.ndarray:
        return np.hypot(*(hit - middle).T) < radius

    light = dense_corner.rendered(camera, near, half, case.pose, colour, 1 << 18)
    places = (np.arange(len(light)) - (len(light) - 1) / 2) / dense_corner.SQUARES
    dense = near + np.array([light.sum(axis=0) @ places, light.sum(axis=1) @ places]) / light.sum()
    assert found.x_px == pytest.approx(dense, abs=DENSE_CENTROID_PX)
    assert stop == 17.1 or np.hypot(*(found.x_px - x)) > 10 * DENSE_CENTROID_PX


@pytest.mark.heavy
def test_of_a_fast_lens_a_centroid_is_known_to_a_thousandth_of_a_pixel(monkeypatch: pytest.MonkeyPatch) -> None:
    """At f/2, where coma is wide: with three and four rings it erred by 1.7e-3 px, and stated 0.035."""
    case = case_of(off_axis(17.1, 0.01), discs(1.0), rigs.facing(434.0, 12.0, 40.0, 20.0))
    given = case.rig, 0, case.j_px[0], case.planes[case.solutions.point[0]], 1.0
    found = centroid(*given)
    monkeypatch.setattr(centroids, "_FINE", (7, 12, 192, 6, 24))
    assert np.hypot(*(found.x_px - centroid(*given).x_px)) < found.error_px < 1e-3


def test_cells_are_empty_where_nothing_is_defined() -> None:
    """A disc is no corner and a corner no disc; a disc that the image cuts has no centroid."""
    camera = rigs.bare(rigs.tronnier(4.0), Sensor(width_px=101, height_px=101, pitch_mm=0.05), 131.81, (400.0, 480.0))
    dots = case_of(camera, discs(2.0), rigs.facing(434.4, 0.0, 4.0, 0.0))
    assert np.isnan(saddles(dots)).all()
    cut = column_set("centroid", dots.rig, dots.target, dots.pose, Planes(dots.planes), dots.solutions)
    assert np.isnan(cut.x_px[:, 0]).tolist() == (dots.j_px[:, 0] > 80).tolist()
    assert "disc not whole in image or cell 1" in cut.note.text
    corners = case_of(camera, board(), rigs.facing(434.4))
    none = column_set("centroid", corners.rig, corners.target, corners.pose, Planes(corners.planes), corners.solutions)
    assert np.isnan(none.x_px).all()
    assert "not a disc 2" in none.note.text
