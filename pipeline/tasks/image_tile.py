"""Task `image_tile`: some rows of an image, for the task `image`."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from pipeline.files.npy import read_npy, write_npy
from pipeline.render.imaging import pictures
from pipeline.render.light import TargetLight
from pipeline.tasks.cameras import Inputs, tracer_of
from pipeline.tasks.surroundings import placed_occluders, placed_targets
from pipeline.tasks.white_tile import FOREIGN, WHITE

PIXELS = "pixels.npy"


def run(params: dict[str, Any], inputs: Inputs, out: Path) -> None:
    """Params: those of `image`; rows."""
    run_together([params], inputs, [out])


def run_together(params: Sequence[dict[str, Any]], inputs: Inputs, outs: Sequence[Path]) -> None:
    """The same rows of several frames, which share the rays."""
    for pixels, out in zip(image_rows(params, inputs), outs, strict=True):
        write_npy(out / PIXELS, pixels)


def image_rows(params: Sequence[dict[str, Any]], inputs: Inputs) -> np.ndarray:
    """Rows of images that the params ask for, else all, (frames, h, w) float64; params differ in their scenes alone."""
    tracer, images = tracer_of(inputs, params[0]["seed"])
    white, foreign = (read_npy(inputs["white"][name]) for name in (WHITE, FOREIGN))
    parts = np.array([white - foreign, foreign])
    return pictures(tracer, images, params[0]["samples"], list(map(_scene, params)), parts, params[0].get("rows"))


def _scene(params: dict[str, Any]) -> TargetLight:
    targets, occluders = placed_targets(params["targets"]), placed_occluders(params["occluders"])
    return TargetLight(targets, params["background"], occluders)
