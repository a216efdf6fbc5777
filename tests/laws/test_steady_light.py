"""Lit images know the flux of a pixel: no noise of rays is left where it decides, and no bias comes in."""

import dataclasses

import numpy as np
import pytest
from laws import rigs
from laws.dispersion import in_light
from laws.lit import lamp, matt, plate, towards

from pipeline.camera.parts.camera import Camera
from pipeline.camera.rig import Rig
from pipeline.camera.tracer import Tracer
from pipeline.records.plain import to_plain
from pipeline.render import imaging
from pipeline.render.band import Band
from pipeline.render.imaging import irradiance
from pipeline.render.in_lights import pictures_in_lights, white_parts
from pipeline.render.known_flux import known_flux
from pipeline.render.lighting.lit_scene import LitView
from pipeline.render.lighting.records import Finish, Lighting, PlacedLamp

RED = {600.0: 0.3, 640.0: 0.5, 680.0: 0.2}
"""Shares of the wavelengths of a channel."""


def small() -> Camera:
    """Few coarse pixels."""
    return rigs.conventional(4.5, 24, 18, 0.2)


def view(lamps: tuple[PlacedLamp, ...], half_mm: float, wavelengths_nm: tuple[float, ...] = (550.0,)) -> LitView:
    """A plate of half white, and lamps."""
    finish = to_plain(Finish(materials=(matt(0.5),)))
    lighting = Lighting(lamps=lamps, finishes=(finish,), bounces=0)
    return LitView([], [(plate(434.4, half_mm), np.eye(4))], lighting, {}, 0.0, wavelengths_nm)


def test_the_known_flux_is_that_of_many_rays_where_light_falls_off_too() -> None:
    camera = rigs.conventional(17.0, 96, 64, 0.4)
    rig = Rig.of(Tracer(camera, 3))
    known = known_flux(Band.of(rig, (0, 2)))
    assert known is not None
    known /= rig.tracer.reference_weight_sr
    white = irradiance(rig, 1 << 15, None, (0, 2)).ravel()
    assert white.min() < 0.8, "on the axis it is 1: vignetting must be part of it"
    np.testing.assert_allclose(known, white, atol=2e-3)
    assert abs(np.mean(known - white)) < 2e-4


def test_what_is_known_of_a_pixel_depends_on_no_other_rows() -> None:
    rig = Rig.of(Tracer(small(), 3))
    whole, part = known_flux(Band.of(rig)), known_flux(Band.of(rig, (5, 9)))
    assert whole is not None and part is not None
    assert part.tobytes() == whole.reshape(18, 24)[5:9].tobytes()


def test_behind_microlenses_nothing_is_known() -> None:
    rig = Rig.of(Tracer(rigs.plenoptic(extent_mm=1.2, width_px=40, height_px=30), 3))
    assert known_flux(Band.of(rig, (0, 4))) is None


def test_a_furnace_behind_a_camera_has_no_noise_of_its_rays() -> None:
    """A plate that fills the view reflects half of an even sky: half of the white image, as quadrature knows it."""
    rig = Rig.of(Tracer(small(), 3))
    white = white_parts(rig, 4)
    image = pictures_in_lights(rig, 4, [view((lamp("dome"),), 400.0)], white)[0]
    known = known_flux(Band.of(rig))
    assert known is not None
    exact = 0.5 * known.reshape(image.shape) / rig.tracer.reference_weight_sr
    np.testing.assert_allclose(image, exact, rtol=1e-9)
    assert np.std(white[0, ..., 0] / exact) > 0.02, "the white image of four rays has noise"


@pytest.mark.parametrize("seeds", [24, pytest.param(48, marks=pytest.mark.heavy)])
def test_the_correction_has_no_bias_at_edges_and_in_several_wavelengths(seeds: int, monkeypatch) -> None:
    """The mean over seeds is that of images of many rays without correction, pixel by pixel and in the sum."""
    rig = Rig.of(Tracer(in_light(small(), RED), 5))
    scene = view((lamp("rect", (60.0, 40.0), towards((0.2, 0.3, -1.0), (30.0, 60.0, 150.0))),), 6.0, tuple(RED))

    def image(samples: int, seed: int) -> np.ndarray:
        one = dataclasses.replace(rig, tracer=dataclasses.replace(rig.tracer, seed=seed))
        return pictures_in_lights(one, samples, [scene], white_parts(one, samples))[0]

    found = np.array([image(8, seed) for seed in range(seeds)])
    monkeypatch.setattr(imaging, "known_flux", lambda band: None)
    plain = np.array([image(512, seed) for seed in range(100, 108)])
    raw = np.array([image(8, seed) for seed in range(seeds)])
    error = np.sqrt(found.var(axis=0, ddof=1) / len(found) + plain.var(axis=0, ddof=1) / len(plain))
    noisy = error > 1e-4
    z = (found.mean(axis=0) - plain.mean(axis=0))[noisy] / error[noisy]
    assert noisy.sum() > 50 and np.abs(z).max() < 6
    total = found.sum(axis=(1, 2))
    assert abs(total.mean() - plain.sum(axis=(1, 2)).mean()) < 5 * total.std(ddof=1) / np.sqrt(len(total))
    assert found.var(axis=0).sum() < raw.var(axis=0).sum()
