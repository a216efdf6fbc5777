"""Claim: photons are radiance times etendue times transmission, surfaces reflect as Fresnel says, weights are projected
solid angles, and random points are what they say.
"""

import dataclasses
import itertools
import math
from itertools import pairwise

import numpy as np
import pytest
from laws import rigs
from laws.rigs import at, in_light, thin
from scipy.stats import qmc
from tolerances import BISECTED, MEAN_TRANSMISSION, SIGMAS

from pipeline.camera.parts.camera import Camera, Sensor
from pipeline.camera.parts.polygon import projected_solid_angle
from pipeline.camera.rig import Rig
from pipeline.camera.tracer import Tracer
from pipeline.camera.tracing.packets import draw
from pipeline.camera.tracing.sobol import DIMENSIONS, hash32, sobol_bits
from pipeline.optics.first_order import first_order
from pipeline.optics.transmission import Coating, Losses, fresnel
from pipeline.render.imaging import irradiance
from pipeline.render.radiometry import axial_transmission, photon_rate
from pipeline.render.sensor.response import Irradiation, Radiance, SensorResponse
from pipeline.render.spectral.spectra import effective_nm, illuminant

pytestmark = pytest.mark.filterwarnings("ignore:divide by zero:RuntimeWarning")
"""A stop alone has no focal length."""
SENSOR = Sensor(width_px=32, height_px=32, pitch_mm=0.01)
GREEN = Radiance(w_per_m2_sr=2.0, effective_nm=550.0)
BARE = Losses(coatings=(None,) * 11, per_mm=(1.0,) * 11)
"""The double Gauss of the proofs without coatings, of clear glass."""


def flat(*reflectance: float | None) -> tuple[Coating | None, ...]:
    """Coatings that reflect the same at all angles; None: a bare surface."""
    return tuple(None if one is None else Coating(reflectance=(one,)) for one in reflectance)


@pytest.mark.parametrize("semi_mm", [0.5, 4.0])
def test_photons_are_radiance_times_the_projected_solid_angle(semi_mm: float) -> None:
    """An ideal lens focused on infinity fills the cone of its rim: L A pi sin^2(theta) lambda / (h c)."""
    camera = Camera(prescription=thin(50.0, semi_mm), sensor=SENSOR, sensor_distance_mm=50.0)
    sine = math.sin(math.atan(semi_mm / 50.0))
    expected = 2.0 * (1e-5) ** 2 * math.pi * sine**2 * 550e-9 / (6.62607015e-34 * 299792458)
    assert photon_rate(camera, GREEN) == pytest.approx(expected, rel=1e-7)


def test_twice_the_time_and_twice_the_radiance_are_twice_the_photons() -> None:
    response = SensorResponse(quantum_efficiency=(0.6,), full_well_e=9e3, gain_dn_per_e=0.4, bit_depth=12)
    camera = rigs.conventional(4.5)
    rate = photon_rate(camera, GREEN)
    once, twice = (Irradiation(exposure_time_s=t, radiance=GREEN).photons_at_one(response, rate) for t in (0.01, 0.02))
    assert twice == pytest.approx(2 * once, rel=BISECTED)
    brighter = dataclasses.replace(GREEN, w_per_m2_sr=4.0)
    assert photon_rate(camera, brighter) == pytest.approx(2 * rate, rel=BISECTED)


def test_photons_of_a_channel_are_an_integral_over_its_response() -> None:
    """Equal energy from 380 to 780 nm and a response that is flat from a to b: (b^2 - a^2) / 2 / 400 nm; its
    scale does not count, and one that rises from a to b has its own integral.
    """
    low, high, unit = 500.0, 600.0, 1 / 400.0
    for scale in (1.0, 0.3):
        found = effective_nm((np.array([low, high]), np.full(2, scale)), illuminant("E"))
        assert found == pytest.approx((high**2 - low**2) / 2 * unit, rel=1e-12)
    rising = effective_nm((np.array([low, high]), np.array([0.0, 1.0])), illuminant("E"))
    expected = ((high**3 - low**3) / 3 - low * (high**2 - low**2) / 2) / (high - low) * unit
    assert rising == pytest.approx(expected, rel=1e-5)  # trapezoids of 0.5 nm


def test_a_channel_has_the_photons_of_its_wavelengths_by_their_shares() -> None:
    """One wavelength is the camera in that light, and two of them are their mean, each with its own losses."""
    camera, nm = rigs.conventional(4.5), {450.0: 0.3, 650.0: 0.7}
    clear, coated = (Losses(coatings=flat(*(share,) * 11), per_mm=(1.0,) * 11) for share in (0.001, 0.02))
    alone = [
        photon_rate(at(camera, one), Radiance(w_per_m2_sr=2.0, effective_nm=550.0, losses=(losses,)))
        for one, losses in zip(nm, (clear, coated), strict=True)
    ]
    one = Radiance(channel="", w_per_m2_sr=2.0, effective_nm=550.0, losses=(clear,))
    assert photon_rate(in_light(camera, {450.0: 1.0}), one) == pytest.approx(alone[0], rel=1e-12)
    both = dataclasses.replace(one, losses=(clear, coated))
    assert photon_rate(in_light(camera, nm), both) == pytest.approx(0.3 * alone[0] + 0.7 * alone[1], rel=1e-12)
    assert alone[1] < 0.85 * alone[0]


@pytest.mark.parametrize("index", [1.6, 1 / 1.6])
def test_at_brewsters_angle_nothing_is_reflected_in_the_plane_and_energy_is_kept(index: float) -> None:
    """tan(i) = n; and Fresnel's other pair of equations, for the transmitted amplitude, adds up with it to 1."""
    for i in (math.atan(index), 0.0, 0.3, 0.67):
        r = math.asin(math.sin(i) / index)
        before, behind = (np.array([[math.sin(a), 0.0, math.cos(a)]]) for a in (i, r))
        s, p = fresnel(1 / index, before, behind)[:, 0]
        amplitudes = [2 * math.cos(i) / (math.cos(i) + index * math.cos(r))]
        amplitudes += [2 * math.cos(i) / (index * math.cos(i) + math.cos(r))]
        flux = index * math.cos(r) / math.cos(i)
        np.testing.assert_allclose([s, p], [flux * one**2 for one in amplitudes], rtol=BISECTED)
        if i == math.atan(index):
            assert p == pytest.approx(1, abs=BISECTED)


def test_a_lens_without_losses_and_with_coatings_alone() -> None:
    """Coatings multiply; bare surfaces of the double Gauss lose what their indices say."""
    tracer = Tracer(rigs.conventional(2.0))
    coated = Losses(coatings=flat(*(0.01,) * 11), per_mm=(1.0,) * 11)
    assert axial_transmission(tracer, None) == 1
    assert axial_transmission(tracer, coated) == pytest.approx(0.99**11, rel=BISECTED)
    indices = [1.0, *(surface.index for surface in tracer.camera.prescription.surfaces)]
    normal = math.prod(1 - ((a - b) / (a + b)) ** 2 for a, b in pairwise(indices))
    assert axial_transmission(tracer, BARE) == pytest.approx(normal, rel=MEAN_TRANSMISSION)


def test_glass_absorbs_by_the_length_of_the_way() -> None:
    """Near the axis the way in each glass is its thickness."""
    tracer = Tracer(rigs.conventional(0.2))
    glass = tuple(0.99 if surface.index > 1 else 1.0 for surface in tracer.camera.prescription.surfaces)
    losses = Losses(coatings=flat(*(0.0,) * 11), per_mm=glass)
    length = sum(one.thickness_mm for one in tracer.camera.prescription.surfaces if one.index > 1)
    assert axial_transmission(tracer, losses) == pytest.approx(0.99**length, rel=MEAN_TRANSMISSION)


def lambert(polygon: np.ndarray, x: float, y: float, distance: float) -> float:
    return float(projected_solid_angle(polygon, len(polygon), x, y, distance))


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
