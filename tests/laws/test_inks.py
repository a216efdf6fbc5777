"""Coloured ink and paper: a channel sees the integral of light, reflectance and response."""

import dataclasses

import numpy as np
import pytest
from colour.characterisation import SDS_COLOURCHECKERS
from laws import rigs
from laws.dispersion import in_light
from laws.lit import lamp, looked
from tolerances import LIT_ERRORS

from pipeline.camera.parts.camera import Sensor
from pipeline.camera.parts.spectrum import alone
from pipeline.camera.rig import Rig
from pipeline.camera.tracer import Tracer
from pipeline.render.glow import GlowingView
from pipeline.render.imaging import pictures_in_lights, white_parts
from pipeline.render.lighting.lit_scene import LitView
from pipeline.render.lighting.records import Lighting
from pipeline.render.spectral.nodes import gauss_nodes, points_of, slices_of
from pipeline.render.spectral.prints import Print, Spectrum
from pipeline.render.spectral.spectra import illuminant, reflectance
from pipeline.targets.patterns.checkerboard import Checkerboard
from pipeline.targets.target import Target

BOARD = Target(Checkerboard(columns=2, rows=1, square_mm=40.0))
LOW, HIGH = 500.0, 600.0
"""Ends of a flat response [nm]."""
PRINT = Print(
    ink=Spectrum(wavelengths_nm=(LOW, HIGH), reflectance=(0.3, 0.1)),
    paper=Spectrum(wavelengths_nm=(LOW, HIGH), reflectance=(0.2, 0.8)),
)


def mean_nm() -> float:
    """Mean wavelength of photons of equal energy through a flat response: integrals of lambda^2 and lambda."""
    return (HIGH**3 - LOW**3) / 3 / ((HIGH**2 - LOW**2) / 2)


def test_a_channel_is_the_integral_of_light_reflectance_and_response() -> None:
    """A reflectance that is linear over a flat response, in light of equal energy, is that at the mean wavelength."""
    points = points_of((np.array([LOW, HIGH]), np.ones(2)), illuminant("E"), counts_photons=True)
    light = dict(zip(*(values.tolist() for values in gauss_nodes(points, 5)), strict=True))
    sensor = Sensor(width_px=4, height_px=2, pitch_mm=0.4)
    camera = in_light(rigs.bare(rigs.tronnier(4.5), sensor, 131.81, (400.0, 480.0)), light)
    # The middle of the sensor sees the column of squares in the middle: black above, white below, or the other way.
    colours = PRINT.colours(BOARD, slices_of(points, np.array(list(light.values()))))
    views = [GlowingView([(BOARD, rigs.facing(434.4, y_mm=20.0 * s))], 0.0, (), [colours]) for s in (1, -1)]
    rig = Rig.of(Tracer(camera))
    white = white_parts(rig, 64)
    images = pictures_in_lights(rig, 64, views, white)
    whole = np.average(white[0], axis=-1, weights=list(light.values()))
    expected = sorted(np.interp(mean_nm(), one.wavelengths_nm, one.reflectance) for one in (PRINT.ink, PRINT.paper))
    found = sorted((images / whole).mean(axis=(1, 2)))
    np.testing.assert_allclose(found, expected, rtol=1e-3)  # bundles of the wavelengths differ by less


def test_below_an_even_sky_ink_and_paper_have_the_radiance_of_their_reflectance() -> None:
    """The radiance of a matt surface below a sky of 1 is its reflectance, here at two wavelengths."""
    wavelengths, lighting = (520.0, 590.0), Lighting(lamps=(lamp("dome"),), coats=(None,), bounces=0)
    lights = tuple(map(alone, wavelengths))
    view = LitView([(BOARD, rigs.facing(434.4))], [], lighting, {}, 0.0, lights, [PRINT.colours(BOARD, lights)])
    for number, nm in enumerate(wavelengths):
        found = sorted(looked(view.in_light(number), (0.0, y, 434.4)) for y in (-20.0, 20.0))
        expected = sorted(np.interp(nm, one.wavelengths_nm, one.reflectance) for one in (PRINT.ink, PRINT.paper))
        for (mean, error), value in zip(found, expected, strict=True):
            assert abs(mean - value) <= LIT_ERRORS * error + 1e-9


def test_without_a_spectrum_a_target_keeps_its_colours_and_white_scales_both() -> None:
    assert Print().colours(BOARD, (alone(550.0),)) == ()
    bright = dataclasses.replace(BOARD, pattern=dataclasses.replace(BOARD.pattern, white=2.0, black=0.5))
    lights = alone(LOW), alone(HIGH)
    np.testing.assert_allclose(Print(paper=PRINT.paper).colours(bright, lights), [[[0.5, 0.4]], [[0.5, 1.6]]])
    np.testing.assert_allclose(Print(ink=PRINT.ink).colours(bright, lights[1:]), [[[0.2, 2.0]]])


@pytest.mark.parametrize("patch", ["cyan", "red", "neutral 5 (.70 D)"])
def test_a_patch_of_the_colorchecker_reflects_what_another_laboratory_measured(patch: str) -> None:
    """The average of BabelColor, in steps of 10 nm, of other specimens."""
    other = SDS_COLOURCHECKERS["BabelColor Average"][patch]
    found = np.interp(other.wavelengths, *reflectance(patch))
    assert np.abs(found - other.values).max() < 0.05
    assert np.ptp(other.values) > 0.1 or patch.startswith("neutral")
