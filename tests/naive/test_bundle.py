"""Claim: bounded, stratified, packed bundles have the mean, covariance and weight of brute-force ones, and images the
brightness of pixels computed ray by ray.
"""

import numpy as np
import pytest
from laws import rigs
from naive import brute, textbook
from naive.bundles import GROUPS, RAYS, brute_moments, deviations, packed_moments
from shorter import few
from tolerances import SIGMAS

from pipeline.camera.micro_images.centres import micro_images
from pipeline.camera.parts.camera import Camera, Sensor
from pipeline.camera.rig import Rig
from pipeline.camera.tracer import Tracer
from pipeline.camera.tracing.sampling_bounds import NO_MICROLENS
from pipeline.render.glow import TargetLight
from pipeline.render.imaging import irradiance
from pipeline.targets.patterns.checkerboard import Checkerboard
from pipeline.targets.target import Target


@pytest.mark.parametrize("start_mm", few([(-14.0, 16.0)], (0.0, 0.0), (7.0, 4.0)))
def test_conventional_bundles_are_those_of_rays_all_over_the_rear_surface(start_mm: tuple[float, float]) -> None:
    """At f/2, on the axis, off it and in the vignetted corner: J on two tilted planes, second moments, weight."""
    camera, start = rigs.conventional(17.1, 900, 900), np.array(start_mm)
    found = deviations(packed_moments(camera, start, NO_MICROLENS), brute_moments(camera, start))
    assert np.abs(found).max() < SIGMAS


@pytest.mark.parametrize(
    "start_mm",
    [(7.0, -4.0), *(pytest.param(start, marks=pytest.mark.heavy) for start in [(0.0, 0.0), (-14.0, 16.0)])],
)
def test_conventional_bundles_of_a_displaced_lens_are_those_of_brute_force(start_mm: tuple[float, float]) -> None:
    """At f/2: coma of decentred groups and one-sided vignetting; every moment on both tilted planes."""
    camera, start = rigs.displaced(rigs.conventional(17.1, 900, 900)), np.array(start_mm)
    found = deviations(packed_moments(camera, start, NO_MICROLENS), brute_moments(camera, start))
    assert np.abs(found).max() < SIGMAS


@pytest.mark.parametrize(
    ("k", "l", "is_displaced"),
    [
        (20, -56, False),
        (-30, 45, True),
        *(
            pytest.param(*case, marks=pytest.mark.heavy)
            for case in ((1, 0, False), (0, 0, False), (-30, 45, False), (0, 0, True))
        ),
    ],
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


DISPLACED = "displaced conventional", "displaced plenoptic"


@pytest.mark.parametrize(
    "kind",
    [
        "conventional",
        *(pytest.param(kind, marks=pytest.mark.heavy) for kind in ("plenoptic", *DISPLACED)),
    ],
)
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
