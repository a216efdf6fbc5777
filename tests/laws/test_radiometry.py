"""Claim: photons are radiance times etendue times transmission, and surfaces reflect as Fresnel says."""

import dataclasses
import math
from itertools import pairwise

import numpy as np
import pytest
from laws import rigs
from laws.dispersion import at, in_light
from laws.ideal_lens import thin
from tolerances import BISECTED, MEAN_TRANSMISSION

from pipeline.camera.parts.camera import Camera, Sensor
from pipeline.camera.rig import Rig
from pipeline.camera.tracer import Tracer
from pipeline.optics.rays import traced
from pipeline.optics.table import towards_scene, towards_sensor
from pipeline.optics.transmission import Coating, Losses, fresnel, transmitted
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


def test_a_hole_gives_cos_to_the_fourth() -> None:
    """White seen through a stop alone, far from a large sensor: cos^4 of the angle, pixel by pixel."""
    sensor = Sensor(width_px=41, height_px=1, pitch_mm=0.5)
    camera = Camera(prescription=rigs.hole(0.2), sensor=sensor, sensor_distance_mm=10.0, near_mm=100.0, far_mm=200.0)
    image = irradiance(Rig.of(Tracer(camera)), 16384, None)[0]
    x_mm = (np.arange(41) - 20) * 0.5
    # The mean over a pixel and over the disc of the stop differ from their middles by squares of their widths / 10 mm.
    np.testing.assert_allclose(image, np.cos(np.arctan(x_mm / 10)) ** 4, rtol=2e-3)


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


@pytest.mark.parametrize("index", [1.5168, 1.9])
def test_light_across_a_bare_plate_loses_fresnels_share_twice(index: float) -> None:
    """((n - 1) / (n + 1))^2 at each surface, at normal incidence."""
    for ratio in (1 / index, index):
        found = fresnel(ratio, np.array([[0.0, 0.0, 1.0]]), np.array([[0.0, 0.0, 1.0]]))
        np.testing.assert_allclose(found, 1 - ((index - 1) / (index + 1)) ** 2, rtol=BISECTED)


def test_at_brewsters_angle_nothing_is_reflected_in_the_plane_and_energy_is_kept() -> None:
    """tan(i) = n; and Fresnel's other pair of equations, for the transmitted amplitude, adds up with it to 1."""
    index = 1.6
    for i in (math.atan(index), 0.3, 1.2):
        r = math.asin(math.sin(i) / index)
        before, behind = (np.array([[math.sin(a), 0.0, math.cos(a)]]) for a in (i, r))
        s, p = fresnel(1 / index, before, behind)[:, 0]
        amplitudes = [2 * math.cos(i) / (math.cos(i) + index * math.cos(r))]
        amplitudes += [2 * math.cos(i) / (index * math.cos(i) + math.cos(r))]
        flux = index * math.cos(r) / math.cos(i)
        np.testing.assert_allclose([s, p], [flux * one**2 for one in amplitudes], rtol=BISECTED)
        if i == math.atan(index):
            assert p == pytest.approx(1, abs=BISECTED)


def test_transmission_is_the_same_either_way() -> None:
    """Rays from the sensor, and the same rays turned round, with bare, coated and absorbing parts."""
    prescription = rigs.tronnier(9.0)
    losses = Losses(
        coatings=flat(None, 0.01, None, 0.02, *(None,) * 7), per_mm=(0.99, 1.0, 0.98, *(1.0,) * 5, 0.97, 1.0, 1.0)
    )
    rng = np.random.default_rng(3)
    start = np.column_stack([rng.uniform(-5, 5, (200, 2)), np.full(200, -131.0)])
    way = np.column_stack([rng.uniform(-0.1, 0.1, (200, 2)), np.ones(200)])
    way /= np.linalg.norm(way, axis=1, keepdims=True)
    # Seen from the sensor, the medium behind a surface is that of the surface before it.
    from_sensor = Losses(coatings=losses.coatings[::-1], per_mm=(*losses.per_mm[-2::-1], 1.0))
    there = transmitted(towards_scene(prescription), start, way, from_sensor)
    end, direction, passes = traced(towards_scene(prescription), start, way)
    flip = np.array([1.0, -1.0, -1.0])
    back = transmitted(towards_sensor(prescription), (end + direction) * flip, -direction * flip, losses)
    assert passes.sum() > 50 and there[passes].min() > 0.2 and there[passes].max() < 0.7
    np.testing.assert_allclose(back[passes], there[passes], rtol=1e-9)
    assert not there[~passes].any()


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
