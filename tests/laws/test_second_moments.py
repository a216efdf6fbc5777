"""Claim: second moments and errors map as the rays do that they belong to, on planes turned about any axis and through
any derivative of J.
"""

import numpy as np
import pytest
from laws.fast_lens import FAR_MM, NEAR_MM
from laws.oblique import MEAN, OBLIQUE, turned
from tolerances import ORDER, ROUNDING_MM

from pipeline.truth import blur
from pipeline.truth.grid.position_image import crossing_share, in_pixels, jacobian, on_target
from pipeline.truth.grid.ray_grid import matrix_4

SHEARED = np.array([[0.31, 0.12], [-0.05, -0.24]])
"""A derivative of J that is not symmetric [mm per px]."""


@pytest.mark.parametrize("axes", OBLIQUE)
def test_the_covariance_of_hits_is_that_of_the_rays_projected(axes: str) -> None:
    """Rays in mirrored pairs hit the plane and are mapped to the image singly: their covariance is approached with the
    square of their distances, relative to itself."""
    pose, deviations = turned(*OBLIQUE[axes]), np.random.default_rng(3).normal(0, 0.3, (6, 4))
    share, _, way = crossing_share(MEAN[None, :2], MEAN[None, 2:], NEAR_MM, FAR_MM, pose)
    left = []
    for scale in (0.5, 0.25):
        scattered = scale * np.concatenate([deviations, -deviations])
        rays = MEAN + scattered
        hits = on_target(rays[:, :2], rays[:, 2:], NEAR_MM, FAR_MM, pose) @ np.linalg.inv(SHEARED).T
        triangle = (scattered.T @ scattered / len(scattered))[np.triu_indices(4)]
        uu, _ = blur.deviations(matrix_4(triangle[None]), share)
        found = blur.in_image(blur.on_plane(uu, way, pose), SHEARED[None])[0]
        left.append(np.abs(np.cov(hits.T, bias=True) - found).max() / np.abs(found).max())
    assert np.log2(left[0] / left[1]) == pytest.approx(2, abs=5 * ORDER)


def test_moments_at_a_plane_are_those_of_the_crossings_there() -> None:
    """u at a share t of the way and v, the difference of the far and the near crossing; u stands before v."""
    near, far = np.random.default_rng(5).normal(0, 1.0, (2, 7, 2))
    near, far = near - near.mean(axis=0), far - far.mean(axis=0)
    triangle = np.cov(np.hstack([near, far]).T, bias=True)[np.triu_indices(4)]
    for t in (-0.3, 0.2, 1.4):
        uu, uv = blur.deviations(matrix_4(triangle[None]), np.array([t]))
        at_plane = (1 - t) * near + t * far
        np.testing.assert_allclose(uu[0], at_plane.T @ at_plane / 7, rtol=0, atol=ROUNDING_MM)
        np.testing.assert_allclose(uv[0], at_plane.T @ (far - near) / 7, rtol=0, atol=ROUNDING_MM)


@pytest.mark.parametrize("spreads", [True, False])
def test_rho_is_the_radius_of_a_uniform_disc_and_positive_beyond_the_best_focus(spreads: bool) -> None:
    """A disc of radius r has the variance r^2 / 4 along each axis; its sign is that of the covariance of u and v."""
    radius_px = 3.0
    covariance = np.eye(2)[None] * radius_px**2 / 4
    rho = blur.signed_radius_px(covariance, (1.0 if spreads else -1.0) * covariance)
    assert rho[0] == pytest.approx(radius_px if spreads else -radius_px, rel=1e-12)


def test_errors_map_through_the_inverse_derivative() -> None:
    """Independent errors along x and y of the target; columns of the derivative are steps of the fine grid."""
    variance = np.array([4e-6, 1e-6])
    steps = np.linalg.inv(SHEARED)
    expected = np.sqrt(steps**2 @ variance) / 3
    np.testing.assert_allclose(in_pixels(variance[None], SHEARED[None], 3)[0], expected, rtol=1e-12)


def test_derivatives_along_columns_and_rows_stay_in_their_cell() -> None:
    """An affine J in two cells that differ by a jump: the same derivative everywhere, columns before rows."""
    row, column = np.mgrid[:6, :8].astype(float)
    cell = (column >= 4).astype(int)
    image = np.stack([column, row], axis=-1) @ SHEARED.T + 100.0 * cell[..., None]
    np.testing.assert_allclose(jacobian(image, cell), np.broadcast_to(SHEARED, (6, 8, 2, 2)), rtol=0, atol=ROUNDING_MM)
