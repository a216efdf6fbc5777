"""Claim: bounded, stratified, packed bundles have the mean, covariance and weight of brute-force ones, and images the
brightness of pixels computed ray by ray.
"""

import numpy as np
import pytest
from laws import rigs
from naive import brute, textbook
from naive.brute import GROUPS, POSES, RAYS, brute_moments, deviations, packed_moments
from shorter import few, few_cases
from tolerances import SIGMAS

from pipeline.camera.integrals import Bundles, integrals
from pipeline.camera.micro_images.centres import micro_images
from pipeline.camera.parts.camera import Camera, Sensor
from pipeline.camera.rig import Rig
from pipeline.camera.tracer import Tracer, target_plane
from pipeline.camera.tracing.moments import COVARIANCE, WEIGHT
from pipeline.camera.tracing.sampling_bounds import NO_MICROLENS
from pipeline.render.glow import TargetLight
from pipeline.render.imaging import irradiance
from pipeline.targets.patterns.checkerboard import Checkerboard
from pipeline.targets.target import Target


@pytest.mark.parametrize(
    ("x_mm", "y_mm", "is_displaced"),
    few_cases(
        [(-14.0, 16.0, False), (7.0, -4.0, True)],
        *((0.0, 0.0, False), (7.0, 4.0, False), (0.0, 0.0, True), (-14.0, 16.0, True)),
    ),
)
def test_conventional_bundles_are_those_of_rays_all_over_the_rear_surface(
    x_mm: float, y_mm: float, is_displaced: bool
) -> None:
    """At f/2, on the axis, off it and in the vignetted corner: J on two tilted planes, second moments, weight; also
    with the coma of decentred groups and one-sided vignetting."""
    camera, start = rigs.conventional(17.1, 900, 900), np.array([x_mm, y_mm])
    camera = rigs.displaced(camera) if is_displaced else camera
    found = deviations(packed_moments(camera, start, NO_MICROLENS), brute_moments(camera, start))
    assert np.abs(found).max() < SIGMAS


@pytest.mark.parametrize(
    ("k", "l", "is_displaced"),
    few_cases([(20, -56, False), (-30, 45, True)], (1, 0, False), (0, 0, False), (-30, 45, False), (0, 0, True)),
)
def test_plenoptic_bundles_are_those_of_rays_all_over_the_microlens(k: int, l: int, is_displaced: bool) -> None:
    """All types, on the axis and in the corners of the array; positions in the middle of the cell and near its edge."""
    camera = rigs.displaced(rigs.plenoptic()) if is_displaced else rigs.plenoptic()
    tracer = Tracer(camera)
    row = int(np.flatnonzero((tracer.lattice.k == k) & (tracer.lattice.l == l))[0])
    vertex = -np.array([tracer.lattice.x_mm[row], tracer.lattice.y_mm[row]])
    focal = (1.9, 2.1, 2.3)[(k - l) % 3]
    for offset in ((0.004, -0.01), (0.09, 0.03)):
        start = micro_images(tracer).centre_mm[row] + offset
        found = deviations(packed_moments(camera, start, row), brute_moments(camera, start, vertex, focal))
        assert np.abs(found).max() < SIGMAS


BOARD = Checkerboard(columns=4, rows=3, square_mm=6.0, white=0.9, black=0.1)
BACKGROUND = 0.3


def pattern(points_mm: np.ndarray) -> np.ndarray:
    """Radiance of the board by counting squares from its top left corner; white margin, background beyond."""
    column, row = np.floor(points_mm[:, 0] / 6.0 + 2.5), np.floor(2.0 - points_mm[:, 1] / 6.0)
    black = (column >= 0) & (column <= 4) & (row >= 0) & (row <= 3) & ((column + row) % 2 == 0)
    beyond = (np.abs(points_mm[:, 0]) > 21.0) | (np.abs(points_mm[:, 1]) > 18.0)
    return np.where(beyond, BACKGROUND, np.where(black, 0.1, 0.9))


def brute_pixel(camera: Camera, x_px: float, y_px: float, pose: np.ndarray, rng: np.random.Generator) -> float:
    """Light of a pixel [sr], over all microlenses within one and a half pitches."""
    pitch = camera.sensor.pitch_mm
    x = (x_px - (camera.sensor.width_px - 1) / 2 + rng.uniform(-0.5, 0.5, RAYS)) * pitch
    y = (y_px - (camera.sensor.height_px - 1) / 2 + rng.uniform(-0.5, 0.5, RAYS)) * pitch
    start = -np.stack([x, y], axis=1)
    ways: list[tuple[np.ndarray | None, float | None]] = [(None, None)]
    if camera.microlenses:
        grid = Tracer(camera).lattice
        vertices = -np.stack([grid.x_mm, grid.y_mm], axis=1)
        near = np.flatnonzero(np.linalg.norm(vertices - start.mean(axis=0), axis=1) < 1.5 * camera.microlenses.pitch_mm)
        ways = [(vertices[i], camera.microlenses.focal_lengths_mm[grid.type[i]]) for i in near]
    total = 0.0
    for vertex, focal in ways:
        position, direction, weight = brute.rays_through(camera, start, vertex, focal, RAYS, rng)
        kept = weight > 0
        total += weight[kept] @ pattern(textbook.at_plane(position[kept], direction[kept], pose))
    return total


def small(camera_kind: str) -> Camera:
    """A few coarse pixels around the middle of the field: their squares matter."""
    if camera_kind.startswith("displaced"):
        return rigs.displaced(small(camera_kind.removeprefix("displaced ")))
    if camera_kind == "plenoptic":
        return rigs.plenoptic(1.6, width_px=9, height_px=7, pitch_mm=0.04)
    return rigs.bare(rigs.tronnier(8.0), Sensor(width_px=9, height_px=7, pitch_mm=1.7), 131.81, (400.0, 470.0))


@pytest.mark.parametrize("kind", few(["conventional"], "plenoptic", "displaced conventional", "displaced plenoptic"))
def test_pixels_are_as_bright_as_rays_summed_one_by_one(kind: str) -> None:
    """A tilted board before a grey background; light through neighbouring microlenses included. z-test per pixel."""
    camera, pose, rng = small(kind), rigs.facing(425.0, 25.0, 2.0, -1.0), np.random.default_rng(13)
    light = TargetLight([(Target(BOARD), pose)], BACKGROUND)
    seeds = [Tracer(camera, seed) for seed in range(16)]
    images = micro_images(seeds[0]) if camera.microlenses else None
    stack = np.stack([irradiance(Rig(t, images), 256, light.radiance) * t.reference_weight_sr for t in seeds])
    for x, y in ((4, 3), (8, 1), (2, 6)):
        brute_values = [brute_pixel(camera, x, y, pose, rng) for _ in range(GROUPS)]
        error = np.hypot(np.std(stack[:, y, x], ddof=1) / 4, np.std(brute_values, ddof=1) / np.sqrt(GROUPS))
        assert abs(np.mean(stack[:, y, x]) - np.mean(brute_values)) < SIGMAS * error
        assert error < 0.03 * np.mean(brute_values)


PIXEL_MM, FOCAL_MM, MANY_RAYS = 0.01, 1.9, 10_000


def test_conventional_bundles_of_squares_are_those_of_random_starts() -> None:
    camera, start = rigs.conventional(17.1, 900, 900), np.array([7.0, 4.0])
    expected = brute_moments(camera, start, None, None, 60 * 0.05, 2_000)
    assert np.abs(deviations(packed_moments(camera, start, NO_MICROLENS, 60.0), expected)).max() < SIGMAS


@pytest.mark.parametrize(
    ("off_mm", "pull_px"),
    few_cases([(0.11, 0.17)], (0.113, 0.26), (0.05, 0.0)),
)
def test_in_the_penumbra_the_pixel_pulls_j_to_the_brighter_side(off_mm: float, pull_px: float) -> None:
    """Paper's rig, f = 1.9 mm, K = 1: 0.17 px at a hit fraction of 0.18, 0.26 px at 0.09, nothing in full light.

    `pull_px` was printed by the twin alone; its rays scatter by 0.005 px. Random rays and quadrature agree with it.
    """
    camera = rigs.plenoptic(2.0)
    tracer, images = Tracer(camera), micro_images(Tracer(camera))
    row = int(np.flatnonzero((tracer.lattice.k == 0) & (tracer.lattice.l == 0))[0])
    start = images.centre_mm[row] + off_mm * np.array([0.96, 0.28])
    through = tracer.vertices_mm[row], FOCAL_MM
    point, square = (brute_moments(camera, start, *through, edge_mm, MANY_RAYS) for edge_mm in (0.0, PIXEL_MM))
    steps = [
        brute_moments(camera, start + 0.001 * way, *through, 0.0, 2_000)[:, :2].mean(axis=0)
        for way in (*np.eye(2), *-np.eye(2))
    ]
    # Image positions and vision coordinates on the sensor run against each other.
    px_from_mm = np.linalg.inv(-np.stack([steps[0] - steps[2], steps[1] - steps[3]], axis=1) / 0.002 * PIXEL_MM)
    pull = px_from_mm @ (square - point)[:, :2].mean(axis=0)
    bright = np.array([0.96, 0.28])
    assert np.hypot(*pull) == pytest.approx(pull_px, rel=0, abs=0.015)
    assert pull_px == 0 or pull @ bright > 0.9 * np.hypot(*pull)
    assert np.abs(deviations(packed_moments(camera, start, row, 1.0), square)).max() < SIGMAS
    x, planes = tracer.pixels_at(start[None]), np.stack([target_plane(pose) for pose in POSES])[None]
    found = integrals(tracer, Bundles(x, np.array([row]), planes, 1.0), 3)
    assert not found.is_random[0]
    here = found.moments[0, [*range(COVARIANCE + 10), WEIGHT]]
    error = square.std(axis=0, ddof=1) / np.sqrt(GROUPS)
    assert np.abs((square.mean(axis=0) - here) / error).max() < SIGMAS
