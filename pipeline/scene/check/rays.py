"""Warnings about the duration of a build, estimated from its number of rays."""

from collections.abc import Iterator

from pxr import Usd

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
    images = pixels * camera.image_samples * (1 + len(camera.f_numbers) + frames)
    if camera.truth.get("method") == "direct":
        return images, 0.0
    return images, pixels * camera.sampling.supersampling**2 * camera.sampling.samples


def check_rays(stage: Usd.Stage, dataset: Dataset) -> Iterator[Problem]:
    """A warning for each camera whose rays would take one core hours."""
    for camera in dataset.cameras:
        images, positions = rays_of(camera, len(dataset.frames))
        seconds = (images + positions) / RAYS_PER_S
        if seconds < LONG_S:
            continue
        name = "plen:image:samples" if images >= positions else "plen:truth:samples"
        what = f"{images:.2g} rays of images and {positions:.2g} of position images take one core about"
        hint = "fewer samples or frames; a smaller plen:truth:supersampling, or the method direct, for position images"
        attribute = stage.GetPrimAtPath(camera.prim_path).GetAttribute(name)
        yield problem(attribute, CODE, f"{what} {seconds / 3600:,.0f} hours", hint=hint, severity="warning")
