"""Previews: images only, a quarter of the size and with few samples. A preview has its own tasks and output folder."""

import dataclasses
import math
from pathlib import Path

from pipeline.camera.parts.camera import Sensor
from pipeline.engine.project import Project
from pipeline.scene.dataset import CameraEntry, Dataset

SHRINK = 4
"""Pixels along each axis that become one in a preview: a sixteenth of the rays, and details remain recognisable."""
SAMPLES = 16
"""Most rays per pixel and microlens: noise of about one 8-bit step on a pixel that an edge crosses."""


def preview_of(dataset: Dataset) -> Dataset:
    """The dataset with few, large pixels on the same sensors, and few samples."""
    return dataclasses.replace(dataset, cameras=tuple(map(_small, dataset.cameras)))


def _small(entry: CameraEntry) -> CameraEntry:
    asked = dataclasses.replace(entry.asked, sensor=_coarse(entry.asked.sensor))
    return dataclasses.replace(
        entry, asked=asked, image_samples=min(SAMPLES, entry.image_samples), image_noise=None, f_numbers=()
    )


def _coarse(sensor: Sensor) -> Sensor:
    """The sensor with pixels four times as wide, about its centre; it may be up to three old pixels larger."""
    return dataclasses.replace(
        sensor,
        width_px=math.ceil(sensor.width_px / SHRINK),
        height_px=math.ceil(sensor.height_px / SHRINK),
        pitch_mm=sensor.pitch_mm * SHRINK,
    )


def only_images(project: Project) -> Project:
    """The part of a project that makes pictures to look at: `image.png` and `white.png`."""
    files = {path: source for path, source in project.files.items() if path.endswith(("/image.png", "/white.png"))}
    tasks = {source[0] for source in files.values() if not isinstance(source, bytes)}
    return dataclasses.replace(
        project,
        graph=project.graph.up_to(tasks),
        files=files,
        findings={},
        source=None,
        stage_id=f"{project.stage_id} preview",
    )


def folder_of(out: Path) -> Path:
    """Output folder of the preview beside that of the dataset: `build/02_plenoptic.preview`."""
    return out.with_name(f"{out.name}.preview")
