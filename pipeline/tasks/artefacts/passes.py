"""Artefacts that passes leave for each other, for the check of their noise, and for the image."""

import shutil
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np

from pipeline.camera.parts.camera import REPLICAS
from pipeline.files.exr_bands import BandedPart
from pipeline.files.jsonfile import read_json, write_json
from pipeline.files.npy import read_npy, write_npy
from pipeline.jit.work import work
from pipeline.render.passes import Batch, joined, noise_of, standard_error
from pipeline.tasks.artefacts.cameras import Inputs
from pipeline.tasks.params.images import BEFORE, CHECK, STRIP

MEANS, COLOURS, FACTS = "means.npy", "colours.npy", "facts.json"
LEVEL, VERDICT = "level.json", "verdict.json"


class SoFar(NamedTuple):
    """Some rows after a pass: passes that took samples, the root mean square of the standard errors of the pixels that
    have any and the sum of all pixels, both as relative irradiance, and the number of pixels.
    """

    passes: int
    noise: float
    light: float
    pixels: int


def facts_of(inputs: Inputs, role: str) -> SoFar:
    """Facts that a pass left about its rows."""
    return SoFar(**read_json(inputs[role][FACTS]))


def is_over(number: int, inputs: Inputs) -> bool:
    """Whether the passes before have as little noise as asked for."""
    return number > 0 and not read_json(inputs[CHECK][VERDICT])["goes_on"]


def hand_on(inputs: Inputs, out: Path) -> None:
    """Leave what the pass before left."""
    for name in (MEANS, FACTS):
        shutil.copyfile(inputs[BEFORE][name], out / name)


def means_of(number: int, samples: int, inputs: Inputs, render: Callable[[Batch], np.ndarray]) -> np.ndarray:
    """Means over all samples so far of each replica, (replicas, ...), after a pass of batches.

    The first pass takes `samples` rays in all replicas together.
    """
    first = max(1, samples // REPLICAS)
    now = np.stack([render(Batch(first, number, replica)) for replica in range(REPLICAS)])
    return joined(read_npy(inputs[BEFORE][MEANS]) if number else None, now)


def write_pass(out: Path, means: np.ndarray, seen: np.ndarray, passes: int, light: float) -> None:
    """Write the means of replicas, and facts about the images (replicas, h, w) in which noise is judged."""
    write_npy(out / MEANS, means)
    facts = SoFar(passes, noise_of(standard_error(seen)), light, int(seen[0].size))
    write_json(out / FACTS, facts._asdict())


class Ended(NamedTuple):
    """An image after its last pass: the mean over its replicas, and the standard error of that, (h, w) float64 each;
    labels are attributes in the header of the file.
    """

    pixels: np.ndarray
    error: np.ndarray
    labels: dict[str, float | int]

    @property
    def part(self) -> BandedPart:
        """The standard error as a part of a file."""
        content = f"standard error of each pixel of the image, from {REPLICAS} independent replicas"
        return part_of("standard_error", self.error, {"content": content})


def ended(inputs: Inputs, asked: float, replicas: Callable[[int], np.ndarray]) -> Ended:
    """An image whose strips are after their last pass, the roles `tile0`, `tile1`, ….

    `asked` is the noise relative to the mean of the image; `replicas` returns the images (replicas, h, w) of a strip.
    """
    strips = range(sum(role.startswith(STRIP) for role in inputs))
    images = (replicas(strip) for strip in strips)
    pixels, errors = zip(*((image.mean(axis=0), standard_error(image)) for image in images), strict=True)
    facts, level = [facts_of(inputs, f"{STRIP}{strip}") for strip in strips], read_json(inputs["level"][LEVEL])["mean"]
    labels = {
        "noise_asked": asked,
        "noise": max(strip_facts.noise for strip_facts in facts) / level if level > 0 else 0.0,
        "passes_least": min(strip_facts.passes for strip_facts in facts),
        "passes_most": max(strip_facts.passes for strip_facts in facts),
    }
    if labels["noise"] > asked:
        work().news = f"noise {labels['noise']:.2g} with the most samples there may be, asked {asked:g}"
    return Ended(np.concatenate(pixels), np.concatenate(errors), labels)


def part_of(name: str, pixels: np.ndarray, attributes: dict[str, str | float | int]) -> BandedPart:
    """A part of a file with one channel, (h, w)."""

    def rows(first: int, end: int) -> dict[str, np.ndarray]:
        return {"Y": pixels[first:end]}

    height, width = pixels.shape
    return BandedPart(name=name, shape=(height, width), channels=("Y",), rows=rows, attributes=attributes)
