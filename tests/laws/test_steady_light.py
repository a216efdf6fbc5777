"""Images know the flux of a pixel: no noise of rays is left where it decides, and no bias comes in."""

import dataclasses

import numpy as np
import pytest
from laws import rigs
from laws.dispersion import in_light
from laws.lit import lamp, matt, plate, towards
from shorter import few
from tolerances import KNOWN_FLUX, LIT_ERRORS

from pipeline.camera.integrals import Bundles, integrals
from pipeline.camera.parts.camera import Camera
from pipeline.camera.parts.spectrum import Slices, alone
from pipeline.camera.rig import Rig
from pipeline.camera.tracer import Tracer, parallel_planes
from pipeline.camera.tracing.moments import WEIGHT
from pipeline.camera.tracing.sampling_bounds import NO_MICROLENS
from pipeline.records.plain import to_plain
from pipeline.render.glow import TargetLight
from pipeline.render.imaging import in_all, irradiance, known_white_parts, pictures_in_lights, white_parts
from pipeline.render.known_flux import known_flux
from pipeline.render.lighting.lit_scene import LitView
from pipeline.render.lighting.records import Finish, Lighting, PlacedLamp
from pipeline.render.pixel_rays import Band
from pipeline.targets.patterns.checkerboard import Checkerboard
from pipeline.targets.target import Target

RED = {600.0: 0.3, 640.0: 0.5, 680.0: 0.2}
"""Shares of the wavelengths of a channel."""


def small() -> Camera:
    """Few coarse pixels."""
    return rigs.conventional(4.5, 24, 18, 0.2)


def view(lamps: tuple[PlacedLamp, ...], half_mm: float, lights: tuple[Slices, ...] = (alone(550.0),)) -> LitView:
    """A plate of half white, and lamps."""
    finish = to_plain(Finish(materials=(matt(0.5),)))
    lighting = Lighting(lamps=lamps, finishes=(finish,), bounces=0)
    return LitView([], [(plate(434.4, half_mm), np.eye(4))], lighting, {}, 0.0, lights)


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


@pytest.mark.parametrize("pitch_mm", [0.4, 0.8])
def test_the_known_flux_is_that_of_quadrature_at_every_pixel_of_a_coarse_sensor(pitch_mm: float) -> None:
    """Wide open, vignetting begins and grows within a few pixels; cubics must not smooth it."""
    rig = Rig.of(Tracer(rigs.conventional(17.0, 96, 64, pitch_mm), 3))
    known, x_px = known_flux(Band.of(rig, (31, 32))), np.arange(96.0)
    positions = np.stack([x_px, np.full(96, 31.0)], axis=1)
    planes = np.broadcast_to(parallel_planes(1.0, 2.0), (96, 2, 4, 3))
    exact = integrals(rig.tracer, Bundles(positions, np.full(96, NO_MICROLENS), planes), 2).moments[:, WEIGHT]
    assert known is not None and exact.min() < 0.85 * exact.max()
    assert np.abs(known - exact).max() < KNOWN_FLUX * rig.tracer.reference_weight_sr


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


def test_the_white_image_by_quadrature_is_that_of_many_rays_in_several_wavelengths() -> None:
    """The mean over pixels lies within 4.5 of its errors, by 16 seeds. Pixels over their own errors follow Student's
    law with 15 degrees of freedom: the mean of 432 squares is 1.15, give or take 0.09."""
    rig = Rig.of(Tracer(in_light(small(), RED), 5))
    seeds = [dataclasses.replace(rig, tracer=dataclasses.replace(rig.tracer, seed=seed)) for seed in range(16)]
    many = np.array([in_all(one.tracer, white_parts(one, 512)[0]) for one in seeds])
    parts = known_white_parts(rig)
    assert parts is not None
    off, error = many.mean(axis=0) - in_all(rig.tracer, parts[0]), many.std(axis=0, ddof=1) / 4.0
    total = many.mean(axis=(1, 2))
    assert abs(off.mean()) < LIT_ERRORS * total.std(ddof=1) / 4.0
    assert np.mean((off / error) ** 2) < 1.7


def test_behind_microlenses_the_white_image_stays_that_of_rays() -> None:
    assert (
        known_white_parts(Rig.of(Tracer(rigs.plenoptic(extent_mm=1.2, width_px=40, height_px=30), 3)), (0, 4)) is None
    )


LAMP = lamp("rect", (60.0, 40.0), towards((0.2, 0.3, -1.0), (30.0, 60.0, 150.0)))
SCENES = {
    "lit": view((LAMP,), 6.0, tuple(map(alone, RED))),
    "glowing": TargetLight(
        [(Target(Checkerboard(columns=41, rows=40, square_mm=0.83)), rigs.facing(430.0, 20.0))], 0.3
    ),
}
"""An edge below a lamp, and squares of 1.2 pixels: dark pixels between two bright ones, and the other way round."""


@pytest.mark.parametrize("name", few(["glowing"], "lit"))
@pytest.mark.parametrize("seeds", [24, pytest.param(48, marks=pytest.mark.heavy)])
def test_the_correction_has_no_bias_at_edges_and_in_several_wavelengths(seeds: int, name: str) -> None:
    """The mean over seeds is that of images of many rays without correction, pixel by pixel and in the sum."""
    rig = Rig.of(Tracer(in_light(small(), RED), 5))
    known = known_white_parts(rig)
    assert known is not None

    def image(samples: int, seed: int, white: np.ndarray | None = None) -> np.ndarray:
        one = dataclasses.replace(rig, tracer=dataclasses.replace(rig.tracer, seed=seed))
        white = white_parts(one, samples) if white is None else white
        return pictures_in_lights(one, samples, [SCENES[name]], white)[0]

    found = np.array([image(8, seed, known) for seed in range(seeds)])
    plain = np.array([image(512, seed) for seed in range(100, 108)])
    raw = np.array([image(8, seed) for seed in range(seeds)])
    error = np.sqrt(found.var(axis=0, ddof=1) / len(found) + plain.var(axis=0, ddof=1) / len(plain))
    noisy = error > 1e-4
    z = (found.mean(axis=0) - plain.mean(axis=0))[noisy] / error[noisy]
    assert noisy.sum() > 50 and np.abs(z).max() < 6
    total = found.sum(axis=(1, 2))
    assert abs(total.mean() - plain.sum(axis=(1, 2)).mean()) < 5 * total.std(ddof=1) / np.sqrt(len(total))
    assert found.var(axis=0).sum() < raw.var(axis=0).sum()
