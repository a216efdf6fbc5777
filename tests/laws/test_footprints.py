"""Pixels that are called of one colour are of one colour: every ray of them brings the same light.

A pixel that is called so takes its colour by the light of a white scene; the others are sampled as a whole scene is.
"""

from dataclasses import replace

import numpy as np
import pytest
from laws.random_scenes import random_camera, random_pose, random_target
from shorter import one_in

from pipeline.camera.micro_images.centres import MicroImages, micro_images, pixel_strata, positions_of
from pipeline.camera.parts.camera import Camera
from pipeline.camera.rig import Rig
from pipeline.camera.tracer import Tracer
from pipeline.camera.tracing.sampling_bounds import SKIP
from pipeline.files.jsonfile import write_json
from pipeline.frames import rigid
from pipeline.products.cameras import FOCUSED, rig_of, tracer_alone
from pipeline.records.plain import to_plain
from pipeline.render import pixel_rays
from pipeline.render.footprints import Footprints
from pipeline.render.glow import TargetLight
from pipeline.render.imaging import irradiance, irradiance_and_crosstalk, pictures
from pipeline.render.pixel_rays import Band, Batch, rays_of
from pipeline.targets.mesh import Occluder
from pipeline.targets.patterns.checkerboard import Checkerboard
from pipeline.targets.patterns.circles import CircleGrid
from pipeline.targets.surfaces import Cylinder
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
        part = rays.pixels[rays.row] + len(lenses) * (rays.route > 0)
        value = light.radiance(rays.leaving.origin, rays.leaving.direction)
        np.minimum.at(least, part, value)
        np.maximum.at(most, part, value)
    return least.reshape(2, -1), most.reshape(2, -1)


def seen(rig: Rig, light: TargetLight) -> np.ndarray:
    return light.uniform(Footprints(Band.of(rig, ROWS)))


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


SQUARES = Checkerboard(columns=6, rows=3, square_mm=3.0)
POSE = rigid(np.diag([1.0, -1.0, -1.0]), np.array([0.3, -0.2, 430.0]))
BEHIND = rigid(np.diag([1.0, -1.0, -1.0]), np.array([9.0, 2.0, 470.0]))
SHARED_SCENES = [
    TargetLight([(Target(SQUARES), POSE)], 0.25),
    TargetLight([(Target(CircleGrid(columns=5, rows=4, spacing_mm=4.0, diameter_mm=2.0)), POSE)], 0.1),
    TargetLight([(Target(SQUARES), POSE), (Target(SQUARES), BEHIND)], 0.1),
    TargetLight([(Target(SQUARES, Cylinder(radius_mm=30.0)), POSE)], 0.5),
    TargetLight([], 0.7),
]
SHARED_ROWS = (20, 29)


@pytest.mark.parametrize("kind", ["conventional", "plenoptic"])
def test_scenes_in_company_are_scenes_alone(kind: str, request: pytest.FixtureRequest, monkeypatch) -> None:
    camera: Camera = request.getfixturevalue(kind)
    tracer = Tracer(camera, seed=3)
    rig = Rig.of(tracer)
    white, foreign = irradiance_and_crosstalk(rig, 16, None, SHARED_ROWS)
    parts = np.array([white - foreign, foreign])
    together = pictures(rig, 16, SHARED_SCENES, parts, SHARED_ROWS)
    assert np.ptp(together[:4], axis=(1, 2)).min() > 0
    for scene, image in zip(SHARED_SCENES, together, strict=True):
        assert np.array_equal(image, pictures(rig, 16, [scene], parts, SHARED_ROWS)[0])
    monkeypatch.setattr(pixel_rays, "_RAYS_PER_CHUNK", 500)
    assert np.array_equal(together, pictures(rig, 16, SHARED_SCENES, parts, SHARED_ROWS))
    first = [pictures(rig, 16, SHARED_SCENES, parts[:, a - 20 : b - 20], (a, b)) for a, b in ((20, 23), (23, 29))]
    assert np.array_equal(together, np.concatenate(first, axis=1))
    some = pictures(rig, 16, SHARED_SCENES, parts[:, :, 30:45], SHARED_ROWS, (30, 45))
    assert np.array_equal(together[:, :, 31:44], some[:, :, 1:-1])
    assert kind == "conventional" or np.array_equal(together[:, :, 30:45], some)


def test_tasks_of_a_camera_share_what_makes_it_ready_and_no_other_camera_or_seed_does(plenoptic, tmp_path) -> None:
    other = replace(plenoptic, sensor_distance_mm=np.nextafter(plenoptic.sensor_distance_mm, np.inf))
    ready = {}
    for name, camera, seed in (("one", plenoptic, 3), ("two", plenoptic, 3), ("seed", plenoptic, 4), ("mm", other, 3)):
        (tmp_path / name).mkdir()
        write_json(tmp_path / name / FOCUSED, to_plain(camera))
        inputs = {"camera": {FOCUSED: tmp_path / name / FOCUSED}}
        ready[name] = (tracer_alone(inputs, seed), rig_of(inputs, seed).tracer, rig_of(inputs, seed).images)
        assert (ready[name][0].camera, ready[name][0].seed) == (camera, seed)
    assert all(one is two for one, two in zip(ready["one"], ready["two"], strict=True))
    assert ready["one"][0] is ready["one"][1]
    assert not {*map(id, ready["one"])} & {*map(id, ready["seed"]), *map(id, ready["mm"])}
