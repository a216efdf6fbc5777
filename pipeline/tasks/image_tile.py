"""Task `image_tile`: some rows of an image, for the task `image`."""

from pathlib import Path
from typing import Any

import numpy as np

from pipeline.files.npy import write_npy
from pipeline.render.imaging import irradiance
from pipeline.render.light import TargetLight
from pipeline.tasks.cameras import Inputs, tracer_of
from pipeline.tasks.surroundings import placed_occluders, placed_targets

PIXELS = "pixels.npy"


def run(params: dict[str, Any], inputs: Inputs, out: Path) -> None:
    """Params: those of `image`; rows."""
    write_npy(out / PIXELS, image_rows(params, inputs))


def image_rows(params: dict[str, Any], inputs: Inputs) -> np.ndarray:
    """Rows of an image that the params ask for, else all, (h, w) float64."""
    tracer, images = tracer_of(inputs, params["seed"])
    targets, occluders = placed_targets(params["targets"]), placed_occluders(params["occluders"])
    light = TargetLight(targets, params["background"], occluders)
    return irradiance(tracer, images, params["samples"], light.radiance, params.get("rows"))
