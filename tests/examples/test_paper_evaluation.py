"""The evaluation of example 03: its rays, its statistics, a small run, and the table that is committed with it."""

import math
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from builds import cells
from laws import rigs
from tolerances import ROUNDING_MM, SIGMAS

from pipeline.camera.integrating.polar_hits import single_hits
from pipeline.camera.rig import Rig
from pipeline.camera.tracer import Tracer, parallel_planes, target_plane
from pipeline.camera.tracing.moments import COVARIANCE, FREE_WEIGHT, WEIGHT
from pipeline.camera.tracing.sampling_bounds import NO_MICROLENS
from pipeline.files.png import read_png
from pipeline.scene.load import load
from pipeline.truth.grid import quad_search
from pipeline.truth.grid.ray_grid import image_from_fine

EXAMPLE = Path(__file__).resolve().parents[2] / "examples/03_paper_evaluation"
sys.path.insert(0, str(EXAMPLE))  # its modules lie beside the script that imports them

import bars  # noqa: E402
import corners  # noqa: E402
import precision  # noqa: E402
import reading  # noqa: E402
import sampling  # noqa: E402

NEAR_MM, FAR_MM = 400.0, 480.0
KS = np.array([1, 2, 4, 6, 8, 10])
IN_MM = np.array([[0.0, 1.0], [0.0, 1.0]])
"""A texture whose coordinates are those of its plane."""


@pytest.fixture(scope="module")
def starts(plenoptic_tracer):
    """Two positions behind each of five microlenses: near the middle, and where the stop cuts the bundle."""
    lens = np.argsort(np.hypot(*(plenoptic_tracer.vertices_mm - [3.0, 2.0]).T))[:5]
    middle = plenoptic_tracer.vertices_mm[lens] * 1.0132
    positions = np.concatenate([middle + np.array(shift) for shift in ((0.01, 0.02), (0.09, 0.03))])
    return positions, np.tile(lens, 2), np.arange(20).reshape(10, 2)


@pytest.mark.parametrize("width_px", [0.0, 0.25])
def test_our_rays_are_those_of_a_build(plenoptic_tracer, starts, width_px):
    """Mean crossings of points' and fine pixels' bundles, after 4,096 rays and after 16,384 of the same sequence."""
    positions, lens, fine = starts
    planes, counts = parallel_planes(NEAR_MM, FAR_MM), (4096, 16384)
    width_mm = width_px * plenoptic_tracer.camera.sensor.pitch_mm
    spans = np.stack([IN_MM] * 2)
    found, _ = sampling.means(plenoptic_tracer, "ours", positions, lens, fine, planes, spans, counts, width_mm)
    for j, samples in enumerate(counts):
        expected = plenoptic_tracer.moments(positions, lens, planes, samples, fine, width_px)[:, :4]
        np.testing.assert_allclose(found[:, j].reshape(-1, 4), expected, rtol=0, atol=ROUNDING_MM)


@pytest.mark.parametrize("width_mm", [0.0, 0.01])
def test_independent_rays_have_the_same_mean(plenoptic_tracer, starts, width_mm):
    """Of 65,536 rays each, also where the stop cuts bundles, within the noise of those that get through."""
    positions, lens, fine = starts
    planes, samples = target_plane(rigs.facing(430.0, 30.0))[None], 1 << 16
    ours, plain = (
        sampling.means(plenoptic_tracer, kind, positions, lens, fine, planes, IN_MM[None], (samples,), width_mm)[0][
            :, 0, 0
        ]
        for kind in ("ours", "independent")
    )

    def bundles(shift_x_mm: float, shift_y_mm: float) -> np.ndarray:
        shifted, two = positions + np.array([shift_x_mm, shift_y_mm]), np.concatenate([planes, planes])
        return plenoptic_tracer.moments(shifted, lens, two, samples, fine)

    half, here = width_mm / 2, bundles(0.0, 0.0)
    across = (
        bundles(half, 0.0)[:, :2] - bundles(-half, 0.0)[:, :2],
        bundles(0.0, half)[:, :2] - bundles(0.0, -half)[:, :2],
    )
    # A ray scatters by the width of its bundle and by its start, which is uniform on the square.
    variance = here[:, [COVARIANCE, COVARIANCE + 4]] + (across[0] ** 2 + across[1] ** 2) / 12
    through = samples * here[:, WEIGHT] / here[:, FREE_WEIGHT]
    sigmas = (plain - ours) / np.sqrt(variance / through[:, None])
    assert np.abs(sigmas).max() < SIGMAS
    assert 0.5 < np.sqrt(np.mean(sigmas**2)) < 1.7


def test_independent_rays_scatter_as_their_number_says(plenoptic_tracer, starts):
    """Variance of the mean of 1,024 rays is the bundle's over 1,024: 300 repetitions know it to 8 per cent."""
    positions, lens, _ = (np.repeat(values[:1], 300, axis=0) for values in starts)
    planes, fine = parallel_planes(NEAR_MM, FAR_MM), np.arange(600).reshape(300, 2)
    given = positions, lens, fine, planes, np.stack([IN_MM] * 2)
    found = sampling.means(plenoptic_tracer, "independent", *given, (1024,), 0.0)[0][:, 0]
    bundle = plenoptic_tracer.moments(positions[:1], lens[:1], planes, 1 << 16, fine[:1])[0]
    expected = bundle[COVARIANCE + np.array([0, 4, 7, 9])] / 1024
    np.testing.assert_allclose(found.reshape(-1, 4).var(axis=0, ddof=1), expected, rtol=SIGMAS * np.sqrt(2 / 299))


@pytest.fixture(scope="module")
def conventional() -> Tracer:
    """The paper's lens without microlenses, in focus at 430 mm."""
    camera, seed, _, _ = corners.camera_and_boards()
    return Tracer(corners.without_microlenses(camera), seed)


def test_rays_without_microlenses_have_the_mean_of_a_build(conventional):
    """Ours have its bits but for rounding; of 65,536 independent rays, nearly all of which pass, within their noise."""
    positions, fine = np.array([[0.0, 0.0], [4.0, -3.0], [-6.0, 2.5]]), np.arange(6).reshape(3, 2)
    lens, planes, samples = np.full(3, NO_MICROLENS), parallel_planes(NEAR_MM, FAR_MM), 1 << 16
    given = positions, lens, fine, planes, np.stack([IN_MM] * 2), (samples,), 0.0
    ours, plain = (sampling.means(conventional, kind, *given)[0].reshape(3, 4) for kind in ("ours", "independent"))
    bundles = conventional.moments(positions, lens, planes, samples, fine)
    np.testing.assert_allclose(ours, bundles[:, :4], rtol=0, atol=ROUNDING_MM)
    sigma = np.sqrt(bundles[:, COVARIANCE + np.array([0, 4, 7, 9])] / samples)
    assert np.abs((plain - ours) / sigma).max() < SIGMAS
    assert Rig.of(conventional).images is None


def test_running_sums_in_single_precision_drift_by_up_to_a_rounding_per_ray(plenoptic_tracer, starts):
    """More with more rays, far beyond one rounding; with texture coordinates of a plane twice as wide, by others."""
    positions, lens, fine = starts
    planes, counts = target_plane(rigs.facing(430.0, 30.0))[None], (4096, 1 << 18)
    spans = np.array([[[-28.0, 56.0], [-17.5, 35.0]]])
    exact, running = sampling.means(plenoptic_tracer, "independent", positions, lens, fine, planes, spans, counts, 0.0)
    drift = np.abs(running - exact)[:, :, 0] / spans[0, :, 1]
    for number, count in enumerate(counts):
        assert drift[:, number].max() < count * 2.0**-24
    assert np.median(drift[:, 1]) > 4 * np.median(drift[:, 0]) > 0
    assert drift[:, 1].max() > 2.0**-18


def test_the_trace_in_numpy_is_that_of_the_package(plenoptic_tracer, conventional):
    """In float64 to rounding, with the same rays blocked; in float32 to some of its roundings of 500 mm, no fewer."""
    plane = target_plane(rigs.facing(430.0, 30.0))
    for tracer, microlens in ((plenoptic_tracer, 5), (conventional, NO_MICROLENS)):
        beside = tracer.vertices_mm[microlens] if microlens >= 0 else np.zeros(2)
        x_px = tracer.pixels_at(beside[None] * 1.0132 + 0.08)[0]
        started = precision.start(tracer, x_px, microlens, 500)
        hits = {}
        for kind in (np.float64, np.float32):
            point, direction, alive = precision.trace(tracer, *started, kind)
            hits[kind] = np.where(alive[:, None], precision.met(plane, point, direction), np.nan)
        rays = np.repeat(started[0][None], 500, axis=0), np.full(500, microlens), started[1]
        expected = single_hits(tracer.arrays, *rays, np.repeat(plane[None], 500, axis=0))
        np.testing.assert_allclose(hits[np.float64], expected, rtol=0, atol=ROUNDING_MM)
        apart = np.abs(hits[np.float32] - hits[np.float64])
        assert 2e-6 < np.nanmedian(apart) < np.nanmax(apart) < 2e-3


def test_the_printed_mapping_alone_makes_a_trend():
    """0.64, 0.28, 0.11, 0.05, 0.02, 0 px against K = 10, from (K - 1) / (2 K) on both axes."""
    halves = np.array([0.0, 0.25, 0.375, 5 / 12, 0.4375, 0.45])
    np.testing.assert_allclose(reading.printed_trend_px(KS), (0.45 - halves) * np.sqrt(2), rtol=0, atol=1e-12)
    for k in KS:
        fine = np.array([[3.25, 17.5]])
        np.testing.assert_allclose(bars.mapped(image_from_fine(fine, k), int(k), "printed"), fine / k, atol=1e-12)
        np.testing.assert_array_equal(bars.mapped(fine, int(k), "half-pixel"), fine)


def test_noisy_grids_pass_the_filters_of_a_build_as_often_as_those_of_the_formula():
    """Square grids with 0.03, 0.04 and 0.06 steps of noise: nearly all, two in three, one in ten."""
    random, count, noises = np.random.default_rng(5), 500, (0.03, 0.04, 0.06)
    column, row = np.meshgrid(np.arange(4.0), np.arange(4.0))
    seen = []
    for noise in noises:
        status, solution = np.empty(1, np.int64), np.full((1, 9), np.nan)
        cell, quad, passed = np.zeros((4, 4), np.int64), np.array([[0, 1, 1]]), 0
        limits = quad_search.Filter(True, 0.15, math.radians(10))
        for _ in range(count):
            image = np.stack([column, row], axis=-1) + random.normal(0, noise, (4, 4, 2))
            quad_search.solve_quads(image, cell, np.array([[1.5, 1.5]]), quad, limits, status, solution)
            passed += status[0] == quad_search.ACCEPTED
        seen.append(passed / count)
    expected = reading.ideal_grid_share(np.array(noises))
    assert np.all(np.abs(expected - seen) < SIGMAS * np.sqrt(expected * (1 - expected) * (1 / count + 1 / 4000)))
    assert seen[0] > 0.95 > 0.75 > seen[1] > 0.55 > 0.2 > seen[2]


def test_the_dataset_is_the_papers_camera_with_its_whole_sensor():
    found = load(EXAMPLE / "dataset.usda")
    assert found.problems == []
    (entry,) = found.dataset.cameras
    assert len(found.dataset.frames) == 6
    assert (entry.camera.sensor.width_px, entry.camera.sensor.height_px) == (2173, 2173)
    assert entry.camera.microlenses.focal_lengths_mm == (1.9, 2.1, 2.3)
    assert entry.truth.method == "direct"


@pytest.mark.heavy
def test_a_small_evaluation_runs(tmp_path):
    """Files, verdict, and what holds for any corners: windows do not matter, direct is exact."""
    command = [sys.executable, str(EXAMPLE / "evaluate.py"), "--small", "--out", str(tmp_path), "--jobs", "2"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr
    moved = re.findall(r"find or lose 0 of \d+ positions, and move none by more than (\S+) px", done.stdout)
    assert len(moved) == 2 and max(map(float, moved)) <= np.spacing(2173.0)  # the last digit of the largest position
    sentences = re.findall(r"^\| (?:error and variance|detected corners|320|64|the methods)", done.stdout, re.M)
    assert len(sentences) == 2 * 6  # of both cameras
    every = cells(tmp_path / "results.csv")
    assert {row["camera"] for row in every} == {"plenoptic", "conventional"}
    rows = [row for row in every if row["camera"] == "plenoptic"]
    assert {row["method"] for row in rows} == {"image", "two-plane", "direct"}
    for row in rows:
        if row["method"] == "direct":
            assert float(row["mean_px"]) < 1e-3
    for name in ("picture.png", "figure_two_plane.png", "figure_conventional.png"):
        assert read_png(tmp_path / name).shape[1] >= 600
