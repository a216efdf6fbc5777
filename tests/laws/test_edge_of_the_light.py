"""Claim: rows at the edge of the light, whose bundles many rims cut, keep the claim and three of their own sigmas.

The judge looks for the edge in 16,384 directions by halving, and for no corner, no bound and no chief ray; a quarter of
them say how well it knows.
"""

import numpy as np
import pytest
from laws import rigs
from laws.random_scenes import random_camera
from laws.solving import rig_of
from naive import polar
from published.library import prescription

import pipeline
from pipeline.camera.parts.camera import Camera, Sensor
from pipeline.frames import apply
from pipeline.optics.first_order import first_order
from pipeline.optics.kernels import trace_rays
from pipeline.optics.prescription import Prescription
from pipeline.optics.table import towards_scene
from pipeline.truth.direct.direct_rows import Guess, solve

CLAIM_PX, HALVED_PX = 1e-3, 1e-6
"""The default claim, and what halved edges and corners leave in rows."""
PITCH_MM, DIRECTIONS = 0.006, (1 << 14, 1 << 12)
ENDS_MM = {
    "double_gauss_50mm_canon_rf": 27.0,
    "macro_100mm_canon": 34.0,
    "double_gauss_100mm_mills": 52.0,
    "cooke_triplet_50mm": 33.0,
    "retrofocus_28mm_leica": 26.8,
    "telephoto_250mm_sigler": 74.0,
    "wide_22mm_nakamura": 22.9,
    "double_gauss_80mm_zeiss": 52.7,
    "double_gauss_100mm_fujioka": 57.0,
    "portrait_85mm_pentax": 37.0,
}
"""Lenses of the library, spherical and not, and where their light ends, or nearly. At the end of the second there is no
chief ray, though 7 % of the light arrives; of the third an inner rim begins to cut between two heights of a bound."""


def fully_open(name: str) -> Camera:
    """A lens of the library before a sensor whose corners lie where its light ends."""
    lens = prescription(name)
    distance_mm, size = 12 * first_order(lens).efl_mm, int(np.sqrt(2) * ENDS_MM[name] / PITCH_MM)
    sensor = Sensor(width_px=size, height_px=size, pitch_mm=PITCH_MM)
    return rigs.bare(lens, sensor, -first_order(lens).image_mm(distance_mm), (0.9 * distance_mm, 1.1 * distance_mm))


def by_kernel(lens: Prescription, position: np.ndarray, direction: np.ndarray) -> tuple[np.ndarray, ...]:
    """`textbook.trace` knows no aspheres; the trace itself is judged elsewhere."""
    position, alive = position.copy(), np.ones(len(position))
    direction = direction / np.linalg.norm(direction, axis=1, keepdims=True)
    trace_rays(towards_scene(lens), position, direction, alive)
    return np.nan_to_num(position), np.where(alive[:, None] > 0, direction, [0.0, 0.0, 1.0]), alive > 0


@pytest.mark.parametrize(
    ("name", "count"),
    [
        ("double_gauss_50mm_canon_rf", 5),
        ("macro_100mm_canon", 2),
        ("double_gauss_100mm_mills", 3),
        *(pytest.param(name, 12, marks=pytest.mark.heavy) for name in ENDS_MM),
    ],
)
def test_rows_at_the_edge_of_the_light_keep_claim_and_sigma(name: str, count: int) -> None:
    """Points are where the judge says that positions look, on a tilted board out of focus."""
    camera, rng = fully_open(name), np.random.default_rng(47)
    rig, pose = rig_of(camera), rigs.facing(0.93 * 12 * first_order(camera.prescription).efl_mm, 15.0)
    far, angle = ENDS_MM[name] * rng.uniform(0.92, 0.999, count), np.pi / 4 + rng.uniform(-0.02, 0.02, count)
    planes, x_px = np.tile([pose[:3, 3], *pose[:3, :3].T], (count, 1, 1)), np.empty((count, 2))
    doubt_mm = np.empty((count, 2))
    for i, start in enumerate(np.stack([far * np.cos(angle), far * np.sin(angle)], axis=1)):
        hit, coarser = (polar.mean_hit(camera, start, pose, None, n, 12, by_kernel)[0] for n in DIRECTIONS)
        doubt_mm[i] = hit - coarser
        planes[i, 0], x_px[i] = apply(pose, np.array([*hit, 0.0])), rig.tracer.pixels_at(start[None])[0]
    guess = Guess(np.arange(count), np.zeros(count, np.int64), x_px + rng.uniform(-2, 2, x_px.shape))
    rows = solve(rig, guess, planes, CLAIM_PX, 0.0)
    assert rows.counts["inaccurate"] == 0 and len(rows.solutions.point) + rows.counts["dropped_outside_image"] == count
    assert len(rows.solutions.point) > count / 2
    solved = rows.solutions.xy_px
    apart = np.hypot(*(solved - x_px[rows.solutions.point]).T)
    assert apart.max() < CLAIM_PX
    doubt = np.hypot(*np.linalg.solve(rows.solutions.jacobian, doubt_mm[rows.solutions.point, :, None])[..., 0].T)
    assert np.all(apart <= 3 * np.hypot(*rows.sigma_px.T) + doubt + HALVED_PX)


@pytest.mark.parametrize("count", [20, pytest.param(100, marks=pytest.mark.heavy)])
def test_positions_beside_a_rim_that_begins_to_cut_come_back_within_their_errors(count: int) -> None:
    """There J bends: a difference over half a pixel is no derivative of it, and was wrong by a factor of five."""
    camera = pipeline.ready(random_camera(np.random.default_rng(6)))
    rng, sensor = np.random.default_rng(1), camera.camera.sensor
    x_px, y_px = rng.uniform(-0.5, sensor.width_px - 0.5, count), rng.uniform(-0.5, sensor.height_px - 0.5, count)
    rays, distance_mm = camera.rays(x_px, y_px), rng.uniform(*camera.planes_mm, count)
    lit = np.flatnonzero(rays.hit_fraction >= 0.05)
    points = np.stack([rays.at_distance(distance_mm[i])[i] for i in lit])
    images = camera.project(points)
    came_back = 0
    for number, i in enumerate(lit):
        own = np.flatnonzero((images.point == number) & (images.microlens == rays.microlens[i]).all(axis=1))
        apart = np.hypot(images.x_px[own] - x_px[i], images.y_px[own] - y_px[i])
        claimed = 3 * np.hypot(*images.error_px[own].T) + 3 * np.hypot(*rays.error_px[i]) + HALVED_PX
        came_back += bool((apart <= claimed).any())
    assert came_back == len(lit) > 0.8 * count
