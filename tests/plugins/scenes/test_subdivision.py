"""Subdivision surfaces are the splines that they generalise, else what their rule leads to; solids have a volume."""

import numpy as np
import pytest
from scipy.interpolate import BSpline
from shorter import few_cases

from pipeline.plugins.scenes.reading import solids
from pipeline.plugins.scenes.reading.cage import Cage, NotManifold
from pipeline.plugins.scenes.reading.subdivision import (
    BILINEAR,
    CATMULL_CLARK,
    LOOP,
    Levels,
    _Rules,
    limit_normals,
)
from pipeline.targets.mesh import _distances

RNG = np.random.default_rng(11)


def cage(faces, vertices: int, sharp: float = 0.0) -> Cage:
    count = np.array([len(face) for face in faces])
    vertex = np.concatenate([np.array(face, int) for face in faces])
    return Cage(vertex, count, np.full(len(vertex), sharp), np.zeros(vertices))


def grid(n: int) -> Cage:
    """Quads between n x n vertices, the first index along x."""
    at = np.arange(n * n).reshape(n, n)
    quads = np.stack([at[:-1, :-1], at[1:, :-1], at[1:, 1:], at[:-1, 1:]], axis=-1).reshape(-1, 4)
    return cage(quads, n * n)


def cube(sharp: float = 0.0) -> tuple[Cage, np.ndarray]:
    points = np.array([(x, y, z) for z in (-1.0, 1.0) for y in (-1.0, 1.0) for x in (-1.0, 1.0)])
    faces = [(0, 2, 3, 1), (4, 5, 7, 6), (0, 1, 5, 4), (2, 6, 7, 3), (0, 4, 6, 2), (1, 3, 7, 5)]
    return cage(faces, 8, sharp), points


def fan(scheme: str, n: int, is_open: bool) -> Cage:
    """n faces around vertex 0: then its neighbours, then for quads the vertices diagonally across."""
    neighbours = n + is_open
    ring = [1 + i % neighbours for i in range(n + 1)]
    if scheme == LOOP:
        return cage([(0, ring[i], ring[i + 1]) for i in range(n)], 1 + neighbours)
    return cage([(0, ring[i], 1 + neighbours + i, ring[i + 1]) for i in range(n)], 1 + neighbours + n)


def step(ring: Cage, scheme: str) -> np.ndarray:
    """The matrix of one level on the vertex, its neighbours and those across, read from the refined fan."""
    levels = Levels(ring, scheme)
    matrix = levels.points(1, of_limit=False).toarray()
    v, e = len(ring.corner), len(ring.ends)
    to_neighbour = np.flatnonzero(ring.ends[:, 0] == 0)
    across = [] if scheme == LOOP else list(v + e + np.arange(len(ring.count)))
    return matrix[[0, *(v + to_neighbour[np.argsort(ring.ends[to_neighbour, 1])]), *across]]


def test_a_regular_grid_is_the_bicubic_b_spline():
    n, level = 8, 3
    levels, heights = Levels(grid(n), CATMULL_CLARK), RNG.normal(size=(n, n))
    surface = levels.points(level) @ heights.ravel()
    x, y = np.meshgrid(np.arange(n), np.arange(n), indexing="ij")
    place = levels.points(level) @ np.stack([x.ravel(), y.ravel()], axis=1).astype(float)
    inside = ((place > 1) & (place < n - 2)).all(axis=1)
    spline = BSpline(np.arange(-2, n + 2), np.eye(n), 3)
    expected = np.einsum("pi,ij,pj->p", spline(place[inside, 0]), heights, spline(place[inside, 1]))
    assert inside.sum() > 1000
    np.testing.assert_allclose(surface[inside], expected, rtol=0, atol=1e-12)
    normals = np.zeros((len(place), 3))
    normals[levels.cage(level).vertex] = levels.normals(level, np.stack([x.ravel(), y.ravel(), heights.ravel()], 1))
    slopes = [
        np.einsum("pi,ij,pj->p", spline(place[inside, 0], nu=a), heights, spline(place[inside, 1], nu=b))
        for a, b in ((1, 0), (0, 1))
    ]
    expected = np.stack([-slopes[0], -slopes[1], np.ones(inside.sum())], axis=1)
    expected /= np.linalg.norm(expected, axis=1, keepdims=True)
    np.testing.assert_allclose(normals[inside], expected, rtol=0, atol=1e-12)


def test_a_boundary_is_the_cubic_b_spline_of_its_vertices():
    n, level = 8, 3
    levels, heights = Levels(grid(n), CATMULL_CLARK), RNG.normal(size=n * n)
    limit = levels.points(level)
    y, x = limit @ np.tile(np.arange(n), n).astype(float), limit @ np.repeat(np.arange(n), n).astype(float)
    edge = np.flatnonzero(np.isin(np.arange(len(x)), levels.cage(level).ends[levels.cage(level).faces_at_edge == 1]))
    side = edge[(np.abs(x[edge]) < 1e-12) & (y[edge] > 1) & (y[edge] < n - 2)]
    expected = BSpline(np.arange(-2, n + 2), heights[:n], 3)(y[side])
    assert len(side) > 30
    np.testing.assert_allclose((limit @ heights)[side], expected, rtol=0, atol=1e-12)


def test_loops_surface_of_a_quadratic_on_a_regular_lattice_is_the_quadratic():
    """With the box spline's variance added: 1/4 along both axes, none across, for a lattice of edge 1."""
    n, level = 9, 2
    at = np.arange(n * n).reshape(n, n)
    a, b, c, d = at[:-1, :-1].ravel(), at[1:, :-1].ravel(), at[1:, 1:].ravel(), at[:-1, 1:].ravel()
    levels = Levels(cage([*zip(a, b, d, strict=True), *zip(b, c, d, strict=True)], n * n), LOOP)
    i, j = np.meshgrid(np.arange(n), np.arange(n), indexing="ij")
    x, y = (i + j / 2).ravel(), (j * np.sqrt(0.75)).ravel()
    limit = levels.points(level)
    u, v, k = limit @ x, limit @ y, limit @ j.ravel()
    inside = (k > 2) & (k < n - 3) & (u - k / 2 > 2) & (u - k / 2 < n - 3)
    for quadratic in (lambda x, y: x * x, lambda x, y: x * y, lambda x, y: 3 * y * y - x):
        shift = (quadratic(1.0, 0.0) + quadratic(-1.0, 0.0)) / 8 + (quadratic(0.0, 1.0) + quadratic(0.0, -1.0)) / 8
        np.testing.assert_allclose((limit @ quadratic(x, y))[inside], quadratic(u, v)[inside] + shift, atol=1e-12)


@pytest.mark.parametrize("scheme", [CATMULL_CLARK, LOOP])
@pytest.mark.parametrize(
    ("n", "is_open"), [(3, False), (5, False), (8, False), (1, True), (2, True), (3, True), (4, True)]
)
def test_limit_and_normal_are_where_the_rule_itself_leads(scheme: str, n: int, is_open: bool):
    """The limit is the endless power of one level; the tangents are what is left the longest, its next eigenvectors."""
    ring = fan(scheme, n, is_open)
    matrix, points = step(ring, scheme), RNG.normal(scale=(0.03, 0.03, 0.3), size=(len(ring.corner), 3))
    angle = np.linspace(0, 2.5 if is_open else 2 * np.pi, n + 1)[: n + is_open]
    points[1 : 1 + len(angle), :2] += np.stack([np.cos(angle), np.sin(angle)], axis=1)
    limit = np.linalg.matrix_power(matrix, 200)[0]
    np.testing.assert_allclose(_Rules(ring, scheme).limits().toarray()[0], limit, rtol=0, atol=1e-12)
    values, vectors = np.linalg.eig(matrix.T)
    leading = np.argsort(-np.abs(values), kind="stable")[1:3]
    normal = np.cross(*(vectors[:, leading].real.T @ points))
    normal *= np.sign(normal[2]) / np.linalg.norm(normal)
    at_vertex = limit_normals(ring, scheme, points)[ring.vertex == 0]
    np.testing.assert_allclose(at_vertex, np.broadcast_to(normal, at_vertex.shape), rtol=0, atol=1e-9)


def test_the_corners_of_a_cube_end_at_a_quarter_of_its_size_and_sharp_ones_where_they_are():
    """By Halstead's limit (1993): (9 v + 4 x 3 edges + 3 diagonals) / 24, which is half of the corner."""
    for sharp, factor in ((0.0, 0.5), (10.0, 1.0)):
        ring, points = cube(sharp)
        limit = Levels(ring, CATMULL_CLARK).points(3) @ points
        np.testing.assert_allclose(limit[:8], factor * points, rtol=0, atol=1e-12)


def test_a_crease_of_two_levels_is_sharp_for_two_and_then_smooth():
    ring, points = cube(2.0)
    sharp = Levels(cube(np.inf)[0], CATMULL_CLARK)
    then = sharp.cage(2)
    smooth = Levels(Cage(then.vertex, then.count, np.zeros(len(then.vertex)), then.corner), CATMULL_CLARK)
    expected = smooth.points(2) @ (sharp.points(2, of_limit=False) @ points)
    np.testing.assert_allclose(Levels(ring, CATMULL_CLARK).points(4) @ points, expected, rtol=0, atol=1e-12)


def test_half_a_level_of_sharpness_is_the_mean_of_a_sharp_and_a_smooth_rule():
    points = [Levels(cube(sharp)[0], CATMULL_CLARK).points(1, of_limit=False) @ cube()[1] for sharp in (0.0, 0.5, 1.0)]
    np.testing.assert_allclose(points[1], (points[0] + points[2]) / 2, rtol=0, atol=1e-12)
    assert np.abs(points[2] - points[0]).max() > 0.3


@pytest.mark.parametrize(("sharp", "tolerance"), few_cases([(0.0, 0.003), (1.5, 0.03)], (0.0, 0.03), (1.5, 0.003)))
def test_triangles_are_as_near_to_the_limit_as_asked(sharp: float, tolerance: float):
    ring, points = cube(sharp)
    levels = Levels(ring, CATMULL_CLARK)
    level, distance = levels.level_for(points, tolerance, 10**6)
    assert distance <= tolerance
    quads = (levels.points(level) @ points)[levels.cage(level).vertex.reshape(-1, 4)]
    triangles = np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])
    limit = levels.points(7) @ points
    off = [_distances(point, triangles).min() for point in limit[RNG.choice(len(limit), 150)]]
    assert distance / 8 < max(off) < 1.1 * tolerance


def test_bilinear_faces_keep_their_shape():
    ring, points = cube()
    level, distance = Levels(ring, BILINEAR).level_for(points, 1e-6, 10**6)
    assert (level, distance) == (0, 0.0)


@pytest.mark.parametrize(
    "faces",
    [
        [(0, 1, 2), (0, 1, 3), (1, 0, 4)],  # three at an edge
        [(0, 1, 2), (0, 1, 3)],  # one turned over
        [(0, 1, 2), (0, 3, 4)],  # at a vertex alone
    ],
)
def test_faces_without_a_rule_are_refused(faces):
    with pytest.raises(NotManifold):
        Levels(cage(faces, 5), LOOP)


@pytest.mark.parametrize(
    ("make", "volume", "area"),
    [
        (lambda t: solids.sphere(2.0, t), 32 / 3 * np.pi, 16 * np.pi),
        (lambda t: solids.cube(2.0), 8.0, 24.0),
        (lambda t: solids.frustum(1.0, 1.0, 3.0, t).along("X"), 3 * np.pi, 8 * np.pi),
        (lambda t: solids.frustum(1.0, 0.0, 3.0, t).along("Y"), np.pi, np.pi * (1 + np.sqrt(10))),
        (lambda t: solids.capsule(1.0, 1.0, 2.0, t), 10 / 3 * np.pi, 8 * np.pi),
        (lambda t: solids.frustum(2.0, 1.0, 3.0, t), 7 * np.pi, np.pi * (5 + 3 * np.sqrt(10))),
    ],
)
def test_solids_have_their_volume_and_area_and_normals_that_point_out(make, volume, area):
    tolerance = 1e-3
    solid = make(tolerance)
    corners = solid.points[solid.triangles]
    twice = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    assert 0 <= volume - np.sum(corners[:, 0] * twice) / 6 <= 1.01 * tolerance * area
    assert 0 <= 1 - np.linalg.norm(twice, axis=1).sum() / 2 / area <= tolerance
    np.testing.assert_allclose(np.linalg.norm(solid.normals, axis=2), 1, rtol=0, atol=1e-12)
    assert (np.sum(solid.normals * twice[:, None], axis=2) > 0).all()
