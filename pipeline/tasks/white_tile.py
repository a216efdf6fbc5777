"""Task `white_tile`: some rows of the image of a white scene, for the tasks `white` and `image_tile`."""

from pathlib import Path
from typing import Any

import numpy as np

from pipeline.files.npy import write_npy
from pipeline.render.imaging import irradiance_and_crosstalk
from pipeline.tasks.cameras import Inputs, tracer_of

WHITE, FOREIGN = "white.npy", "foreign.npy"


def run(params: dict[str, Any], inputs: Inputs, out: Path) -> None:
    """Params: those of `white`; rows."""
    white_rows(params, inputs, out)


def white_rows(params: dict[str, Any], inputs: Inputs, out: Path) -> tuple[np.ndarray, np.ndarray]:
    """Rows that the params ask for, else all, (h, w) float64 each, written for images: the white image, and its part
    through other microlenses than that of the pixel's cell."""
    tracer, images = tracer_of(inputs, params["seed"])
    parts = irradiance_and_crosstalk(tracer, images, params["samples"], None, params.get("rows"))
    for name, pixels in zip((WHITE, FOREIGN), parts, strict=True):
        write_npy(out / name, pixels)
    return parts
