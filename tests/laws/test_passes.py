"""Images in passes: they continue one sequence, and state a standard error that is right."""

import numpy as np
import pytest
from laws.rigs import conventional, facing, plenoptic

from pipeline.camera.parts.camera import REPLICAS, Camera
from pipeline.camera.rig import Rig
from pipeline.camera.tracer import Tracer
from pipeline.render.glow import TargetLight
from pipeline.render.imaging import colours_in_lights, sampled_in_lights, white_parts
from pipeline.render.passes import Batch, joined, noise_of, standard_error
from pipeline.targets.patterns.checkerboard import Checkerboard
from pipeline.targets.target import Target

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
    """The sampled part of an image."""
    colour = colours_in_lights(rig, light()) if colour is None else colour
    return sampled_in_lights(rig, batch, light(), white, colour)


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
    white, colour = white_parts(rig, Batch(4)), colours_in_lights(rig, light())
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
