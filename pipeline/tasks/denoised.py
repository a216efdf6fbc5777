"""Task `denoised`: a picture of a finished image without its noise."""

from pathlib import Path

import numpy as np

from pipeline.files.exr import ExrWindows
from pipeline.files.png import write_png
from pipeline.render.denoising import denoised
from pipeline.tasks.artefacts.cameras import Inputs
from pipeline.tasks.colour_image import picture
from pipeline.tasks.params.cameras import Nothing
from pipeline.tasks.params.outputs import DENOISED


def run(params: Nothing, inputs: Inputs, out: Path) -> None:
    """Write the picture; of channels that are no red, green and blue it shows the mean, as image.png does."""
    image = ExrWindows(inputs["image"]["image.exr"])
    channels = image.rows("image", 0, image.headers["image"].shape[0])
    if not channels.keys() >= set("RGB"):
        channels = {"Y": np.mean(list(channels.values()), axis=0)}
    names = "RGB" if "R" in channels else "Y"
    clear = denoised(np.stack([channels[name] for name in names], axis=-1, dtype=np.float32))
    write_png(out / DENOISED, picture({name: clear[..., number] for number, name in enumerate(names)}))
