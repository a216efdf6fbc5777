"""Golden images as mean and variance over many seeds, and z-tests of images with other seeds.

`pytest --update-golden tests/golden/test_images.py` writes them. The tests are shown to notice a tenth of a pixel and a
hundredth of the light.
"""

import functools
import math
from pathlib import Path
from statistics import NormalDist

import numpy as np
import pytest
from golden.renders import Scene
from shorter import few

from pipeline.files.exr import Part, read_exr, write_exr

HERE = Path(__file__).parent
TINY = ("tiny_conventional", "tiny_plenoptic")
OF_GOLDEN, OF_TEST = range(100_000, 101_024), range(8)
"""Seeds of what is kept, and of what is tested."""
CHANCE = 1e-6
"""Probability of each of the three verdicts about a right image [1]: a change of random numbers is no alarm."""
ROUNDING = 1e-6
"""Standard deviation below which a pixel has no noise [1]: the file is single precision, and flat light of a lit scene
leaves nothing to chance.
"""
RARE = 8.0
"""Excess kurtosis of a pixel [1] beyond which the mean of eight images is not near to normal: one ray in hundreds meets
something else. Such pixels count in the sum alone.
"""


def judged(image: np.ndarray, known: dict[str, np.ndarray]) -> list[str]:
    """Verdicts against the mean of the tested seeds: none if it is right."""
    count = len(OF_TEST)
    variance, wrong = known["variance"] * (1 / count + 1 / len(OF_GOLDEN)), []
    off, noisy = image - known["mean"], variance > ROUNDING**2
    usual = noisy & (known["excess"] < RARE)
    assert np.mean(usual | ~noisy) > 0.85, "most pixels must be judged"
    z = off[usual] / np.sqrt(variance[usual])
    most = -NormalDist().inv_cdf(CHANCE / 2 / len(z))
    if np.abs(z).max() > most:
        wrong.append(f"a pixel is {np.abs(z).max():.1f} sigma off, more than {most:.1f}")
    # The square of a number with excess kurtosis e has the variance 2 + e.
    far = -NormalDist().inv_cdf(CHANCE / 2) * math.sqrt(np.sum(2 + known["excess"][usual] / count))
    if abs(np.sum(z**2) - len(z)) > far:
        wrong.append(f"chi-square is {np.sum(z**2):.0f}, not {len(z)} +- {far:.0f}")
    whole = abs(np.sum(off)) / math.sqrt(np.sum(variance))
    if whole > -NormalDist().inv_cdf(CHANCE / 2):
        wrong.append(f"the sum is {whole:.1f} sigma off")
    # Where no seed of many saw anything else, a few rays may.
    if np.any(np.abs(off[~noisy]) > 1 / 64):
        wrong.append(f"a pixel without noise is {np.abs(off[~noisy]).max()} off")
    return wrong


def mean_of(scene: Scene) -> np.ndarray:
    """The mean of the images that are tested."""
    return np.mean([scene.image(seed) for seed in OF_TEST], axis=0)


@functools.cache
def known_of(file: Path) -> dict[str, np.ndarray]:
    """The golden image."""
    channels = read_exr(file)["image"].channels
    return {channel: values.astype(float) for channel, values in channels.items()}


def same_or_written(scene: Scene, file: Path, golden) -> None:
    """An image with other seeds is the golden one within its noise."""
    update, show = golden
    if not update:
        image = mean_of(scene)
        assert judged(image, known_of(file)) == []
        assert any("sum" in verdict for verdict in judged(1.01 * image, known_of(file))), "a hundredth of the light"
        return
    images = np.stack([scene.image(seed) for seed in OF_GOLDEN])
    mean, variance = images.mean(axis=0), images.var(axis=0, ddof=1)
    fourth = np.mean((images - mean) ** 4, axis=0)
    excess = np.divide(fourth, variance**2, out=np.full_like(mean, 3.0), where=variance > 0) - 3.0
    old = read_exr(file)["image"].channels["mean"] if file.exists() else np.full_like(mean, np.nan)
    show(f"{file.name}: mean {old.mean()} -> {mean.mean()}, largest change {np.abs(old - mean).max()}")
    write_exr(file, [Part(name="image", channels={"mean": mean, "variance": variance, "excess": excess})])


def notices_a_tenth_of_a_pixel(moved: Scene, file: Path) -> None:
    assert any("chi-square" in verdict for verdict in judged(mean_of(moved), known_of(file)))


@pytest.mark.parametrize("name", TINY)
def test_an_image_with_other_seeds_is_the_golden_one_within_its_noise(name, golden):
    same_or_written(Scene(name), HERE / f"{name}.exr", golden)


@pytest.mark.parametrize("name", few(["tiny_conventional"], "tiny_plenoptic"))
def test_a_tenth_of_a_pixel_is_noticed(name):
    notices_a_tenth_of_a_pixel(Scene(name, shift_px=0.1), HERE / f"{name}.exr")
