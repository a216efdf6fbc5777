"""Images know the flux of a pixel: no noise of rays is left where it decides, and no bias comes in."""

import dataclasses

import numpy as np
import pytest
from laws import rigs
from laws.rigs import conventional, facing, in_light, plenoptic
from tolerances import KNOWN_FLUX, LIT_ERRORS

from pipeline.camera.integrals import Bundles, integrals
from pipeline.camera.parts.camera import REPLICAS, Camera
from pipeline.camera.rig import Rig
from pipeline.camera.tracer import Tracer, parallel_planes
from pipeline.camera.tracing.moments import WEIGHT
from pipeline.camera.tracing.sampling_bounds import NO_MICROLENS
from pipeline.render.glow import TargetLight
from pipeline.render.imaging import (
    SceneView,
    bands_in_lights,
    colours_in_lights,
    known_flux,
    known_white_parts,
    over_wavelengths,
    pictures_in_lights,
    sampled_in_lights,
    white_parts,
)
from pipeline.render.pixel_rays import Band, Batch, joined, noise_of, standard_error
from pipeline.targets.patterns.checkerboard import Checkerboard
from pipeline.targets.target import Target

RED = {600.0: 0.3, 640.0: 0.5, 680.0: 0.2}
"""Shares of the wavelengths of a channel."""


def small() -> Camera:
    return rigs.conventional(4.5, 24, 18, 0.2)


@pytest.mark.parametrize(("pitch_mm", "row"), [(0.4, 0), (0.4, 31), (0.8, 31)])
def test_the_known_flux_is_that_of_quadrature_at_every_pixel_of_a_coarse_sensor(pitch_mm: float, row: int) -> None:
    """Wide open, vignetting begins and grows within a few pixels; cubics must not smooth it."""
    rig = Rig.of(Tracer(rigs.conventional(17.0, 96, 64, pitch_mm), 3))
    known, x_px = known_flux(Band.of(rig, (row, row + 1))), np.arange(96.0)
    positions = np.stack([x_px, np.full(96, float(row))], axis=1)
    planes = np.broadcast_to(parallel_planes(1.0, 2.0), (96, 2, 4, 3))
    exact = integrals(rig.tracer, Bundles(positions, np.full(96, NO_MICROLENS), planes), 2).moments[:, WEIGHT]
    assert known is not None and exact.min() < 0.85 * exact.max()
    assert np.abs(known - exact).max() < KNOWN_FLUX * rig.tracer.reference_weight_sr


def test_what_is_known_of_a_pixel_depends_on_no_other_rows() -> None:
    rig = Rig.of(Tracer(small(), 3))
    whole, part = known_flux(Band.of(rig)), known_flux(Band.of(rig, (5, 9)))
    assert whole is not None and part is not None
    assert part.tobytes() == whole.reshape(18, 24)[5:9].tobytes()
    some = known_flux(Band.of(rig, (5, 9), (3, 11)))
    assert some is not None and some.tobytes() == whole.reshape(18, 24)[5:9, 3:11].tobytes()


def test_behind_microlenses_nothing_is_known() -> None:
    rig = Rig.of(Tracer(rigs.plenoptic(extent_mm=1.2, width_px=40, height_px=30), 3))
    assert known_flux(Band.of(rig, (0, 4))) is None and known_white_parts(rig, (0, 4)) is None


def test_the_white_image_by_quadrature_is_that_of_many_rays_in_several_wavelengths() -> None:
    """The mean over pixels lies within 4.5 of its errors, by 16 seeds. Pixels over their own errors follow Student's
    law with 15 degrees of freedom: the mean of 432 squares is 1.15, give or take 0.09."""
    rig = Rig.of(Tracer(in_light(small(), RED), 5))
    seeds = [dataclasses.replace(rig, tracer=dataclasses.replace(rig.tracer, seed=seed)) for seed in range(16)]
    many = np.array([over_wavelengths(one.tracer, white_parts(one, 512)[0]) for one in seeds])
    parts = known_white_parts(rig)
    assert parts is not None
    off, error = many.mean(axis=0) - over_wavelengths(rig.tracer, parts[0]), many.std(axis=0, ddof=1) / 4.0
    total = many.mean(axis=(1, 2))
    assert abs(off.mean()) < LIT_ERRORS * total.std(ddof=1) / 4.0
    assert np.mean((off / error) ** 2) < 1.7


SQUARES = TargetLight([(Target(Checkerboard(columns=41, rows=40, square_mm=0.83)), rigs.facing(430.0, 20.0))], 0.3)
"""Squares of 1.2 pixels: dark pixels between two bright ones, and the other way round."""


@pytest.mark.parametrize("seeds", [24, pytest.param(48, marks=pytest.mark.heavy)])
def test_the_correction_has_no_bias_at_edges_and_in_several_wavelengths(seeds: int) -> None:
    has_no_bias(SQUARES, seeds)


def has_no_bias(scene: SceneView, seeds: int) -> None:
    """The mean over seeds is that of images of many rays without correction, pixel by pixel and in the sum."""
    rig = Rig.of(Tracer(in_light(small(), RED), 5))
    known = known_white_parts(rig)
    assert known is not None

    def image(samples: int, seed: int, white: np.ndarray | None = None) -> np.ndarray:
        one = dataclasses.replace(rig, tracer=dataclasses.replace(rig.tracer, seed=seed))
        white = white_parts(one, samples) if white is None else white
        return pictures_in_lights(one, samples, [scene], white)[0]

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


CAMERAS = {
    "conventional": conventional(width_px=24, height_px=18, pitch_mm=0.1),
    "plenoptic": plenoptic(extent_mm=1.2, width_px=40, height_px=30),
}
ASKED = 0.0368
"""Noise that some seeds reach in four passes and some in five [relative irradiance]."""
ROUNDING = 1e-12
"""Relative difference of two sums of the same numbers in another order [1]."""


def light() -> TargetLight:
    return TargetLight([(Target(Checkerboard(columns=4, rows=3, square_mm=1.5)), facing(434.4, 20.0))], 0.3)


def sampled(rig: Rig, batch: Batch, white: np.ndarray, colour: np.ndarray | None = None) -> np.ndarray:
    bands = bands_in_lights(rig)
    colour = colours_in_lights(bands, [light()]) if colour is None else colour
    return sampled_in_lights(rig, bands, batch, [light()], white, colour)[0]


@pytest.mark.parametrize("name", CAMERAS)
def test_passes_take_the_samples_that_one_pass_over_all_of_them_takes(name: str) -> None:
    """Of a microlens with little light, too, which gets fewer."""
    rig = Rig.of(Tracer(CAMERAS[name], 5))
    white = white_parts(rig, 16)
    image, whole = None, None
    for number in range(3):
        image = joined(image, sampled(rig, Batch(4, number, replica=1), white))
        whole = joined(whole, white_parts(rig, Batch(4, number, replica=1)))
    once = sampled(rig, Batch(16, replica=1), white)
    assert once.std() > 0.1 and image is not None and whole is not None
    np.testing.assert_allclose(image, once, rtol=ROUNDING, atol=ROUNDING)
    np.testing.assert_allclose(whole, white_parts(rig, Batch(16, replica=1)), rtol=ROUNDING, atol=ROUNDING)


def stopped(camera: Camera, seed: int, noise: float) -> tuple[np.ndarray, np.ndarray, int]:
    """An image that is sampled until its noise is small enough, its standard error, and the passes that it took."""
    rig = Rig.of(Tracer(camera, seed))
    white, colour = white_parts(rig, Batch(4)), colours_in_lights(bands_in_lights(rig), [light()])
    images = None
    for number in range(6):
        now = np.stack([sampled(rig, Batch(1, number, replica), white, colour) for replica in range(REPLICAS)])
        images = joined(images, now)
        error = standard_error(images)
        if noise_of(error) <= noise:
            break
    assert images is not None
    return images.mean(axis=0), error, number


def test_the_stated_error_is_that_of_many_seeds_and_stopping_by_it_has_no_bias() -> None:
    """The mean square of the deviations is that of the stated errors; their mean is 0."""
    camera = CAMERAS["conventional"]
    rig = Rig.of(Tracer(camera, 999))
    exact = sampled(rig, Batch(2048), white_parts(rig, Batch(64)))
    runs = [stopped(camera, seed, ASKED) for seed in range(24)]
    assert len({passes for *_, passes in runs}) > 1, "the rule must have a choice"
    off = np.array([image - exact for image, *_ in runs])
    stated = np.array([error for _, error, _ in runs])
    pixels = np.count_nonzero(stated.any(axis=0))
    assert pixels > 60
    # Four replicas have three degrees of freedom: a ratio of mean squares scatters by the root of 2 / 3 of a pixel's.
    scatter = np.sqrt((2 + 2 / 3) / (pixels * len(runs)))
    assert abs(np.mean(off**2) / np.mean(stated**2) - 1) < 6 * scatter
    assert abs(np.sum(off)) < 5 * np.sqrt(np.sum(stated**2))
    assert all(noise_of(error) <= ASKED for error in stated)


def test_noise_is_of_the_pixels_that_have_any() -> None:
    assert noise_of(np.array([[0.0, 3.0], [4.0, 0.0]])) == pytest.approx(np.sqrt(12.5))
    assert noise_of(np.zeros((2, 2))) == 0.0
