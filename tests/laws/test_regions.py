"""Claim: whatever the bundle looks like where it leaves the lens (one piece, a ring, two pieces apart), method `direct`
puts the row where the mean of all of it looks, with the share of light that all of it has.

An ideal lens before apertures in air, so that rays are two lines each. The truth is a sum over four million points of
the stop.
"""

import dataclasses
import math
from pathlib import Path

import numpy as np
import pytest
from laws import rigs
from laws.solving import correspond
from naive import slow_microlens
from tolerances import MEAN_SHARE, SAMPLED_SHARE, SIGMAS

from pipeline.camera.integrals import NODES, Bundles, integrals
from pipeline.camera.integrating.polar_hits import Polar, bundle_hits
from pipeline.camera.integrating.quadrature import NOT_STAR_SHAPED, edges
from pipeline.camera.parts.camera import Camera, Sensor
from pipeline.camera.rig import Rig
from pipeline.camera.tracer import Tracer, parallel_planes
from pipeline.camera.tracing.moments import WEIGHT
from pipeline.camera.tracing.sampling_bounds import NO_MICROLENS
from pipeline.optics.prescription import Prescription, Surface
from pipeline.truth.direct.direct_rows import guesses, solve
from pipeline.truth.grid.position_image import on_target
from pipeline.truth.grid.ray_grid import RayGrid, fine_from_image, image_from_fine
from pipeline.truth.planes import tangent_planes
from pipeline.truth.settings import TruthSettings

SENSOR_MM, TARGET_MM, PITCH_MM, RADIUS_MM = 60.0, 900.0, 0.1, 5.0
LENS_MM, FOCAL_MM = 2.0, 300.0
"""Where the ideal lens stands before the stop, and far out of focus."""
RING = {"inner_semi_diameter_mm": 2.5}
REGIONS = {
    "disc": ({}, None),
    "ring": (RING, None),
    "slit over a ring": (RING, {"half_widths_mm": (5.0, 1.5)}),
    "slit over a ring off its place": ({**RING, "decentre_mm": (0.8, 0.0)}, {"half_widths_mm": (4.9, 1.0)}),
    "upright slit": ({**RING, "decentre_mm": (0.0, -0.8)}, {"half_widths_mm": (1.0, 4.9)}),
}
"""The stop, and another aperture half a millimetre before it: more than its semi-diameter."""
QUICK = "disc", "slit over a ring off its place"
"""Regions whose rows `make test` holds against the sum; `make proofs` does so with all."""
BEFORE_MM = 0.5
STEPS, COS, SIN = 2000, np.cos(0.4), np.sin(0.4)
"""The grid of the sum lies aslant: rows of points along the edge of a slit would count it wrong by up to 0.05 px."""
BRUTE_PX, DERIVATIVE = 1e-3, 0.05
"""Error of that sum, and of a derivative, by differences of rough integrals [relative]."""
SPOT_PX = 1e-7
"""Error of quadrature of discs, by which edges are known."""


def camera_with(region: str) -> Camera:
    """64 x 48 pixels behind the stop."""
    stop, slit = REGIONS[region]
    surfaces = (
        Surface(focal_length_mm=FOCAL_MM, semi_diameter_mm=20.0, thickness_mm=LENS_MM - BEFORE_MM),
        Surface(semi_diameter_mm=7.5, thickness_mm=BEFORE_MM, **(slit or {})),
        Surface(semi_diameter_mm=RADIUS_MM, is_stop=True, **stop),
    )
    sensor = Sensor(width_px=64, height_px=48, pitch_mm=PITCH_MM)
    return rigs.bare(Prescription(surfaces=surfaces), sensor, SENSOR_MM, (500.0, 1500.0))


def brute(region: str, x_px: np.ndarray, steps: int = STEPS) -> tuple[np.ndarray, float]:
    """Mean hit on the plane z = TARGET_MM, (2,) [mm], and weight [sr] of the bundle of an image position."""
    start = -(x_px - np.array([31.5, 23.5])) * PITCH_MM  # the half turn of the sensor frame
    u, v = ((np.mgrid[:steps, :steps] + 0.5) / steps - 0.5) * 2.2 * RADIUS_MM
    x, y = COS * u - SIN * v, SIN * u + COS * v
    area = (2.2 * RADIUS_MM / steps) ** 2
    stop, slit = REGIONS[region]
    across, up = stop.get("decentre_mm", (0.0, 0.0))
    off = np.hypot(x - across, y + up)  # the lens frame has y up, the vision frame down
    passes = (off <= RADIUS_MM) & (off >= stop.get("inner_semi_diameter_mm", 0.0))
    if slit:
        further = 1 + BEFORE_MM / SENSOR_MM
        half_x, half_y = slit["half_widths_mm"]
        passes &= np.abs(start[0] + further * (x - start[0])) <= half_x
        passes &= np.abs(start[1] + further * (y - start[1])) <= half_y
    squared = (x - start[0]) ** 2 + (y - start[1]) ** 2 + SENSOR_MM**2
    weight = np.where(passes, SENSOR_MM**2 / squared**2 * area, 0.0)
    middle = np.array([np.sum(weight * x), np.sum(weight * y)]) / weight.sum()
    slope = (middle - start) / SENSOR_MM  # the map is linear: the mean ray hits at the mean of the hits
    at_lens = middle + LENS_MM * slope
    return at_lens + (TARGET_MM - LENS_MM) * (slope - at_lens / FOCAL_MM), float(weight.sum())


@pytest.mark.parametrize(
    "region", [pytest.param(name, marks=() if name in QUICK else pytest.mark.heavy) for name in REGIONS]
)
def test_a_row_has_all_of_the_light_of_its_bundle(region: str) -> None:
    """A pixel is 1.5 mm on the target, and each of two pieces alone would be seen 20 px aside.

    A row errs by no more than the sum does, and knows how its position moves with the point.
    """
    rig = Rig(Tracer(camera_with(region)), None)
    points = np.array([[4.0, -7.0, 0.0], [-11.0, 6.0, 0.0]])
    planes = tangent_planes(rigs.facing(TARGET_MM), points)
    found = solve(rig, guesses(rig, planes)[0], planes, 1e-3, 0.01)
    assert found.solutions.point.tolist() == [0, 1] and found.counts["random"] == 0
    _, reference = brute(region, np.array([31.5, 23.5]))
    for i, point in enumerate(planes[:, 0, :2]):
        x = np.array([found.solutions.x_px[i], found.solutions.y_px[i]])
        hit, weight = brute(region, x)
        off_px = np.abs(hit - point) * SENSOR_MM / (PITCH_MM * TARGET_MM)
        assert np.all(off_px < SIGMAS * found.sigma_px[i] + BRUTE_PX)
        assert found.hit_fraction[i] == pytest.approx(weight / reference, rel=2e-3)
        here, right, below = (brute(region, x + step, STEPS // 3)[0] for step in ((0, 0), (1, 0), (0, 1)))
        along = planes[i, 1:3, :2] @ np.stack([right - here, below - here], axis=1)
        assert np.abs(found.solutions.jacobian[i] - along).max() < DERIVATIVE * np.abs(along).max()


@pytest.mark.parametrize(
    "region", [pytest.param(name, marks=() if name in QUICK else pytest.mark.heavy) for name in REGIONS]
)
def test_the_weight_of_reference_is_all_of_the_light_on_the_axis(region: str) -> None:
    """W_ref is an integral, or random rays of a slit would carry their own error into every hit fraction."""
    found = Tracer(camera_with(region)).reference_weight_sr
    assert found == pytest.approx(brute(region, np.array([31.5, 23.5]))[1], rel=4e-4)


@pytest.mark.parametrize("region", REGIONS)
def test_only_a_bundle_in_one_piece_has_a_saddle_and_a_centroid(region: str) -> None:
    """Nodes along a few directions may miss the other piece, and the image of a corner would lack its light."""
    tracer = Tracer(camera_with(region))
    x = np.array([29.0, 31.0]) + np.random.default_rng(0).uniform(-0.7, 0.7, (9, 2))
    plane, shares = parallel_planes(TARGET_MM, TARGET_MM)[0], np.linspace(0.0, 1.0, 9)
    found = bundle_hits(tracer.arrays, tracer.positions_mm(*x.T), NO_MICROLENS, plane, Polar(shares, 16))
    assert found.is_star_shaped.tolist() == [region == "disc"] * len(x)


HOLE_BEFORE_MM, HOLES, FOUND_PERCENT = 20.0, 200, {2.0: 100, 0.1: 20}
"""Holes of so many percent of a bundle's area, and of how many at least the coarsest quadrature takes notice."""


def behind_a_spot(radius_mm: float) -> Tracer:
    """A stop behind an obstruction so far before it that each pixel sees it elsewhere; all of the stop counts alike."""
    spot = Surface(semi_diameter_mm=60.0, inner_semi_diameter_mm=radius_mm, thickness_mm=HOLE_BEFORE_MM)
    lens = Prescription(surfaces=(spot, Surface(semi_diameter_mm=RADIUS_MM, is_stop=True)))
    sensor = Sensor(width_px=64, height_px=48, pitch_mm=0.4)
    camera = rigs.bare(lens, sensor, SENSOR_MM, (500.0, 1500.0))
    return Tracer(dataclasses.replace(camera, weight="area"))


def where_seen(tracer: Tracer, in_stop: np.ndarray) -> Bundles:
    """Positions (n, 2) from which the obstruction covers these places of the stop (n, 2) [mm]."""
    x = np.array([31.5, 23.5]) - in_stop * (SENSOR_MM + HOLE_BEFORE_MM) / HOLE_BEFORE_MM / tracer.camera.sensor.pitch_mm
    planes = np.repeat(parallel_planes(TARGET_MM, TARGET_MM)[None], len(x), axis=0)
    return Bundles(x, np.full(len(x), NO_MICROLENS), planes)


@pytest.mark.parametrize("percent", FOUND_PERCENT)
def test_a_hole_in_a_bundle_is_noticed_unless_it_is_too_small_to_matter(percent: float) -> None:
    """Anywhere in the bundle, of which the quadrature of one region is told nothing.

    Those of two percent are never missed, on any level; docs/truth.md says what smaller ones do.
    """
    radius = RADIUS_MM * math.sqrt(percent / 100)
    tracer, dice = behind_a_spot(radius), np.random.default_rng(0)
    off = (RADIUS_MM - radius) * np.sqrt(dice.uniform(size=HOLES))
    turn = dice.uniform(0, 2 * np.pi, HOLES)
    bundles = where_seen(tracer, np.stack([off * np.cos(turn), off * np.sin(turn)], axis=1))
    found = edges(tracer.arrays, tracer.positions_mm(*bundles.x_px.T), bundles.microlens)
    noticed = [np.mean(found.moments(bundles.planes, NODES[i])[1] == NOT_STAR_SHAPED) * 100 for i in (1, 2)]
    assert noticed[0] >= FOUND_PERCENT[percent] and noticed[1] >= noticed[0]


def shared_by_discs(radius: float, other: float, apart: float) -> tuple[float, float]:
    """Area that two discs share, and its first moment about the middle of the first, along the line of both."""
    if apart <= abs(radius - other) or apart >= radius + other:
        area = math.pi * min(radius, other) ** 2 * (apart < radius + other)
        return area, area * apart * (other < radius)
    chord = (apart**2 + radius**2 - other**2) / (2 * apart)
    near, far = (
        r**2 * math.acos(height / r) - height * math.sqrt(r**2 - height**2)
        for r, height in ((radius, chord), (other, apart - chord))
    )
    return near + far, apart * far  # what both segments lack of the middles of their discs cancels


@pytest.mark.parametrize("percent", [0.1, 4.0, 60.0, 110.0])
def test_an_obstruction_takes_its_light_wherever_it_is_seen(percent: float) -> None:
    """In the middle of the stop, across its edge, just touching it, or covering nearly all: two discs, in closed form.

    The blur is 13 pixels wide, so a lost thousandth of the light would be seen.
    """
    radius, dice = RADIUS_MM * math.sqrt(percent / 100), np.random.default_rng(1)
    tracer = behind_a_spot(radius * (1 + HOLE_BEFORE_MM / SENSOR_MM))
    apart, turn = np.linspace(0.0, 1.05 * (RADIUS_MM + radius), HOLES), dice.uniform(0, 2 * np.pi, HOLES)
    along = np.stack([np.cos(turn), np.sin(turn)], axis=1)
    bundles = where_seen(tracer, apart[:, None] * along)
    found, start = integrals(tracer, bundles, 2), tracer.positions_mm(*bundles.x_px.T)
    shared = np.array([shared_by_discs(RADIUS_MM, radius, distance) for distance in apart])
    area = math.pi * RADIUS_MM**2 - shared[:, 0]
    some = area > 1e-3 * RADIUS_MM**2
    middle = -shared[some, 1:] * along[some] / area[some, None]
    hit = start[some] + (middle - start[some]) * (1 + TARGET_MM / SENSOR_MM)
    off_px = np.abs(found.moments[some, :2] - hit) / tracer.camera.sensor.pitch_mm * SENSOR_MM / TARGET_MM
    assert not found.is_random.any() and off_px.max() < SPOT_PX
    np.testing.assert_allclose(found.moments[some, WEIGHT], area[some], rtol=1e-6)


HOLE_PITCH_MM = 1.0


def hole() -> Camera:
    """No lens: a stop before large pixels, which see it under up to 33 degrees."""
    sensor = Sensor(width_px=64, height_px=48, pitch_mm=HOLE_PITCH_MM)
    return rigs.bare(rigs.hole(RADIUS_MM), sensor, SENSOR_MM, (500.0, 1500.0))


def share_of_light(x_px: np.ndarray, y_px: np.ndarray) -> np.ndarray:
    """Irradiance by a uniform disc parallel to the sensor, over that on its axis.

    P. D. Foote, Illumination from a radiating disk, Scientific Papers of the Bureau of Standards 12 (1915) 583.
    """
    off = ((x_px - 31.5) ** 2 + (y_px - 23.5) ** 2) * HOLE_PITCH_MM**2

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
    rows = correspond(image, points, hole_grid, pose, TruthSettings(method="two-plane", filter="none"))
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
            left = slow_microlens.leaving(camera, start, vertex, kind, rays, rng)
            shares.append(left.weight.sum() / left.entered)
        expected, error = np.mean(shares), np.std(shares, ddof=1) / math.sqrt(groups)
        partly += 0.1 < expected < 0.9
        assert error < 0.01
        assert abs(grid.hit_fraction[row, column] - expected) < SIGMAS * error + SAMPLED_SHARE
        planes = parallel_planes(400.0, 470.0)[None]
        quadrature = rig.hit_fraction(integrals(tracer, Bundles(x, np.array([cell]), planes), 2).moments)[0]
        assert abs(quadrature - expected) < SIGMAS * error + MEAN_SHARE
    assert partly >= 2
