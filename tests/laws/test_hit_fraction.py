"""Claim: a hit fraction is the share of the light that could arrive which does: of position images, of bundles by
quadrature and in the rows of a table, against a closed form and against the slow twin of microlenses.
"""

import math
from pathlib import Path

import numpy as np
import pytest
from laws import rigs
from naive import slow_microlens, textbook
from tolerances import MEAN_SHARE, SAMPLED_SHARE, SIGMAS

from pipeline.camera.integrals import Bundles, integrals
from pipeline.camera.parts.camera import Camera, Sensor
from pipeline.camera.rig import Rig
from pipeline.camera.tracer import Tracer, parallel_planes
from pipeline.camera.tracing.sampling_bounds import NO_MICROLENS
from pipeline.truth.grid.correspond import correspond
from pipeline.truth.grid.position_image import on_target
from pipeline.truth.grid.ray_grid import RayGrid, fine_from_image, image_from_fine
from pipeline.truth.settings import TruthSettings

SENSOR_MM, RADIUS_MM, PITCH_MM = 60.0, 5.0, 1.0


def hole() -> Camera:
    """No lens: a stop before large pixels, which see it under up to 33 degrees."""
    sensor = Sensor(width_px=64, height_px=48, pitch_mm=PITCH_MM)
    return rigs.bare(rigs.hole(RADIUS_MM), sensor, SENSOR_MM, (500.0, 1500.0))


def share_of_light(x_px: np.ndarray, y_px: np.ndarray) -> np.ndarray:
    """Irradiance by a uniform disc parallel to the sensor, over that on its axis.

    P. D. Foote, Illumination from a radiating disk, Scientific Papers of the Bureau of Standards 12 (1915) 583.
    """
    off = ((x_px - 31.5) ** 2 + (y_px - 23.5) ** 2) * PITCH_MM**2

    def irradiance(r2: np.ndarray) -> np.ndarray:
        h2, disc2 = SENSOR_MM**2, RADIUS_MM**2
        return 1 - (h2 + r2 - disc2) / np.sqrt((h2 + r2 + disc2) ** 2 - 4 * r2 * disc2)

    return irradiance(off) / irradiance(np.zeros(1))


@pytest.fixture(scope="module")
def hole_grid(tmp_path_factory: pytest.TempPathFactory) -> RayGrid:
    return rigs.ray_grid(tmp_path_factory.mktemp("hole"), hole(), 2, 1024)


def test_position_images_and_quadrature_have_the_closed_form_of_a_disc(hole_grid: RayGrid) -> None:
    """From 1 on the axis to 0.5 in the corners."""
    row, column = np.mgrid[: hole_grid.near.shape[0], : hole_grid.near.shape[1]]
    x, y = image_from_fine(column, 2), image_from_fine(row, 2)
    ratio = hole_grid.hit_fraction / share_of_light(x, y)
    assert np.abs(ratio - 1).max() < SAMPLED_SHARE
    assert abs(ratio.mean() - 1) < MEAN_SHARE
    assert hole_grid.hit_fraction.min() < 0.55
    rig, some = Rig(Tracer(hole()), None), np.array([[31.5, 23.5], [2.0, 5.0], [60.0, 47.0], [31.5, 0.0]])
    planes = np.repeat(parallel_planes(500.0, 600.0)[None], len(some), axis=0)
    bundles = Bundles(some, np.full(len(some), NO_MICROLENS), planes)
    found = rig.hit_fraction(integrals(rig.tracer, bundles, 1).moments)
    np.testing.assert_allclose(found, share_of_light(*some.T), rtol=MEAN_SHARE)


def test_rows_have_the_hit_fraction_of_their_position(hole_grid: RayGrid) -> None:
    """A hundred points of a plane that is not parallel to the sensor; across a fine pixel the share bends by 0.7 %."""
    pose = rigs.facing(900.0, 20.0)
    x = np.random.default_rng(6).uniform([3.0, 3.0], [60.0, 44.0], (100, 2))
    image = on_target(hole_grid.near, hole_grid.far, hole_grid.near_mm, hole_grid.far_mm, pose)
    row, column = np.rint(fine_from_image(x[:, ::-1], 2)).astype(int).T
    points = np.column_stack([image[row, column] + 0.3, np.zeros(len(x))])  # not in the middle of pixels
    rows = correspond(image, points, hole_grid, pose, TruthSettings(method="moments", filter="none"))
    assert len(rows.solutions.point) > 90
    np.testing.assert_allclose(rows.hit_fraction, share_of_light(rows.solutions.x_px, rows.solutions.y_px), rtol=0.01)


def test_behind_microlenses_it_is_the_share_that_the_main_lens_lets_through(tmp_path: Path) -> None:
    """Rays of the slow twin through the whole aperture of a microlens: how many of them the main lens lets through."""
    camera, rng, groups, rays = rigs.plenoptic(1.0, 32, 24), np.random.default_rng(9), 8, 4_000
    tracer, grid = Tracer(camera), rigs.ray_grid(tmp_path, camera, 1, 1024)
    rig, partly = Rig.of(tracer), 0
    for row, column in ((3, 5), (12, 16), (9, 27), (20, 11), (6, 22), (17, 30)):
        cell, x = int(grid.cell[row, column]), np.array([[column, row]], float)
        k, l, kind = grid.microlenses[cell].tolist()
        vertex, shares = slow_microlens.vertex(camera, k, l), []
        for _ in range(groups):
            start = tracer.positions_mm(*x.T)[0]
            *ray, weight, entered = slow_microlens.rays_before(camera, start, vertex, kind, rays, rng)
            *_, passes = textbook.trace(camera.prescription, *ray)
            shares.append(weight[passes].sum() / entered.sum())
        expected, error = np.mean(shares), np.std(shares, ddof=1) / math.sqrt(groups)
        partly += 0.1 < expected < 0.9
        assert error < 0.01
        assert abs(grid.hit_fraction[row, column] - expected) < SIGMAS * error + SAMPLED_SHARE
        planes = parallel_planes(400.0, 470.0)[None]
        quadrature = rig.hit_fraction(integrals(tracer, Bundles(x, np.array([cell]), planes), 2).moments)[0]
        assert abs(quadrature - expected) < SIGMAS * error + MEAN_SHARE
    assert partly >= 2
