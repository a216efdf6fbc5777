"""Claim: at the corners of the field of fast lenses nothing of a bundle is lost: `direct` has the light and the mean of
brute force over the whole rear surface; and an edge that does lose light is noticed.
"""

import functools
import math
from collections.abc import Callable
from unittest.mock import Mock

import numpy as np
import pytest
from laws import rigs
from laws.bounds import plenoptic_positions
from laws.random_scenes import random_camera
from laws.solving import rig_of
from naive import polar, textbook
from naive.kinds import KINDS, PIXELS, camera_with
from published.library import prescription
from shorter import few, one_in
from tolerances import QUADRATURE_MM, SIGMAS

import pipeline
from pipeline.camera.integrals import NODES, Bundles, Integral, integrals, random_integrals
from pipeline.camera.integrating import edge_search, radials
from pipeline.camera.integrating.edge_search import PASSES
from pipeline.camera.integrating.quadrature import INTEGRATED, NOT_STAR_SHAPED, Edges, bounded, edges
from pipeline.camera.micro_images.centres import micro_images
from pipeline.camera.parts.camera import Camera, Sensor
from pipeline.camera.tracer import Tracer, parallel_planes, target_plane
from pipeline.camera.tracing.moments import COLUMNS, WEIGHT
from pipeline.camera.tracing.sampling_bounds import NO_MICROLENS
from pipeline.frames import apply
from pipeline.optics.first_order import first_order
from pipeline.optics.kernels import trace_rays
from pipeline.optics.prescription import Prescription
from pipeline.optics.table import SEMI_DIAMETER_SQUARED, VERTEX, towards_scene
from pipeline.truth.direct import newton
from pipeline.truth.direct.direct_rows import Guess, solve
from pipeline.truth.planes import Exposed

DISTANCE_MM = 600.0
FAST = ("double_gauss_50mm_canon_rf", "double_gauss_50mm_canon", "double_gauss_50mm_tronnier")
CORNERS_PX = np.array([[0.0, 45.0], [86.4, 0.0], [8.6, 63.0], [8.6, 36.0], [25.9, 0.0], [80.0, 57.0]])
"""Where edges of no length of the pupil's outline were once taken for its border, and others."""
RAYS = 1 << 17
WIDER = 1.5
"""Towards a corner rays cross the rear vertex plane outside of the rear surface's own circle."""


def fully_open(name: str) -> Camera:
    """A lens of the library at its largest aperture before 36 x 24 mm, focused at 600 mm."""
    lens, sensor = prescription(name), Sensor(width_px=96, height_px=64, pitch_mm=0.375)
    return rigs.bare(lens, sensor, -first_order(lens).image_mm(DISTANCE_MM), (550.0, 650.0))


@pytest.mark.parametrize("name", one_in(len(FAST), FAST))
def test_direct_has_all_the_light_at_the_corners_of_the_field(name: str) -> None:
    """Hit fraction and mean hit on a board out of focus, against textbook rays all over the rear surface."""
    tracer, pose, rng = Tracer(fully_open(name)), rigs.facing(560.0, 20.0), np.random.default_rng(7)
    at_random = rng.uniform([0.0, 0.0], [95.0, 63.0], (6, 2))
    x = np.concatenate([CORNERS_PX, at_random])
    planes = np.repeat(np.stack([target_plane(pose)] * 2)[None], len(x), axis=0)
    found = integrals(tracer, Bundles(x, np.full(len(x), NO_MICROLENS), planes), 1)
    assert not found.is_random.any()
    for row, start in zip(found.moments, tracer.positions_mm(*x.T), strict=True):
        hit, weight = everywhere(tracer, start, pose, rng)
        light, passed = weight.sum(), weight > 0
        assert passed.sum() > 1000
        assert abs(row[WEIGHT] - light) < SIGMAS * np.std(weight) * np.sqrt(RAYS)
        mean = weight @ hit / light
        spread = np.sqrt((weight**2) @ (hit - mean) ** 2) / light
        assert np.all(np.abs(row[:2] - mean) < SIGMAS * spread)


def everywhere(
    tracer: Tracer, start_mm: np.ndarray, pose: np.ndarray, rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray]:
    """Hits on a board (n, 2), weights (n,) of rays all over a disc wider than the rear surface: no bound, no edge."""
    table = tracer.table
    radius = WIDER * np.sqrt(table[0, SEMI_DIAMETER_SQUARED])
    far, angle = radius * np.sqrt(rng.uniform(0, 1, RAYS)), rng.uniform(0, 2 * np.pi, RAYS)
    ahead = table[0, VERTEX] - tracer.sensor_z_mm
    offset = np.column_stack([far * np.cos(angle) - start_mm[0], far * np.sin(angle) - start_mm[1]])
    direction = np.column_stack([offset, np.full(RAYS, ahead)])
    cosine = ahead / np.linalg.norm(direction, axis=1)
    direction *= (cosine / ahead)[:, None]
    position, alive = np.tile([*start_mm, tracer.sensor_z_mm], (RAYS, 1)), np.ones(RAYS)
    trace_rays(table, position, direction, alive)
    weight = np.where(alive > 0, np.pi * radius**2 / RAYS * cosine**4 / ahead**2, 0.0)
    return np.where(alive[:, None] > 0, textbook.at_plane(position, direction, pose), 0.0), weight


def about_corners() -> Edges:
    """The edges of those bundles."""
    tracer = Tracer(fully_open("double_gauss_50mm_canon_rf"))
    return edges(tracer.arrays, tracer.positions_mm(*CORNERS_PX.T), np.full(len(CORNERS_PX), NO_MICROLENS))


def test_an_edge_drawn_too_short_in_a_few_directions_is_noticed() -> None:
    """A fifth of the circle ends at half its way, in every other bundle: a seventh of the light lies there."""
    found = about_corners()
    owner, angle = found.directions(64)
    radius, share = found.edge_points(owner, angle)[0], np.full(len(owner), 2 * np.pi / 64)
    whole, _ = radials.agrees_with_probes(found, owner, angle, radius, share, 256)
    assert whole.all()
    short = np.where((owner % 2 == 1) & (angle < 2 * np.pi / 5), 0.5, 1.0)
    whole, _ = radials.agrees_with_probes(found, owner, angle, radius * short, share, 256)
    assert whole.tolist() == [True, False] * (len(CORNERS_PX) // 2)


def test_light_beyond_a_border_that_is_drawn_too_near_hands_over_to_random_rays(monkeypatch) -> None:
    """Half of the way to the bound is taken for all of it in a sixth of the circle, so that no search finds more."""
    found, reach = about_corners(), edge_search.reach

    def too_near(polygons, counts, centres, spokes, side) -> None:
        reach(polygons, counts, centres, spokes, side)
        spokes.polygon_radius[spokes.angle % (2 * np.pi) < np.pi / 3] *= 0.5

    monkeypatch.setattr(edge_search, "reach", too_near)
    n = len(CORNERS_PX)
    _, status, _ = found.moments(np.repeat(np.stack([target_plane(rigs.facing(560.0))] * 2)[None], n, axis=0), (8, 32))
    assert status.tolist() == [NOT_STAR_SHAPED] * n


def test_rays_beyond_an_edge_are_the_same_alone_and_among_those_of_others(monkeypatch: pytest.MonkeyPatch) -> None:
    """Or whether a bundle is integrated or traced at random, and so its row, would depend on the other rows."""
    found, sent = about_corners(), []

    def probe(_: Edges, owner: np.ndarray, points: np.ndarray) -> np.ndarray:
        sent.append(points[owner == 5])
        return np.zeros(len(owner), int)

    for rows in (np.arange(6), np.array([5])):
        owner, angle = np.repeat(rows, 7), np.tile(np.arange(7.0), len(rows))
        radius, _, limit, _ = found.edge_points(owner, angle)
        with monkeypatch.context() as patched:
            patched.setattr(radials.StarRegions, "probe", probe)
            found.nothing_beyond(owner, np.stack([np.cos(angle), np.sin(angle)], axis=1), radius, limit)
    assert len(sent[1]) > 3 and np.array_equal(*sent)


def behind_microlenses() -> Edges:
    """Edges of bundles of the paper's camera: of cells, of the stop, and of both."""
    tracer = Tracer(rigs.plenoptic(4.0))
    positions, lens = plenoptic_positions(tracer, 12)
    return edges(tracer.arrays, positions, lens)


def behind(kind: str) -> Edges:
    """The same behind few pixels and microlenses of other models."""
    tracer = Tracer(camera_with(kind))
    positions, lens = plenoptic_positions(tracer, 12)
    return edges(tracer.arrays, positions, lens)


def displaced_with_blades() -> Edges:
    """A displaced lens with a hexagonal stop: how far an edge is, its clearance does not say."""
    camera = rigs.displaced(rigs.conventional())
    tracer = Tracer(rigs.reshaped(camera, {camera.prescription.stop_index: {"blades": 6}}))
    positions = tracer.positions_mm(np.array([5.0, 48.0, 90.0]), np.array([5.0, 30.0, 70.0]))
    return edges(tracer.arrays, positions, np.full(3, NO_MICROLENS))


BEHIND = [functools.partial(behind, kind) for kind in ("discs", "tilted", "two-plane", "biconvex cells")]


@pytest.mark.parametrize("make", [about_corners, behind_microlenses, displaced_with_blades, *BEHIND])
@pytest.mark.parametrize("steps", [8, 24])
def test_the_search_finds_the_edge_that_bisection_finds(make, steps: int) -> None:
    """Forty halvings, one ray at a time. It takes three rays more than halvings at worst, half of them as a rule."""
    found = make()
    owner, angle = found.directions(23)
    radius, label, limit, rays = found.edge_points(owner, angle, steps)
    along, centre = np.stack([np.cos(angle), np.sin(angle)], axis=1), found.centres[owner]
    low, high, last = np.zeros(len(owner)), limit.copy(), label.copy()
    open_ = found.probe(owner, centre + limit[:, None] * along) != PASSES
    for _ in range(40):
        middle = (low + high) / 2
        here = found.probe(owner, centre + middle[:, None] * along, is_named=True)
        low, high = np.where(here == PASSES, middle, low), np.where(here == PASSES, high, middle)
        last = np.where(here == PASSES, last, here)
    assert open_.sum() > 20
    assert np.array_equal(radius[~open_], limit[~open_])
    assert np.all(np.abs(radius - low)[open_] <= limit[open_] * 0.5 ** (steps + 1))
    assert np.mean((label == last)[open_]) > 0.97, "all but directions next to a corner"
    assert rays - len(owner) <= (steps + 4) * open_.sum()
    if steps == 24 and make is not displaced_with_blades:
        assert rays - len(owner) < 12 * open_.sum()


def test_a_hexagonal_stop_of_a_displaced_lens_has_six_corners() -> None:
    assert np.bincount(displaced_with_blades().corners.owner).tolist() == [6, 6, 6]


@pytest.mark.parametrize("kind", ["two-plane", "biconvex cells", "biconvex conics, square, tilted discs"])
def test_what_blocks_a_ray_is_the_same_alone_and_among_the_rays_of_others(kind: str) -> None:
    """Rays from five positions through their microlenses and beside them: stopped by faces and sides of these, and by
    the main lens."""
    tracer, rng = Tracer(camera_with(kind)), np.random.default_rng(4)
    positions, lens = plenoptic_positions(tracer, 5)
    found, owner = bounded(tracer.arrays, positions, lens), np.repeat(np.arange(5), 40)
    points = tracer.vertices_mm[lens[owner]] + rng.uniform(-0.15, 0.15, (len(owner), 2))
    together = found.probe(owner, points, is_named=True)
    alone = [found.probe(owner[i : i + 1], points[i : i + 1], is_named=True)[0] for i in range(len(owner))]
    assert together.tolist() == alone
    assert PASSES in alone and np.max(alone) >= len(tracer.table) and len(set(alone)) > 3


def test_chords_hold_the_points_before_the_place_where_a_ray_from_the_middle_meets_them() -> None:
    """Three outlines about a point, their corners in any order and their angles in any turn."""
    rng, corners = np.random.default_rng(5), 12
    owner = np.repeat(np.arange(3), corners)
    angle = np.tile(np.arange(corners) * 2 * np.pi / corners, 3) + rng.uniform(-0.2, 0.2, 36)
    radius, order = rng.uniform(0.5, 2.0, 36), rng.permutation(36)
    chords = radials._chords(owner[order], angle[order] + 2 * np.pi * rng.integers(-1, 2, 36), radius[order], 3)
    corner = (radius * np.exp(1j * angle)).reshape(3, corners)
    side = np.roll(corner, -1, axis=1) - corner
    for number, way in [(number, way) for number in range(3) for way in np.linspace(-3.1, 6.2, 25)]:
        across = cross(np.exp(1j * way), side[number])
        share = cross(corner[number], np.exp(1j * way)) / across
        distance = cross(corner[number], side[number]) / across
        met = (share >= 0) & (share <= 1) & (distance > 0)
        x, y = (distance[met][0] * np.array([1 - 1e-9, 1 + 1e-9])) * np.array([[np.cos(way)], [np.sin(way)]])
        assert chords.hold(np.full(2, number), np.full(2, way), x, y).tolist() == [True, False]
    np.testing.assert_allclose(chords.area(), 0.5 * cross(corner, side).sum(axis=1), rtol=1e-12)


def cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Of vectors of the plane as complex numbers."""
    return np.asarray((a.conj() * b).imag)


CELLS = ((0, 0), (17, -9), (-5, 24))
OFF_CENTRE_MM = np.array([(0.01, -0.004), (0.07, 0.04), (-0.03, 0.1)])
SEEDS, RANDOM_RAYS = 12, 1 << 14
QUICK = {("square", "cone"), ("biconvex cells", "all"), ("tilted", "cone"), ("convex to the sensor", "cosine")}


@pytest.mark.parametrize(
    ("kind", "pixels"),
    [
        pytest.param(kind, pixels, marks=() if (kind, pixels) in QUICK else pytest.mark.heavy)
        for kind in KINDS
        for pixels in PIXELS
    ],
)
def test_quadrature_and_random_rays_agree(kind: str, pixels: str) -> None:
    """Positions in the middle and near the edges of three micro-images; the reference level has 4 times the nodes."""
    camera = camera_with(kind, 5.0, pixels)
    tracer = Tracer(camera)
    assert tracer.lattice is not None
    lens = np.array([np.flatnonzero((tracer.lattice.k == k) & (tracer.lattice.l == l))[0] for k, l in CELLS])
    x = tracer.pixels_at(micro_images(tracer).centre_mm[lens] + OFF_CENTRE_MM)
    planes = np.repeat(parallel_planes(400.0, 470.0)[None], len(x), axis=0)
    exact, status, _ = edges(tracer.arrays, tracer.positions_mm(*x.T), lens).moments(planes, (48, 1024))
    assert (status == INTEGRATED).all()

    bundles = Bundles(x, lens, planes)
    random = [random_integrals(Tracer(camera, seed), bundles, RANDOM_RAYS).moments for seed in range(SEEDS)]
    columns = [0, 1, WEIGHT]
    scatter = np.std(random, axis=0, ddof=1)[:, columns] / np.sqrt(SEEDS)
    assert np.all(np.abs(np.mean(random, axis=0) - exact)[:, columns] < SIGMAS * scatter)

    for level in range(1, len(NODES)):
        found = integrals(tracer, bundles, level)
        assert not found.is_random.any()
        actual = np.abs(found.moments[:, :2] - exact[:, :2]).max()
        assert actual < found.error_mm.max() + QUADRATURE_MM
    assert actual < QUADRATURE_MM


CLAIM_PX, HALVED_PX = 1e-3, 1e-6
"""The default claim, and what halved edges and corners leave in rows."""
PITCH_MM, DIRECTIONS = 0.006, (1 << 14, 1 << 12)
ENDS_MM = {
    "double_gauss_50mm_canon_rf": 27.0,
    "macro_100mm_canon": 34.0,
    "double_gauss_100mm_mills": 52.0,
    "cooke_triplet_50mm": 33.0,
    "retrofocus_28mm_leica": 26.8,
    "telephoto_250mm_sigler": 74.0,
    "wide_22mm_nakamura": 22.9,
    "double_gauss_80mm_zeiss": 52.7,
    "double_gauss_100mm_fujioka": 57.0,
    "portrait_85mm_pentax": 37.0,
}
"""Lenses of the library, spherical and not, and where their light ends, or nearly. At the end of the second there is no
chief ray, though 7 % of the light arrives; of the third an inner rim begins to cut between two heights of a bound."""


def lit_to_the_corner(name: str) -> Camera:
    """A lens of the library before a sensor whose corners lie where its light ends."""
    lens = prescription(name)
    distance_mm, size = 12 * first_order(lens).efl_mm, int(np.sqrt(2) * ENDS_MM[name] / PITCH_MM)
    sensor = Sensor(width_px=size, height_px=size, pitch_mm=PITCH_MM)
    return rigs.bare(lens, sensor, -first_order(lens).image_mm(distance_mm), (0.9 * distance_mm, 1.1 * distance_mm))


def by_kernel(lens: Prescription, position: np.ndarray, direction: np.ndarray) -> tuple[np.ndarray, ...]:
    """`textbook.trace` knows no aspheres; the trace itself is judged elsewhere."""
    position, alive = position.copy(), np.ones(len(position))
    direction = direction / np.linalg.norm(direction, axis=1, keepdims=True)
    trace_rays(towards_scene(lens), position, direction, alive)
    return np.nan_to_num(position), np.where(alive[:, None] > 0, direction, [0.0, 0.0, 1.0]), alive > 0


@pytest.mark.parametrize(
    ("name", "count"),
    [
        ("double_gauss_50mm_canon_rf", 5),
        ("macro_100mm_canon", 2),
        ("double_gauss_100mm_mills", 3),
        *(pytest.param(name, 12, marks=pytest.mark.heavy) for name in ENDS_MM),
    ],
)
def test_rows_at_the_edge_of_the_light_keep_claim_and_sigma(name: str, count: int) -> None:
    """Points are where the judge says that positions look, on a tilted board out of focus."""
    camera, rng = lit_to_the_corner(name), np.random.default_rng(47)
    rig, pose = rig_of(camera), rigs.facing(0.93 * 12 * first_order(camera.prescription).efl_mm, 15.0)
    far, angle = ENDS_MM[name] * rng.uniform(0.92, 0.999, count), np.pi / 4 + rng.uniform(-0.02, 0.02, count)
    planes, x_px = np.tile([pose[:3, 3], *pose[:3, :3].T], (count, 1, 1)), np.empty((count, 2))
    doubt_mm = np.empty((count, 2))
    for i, start in enumerate(np.stack([far * np.cos(angle), far * np.sin(angle)], axis=1)):
        hit, coarser = (polar.mean_hit(camera, start, pose, None, n, 12, by_kernel)[0] for n in DIRECTIONS)
        doubt_mm[i] = hit - coarser
        planes[i, 0], x_px[i] = apply(pose, np.array([*hit, 0.0])), rig.tracer.pixels_at(start[None])[0]
    guess = Guess(np.arange(count), np.zeros(count, np.int64), x_px + rng.uniform(-2, 2, x_px.shape))
    rows = solve(rig, guess, planes, CLAIM_PX, 0.0)
    assert rows.counts["inaccurate"] == 0 and len(rows.solutions.point) + rows.counts["dropped_outside_image"] == count
    assert len(rows.solutions.point) > count / 2
    solved = rows.solutions.xy_px
    apart = np.hypot(*(solved - x_px[rows.solutions.point]).T)
    assert apart.max() < CLAIM_PX
    doubt = np.hypot(*np.linalg.solve(rows.solutions.jacobian, doubt_mm[rows.solutions.point, :, None])[..., 0].T)
    assert np.all(apart <= 3 * np.hypot(*rows.sigma_px.T) + doubt + HALVED_PX)


@pytest.mark.parametrize("count", few([10], 100))
def test_positions_beside_a_rim_that_begins_to_cut_come_back_within_their_errors(count: int) -> None:
    """There J bends: a difference over half a pixel is no derivative of it, and was wrong by a factor of five."""
    camera = pipeline.ready(random_camera(np.random.default_rng(6)))
    rng, sensor = np.random.default_rng(1), camera.camera.sensor
    x_px, y_px = rng.uniform(-0.5, sensor.width_px - 0.5, count), rng.uniform(-0.5, sensor.height_px - 0.5, count)
    rays, distance_mm = camera.rays(x_px, y_px), rng.uniform(*camera.planes_mm, count)
    lit = np.flatnonzero(rays.hit_fraction >= 0.05)
    points = np.stack([rays.at_distance(distance_mm[i])[i] for i in lit])
    images = camera.project(points)
    came_back = 0
    for number, i in enumerate(lit):
        own = np.flatnonzero((images.point == number) & (images.microlens == rays.microlens[i]).all(axis=1))
        apart = np.hypot(images.x_px[own] - x_px[i], images.y_px[own] - y_px[i])
        claimed = 3 * np.hypot(*images.error_px[own].T) + 3 * np.hypot(*rays.error_px[i]) + HALVED_PX
        came_back += bool((apart <= claimed).any())
    assert came_back == len(lit) > 0.8 * count


@pytest.mark.parametrize("least_px", [(-math.inf, -math.inf), (-0.1, -math.inf), (-math.inf, -0.1)])
def test_a_derivative_beside_a_bend_is_not_taken_across_it_whichever_rays_are_random(
    least_px: tuple[float, float], monkeypatch: pytest.MonkeyPatch
) -> None:
    """J(x, y) = (|x + 0.1| - 0.1, y) has the unit matrix at 0, and 0.4 in its corner half a pixel across.

    Rays are random where x and y exceed `least_px`, as between two rims that all but touch.
    """

    search = search_of(
        lambda x, y: (np.abs(x + 0.1) - 0.1, y), np.zeros(2), monkeypatch, error_mm=1e-4, least_px=least_px
    )
    search.linearise()
    np.testing.assert_allclose(search.jacobian[0], np.eye(2), atol=1e-12)


def test_a_step_that_leaves_more_than_its_derivative_promises_is_not_the_last(monkeypatch: pytest.MonkeyPatch) -> None:
    """J(x, y) = (x - max(0.6 x + 0.8 y, 0), y) bends at its solution 0; the first derivative is that of the other side.

    Trusted to a tenth, the third step stated 1.4e-4 px and left 2.8e-3.
    """
    search = search_of(lambda x, y: (x - np.maximum(0.6 * x + 0.8 * y, 0), y), np.full(2, 0.003), monkeypatch)
    search.jacobian = search.inverse = np.eye(2)[None]
    search.refine(np.arange(1), 1e-3)
    assert search.reached.all() and np.hypot(*search.x_px[0]) < 1e-3


def search_of(
    j: Callable[[np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]],
    at_px: np.ndarray,
    monkeypatch: pytest.MonkeyPatch,
    error_mm: float = 0.0,
    least_px: tuple[float, float] = (math.inf, math.inf),
) -> newton.Search:
    """A search from a position for where J is 0, with random rays where x and y exceed `least_px`."""

    def stated(_: Tracer, bundles: Bundles, level: int) -> Integral:
        moments = np.zeros((len(bundles.x_px), COLUMNS))
        moments[:, :4] = np.stack(j(*bundles.x_px.T) * 2, axis=1)
        is_random = (bundles.x_px > least_px).all(axis=1)
        return Integral(moments, np.full((len(moments), 2), error_mm), is_random, 0)

    monkeypatch.setattr(newton, "integrals", stated)
    still = Exposed.still(parallel_planes(1.0, 2.0)[:1])
    return newton.Search(Mock(), np.zeros(1, int), lambda rows, _: still.only(rows), at_px[None], at_px[None])
