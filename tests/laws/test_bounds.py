"""Claim: the bounds within which rays are sampled leave out none that passes.

That bundles within them weigh what those of rays all over do is judged in `naive/test_bundle.py`.
"""

import numpy as np
import pytest
from laws import rigs
from laws.bounds import (
    SHAPES,
    assert_bounds_hold,
    assert_bounds_hold_behind_microlenses,
    with_shapes,
)
from laws.surfaces import whole
from shorter import few, few_cases
from tolerances import ROUNDING_MM, SIGMAS

from pipeline.camera.parts.camera import Sensor
from pipeline.camera.pupil.outlines import DIRECTIONS, directions_of, grid_outlines
from pipeline.camera.rig import Rig
from pipeline.camera.tracer import Tracer
from pipeline.camera.tracing.sampling_bounds import outline_at
from pipeline.frames import VISION_FROM_CAMERA
from pipeline.optics.prescription import Prescription, Surface
from pipeline.render.imaging import irradiance

AZIMUTH = np.array([0.0, 0.3, 1.2, 2.5, 4.0, 5.5])
SLOT = {"half_widths_mm": (22.0, 14.0), "aperture_rotation_deg": -35.0}


def at_heights(heights: np.ndarray, azimuth: np.ndarray) -> np.ndarray:
    return heights[:, None] * np.stack([np.cos(azimuth), np.sin(azimuth)], axis=1)


@pytest.mark.parametrize("stop_semi_mm", few([8.0], 2.0, 17.1))
def test_no_ray_outside_the_bounds_passes_a_conventional_camera(stop_semi_mm: float) -> None:
    """Trial rays all over the rear surface, from the axis to the corner, where the pupil is a pointed sliver."""
    tracer, rng = Tracer(rigs.conventional(stop_semi_mm, 1200, 900)), np.random.default_rng(6)
    heights = np.array([0.0, 0.317, 4.0, 9.5, 15.3, 20.0, 22.7, 24.2, 26.9, 28.4, 31.4, 34.5, 36.5, 37.4])
    azimuth = rng.uniform(0, 2 * np.pi, len(heights))
    assert assert_bounds_hold(tracer, at_heights(heights, azimuth), rng, 20.0, 100_000).sum() > 1000


@pytest.mark.parametrize("stop_semi_mm", few([8.0], 2.0, 17.1))
def test_no_ray_outside_the_bounds_passes_a_displaced_conventional_camera(stop_semi_mm: float) -> None:
    """Trial rays all over the rear surface, from points all over the sensor; bounds without their usual margin."""
    camera, rng = rigs.displaced(rigs.conventional(stop_semi_mm, 1200, 900)), np.random.default_rng(6)
    positions = rng.uniform([-30, -22.5], [30, 22.5], (60, 2))
    assert assert_bounds_hold(Tracer(camera, margin=0.0), positions, rng, 21.0, 40_000).sum() > 1000


@pytest.mark.parametrize("change", few(["none", "displaced", "hexagon"], "ring"))
def test_no_ray_outside_the_bounds_passes_a_plenoptic_camera(change: str) -> None:
    """The displaced one without the usual margin."""
    camera = rigs.plenoptic()
    if change in SHAPES:
        camera = with_shapes(camera, SHAPES[change], SLOT)
    is_displaced = change == "displaced"
    assert_bounds_hold_behind_microlenses(
        Tracer(rigs.displaced(camera), margin=0.0) if is_displaced else Tracer(camera)
    )


@pytest.mark.parametrize("shape", SHAPES)
def test_no_ray_outside_the_bounds_passes_a_shaped_aperture(shape: str) -> None:
    """Of the stop, behind a slot; trial rays all over the rear surface, at azimuths that favour no corner."""
    camera = with_shapes(rigs.conventional(5.0, 800, 600), SHAPES[shape], SLOT)
    positions = at_heights(np.array([0.0, 5.0, 12.0, 18.0, 21.0, 24.0]), AZIMUTH)
    assert assert_bounds_hold(Tracer(camera), positions, np.random.default_rng(6), 20.0, 30_000).sum() > 500


@pytest.mark.parametrize(("stop_semi_mm", "pitch_mm"), few_cases([(0.2, 0.2)], (0.1, 0.05), (0.5, 0.2)))
def test_a_tiny_stop_before_coarse_pixels_loses_no_light(stop_semi_mm: float, pitch_mm: float) -> None:
    """Rays start all over a pixel, and what passes moves along: a bound for the centre alone loses several per cent."""
    camera = rigs.conventional(stop_semi_mm, 16, 12, pitch_mm)
    tight, wide = (
        np.array([irradiance(Rig.of(Tracer(camera, seed, margin)), 256, None).mean() for seed in range(8)])
        for margin in (0.02, 0.5)
    )
    error = np.hypot(tight.std(ddof=1), wide.std(ddof=1)) / np.sqrt(8)
    assert abs(tight.mean() - wide.mean()) < SIGMAS * error
    assert error < 1e-3


@pytest.mark.heavy
def test_bounds_hold_for_all_points_within_reach_of_the_one_they_are_asked_for() -> None:
    """What passes from p + a lies in the outline of p moved by drift a, for |a| up to 1.5 mm, at f/2 where vignetting
    moves the edges of an outline apart; no margin."""
    lens, slack = rigs.displaced(rigs.conventional(17.1)).prescription, 1.5
    wide = grid_outlines(lens, (0.0, 0.0, -131.81), (24.0, 18.0), slack, 0.0)
    rng, polygon, normal = np.random.default_rng(2), np.empty((64, 2)), directions_of(DIRECTIONS)
    for point in rng.uniform([-22, -16], [22, 16], (25, 2)):
        angle = rng.uniform(0, 2 * np.pi)
        step = slack * np.array([np.cos(angle), np.sin(angle)])
        count = outline_at(wide.step_mm, wide.vertices_mm, *point, polygon)
        exact = grid_outlines(lens, (*(point + step).tolist(), -131.81), (1e-3, 1e-3), 0.0, 0.0)
        needed = (exact.vertices_mm[1, 1] @ normal.T).max(axis=0) - normal @ step * wide.drift
        assert np.all((polygon[:count] @ normal.T).max(axis=0) > needed - 1e-3)


def test_a_narrow_beam_of_light_beyond_which_all_is_dark_is_bounded_up_to_its_end() -> None:
    """A long tube before the stop: most of the sensor is dark, and the edge of the light lies between two nodes."""
    tube = Surface(semi_diameter_mm=1.5, thickness_mm=60.0, decentre_mm=(1.0, 0.5))
    stop = Surface(semi_diameter_mm=1.0, is_stop=True, thickness_mm=5.0)
    lens = Prescription(surfaces=(tube, stop, Surface(semi_diameter_mm=6.0)))
    camera = rigs.bare(lens, Sensor(width_px=200, height_px=150, pitch_mm=0.1), 50.0, (100.0, 200.0))
    rng = np.random.default_rng(3)
    passed = assert_bounds_hold(Tracer(camera), rng.uniform([-4, -3], [4, 3], (100, 2)), rng, 3.0, 10_000)
    assert 10 < np.count_nonzero(passed) < 90


@pytest.mark.parametrize(("rows", "columns"), [(3, 3), (4, 7), (9, 5)])
def test_outlines_that_are_bilinear_over_a_grid_come_back_at_any_point_and_beyond_it_those_of_its_border(
    rows: int, columns: int
) -> None:
    """Four nodes say all of a + b x + c y + d x y, whatever each coordinate of each vertex has for a, b, c and d."""
    rng, step = np.random.default_rng(rows), 1.5
    factors, polygon = rng.uniform(-1, 1, (4, DIRECTIONS, 2)), np.empty((64, 2))
    half = np.array([columns - 1, rows - 1]) / 2 * step

    def outline(x: float, y: float) -> np.ndarray:
        return np.tensordot([1.0, x, y, x * y], factors, 1)

    lines = [(np.arange(count) - (count - 1) / 2) * step for count in (rows, columns)]
    grid = np.array([[outline(x, y) for x in lines[1]] for y in lines[0]])
    for point in rng.uniform(-1.3 * half, 1.3 * half, (200, 2)):
        assert outline_at(step, grid, *point, polygon) == DIRECTIONS
        np.testing.assert_allclose(polygon[:DIRECTIONS], outline(*np.clip(point, -half, half)), 0, ROUNDING_MM)


def test_an_outline_is_widened_about_its_own_middle_wherever_that_lies() -> None:
    """A lens that is shifted as a whole has the outlines of the lens, shifted: the margin knows no axis.

    Edges are found by 16 bisections of 60 mm, to 0.9 µm, and second differences of four of them widen an outline.
    """
    camera, shift, normal, found = rigs.conventional(8.0), np.array([9.0, 4.0]), directions_of(DIRECTIONS), []
    for at in (np.zeros(2), shift):
        lens = whole(camera.prescription, decentre_mm=tuple(VISION_FROM_CAMERA[:2, :2] @ at))
        polygons = grid_outlines(lens, (*at.tolist(), -131.81), (6.0, 4.0), 0.0, 0.1).vertices_mm
        found.append((polygons @ normal.T).max(axis=2))
    assert np.ptp(found[0]) > 3
    np.testing.assert_allclose(found[1], found[0] + normal @ shift, rtol=0, atol=5 * 0.9e-3)
