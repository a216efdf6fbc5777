"""Claim: weights are projected solid angles, images obey the cos^4 law, and random points are what they say."""

import itertools
import math

import numpy as np
import pytest
from laws import rigs
from laws.holes import behind_a_hole
from scipy.stats import qmc
from tolerances import ORDER, SIGMAS, STRATIFIED

from pipeline.camera.parts.camera import Sensor
from pipeline.camera.parts.microlens_array import MicrolensArray
from pipeline.camera.parts.polygon import projected_solid_angle, regular
from pipeline.camera.rig import Rig
from pipeline.camera.tracer import Tracer, parallel_planes
from pipeline.camera.tracing.moments import FREE_WEIGHT, WEIGHT
from pipeline.camera.tracing.packets import draw
from pipeline.camera.tracing.sobol import DIMENSIONS, hash32, sobol_bits
from pipeline.optics.first_order import first_order
from pipeline.render.imaging import irradiance


def lambert(polygon: np.ndarray, x: float, y: float, distance: float) -> float:
    """The kernel's integral of cos(theta) d omega."""
    return float(projected_solid_angle(polygon, len(polygon), x, y, distance))


def test_a_polygon_of_many_sides_weighs_what_a_disc_weighs() -> None:
    """pi sin^2 of the half angle; double the sides, and the error falls fourfold."""
    expected = math.pi * 3.0**2 / (3.0**2 + 4.0**2)
    errors = [lambert(regular(n, 3.0, 10.0), 0.0, 0.0, 4.0) - expected for n in (16, 32, 64, 128, 256)]
    assert np.all(np.abs(np.log2(np.array(errors[:-1]) / errors[1:])[1:] - 2) < ORDER)


def corner_factor(a: float, b: float) -> float:
    """pi times the view factor from an element to a parallel rectangle a x b at unit distance, over its corner.

    Source: Howell, A Catalog of Radiation Heat Transfer Configuration Factors, B-4.
    """
    p, q = math.hypot(1, a), math.hypot(1, b)
    return 0.5 * (a / p * math.atan2(b, p) + b / q * math.atan2(a, q))


def test_rectangles_weigh_what_the_catalogue_of_view_factors_says() -> None:
    """Seen from below the centre, from below a corner, and from aside, where corners add and subtract."""
    square = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
    assert lambert(2 * square, 0.0, 0.0, 2.0) == pytest.approx(4 * corner_factor(1, 1), rel=1e-14)
    assert lambert(square, -1.0, -1.0, 1.0) == pytest.approx(corner_factor(2, 2), rel=1e-14)
    aside = corner_factor(4, 2) - corner_factor(2, 2)
    assert lambert(square, -3.0, -1.0, 1.0) == pytest.approx(aside, rel=1e-13)


def test_the_weights_of_a_camera_that_blocks_nothing_add_up_to_its_free_weight() -> None:
    """Sobol sums of cos^4 / h^2 over a microlens against Lambert's formula: hit fraction 1, from anywhere in a cell."""
    array = MicrolensArray(
        pitch_mm=2.0, focal_lengths_mm=(3.0,), width_mm=2.0, height_mm=2.0, distance_mm=1.5, rotation_deg=17.0
    )
    tracer, positions = behind_a_hole(array), np.random.default_rng(1).uniform(-0.9, 0.9, (50, 2))
    row = int(np.flatnonzero((tracer.lattice.k == 0) & (tracer.lattice.l == 0))[0])
    pixels = np.stack([np.arange(50), np.arange(50)], axis=1)
    found = tracer.moments(positions, np.full(50, row), parallel_planes(20.0, 30.0), 1 << 14, pixels)
    np.testing.assert_allclose(found[:, WEIGHT] / found[:, FREE_WEIGHT], 1.0, rtol=0, atol=STRATIFIED)


def test_the_light_on_the_axis_is_that_of_the_exit_pupil() -> None:
    """pi sin^2 of the marginal ray: halve the stop, and its difference from the paraxial pupil falls fourfold."""
    errors = []
    for stop_semi_mm in (16.0, 8.0, 4.0):
        camera = rigs.conventional(stop_semi_mm)
        pupil = first_order(camera.prescription).exit_pupil
        radius, distance = pupil.diameter_mm / 2, pupil.z_mm + camera.sensor_distance_mm
        paraxial = math.pi * radius**2 / (radius**2 + distance**2)
        errors.append(Tracer(camera).reference_weight_sr / paraxial - 1)
    assert abs(errors[0]) > 0.002
    for wide, narrow in itertools.pairwise(errors):
        assert narrow == pytest.approx(wide / 4, rel=0.25, abs=5e-5)


def test_the_white_image_of_a_tiny_stop_follows_cos_to_the_fourth() -> None:
    """Averaged over each pixel; corners at 51 degrees see 0.16 of the light on the axis.

    Each pixel is the mean over 16 seeds, which also give its standard error.
    """
    sensor = Sensor(width_px=17, height_px=13, pitch_mm=3.7)
    camera = rigs.bare(rigs.hole(0.01), sensor, 30.0, (100.0, 200.0))
    images = np.stack([irradiance(Rig.of(Tracer(camera, seed)), 256, None) for seed in range(16)])
    node, weight = np.polynomial.legendre.leggauss(6)
    x = (np.arange(17)[:, None] - 8 + node / 2).ravel() * 3.7
    y = (np.arange(13)[:, None] - 6 + node / 2).ravel() * 3.7
    law = (30.0**2 / (30.0**2 + x**2 + y[:, None] ** 2)) ** 2
    expected = np.einsum("iajb,a,b->ij", law.reshape(13, 6, 17, 6), weight / 2, weight / 2)
    assert expected.min() < 0.16
    deviation = (images.mean(axis=0) - expected) / (images.std(axis=0, ddof=1) / 4)
    assert np.abs(deviation).max() < SIGMAS
    assert np.sqrt(np.mean(deviation**2)) < 1.3


def test_sobol_points_are_those_of_joe_and_kuo() -> None:
    """Against SciPy, which lists them in Gray-code order."""
    bits = sobol_bits(1024)
    digits = np.unpackbits(bits.astype("<u4").view(np.uint8).reshape(DIMENSIONS, 1024, 4), axis=-1, bitorder="little")
    points = (digits.reshape(DIMENSIONS, 1024, 32) @ (0.5 ** np.arange(1, 33))).T
    index = np.arange(1024)
    expected = qmc.Sobol(DIMENSIONS, scramble=False, bits=32).random(1024)
    np.testing.assert_array_equal(points[index ^ index >> 1], expected)


def hashed(*numbers: int) -> np.uint32:
    """The kernels' hash of several numbers."""
    value = np.uint32(numbers[0])
    for number in numbers[1:]:
        value = np.uint32(hash32(value, np.uint32(number)))
    return value


def coordinates(digits: np.ndarray, seed: np.uint32) -> np.ndarray:
    """Scrambled coordinates of a few points of one dimension, (n,)."""
    values = np.empty(len(digits))
    draw(np.ascontiguousarray(digits), 0, len(digits), seed, values)
    return values


@pytest.mark.parametrize("seed", [0, 1, 0xFFFFFFFF, 0x12345678])
def test_scrambling_keeps_one_point_in_every_elementary_interval(seed: int) -> None:
    """256 points: one in each of the 256 boxes of 2^-a x 2^-(8 - a), for every a: a (0, 8, 2)-net in base 2."""
    bits = sobol_bits(256)
    points = np.stack([coordinates(bits[d], hashed(seed, d)) for d in range(4)], axis=1)
    assert np.all((points >= 0) & (points < 1))
    for a in range(9):
        boxes = np.floor(points[:, :2] * [2**a, 2 ** (8 - a)]) @ [2 ** (8 - a), 1]
        assert len(np.unique(boxes)) == 256
    for dimension in range(4):
        assert len(np.unique(np.floor(points[:, dimension] * 256))) == 256


def test_scrambled_points_are_uniform_over_seeds() -> None:
    """The same point under 4,000 seeds: mean 1/2, variance 1/12, and two dimensions uncorrelated."""
    bits = sobol_bits(8)[:, 5:6]
    u = np.concatenate([coordinates(bits[0], hashed(9, n, 0)) for n in range(4000)])
    v = np.concatenate([coordinates(bits[1], hashed(9, n, 1)) for n in range(4000)])
    root = math.sqrt(4000)
    for values in (u, v):
        assert abs(values.mean() - 0.5) < SIGMAS * math.sqrt(1 / 12) / root
        assert abs(values.var() - 1 / 12) < SIGMAS * math.sqrt(1 / 180) / root
    assert abs(np.corrcoef(u, v)[0, 1]) < SIGMAS / root


def test_replicas_err_independently_and_so_do_neighbouring_pixels() -> None:
    """Integration errors of 16 points, two pixels of four replicas each, 1,000 seeds: no correlation beyond chance."""
    errors, bits = np.empty((1000, 8)), sobol_bits(16)
    for n in range(1000):
        for column in range(8):
            pixel, r = divmod(column, 4)
            u, v = (coordinates(bits[d], hashed(n, pixel, 0, 2 * r + d)) for d in (0, 1))
            errors[n, column] = np.mean(np.exp(u) * np.sqrt(v)) - (math.e - 1) * 2 / 3
    assert abs(errors.mean()) < SIGMAS * errors.std() / math.sqrt(errors.size)
    correlation = np.corrcoef(errors.T)[np.triu_indices(8, 1)]
    assert np.abs(correlation).max() < SIGMAS / math.sqrt(1000)
