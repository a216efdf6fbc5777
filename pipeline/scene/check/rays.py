"""Warnings about the duration of a build, estimated from its number of rays."""

from collections.abc import Iterator

from pxr import Usd

from pipeline.limits import MOST_SAMPLES
from pipeline.scene.dataset import CameraEntry, Dataset
from pipeline.scene.usd.problems import Problem
from pipeline.scene.usd.source_locations import problem

CODE = "long-build"
RAYS_PER_S = 4e6
"""Rays per second of one core of 2026, a careful estimate: images of a singlet were traced at 8e6, moments of a
double Gauss at 16e6.
"""
LONG_S = 3 * 3600.0
"""Computing time of one camera on one core above which there is a warning [s]: longer than a person waits, and well
below a night, in which large datasets are built on purpose.
"""


def rays_of(camera: CameraEntry, frames: int) -> tuple[float, float]:
    """Number of rays of all images of a camera, white ones included, and of its position images."""
    pixels = float(camera.asked.sensor.width_px) * camera.asked.sensor.height_px
    images = pixels * samples_of(camera) * (1 + len(camera.f_numbers) + frames)
    if not camera.truth.searches:
        return images, 0.0
    return images, pixels * camera.sampling.supersampling**2 * camera.sampling.samples


def samples_of(camera: CameraEntry) -> float:
    """Rays of a pixel on an edge: as many as the stage says, or as many as the noise that it asks for may take.

    Independent rays, half of them black and half of them white, have the standard error 1 / (2 sqrt(n)).
    """
    if camera.image_noise is None:
        return camera.image_samples
    return max(camera.image_samples, min(MOST_SAMPLES, 0.25 / camera.image_noise**2))


def check_rays(stage: Usd.Stage, dataset: Dataset) -> Iterator[Problem]:
    """A warning for each camera whose rays would take one core hours."""
    for camera in dataset.cameras:
        images, positions = rays_of(camera, len(dataset.frames))
        seconds = (images + positions) / RAYS_PER_S
        if seconds < LONG_S:
            continue
        images_by = "plen:image:noise" if samples_of(camera) > camera.image_samples else "plen:image:samples"
        name = images_by if images >= positions else "plen:truth:samples"
        up_to = "up to " if name == "plen:image:noise" else ""
        what = f"{up_to}{images:.2g} rays of images and {positions:.2g} of position images take one core about"
        hint = (
            "fewer samples or frames, or more noise; of position images a smaller plen:truth:supersampling, or direct"
        )
        attribute = stage.GetPrimAtPath(camera.prim_path).GetAttribute(name)
        yield problem(attribute, CODE, f"{what} {seconds / 3600:,.0f} hours", hint=hint, severity="warning")
