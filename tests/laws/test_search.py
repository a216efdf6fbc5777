"""Claim: the search finds positions where they are, maps them back by the half-pixel rule, and rejects what it should,
for the reason that it should.
"""

import dataclasses

import numpy as np
import pytest
from laws import rigs
from laws.solving import correspond, truth_of
from tolerances import HALF_PIXEL_PX

from pipeline.targets.patterns.checkerboard import Checkerboard
from pipeline.truth.grid import quad_search
from pipeline.truth.grid.correspond import _pooled_error, find
from pipeline.truth.grid.ray_grid import RayGrid, fine_from_image
from pipeline.truth.settings import TruthSettings

AFFINE = np.array([[0.31, 0.04], [-0.06, -0.29]])
SHIFT_MM = np.array([-3.0, 4.2])


def grid_of(supersampling: int, width: int = 24, height: int = 20) -> RayGrid:
    """What the search reads besides the position image."""
    nowhere = np.zeros((height * supersampling, width * supersampling, 2))
    return rigs.sharp_grid(nowhere, nowhere.copy(), supersampling, (1.0, 2.0))


def centres_px(supersampling: int, width: int = 24, height: int = 20) -> np.ndarray:
    """Image positions of the centres of the fine pixels, by counting their edges from the image's corner at -1/2."""
    x = np.linspace(-0.5, width - 0.5, width * supersampling + 1)
    y = np.linspace(-0.5, height - 0.5, height * supersampling + 1)
    return np.stack(np.meshgrid((x[:-1] + x[1:]) / 2, (y[:-1] + y[1:]) / 2), axis=-1)


def points_at(positions_px: np.ndarray) -> np.ndarray:
    return np.column_stack([positions_px @ AFFINE.T + SHIFT_MM, np.zeros(len(positions_px))])


@pytest.mark.parametrize("k", [1, 2, 3, 4, 10])
def test_positions_come_back_from_a_k_times_finer_image(k: int) -> None:
    """On an affine J the search is exact: 1e-9 px at any K."""
    positions = np.random.default_rng(k).uniform(2.0, 17.0, (30, 2))
    image = centres_px(k) @ AFFINE.T + SHIFT_MM
    found, counts = find(image, points_at(positions), grid_of(k), TruthSettings(method="two-plane"))
    np.testing.assert_array_equal(found.point, np.arange(30))
    np.testing.assert_allclose(found.xy_px, positions, rtol=0, atol=HALF_PIXEL_PX)
    np.testing.assert_allclose(found.jacobian, np.broadcast_to(AFFINE, (30, 2, 2)), rtol=0, atol=HALF_PIXEL_PX)
    assert counts["quads"] == 30


@pytest.mark.parametrize("k", [1, 2, 3, 4, 10])
def test_the_often_printed_rule_is_off_by_half_a_pixel_less_half_a_fine_one(k: int) -> None:
    """The solution of the kernel in the fine grid, divided by K alone, misses by (K - 1) / (2 K) on both axes."""
    positions = np.random.default_rng(k).uniform(2.0, 17.0, (30, 2))
    image, points = centres_px(k) @ AFFINE.T + SHIFT_MM, points_at(positions)[:, :2].copy()
    cell = np.zeros(image.shape[:2], np.int64)
    quads, status, solutions = np.empty((30, 3), np.int64), np.empty(30, np.int64), np.empty((30, 9))
    assert quad_search.quads_that_hold(image, cell, points, quads) == 30
    quad_search.solve_quads(image, cell, points, quads, quad_search.Filter(True, 0.15, 0.17), status, solutions)
    miss = solutions[:, :2] / k - positions[quads[:, 0]]
    np.testing.assert_allclose(miss, (k - 1) / (2 * k), rtol=0, atol=HALF_PIXEL_PX)


def test_on_a_projective_image_the_error_falls_with_the_square_of_the_step() -> None:
    """Interpolation is linear: double K, and the rms error falls about fourfold."""
    homography = np.array([[0.3, 0.02, -3.0], [0.01, -0.3, 3.0], [0.004, 0.003, 1.0]])

    def seen(positions: np.ndarray) -> np.ndarray:
        h = np.concatenate([positions, np.ones((*positions.shape[:-1], 1))], axis=-1) @ homography.T
        return h[..., :2] / h[..., 2:]

    positions, errors = np.random.default_rng(1).uniform(2.0, 17.0, (400, 2)), []
    points = np.column_stack([seen(positions), np.zeros(400)])
    for k in (1, 2, 4, 8):
        found, _ = find(seen(centres_px(k)), points, grid_of(k), TruthSettings(method="two-plane"))
        errors.append(np.sqrt(np.mean((found.xy_px - positions[found.point]) ** 2)))
    assert errors[0] < 0.02
    assert np.all(np.abs(np.log2(np.array(errors[:-1]) / errors[1:]) - 2) < 0.2)


def filtered(image: np.ndarray, settings: TruthSettings, cell: np.ndarray | None = None) -> dict:
    grid = grid_of(1)
    if cell is not None:
        grid.cell[:] = cell
    return find(image, np.array([[8.4, 9.3, 0.0]]), grid, settings)[1]


def rejections(counts: dict) -> tuple[int, int, int]:
    return counts["rejected_window"], counts["rejected_lengths"], counts["rejected_angles"]


def test_a_stretched_row_is_rejected_for_its_lengths_once_beyond_the_limit() -> None:
    """One of three columns of distances longer by e deviates from their mean by (2/3) e / (1 + e/3)."""
    for e, expected in ((0.243 - 0.002, (0, 0, 0)), (0.2433 + 0.002, (0, 1, 0))):
        image = centres_px(1)
        image[:, 10:, 0] += e
        assert rejections(filtered(image, TruthSettings(method="two-plane"))) == expected
    image[:, 10:, 0] += 0.5
    assert rejections(filtered(image, TruthSettings(method="two-plane", lambda_d=1.0))) == (0, 0, 0)
    assert rejections(filtered(image, TruthSettings(method="two-plane", filter="none"))) == (0, 0, 0)


def test_a_kink_is_rejected_for_its_angles_once_beyond_the_limit() -> None:
    """One of three rows sheared by a turns its angles by atan(a), two thirds of it from the mean; lengths pass."""
    limit = np.tan(np.radians(15.0))
    for shear, expected in ((limit - 0.003, (0, 0, 0)), (limit + 0.003, (0, 0, 1))):
        image = centres_px(1)
        image[11:, :, 0] += shear
        assert rejections(filtered(image, TruthSettings(method="two-plane"))) == expected
    assert rejections(filtered(image, TruthSettings(method="two-plane", lambda_alpha_deg=20.0))) == (0, 0, 0)


def test_an_outlier_of_noise_is_rejected_for_its_lengths() -> None:
    """A single value of the sixteen moved by a third of a step, any of them."""
    for row in range(8, 12):
        for column in range(7, 11):
            if (row, column) in {(9, 8), (9, 9), (10, 8), (10, 9)}:
                continue
            image = centres_px(1)
            image[row, column] += [0.25, 0.25]
            assert rejections(filtered(image, TruthSettings(method="two-plane"))) == (0, 1, 0)


def test_a_window_that_is_not_filled_or_not_in_one_cell_is_rejected() -> None:
    """One empty value, or one of another micro-image, among the sixteen; one step further off does no harm."""
    for row, column, expected in ((8, 7, 1), (11, 10, 1), (8, 11, 0), (12, 10, 0), (7, 7, 0)):
        image, cell = centres_px(1), np.zeros((20, 24), np.int64)
        image[row, column] = np.nan
        assert rejections(filtered(image, TruthSettings(method="two-plane"))) == (expected, 0, 0)
        cell[row, column] = -1
        assert rejections(filtered(centres_px(1), TruthSettings(method="two-plane"), cell)) == (expected, 0, 0)


def test_a_point_near_the_image_edge_has_no_window() -> None:
    """Three pixels from the edge are enough, two are not."""
    image = centres_px(1)
    for x, expected in ((0.5, (1, 0, 0)), (1.5, (0, 0, 0)), (21.5, (0, 0, 0)), (22.5, (1, 0, 0))):
        _, counts = find(image, np.array([[x, 9.3, 0.0]]), grid_of(1), TruthSettings(method="two-plane"))
        assert rejections(counts) == expected


def test_the_nearest_search_returns_the_nearest_centre_within_its_threshold() -> None:
    """As found by comparing with all positions; beyond the threshold, nothing."""
    positions = np.random.default_rng(2).uniform(1.0, 17.0, (50, 2))
    image, points = centres_px(2) @ AFFINE.T + SHIFT_MM, points_at(positions)
    settings = TruthSettings(method="two-plane", search="nearest", nearest_threshold_mm=0.06)
    found, _ = find(image, points, grid_of(2), settings)
    distance = np.linalg.norm(image.reshape(-1, 1, 2) - points[:, :2], axis=2)
    near = np.flatnonzero(distance.min(axis=0) < 0.06)
    assert 5 < len(near) < 45
    np.testing.assert_array_equal(found.point, near)
    expected = centres_px(2).reshape(-1, 2)[distance.argmin(axis=0)[near]]
    np.testing.assert_allclose(found.xy_px, expected, rtol=0, atol=HALF_PIXEL_PX)


@pytest.mark.parametrize("filter_name", ["lengths-and-angles", "none"])
def test_every_quad_that_held_a_point_is_a_row_or_is_counted(plenoptic_grid: RayGrid, filter_name: str) -> None:
    """Quads = rejections + ambiguous + drops + rows, with every kind of drop provoked."""
    board, pose = Checkerboard(columns=4, rows=3, square_mm=0.7), rigs.facing(440.0, 15.0)
    settings = TruthSettings(method="two-plane", filter=filter_name, lambda_d=0.1, min_hit_fraction=0.6)
    counts = truth_of(plenoptic_grid, board.points_mm(), pose, settings).counts
    parts = [count for name, count in counts.items() if name.startswith(("rejected", "dropped"))]
    assert counts["quads"] == sum(parts) + counts["ambiguous"] + counts["rows"]
    assert counts["rows"] > 50
    assert counts["dropped_hit_fraction"] > 0
    if filter_name != "none":
        assert counts["rejected_window"] > 0
        assert counts["rejected_lengths"] + counts["rejected_angles"] > 0


def test_the_error_of_a_row_comes_from_its_own_cell() -> None:
    """Two cells side by side, one with a hundredfold error: rows up to the edge between them state that of their own.

    The bundles of both planes have the same width, so the errors of the grid are those of the rows but for the gain of
    the interpolation, which is that of a grid whose errors are all the same.
    """
    width, height, k = 24, 20, 2
    fine = np.mgrid[: height * k, : width * k][1]
    own = np.where(fine < width * k // 2, 1.0, 100.0)
    row, column = np.mgrid[: height * k, : width * k].astype(float)
    flat = np.stack([column, row], axis=-1) @ AFFINE.T
    covariance = np.zeros((height, width, 10))
    covariance[..., [0, 2, 4, 6, 7, 9]] = 1.0  # every ray crosses both planes alike
    two = dataclasses.replace(
        grid_of(k),
        near=flat,
        far=flat,
        covariance=covariance,
        cell=(fine >= width * k // 2).astype(np.int64),
        microlenses=np.array([[0, 0, 0], [1, 0, 0]]),
        centres_px=np.array([[width / 4 - 0.5, height / 2 - 0.5], [3 * width / 4 - 0.5, height / 2 - 0.5]]),
        error_px=np.repeat(own[..., None], 2, axis=2),
    )
    even = dataclasses.replace(two, error_px=np.ones((*own.shape, 2)))
    x = np.random.default_rng(2).uniform([3.0, 3.0], [20.0, 16.0], (200, 2))
    points = np.column_stack([fine_from_image(x, k) @ AFFINE.T, np.zeros(len(x))])
    found, reference = (
        correspond(flat, points, grid, np.eye(4), TruthSettings(method="two-plane", filter="none"))
        for grid in (two, even)
    )
    assert len(found.solutions.point) > 150
    np.testing.assert_array_equal(found.solutions.point, reference.solutions.point)
    expected = reference.sigma_px * np.where(found.solutions.cell == 0, 1.0, 100.0)[:, None]
    np.testing.assert_allclose(found.sigma_px, expected, rtol=1e-9)
    near_the_edge = np.abs(found.solutions.x_px - (width - 1) / 2) < 1.0
    assert np.isfinite(found.sigma_px[near_the_edge]).all() and near_the_edge.sum() > 5


def test_the_error_of_a_row_pools_the_nine_positions_around_it_each_once() -> None:
    """Root mean square of those that are known; each alone is taken as it is."""
    around = np.arange(1.0, 10.0).reshape(3, 3)
    grid = dataclasses.replace(grid_of(1), cell=np.zeros((20, 24), np.int64), error_px=np.full((20, 24, 2), np.nan))
    at = np.array([7]), np.array([5]), np.array([0])
    for j, i in np.ndindex(3, 3):
        grid.error_px[6 + j, 4 + i] = around[j, i]
        np.testing.assert_allclose(_pooled_error(grid, *at), around[j, i], rtol=1e-15)
        grid.error_px[6 + j, 4 + i] = np.nan
    grid.error_px[6:9, 4:7] = around[..., None]
    np.testing.assert_allclose(_pooled_error(grid, *at), np.sqrt(np.mean(around**2)), rtol=1e-15)
