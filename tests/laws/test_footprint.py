"""Claim: with footprint `pixel`, every method finds the same J, its square falls out as K grows, blur columns are
without it, and a certificate that judges by another footprint objects.
"""

import dataclasses

import numpy as np
import pytest
from laws import rigs
from laws.solving import judged_rows, rig_of, solved
from tolerances import FIRST_ORDER_BLUR, HALVED_SQUARE

from pipeline.camera.integrals import Bundles, integrals, square_nodes
from pipeline.camera.parts.camera import Sampling
from pipeline.camera.rig import Rig
from pipeline.camera.tracer import Tracer, target_plane
from pipeline.camera.tracing.moments import COLUMNS, COVARIANCE, FREE_WEIGHT, MEAN, WEIGHT, mixed
from pipeline.targets.patterns.checkerboard import Checkerboard
from pipeline.tasks.positions import position_image
from pipeline.truth.direct.direct_rows import polished
from pipeline.truth.grid.correspond import correspond
from pipeline.truth.grid.position_image import corrected, on_target
from pipeline.truth.judging.certificate import certify
from pipeline.truth.planes import tangent_planes
from pipeline.truth.rows import Correspondences
from pipeline.truth.settings import TruthSettings

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
        "moments": corrected(flat, grid, POSE),
    }
    settings = TruthSettings(method="moments", filter="none")
    for name, image in images.items():
        rows = correspond(image, BOARD.points_mm(), grid, POSE, dataclasses.replace(settings, method=name))
        number = {pair: i for i, pair in enumerate(zip(direct.solutions.point, direct.solutions.cell, strict=True))}
        own = [number.get(pair, -1) for pair in zip(rows.solutions.point, rows.solutions.cell, strict=True)]
        assert len(own) > 5 and own.count(-1) <= 1
        apart = np.hypot(
            rows.solutions.x_px - direct.solutions.x_px[own], rows.solutions.y_px - direct.solutions.y_px[own]
        )
        assert np.median(apart[np.array(own) >= 0]) < 0.01  # K = 1: J bends within four pixels
        if name == "moments":
            whole = polished(pixel, rows, PLANES, settings)
            assert whole.solutions.cell.tolist() == direct.solutions.cell.tolist()
            both = whole.solutions.x_px - direct.solutions.x_px, whole.solutions.y_px - direct.solutions.y_px
            assert np.hypot(*both).max() < 2e-3


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
