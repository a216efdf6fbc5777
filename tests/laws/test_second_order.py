"""Claim: second moments remove the bias of two planes, by as much as is known, and do nothing where there is none."""

import numpy as np
import pytest
from laws import rigs
from laws.fast_lens import FAR_MM, NEAR_MM, PIXEL_MM, POINT_MM, fast
from laws.oblique import MEAN, OBLIQUE, turned
from tolerances import ORDER

from pipeline.camera.tracer import Tracer, parallel_planes, target_plane
from pipeline.camera.tracing.moments import COVARIANCE, WEIGHT
from pipeline.camera.tracing.sampling_bounds import NO_MICROLENS
from pipeline.truth.grid.position_image import corrected, correction, crossing_share, on_target

STEP_MM = 0.05


def shifts_px(camera, pose) -> tuple[np.ndarray, np.ndarray]:
    """Bias of two planes before and after the correction at the known sensor point, with the same rays [px]."""
    steps = np.array([[0.0, 0.0], [STEP_MM, 0.0], [-STEP_MM, 0.0], [0.0, STEP_MM], [0.0, -STEP_MM]])
    tracer, lens, pixels = Tracer(camera), np.full(5, NO_MICROLENS), np.zeros((5, 2))
    flat = parallel_planes(NEAR_MM, FAR_MM)
    hits = tracer.moments(steps + POINT_MM, lens, np.stack([target_plane(pose), flat[0]]), 8192, pixels)[:, :2]
    found = tracer.moments(steps + POINT_MM, lens, flat, 8192, pixels)
    near, far = found[:, :2], found[:, 2:4]
    share, _, way = crossing_share(near, far, NEAR_MM, FAR_MM, pose)
    before = on_target(near, far, NEAR_MM, FAR_MM, pose)
    after = before + correction(found[:, COVARIANCE:WEIGHT], share, way, pose)
    jacobian = np.stack([hits[1] - hits[2], hits[3] - hits[4]], axis=1) / (2 * STEP_MM)
    return tuple(np.linalg.solve(jacobian, image[0] - hits[0]) / PIXEL_MM for image in (before, after))


@pytest.mark.parametrize(
    ("stop_semi_mm", "offset_mm", "tilt_deg", "left_px"),
    [
        (17.1, 0.0, 30.0, 0.0019),
        (17.1, 0.0, 45.0, 0.0057),
        (17.1, 20.0, 30.0, 0.0017),
        (17.1, 20.0, 45.0, 0.0047),
        (8.0, 20.0, 30.0, 0.0001),
        (8.0, 20.0, 45.0, 0.0002),
    ],
)
def test_what_the_correction_leaves_is_what_is_known(stop_semi_mm, offset_mm, tilt_deg, left_px):
    """Known to two digits, from an independent trace of the same lens: a tenth more, and rounding, is allowed."""
    before, after = shifts_px(fast(stop_semi_mm), rigs.facing(434.36 + offset_mm, tilt_deg, -21.0, -12.0))
    assert np.linalg.norm(after) < 1.1 * left_px + 1e-4
    assert np.linalg.norm(after) < 0.03 * np.linalg.norm(before)


def test_on_an_untilted_plane_nothing_is_corrected():
    before, after = shifts_px(fast(17.1), rigs.facing(454.36))
    np.testing.assert_allclose(after, before, rtol=0, atol=1e-9)


def left_mm(pose: np.ndarray, deviations: np.ndarray) -> float:
    """What the correction leaves of the difference of the mean hit and the hit of the mean ray, of rays in pairs."""
    rays = MEAN + np.concatenate([deviations, -deviations])
    hits = on_target(rays[:, :2], rays[:, 2:], NEAR_MM, FAR_MM, pose)
    share, _, way = crossing_share(MEAN[None, :2], MEAN[None, 2:], NEAR_MM, FAR_MM, pose)
    covariance = (deviations.T @ deviations / len(deviations))[np.triu_indices(4)]
    middle = on_target(MEAN[None, :2], MEAN[None, 2:], NEAR_MM, FAR_MM, pose)
    return float(np.linalg.norm(hits.mean(axis=0) - (middle + correction(covariance[None], share, way, pose))[0]))


@pytest.mark.parametrize("axes", OBLIQUE)
@pytest.mark.parametrize("pairs", [1, 5])
def test_the_correction_is_the_finite_difference_of_the_hit(axes: str, pairs: int) -> None:
    """For rays in pairs mirrored about their mean what is left falls with the fourth power of their distances."""
    pose, deviations = turned(*OBLIQUE[axes]), np.random.default_rng(8).normal(0, 0.3, (pairs, 4))
    coarse, fine = left_mm(pose, deviations), left_mm(pose, deviations / 2)
    assert np.log2(coarse / fine) == pytest.approx(4, abs=ORDER)


@pytest.mark.parametrize("supersampling", [1, 2])
def test_rays_that_start_on_squares_add_the_covariance_of_the_square(supersampling: int) -> None:
    """Both planes see the sensor affinely and without blur: the mean hit of a whole square, summed over its points, is
    approached with the fourth power of its size on the planes."""
    pose, k = turned(25, -30, 40), supersampling
    row, column = (np.mgrid[: 6 * k, : 6 * k] - 2.5 * k).astype(float)
    node, weight = np.polynomial.legendre.leggauss(4)
    offset, share = (
        np.stack(np.meshgrid(node / 2, node / 2), axis=-1).reshape(-1, 2),
        np.outer(weight, weight).ravel() / 4,
    )
    left = []
    for scale in (1.0, 0.5):
        near, far = scale * np.array([[0.9, 0.2], [-0.1, 0.7]]), scale * np.array([[-0.8, 0.3], [0.4, -1.1]])
        middle = np.stack([column, row], axis=-1)
        grid = rigs.sharp_grid(middle @ near.T, middle @ far.T, k, (NEAR_MM, FAR_MM), square_steps=1.0)
        flat = on_target(grid.near, grid.far, NEAR_MM, FAR_MM, pose)
        points = middle[2, 3] + offset
        whole = share @ on_target(points @ near.T, points @ far.T, NEAR_MM, FAR_MM, pose)
        left.append(np.linalg.norm(corrected(flat, grid, pose)[2, 3] - whole))
        assert left[-1] < 0.01 * np.linalg.norm(flat[2, 3] - whole)
    assert np.log2(left[0] / left[1]) == pytest.approx(4, abs=0.1)
