"""Lit images know the flux of a pixel: no noise of rays is left where it decides, and no bias comes in."""

import numpy as np
import pytest
from laws.test_steady_light import RED, has_no_bias, small
from plugins.scenes.lit import lamp, matt, plate, towards
from shorter import few

from pipeline.camera.parts.spectrum import Slices, alone
from pipeline.camera.rig import Rig
from pipeline.camera.tracer import Tracer
from pipeline.plugins.scenes.lighting.lit_scene import LitView
from pipeline.plugins.scenes.lighting.records import Finish, Lighting, PlacedLamp
from pipeline.records.plain import to_plain
from pipeline.render.imaging import known_flux, known_white_parts, pictures_in_lights, white_parts
from pipeline.render.pixel_rays import Band


def view(lamps: tuple[PlacedLamp, ...], half_mm: float, lights: tuple[Slices, ...] = (alone(550.0),)) -> LitView:
    """A plate of half white, and lamps."""
    finish = to_plain(Finish(materials=(matt(0.5),)))
    lighting = Lighting(lamps=lamps, finishes=(finish,), bounces=0)
    return LitView([], [(plate(434.4, half_mm), np.eye(4))], lighting, {}, 0.0, lights)


def test_a_furnace_behind_a_camera_has_no_noise_of_its_rays() -> None:
    """A plate that fills the view reflects half of an even sky: half of the white image, as quadrature knows it."""
    rig = Rig.of(Tracer(small(), 3))
    steady, known = known_white_parts(rig), known_flux(Band.of(rig))
    assert known is not None and steady is not None
    image = pictures_in_lights(rig, 4, [view((lamp("dome"),), 400.0)], steady)[0]
    exact = 0.5 * known.reshape(image.shape) / rig.tracer.reference_weight_sr
    np.testing.assert_allclose(image, exact, rtol=1e-9)
    white = white_parts(rig, 4)
    assert np.std(white[0, ..., 0] / exact) > 0.02, "the white image of four rays has noise"
    assert steady.shape == white.shape
    np.testing.assert_allclose(image / steady[0, ..., 0], 0.5, rtol=1e-9)
    np.testing.assert_array_equal(steady[1], 0.0)


@pytest.mark.parametrize("seeds", few([24], 48))
def test_the_correction_has_no_bias_at_edges_and_in_several_wavelengths(seeds: int) -> None:
    """An edge below a lamp."""
    window = lamp("rect", (60.0, 40.0), towards((0.2, 0.3, -1.0), (30.0, 60.0, 150.0)))
    has_no_bias(view((window,), 6.0, tuple(map(alone, RED))), seeds)
