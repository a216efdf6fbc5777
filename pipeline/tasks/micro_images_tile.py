"""Task `micro_images_tile`: the light of some of the microlenses of a camera, for the task `micro_images`."""

import dataclasses
from pathlib import Path
from typing import Any

from pipeline.camera.micro_light import micro_light
from pipeline.files.npy import write_npy
from pipeline.tasks.cameras import Inputs, tracer_of


def run(params: dict[str, Any], inputs: Inputs, out: Path) -> None:
    """Params: tile, tiles."""
    tracer, images = tracer_of(inputs, 0)
    assert images is not None
    found = micro_light(tracer, images, params["tile"], params["tiles"])
    for field in dataclasses.fields(found):
        write_npy(out / f"{field.name}.npy", getattr(found, field.name))
