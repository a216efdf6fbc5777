"""Task `micro_images_tile`: the light of some of the microlenses of a camera, for the task `micro_images`."""

import dataclasses
from pathlib import Path

from pipeline.camera.micro_images.light import micro_light
from pipeline.files.npy import write_npy
from pipeline.tasks.artefacts.cameras import Inputs, rig_of
from pipeline.tasks.params.cameras import MicroImagesTile as Params


def run(params: Params, inputs: Inputs, out: Path) -> None:
    """Write the fields of `MicroLight`, a file each."""
    rig = rig_of(inputs, 0)
    assert rig.images is not None
    found = micro_light(rig.tracer, rig.images, params.tile, params.tiles)
    for field in dataclasses.fields(found):
        write_npy(out / f"{field.name}.npy", getattr(found, field.name))
