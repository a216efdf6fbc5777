"""Claim: whatever the camera, target and pose, the three methods give the same rows within what each of them states.

`direct` is judged by random rays, and then judges the others.
"""

import dataclasses
from pathlib import Path

import numpy as np
import pytest
from laws import rigs
from laws.random_scenes import random_camera, random_pose, random_target
from laws.solving import correspond, judged_rows, rig_of, solved
from scipy import stats
from tolerances import FIRST_ORDER_BLUR, HALVED_SQUARE, ONCE_IN_A_MILLION

from pipeline.camera.integrals import Bundles, integrals, square_nodes
from pipeline.camera.parts.camera import Sampling
from pipeline.camera.rig import Rig
from pipeline.camera.tracer import Tracer, parallel_planes, target_plane
from pipeline.camera.tracing.moments import COLUMNS, COVARIANCE, FREE_WEIGHT, MEAN, WEIGHT, mixed
from pipeline.products.positions.make import position_image
from pipeline.products.truth.make import by_two_planes, correspondences
from pipeline.products.truth.table import PosedPoints
from pipeline.targets.patterns.checkerboard import Checkerboard
from pipeline.targets.surfaces import Warped
from pipeline.targets.target import Target
from pipeline.truth.direct.direct_rows import guesses, solve
from pipeline.truth.grid import correspond as searching
from pipeline.truth.grid.correspond import ImageOf, correspond_points
from pipeline.truth.grid.position_image import on_target
from pipeline.truth.grid.ray_grid import RayGrid
from pipeline.truth.judging import Rows, certify
from pipeline.truth.planes import Exposed, tangent_planes
from pipeline.truth.rows import Correspondences
from pipeline.truth.settings import TruthSettings

K = 2
SAMPLES = {True: 64, False: 2048}
"""Rays per position, with and without microlenses: behind those sampling must stand above what interpolation leaves."""
FULL_LIGHT = 0.98
"""Hit fraction above which no edge cuts the bundle: there J is smooth, and sampling is the only error that matters."""
EXACT = TruthSettings(method="direct", accuracy_px=1e-4)


class Scene:
    """One random scene, and the rows of any method in it."""

    def __init__(self, number: int, folder: Path) -> None:
        rng = np.random.default_rng(number)
        camera, target, self.seed = random_camera(rng), random_target(rng), number
        self.samples = SAMPLES[camera.microlenses is not None]
        tracer = Tracer(camera, number)
        self.rig = Rig.of(tracer)
        self.points, self.pose = target.points(), random_pose(rng, self.rig)
        self.grid = rigs.ray_grid(folder / "rays", camera, K, self.samples, number)
        self.direct = self.rows(EXACT)

    def rows(self, settings: TruthSettings) -> Correspondences:
        if settings.method == "direct":
            assert settings.claim_px is not None
            planes = tangent_planes(self.pose, self.points.position_mm, self.points.plane_axes)
            return solve(self.rig, guesses(self.rig, planes)[0], planes, settings.claim_px, settings.min_hit_fraction)
        image_of: ImageOf = by_two_planes
        if settings.method == "image":
            images = [self._traced(frame) for frame in self.points.frames]

            def image_of(number: int, pose: np.ndarray, rays: RayGrid) -> np.ndarray:
                return images[number][rays.fine]

        found = correspondences(self.rig, self.grid, settings, PosedPoints("Board", self.points, self.pose), image_of)
        assert found is not None
        return found

    def _traced(self, target_from_plane: np.ndarray) -> np.ndarray:
        sampling = Sampling(supersampling=K, samples=self.samples, seed=self.seed)
        pose = self.pose @ target_from_plane
        return position_image(self.rig, pose, sampling).astype(np.float64)

    def apart(self, rows: Correspondences) -> tuple[np.ndarray, np.ndarray]:
        """Differences from `direct` (n, 2) [px] of the rows that it knows, and which those are."""
        width = len(self.rig.axial)
        here, there = (r.solutions.point * width + r.solutions.cell for r in (rows, self.direct))
        order = np.argsort(there)
        place = order[np.minimum(np.searchsorted(there[order], here), len(there) - 1)]
        known = there[place] == here
        x, exact = (r.solutions.xy_px for r in (rows, self.direct))
        return x[known] - exact[place[known]], known


def judged(scene: Scene, rows: Correspondences, bias_px: float, claim_px: float, most: int) -> dict:
    some = np.random.default_rng(0).permutation(len(rows.solutions.point))[:most]
    found = rows.solutions.only(some)
    planes = tangent_planes(scene.pose, scene.points.position_mm, scene.points.plane_axes)[found.point]
    x = np.stack([found.x_px + bias_px, found.y_px], axis=1)
    return certify(scene.rig, Rows(Exposed.still(planes), found.cell, x, True), len(some), claim_px)


def most_by_chance(rows: int) -> float:
    """rms of actual over stated error of so many rows that chance exceeds once in a million scenes.

    Squared, it is distributed as F: two components per row, each with a variance from four replicas.
    """
    return float(np.sqrt(stats.f.isf(ONCE_IN_A_MILLION, 2 * rows, 6 * rows)))


def bias_of_two_planes_px(scene: Scene, rows: Correspondences) -> np.ndarray:
    """Distance of the hit of the mean ray from the mean of the hits, by quadrature at each row, (n, 2) [px]."""
    x, lens = rows.solutions.xy_px, scene.rig.microlens(rows.solutions.cell)
    near_far = scene.grid.near_mm, scene.grid.far_mm
    poses = [scene.pose @ scene.points.frames[scene.points.plane[point]] for point in rows.solutions.point]
    flat, own = (
        integrals(scene.rig.tracer, Bundles(x, lens, np.array(planes)), 2).moments
        for planes in ([parallel_planes(*near_far)] * len(x), [[target_plane(pose)] * 2 for pose in poses])
    )
    shift = [
        hit - on_target(mean[:2], mean[2:], *near_far, pose)
        for hit, mean, pose in zip(own[:, :2], flat[:, :4], poses, strict=True)
    ]
    return np.linalg.solve(rows.solutions.jacobian, np.array(shift)[..., None])[..., 0]


QUICK = (7,)
NUMBERS = [pytest.param(n, marks=() if n in QUICK else pytest.mark.heavy) for n in range(12)]


@pytest.fixture(params=NUMBERS)
def scene(request: pytest.FixtureRequest, tmp_path: Path) -> Scene:
    return Scene(request.param, tmp_path)


def test_all_methods_agree_within_what_they_state(scene: Scene) -> None:
    direct = scene.direct
    assert len(direct.solutions.point) >= 4

    honest = judged(scene, direct, 0.0, 5e-4, most=8)
    assert honest["passed"] is True, honest
    biased = judged(scene, direct, 0.02, 5e-4, most=4)
    assert biased["passed"] is False and abs(biased["mean_px"] - 0.02) < 1e-3

    by_method = {"two-plane": scene.rows(TruthSettings(method="two-plane"))}
    if len(scene.points.frames) <= 3:
        by_method["image"] = scene.rows(TruthSettings(method="image"))
    for method, rows in by_method.items():
        apart, known = scene.apart(rows)
        lit = rows.hit_fraction[known] > FULL_LIGHT
        if np.sum(lit) < 4:
            continue
        stated = np.sqrt(np.mean(rows.sigma_px[known][lit] ** 2))
        bias = bias_of_two_planes_px(scene, rows)[known][lit] if method == "two-plane" else 0.0
        ratio = np.sqrt(np.mean((apart[lit] - bias) ** 2)) / stated
        assert ratio < most_by_chance(int(np.sum(lit))), method


def test_rows_of_a_bent_target_are_those_of_the_whole_image(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Each of its points has a plane of its own, and J on that is made only around where the point is seen."""
    grid = rigs.ray_grid(tmp_path / "rays", rigs.conventional(), 1, 64)
    points, pose = Target(Checkerboard(columns=8, rows=5, square_mm=1.4), BENT).points(), rigs.facing(437.0, 8.0)
    made = []

    def image_of(number: int, pose: np.ndarray, rays: RayGrid) -> np.ndarray:
        made.append(rays.size_px)
        return on_target(rays.near, rays.far, rays.near_mm, rays.far_mm, pose)

    found = correspond_points(points, grid, pose, TruthSettings(method="two-plane"), image_of)
    assert len(made) == len(points.position_mm) and np.mean([w * h for w, h in made]) < 0.5 * 96 * 72
    monkeypatch.setattr(searching, "_window", lambda grid, _: tuple(slice(0, size) for size in grid.size_px[::-1]))
    whole = correspond_points(points, grid, pose, TruthSettings(method="two-plane"), image_of)
    assert set(made[len(points.position_mm) :]) == {(96, 72)}
    assert found is not None and whole is not None
    assert found.solutions.point.tolist() == whole.solutions.point.tolist() == list(range(40))
    np.testing.assert_array_equal(found.solutions.x_px, whole.solutions.x_px)
    np.testing.assert_array_equal(found.solutions.y_px, whole.solutions.y_px)


BENT = Warped(deflection_mm=(0.3, -0.2))


RAYS = 1 << 16
SHARE, TRACE = 0.002, 0.01
"""What 65,536 random rays err by, with room: of a hit fraction, and of a trace [relative]."""


def test_rows_of_position_images_have_the_light_and_blur_of_their_own_bundle(tmp_path: Path) -> None:
    """Behind microlenses, where both change within a pixel, against random rays from the row's position."""
    camera, board, pose = rigs.plenoptic(2.0), Checkerboard(columns=3, rows=2, square_mm=1.0), rigs.facing(420.0, 20.0)
    rig, grid = rig_of(camera), rigs.ray_grid(tmp_path, camera, 1, 256)
    settings = TruthSettings(method="two-plane", filter="none")
    points = Target(board).points()
    traced = correspondences(rig, grid, settings, PosedPoints("Board", points, pose), by_two_planes)
    assert traced is not None
    found = traced.solutions
    assert len(found.point) > 20 and traced.hit_fraction.min() < 0.6
    x, planes = found.xy_px, tangent_planes(pose, points.position_mm)[found.point]
    both, lens = np.stack([planes, planes], axis=1), rig.microlens(found.cell)
    moments = rig.tracer.moments(rig.tracer.positions_mm(*x.T), lens, both, RAYS, np.rint(x).astype(np.int64))
    assert np.abs(traced.hit_fraction - rig.hit_fraction(moments)).max() < SHARE
    on_plane = found.jacobian @ traced.blur_px2 @ found.jacobian.transpose(0, 2, 1)
    trace, expected = np.trace(on_plane, axis1=1, axis2=2), moments[:, COVARIANCE] + moments[:, COVARIANCE + 4]
    assert np.abs(trace / expected - 1).max() < TRACE


BOARD, POSE = Checkerboard(columns=2, rows=1, square_mm=1.0), rigs.facing(420.0, 40.0)
PLANES = tangent_planes(POSE, BOARD.points_mm())


@pytest.fixture(scope="module")
def point() -> Rig:
    return rig_of(rigs.plenoptic(2.0, 64, 48))


@pytest.fixture(scope="module")
def pixel(point: Rig) -> Rig:
    return dataclasses.replace(point, square_px=1.0)


@pytest.fixture(scope="module")
def direct(pixel: Rig) -> Correspondences:
    return solved(pixel, BOARD, POSE, 3e-4)


def test_the_shift_falls_with_the_square_of_the_edge(point: Rig) -> None:
    """In the penumbra, where the shift is not small: fourfold for half an edge."""
    assert point.images is not None
    start = point.images.centre_mm[[0]] + np.array([[0.0998, 0.0291]])
    x, planes, lens = point.tracer.pixels_at(start), np.stack([target_plane(POSE)] * 2)[None], np.array([0])
    where, *shifts = (
        integrals(point.tracer, Bundles(x, lens, planes, edge), 4).moments[0, :2] for edge in (0.0, 0.5, 0.25, 0.125)
    )
    length = [float(np.hypot(*(shift - where))) for shift in shifts]
    assert length[0] / length[1] == pytest.approx(4.0, rel=HALVED_SQUARE)
    assert length[1] / length[2] == pytest.approx(4.0, rel=HALVED_SQUARE / 2)


def test_all_methods_find_the_same_rows(pixel: Rig, direct: Correspondences, tmp_path) -> None:
    """Rows from position images of squares, the target's own and two planes', agree with those solved directly."""
    grid = rigs.ray_grid(tmp_path, pixel.tracer.camera, 1, 1024, footprint="pixel")
    flat = on_target(grid.near, grid.far, grid.near_mm, grid.far_mm, POSE)
    sampling = Sampling(supersampling=1, samples=1024, seed=1)
    images = {
        "two-plane": flat,
        "image": position_image(pixel, POSE, sampling).astype(float),
    }
    for name, image in images.items():
        rows = correspond(image, BOARD.points_mm(), grid, POSE, TruthSettings(method=name, filter="none"))
        number = {pair: i for i, pair in enumerate(zip(direct.solutions.point, direct.solutions.cell, strict=True))}
        own = [number.get(pair, -1) for pair in zip(rows.solutions.point, rows.solutions.cell, strict=True)]
        assert len(own) > 5 and own.count(-1) <= 1
        apart = np.hypot(
            rows.solutions.x_px - direct.solutions.x_px[own], rows.solutions.y_px - direct.solutions.y_px[own]
        )
        assert np.median(apart[np.array(own) >= 0]) < 0.01  # K = 1: J bends within four pixels


def test_blur_is_that_of_the_point(point: Rig, pixel: Rig, direct: Correspondences) -> None:
    """Rows in full light: the pixel's own 1/12 px^2 per axis is not in the columns."""
    other = solved(point, BOARD, POSE)
    rows = {pair: i for i, pair in enumerate(zip(other.solutions.point, other.solutions.cell, strict=True))}
    bright = np.flatnonzero(direct.hit_fraction > 0.999)
    same = [rows[direct.solutions.point[i], direct.solutions.cell[i]] for i in bright]
    assert len(same) > 3
    np.testing.assert_allclose(direct.blur_px2[bright], other.blur_px2[same], rtol=FIRST_ORDER_BLUR, atol=1e-4)
    np.testing.assert_allclose(direct.rho_px[bright], other.rho_px[same], rtol=FIRST_ORDER_BLUR)


@pytest.mark.parametrize("is_direct", [True, False])
def test_a_judge_with_the_other_footprint_objects(
    point: Rig, pixel: Rig, direct: Correspondences, is_direct: bool
) -> None:
    """Rows of pixels pass before a judge who means pixels; before one who means points they fail, by five claims."""
    rows = judged_rows(direct.solutions, PLANES, is_direct)
    own, other = (certify(rig, rows, len(rows.cell), 1e-3) for rig in (pixel, point))
    assert own["passed"] is True
    assert other["passed"] is False and other["max_px"] > 5e-3


def test_a_tracer_has_the_hit_fraction_of_a_square(point: Rig) -> None:
    """What leaves over what could, both over the square: 1 in full light, also for squares of several pixels."""
    assert point.images is not None
    x, planes = point.tracer.pixels_at(point.images.centre_mm[[3]]), np.stack([target_plane(POSE)] * 2)[None]
    wide = dataclasses.replace(point, tracer=Tracer(point.tracer.camera, 5))
    for edge in (0.0, 4.0):
        exact = integrals(wide.tracer, Bundles(x, np.array([3]), planes, edge), 2).moments
        assert wide.hit_fraction(exact)[0] == pytest.approx(1.0, rel=0, abs=1e-6)


def test_bundles_of_a_square_joined_are_the_bundle_of_all_their_rays() -> None:
    """Weighted mean and covariance of all rays at once; of the four nodes of one square the last is dark."""
    rng = np.random.default_rng(3)
    crossing, weight = rng.normal((1e3, 0.0, 0.0, 0.0), size=(2, 4, 20, 4)), rng.uniform(size=(2, 4, 20))
    nodes, share = square_nodes(2)
    weight[1, 3], found = 0.0, np.full((2, 4, COLUMNS), np.nan)
    found[..., WEIGHT], found[..., FREE_WEIGHT] = weight.sum(axis=2), 2.0
    for place in set(np.ndindex(2, 4)) - {(1, 3)}:
        found[place][MEAN:COVARIANCE], found[place][COVARIANCE:WEIGHT] = mean_and_covariance(
            crossing[place], weight[place]
        )
    joined = mixed(found, share)
    for row, rays, light in zip(joined, crossing, weight * share[:, None], strict=True):
        mean, covariance = mean_and_covariance(rays.reshape(-1, 4), light.ravel())
        np.testing.assert_allclose(row[MEAN:COVARIANCE], mean, rtol=1e-12)
        np.testing.assert_allclose(row[COVARIANCE:WEIGHT], covariance, rtol=0, atol=1e-9)
        assert row[WEIGHT] == pytest.approx(light.sum(), rel=1e-12) and row[FREE_WEIGHT] == pytest.approx(2.0)
    np.testing.assert_allclose([nodes.T @ share, (nodes**2).T @ share], [[0, 0], [1 / 12, 1 / 12]], atol=1e-15)


def mean_and_covariance(rays: np.ndarray, weight: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Of crossings (n, 4): (4,), and the upper triangle of the covariance (10,)."""
    covariance = np.cov(rays.T, aweights=weight, ddof=0)
    return np.average(rays, axis=0, weights=weight), covariance[np.triu_indices(4)]
