"""Pixels that are called of one colour are of one colour: every ray of them brings the same light.

A pixel that is called so takes its colour by the light of a white scene; the others are sampled as a whole scene is.
"""

import numpy as np
import pytest
from laws.random_scenes import random_camera, random_pose, random_target
from shorter import one_in

from pipeline.camera.micro_images.centres import MicroImages, micro_images, pixel_strata, positions_of
from pipeline.camera.parts.camera import Camera
from pipeline.camera.rig import Rig
from pipeline.camera.tracer import Tracer
from pipeline.camera.tracing.sampling_bounds import SKIP
from pipeline.render.footprints import Footprints
from pipeline.render.glow import TargetLight
from pipeline.render.imaging import irradiance, irradiance_and_crosstalk, pictures
from pipeline.render.passes import Batch
from pipeline.render.pixel_rays import Band, rays_of
from pipeline.targets.mesh import Occluder
from pipeline.targets.patterns.checkerboard import Checkerboard
from pipeline.targets.target import Target

ROWS = (24, 40)
"""In the middle of all cameras here."""
SAMPLES = 512
"""Rays of each pixel and microlens that may find another colour."""
SCENES = 12
CARD = Occluder(
    vertices_mm=((-1.0, -0.4, 0.0), (1.0, -0.4, 0.5), (0.0, 0.8, -0.5)), triangles=((0, 1, 2),), radiance=0.4
)


def scene_of(seed: int) -> tuple[Rig, TargetLight]:
    """A camera and what it looks at: a target, every third time a card before it."""
    rng = np.random.default_rng(seed)
    tracer = Tracer(random_camera(rng), seed)
    rig = Rig.of(tracer)
    pose = random_pose(rng, rig)
    card = pose.copy()
    card[:3, 3] *= rng.uniform(0.9, 0.97)
    return rig, TargetLight([(random_target(rng), pose)], 0.25, [(CARD, card)] if seed % 3 == 0 else [])


def extremes(rig: Rig, light: TargetLight) -> tuple[np.ndarray, np.ndarray]:
    """Least and most light that any ray brings to both parts of each pixel, (2, n); infinite where none arrives."""
    band = Band.of(rig, ROWS)
    lenses = band.strata
    least, most = np.full(2 * len(lenses), np.inf), np.full(2 * len(lenses), -np.inf)
    for rays in rays_of(band, Batch(SAMPLES), np.where(lenses == SKIP, 0, SAMPLES)):
        part = rays.pixels[rays.row] + len(lenses) * (rays.way > 0)
        value = light.radiance(rays.leaving.origin, rays.leaving.direction)
        np.minimum.at(least, part, value)
        np.maximum.at(most, part, value)
    return least.reshape(2, -1), most.reshape(2, -1)


def seen(rig: Rig, light: TargetLight) -> np.ndarray:
    """Colour of both parts of each pixel, (2, n), NaN where it is not sure."""
    return light.seen(Footprints(Band.of(rig, ROWS)))


@pytest.mark.parametrize("seed", one_in(4, range(SCENES)))
def test_no_ray_brings_another_colour(seed: int) -> None:
    rig, light = scene_of(seed)
    colour, (least, most) = seen(rig, light), extremes(rig, light)
    sure = (most >= least) & ~np.isnan(colour)
    assert np.array_equal(least[sure], colour[sure])
    assert np.array_equal(most[sure], colour[sure])


@pytest.mark.parametrize("kind", ["conventional", "plenoptic"])
def test_few_pixels_of_one_colour_are_not_called_so(kind: str, request: pytest.FixtureRequest) -> None:
    """Of a board in focus fewer pixels are doubted for nothing than have an edge."""
    rig = Rig.of(Tracer(request.getfixturevalue(kind)))
    board = Target(Checkerboard(columns=4, rows=3, square_mm=4.0))
    light = TargetLight([(board, random_pose(np.random.default_rng(1), rig))], 0.25)
    colour, (least, most) = seen(rig, light), extremes(rig, light)
    mixed = most > least
    assert 0.1 < mixed[0].mean() < 0.45
    assert np.isnan(colour[mixed]).all()
    assert np.isnan(colour[0]).mean() < 2 * mixed[0].mean()


@pytest.mark.parametrize("kind", ["conventional", "plenoptic"])
def test_the_error_is_that_of_all_samples(kind: str, request: pytest.FixtureRequest) -> None:
    """Against 2,048 samples, 16 samples where an edge may be leave what 16 everywhere leave, within a tenth."""
    camera: Camera = request.getfixturevalue(kind)
    rig = Rig.of(Tracer(camera))
    board = Target(Checkerboard(columns=4, rows=3, square_mm=4.0))
    light = TargetLight([(board, random_pose(np.random.default_rng(1), rig))], 0.25)
    exact = irradiance(Rig(Tracer(camera, 99), rig.images), 2048, light.radiance, ROWS)
    errors = []
    for seed in range(4):
        rig = Rig(Tracer(camera, seed), rig.images)
        white, foreign = irradiance_and_crosstalk(rig, 16, None, ROWS)
        found = pictures(rig, 16, [light], np.array([white - foreign, foreign]), ROWS)[0]
        errors.append([found - exact, irradiance(rig, 16, light.radiance, ROWS) - exact])
    now, all_samples = np.sqrt(np.mean(np.square(errors), axis=(0, 2, 3)))
    assert 0.001 < all_samples < 0.1
    assert now < 1.1 * all_samples


@pytest.mark.parametrize("seed", range(4))
def test_sampled_pixels_are_those_of_the_whole_scene(seed: int) -> None:
    """Where all light comes through one microlens, or none: the same rays, the same sums."""
    rig, light = scene_of(seed)
    white, foreign = irradiance_and_crosstalk(rig, 16, None, ROWS)
    found = pictures(rig, 16, [light], np.array([white - foreign, foreign]), ROWS)[0]
    whole = irradiance(rig, 16, light.radiance, ROWS)
    alone = foreign == 0
    assert alone.mean() > 0.1
    assert np.allclose(found[alone], whole[alone], rtol=0, atol=1e-14)
    assert np.abs(found.mean() - whole.mean()) < 0.01 * white.mean()


def contributors(images: MicroImages, positions_mm: np.ndarray, slack_mm: float) -> np.ndarray:
    """Rows of the microlenses whose light may reach within `slack_mm` of each position, nearest first, (n, s).

    As many columns as the position with the most of them needs; `SKIP` for a microlens whose light does not.
    """
    distance, rows = images.nearby.within(positions_mm, float(images.reach_mm.max()) + slack_mm)
    lit = distance <= images.reach_mm[rows] + slack_mm
    return np.where(lit, rows, SKIP)[:, : int(np.flatnonzero(lit.any(axis=0)).max()) + 1]


def test_microlenses_laid_onto_pixels_are_those_that_a_tree_finds(plenoptic: Camera) -> None:
    tracer = Tracer(plenoptic)
    images, rows = micro_images(tracer), (10, 50)
    found = pixel_strata(tracer, images, rows)
    known = contributors(images, positions_of(tracer, rows), plenoptic.sensor.pitch_mm * np.sqrt(0.5))
    assert np.array_equal(found[:, : known.shape[1]], known)
    assert np.all(found[:, known.shape[1] :] == SKIP)
