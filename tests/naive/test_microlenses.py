"""Claim: microlenses of every layout, aperture, model and mounting send rays where a slow twin sends them, and no bound
loses a ray.
"""

import copy
import dataclasses
import math

import numpy as np
import pytest
from naive import slow_microlens, textbook
from naive.brute import POSES, moments_of
from naive.kinds import KINDS, camera_with, vertex_of
from shorter import few, few_cases
from tolerances import ROUNDING_MM, SIGMAS

import pipeline
from pipeline.camera.micro_images.centres import micro_images
from pipeline.camera.parts.camera import Camera
from pipeline.camera.parts.microlens_array import MicrolensArray
from pipeline.camera.rig import Rig
from pipeline.camera.tracer import Tracer, target_plane
from pipeline.camera.tracing import microlens_kernels
from pipeline.camera.tracing.moments import COVARIANCE, FREE_WEIGHT, WEIGHT
from pipeline.optics.prescription import Prescription
from pipeline.render.imaging import irradiance

RAYS, GROUPS = 8_000, 16


def slow(tracer: Tracer, start: np.ndarray, row: int, seed: int) -> np.ndarray:
    """Mean (4), covariance (10), weight and free weight, one row per group of rays."""
    camera, rng, rows = tracer.camera, np.random.default_rng(seed), []
    for _ in range(GROUPS):
        vertex, kind = vertex_of(tracer, row), int(tracer.lattice.type[row])
        rays = slow_microlens.leaving(camera, start, vertex, kind, RAYS, rng)
        rows.append([*moments_of(*rays[:3]), rays.entered])
    return np.array(rows)


def packed(tracer: Tracer, start: np.ndarray, row: int) -> np.ndarray:
    """The same from the tracer, one row per pixel that the random numbers are made for."""
    planes, pixels = np.stack([target_plane(pose) for pose in POSES]), np.tile(np.arange(GROUPS)[:, None], 2)
    rows = tracer.moments(np.tile(start, (GROUPS, 1)), np.full(GROUPS, row), planes, 2048, pixels)
    return rows[:, [*range(COVARIANCE + 10), WEIGHT, FREE_WEIGHT]]


def assert_same(camera: Camera, seed: int) -> None:
    """Means of all columns agree within their errors, for positions in the middle and at the edge of cells."""
    tracer = Tracer(camera)
    images = micro_images(tracer)
    for k, l, offset in ((0, 0, (0.01, -0.004)), (17, -9, (0.07, 0.04)), (-5, 24, (-0.03, 0.1))):
        row = int(np.flatnonzero((tracer.lattice.k == k) & (tracer.lattice.l == l))[0])
        start = images.centre_mm[row] + offset
        one, other = packed(tracer, start, row), slow(tracer, start, row, seed)
        error = np.sqrt((one.var(axis=0, ddof=1) + other.var(axis=0, ddof=1)) / GROUPS)
        assert error[WEIGHT] < 0.02 * one[0, WEIGHT]
        assert np.abs((one.mean(axis=0) - other.mean(axis=0)) / error).max() < SIGMAS


@pytest.mark.parametrize("kind", [pytest.param("tilted", marks=pytest.mark.heavy), "two-plane", "biconvex cells"])
def test_most_rays_that_are_aimed_at_a_microlens_leave_the_camera(kind: str) -> None:
    """Near the rim of a micro-image, where half of the cell looks past a narrow stop: bounds are tight there."""
    camera = camera_with(kind, 2.0)
    tracer = Tracer(camera)
    images = micro_images(tracer)
    row = int(np.flatnonzero((tracer.lattice.k == 3) & (tracer.lattice.l == -5))[0])
    angle = np.linspace(0, 2 * np.pi, 12, endpoint=False)
    rim = images.centre_mm[row] + 0.9 * images.radius_mm * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    leave = [len(pipeline.bundle(camera, *place, samples=512).weight_sr) / 512 for place in tracer.pixels_at(rim)]
    assert np.mean(leave) > 2 / 3


PLACES = {
    "rotated": {"rotation_deg": 7.0, "layout": "hexagonal-columns"},
    "stretched": {"rotation_deg": -20.0, "cross_pitch_mm": 0.25},
    "square": {"layout": "square", "cross_pitch_mm": 0.19, "offset_x_mm": 0.04, "offset_y_mm": -0.07},
    "tilted about x": {"tilt_x_deg": 9.0},
    "tilted about y": {"tilt_y_deg": -8.0},
    "tilted": {"tilt_x_deg": 9.0, "tilt_y_deg": -8.0, "rotation_deg": 5.0, "offset_x_mm": 0.03},
}


def test_bundles_of_tilted_arrays_are_bounded_where_their_chief_rays_cross_the_middle_of_the_array() -> None:
    """The line through a microlens and the point that its bounds are taken from is, behind the stop, a ray through the
    stop's centre."""
    camera = camera_with("tilted")
    tracer = Tracer(camera)
    bounds = tracer.arrays.microlenses[:, [microlens_kernels.OUTLINE_X, microlens_kernels.OUTLINE_Y]]
    above = tracer.lattice.z_mm
    far = np.abs(above) > 0.1
    vertices = np.column_stack([tracer.vertices_mm, tracer.film_z_mm + above])[far]
    along = np.column_stack([(tracer.vertices_mm - bounds)[far] / above[far, None], np.ones(far.sum())])
    stop = next(i for i, surface in enumerate(camera.prescription.surfaces) if surface.is_stop)
    behind = Prescription(surfaces=camera.prescription.surfaces[stop:])
    crossings, _, _ = textbook.trace(behind, vertices, along)
    assert far.sum() > 1000
    assert np.abs(crossings).max() < ROUNDING_MM


@pytest.mark.parametrize("place", PLACES)
def test_vertices_are_those_of_the_slow_twin(place: str) -> None:
    """Where the array stands behind the lens, three numbers each: the order of two tilts moves those at 4 mm from the
    middle by 0.1 mm."""
    array = MicrolensArray(
        pitch_mm=0.2173, width_mm=8.0, height_mm=2.0, distance_mm=1.7, focal_lengths_mm=(2.1,), **PLACES[place]
    )
    camera = dataclasses.replace(camera_with("tilted"), microlenses=array)
    camera = dataclasses.replace(camera, sensor=dataclasses.replace(camera.sensor, offset_x_mm=0.3, offset_y_mm=-0.2))
    tracer = Tracer(camera)
    found = np.column_stack([tracer.vertices_mm, tracer.film_z_mm + tracer.lattice.z_mm])
    expected = [
        slow_microlens.vertex(camera, k, l)
        for k, l in zip(tracer.lattice.k.tolist(), tracer.lattice.l.tolist(), strict=True)
    ]
    assert len(found) > 300
    np.testing.assert_allclose(found, expected, rtol=0, atol=ROUNDING_MM)


@pytest.mark.heavy
@pytest.mark.parametrize("kind", KINDS)
def test_bundles_are_those_of_the_slow_twin(kind: str) -> None:
    """J on two tilted planes, second moments, weight and free weight, each with its standard error."""
    assert_same(camera_with(kind), 3)


@pytest.mark.parametrize("pixels", [pytest.param("cosine", marks=pytest.mark.heavy), "cone"])
@pytest.mark.parametrize("kind", few(["discs"], "columns, three types", "convex to the lens"))
def test_bundles_of_choosy_pixels_are_those_of_the_slow_twin(kind: str, pixels: str) -> None:
    assert_same(camera_with(kind, pixels=pixels), 4)


@pytest.mark.parametrize(
    ("kind", "pixels"),
    few_cases(
        [("two-plane", "all")],
        *(("tilted", "all"), ("discs", "cone"), ("convex to the lens", "cosine"), ("biconvex cells", "all")),
    ),
)
def test_bundles_by_area_are_those_of_the_slow_twin(kind: str, pixels: str) -> None:
    """Rays weigh area of the plane that their aims lie in, leaving and free ones, times the acceptance."""
    assert_same(dataclasses.replace(camera_with(kind, pixels=pixels), weight="area"), 6)


NEAR_MM = {5.0: 0.55, 17.1: 0.9}
"""How far around a pixel light is looked for, by the semi-diameter of the stop [mm]: twice as far as any comes from, by
the radius of a micro-image, 1.7 / 123 of that, the slope of chief rays, and half of a cell."""


@pytest.mark.parametrize(
    ("kind", "stop_semi_mm"),
    [
        pytest.param(kind, semi, marks=() if (kind, semi) == ("tilted", 5.0) else pytest.mark.heavy)
        for kind in KINDS
        for semi in (5.0, 17.1)
    ],
)
def test_pixels_see_all_light_of_all_microlenses(kind: str, stop_semi_mm: float) -> None:
    """White pixels summed over strata against slow rays through every microlens far around: at f/2, where dozens of
    micro-images overlap (heavy), no contributor is missing."""
    camera, rng = camera_with(kind, stop_semi_mm), np.random.default_rng(5)
    camera = dataclasses.replace(camera, sensor=dataclasses.replace(camera.sensor, offset_x_mm=3.0, offset_y_mm=-2.0))
    tracer = Tracer(camera)
    images = micro_images(tracer)
    found = np.array([irradiance(Rig(t, images), 64, None)[3, 4] * t.reference_weight_sr for t in _seeds(tracer)])
    centre = np.array([3.0, -2.0])
    near = np.flatnonzero(np.hypot(*(tracer.vertices_mm - centre).T) < NEAR_MM[stop_semi_mm])
    brute = []
    for _ in range(8):
        start = centre + rng.uniform(-0.02, 0.02, (2000, 2))
        total = 0.0
        for row in near:
            kind_of = int(tracer.lattice.type[row])
            total += slow_microlens.leaving(camera, start, vertex_of(tracer, row), kind_of, 2000, rng).weight.sum()
        brute.append(total)
    error = np.hypot(np.std(found, ddof=1) / 4, np.std(brute, ddof=1) / math.sqrt(8))
    assert abs(np.mean(found) - np.mean(brute)) < SIGMAS * error
    assert error < 0.02 * np.mean(brute)


def _seeds(tracer: Tracer) -> list[Tracer]:
    """Copies with other random numbers, and what is traced once already."""
    _ = tracer.arrays
    found = [copy.copy(tracer) for _ in range(16)]
    for seed, one in enumerate(found):
        object.__setattr__(one, "seed", seed)
    return found
