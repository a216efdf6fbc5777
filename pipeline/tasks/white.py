"""Task `white`: the image of a white scene, i.e. vignetting and, for a plenoptic camera, the micro-images."""

import math
from pathlib import Path

import numpy as np

from pipeline.files.exr_bands import BandedPart
from pipeline.files.npy import read_npy
from pipeline.render.in_lights import in_all
from pipeline.tasks.artefacts.cameras import Inputs, stacked, tracer_alone
from pipeline.tasks.artefacts.passes import MEANS, ended, part_of
from pipeline.tasks.image import Rendered, write_image
from pipeline.tasks.params.images import STRIP
from pipeline.tasks.params.images import White as Params
from pipeline.tasks.white_tile import FOREIGN, WHITE, white_rows


def run(params: Params, inputs: Inputs, out: Path) -> None:
    """Write white.exr and white.png."""
    tracer, parts, labels = tracer_alone(inputs, params.exposure.seed), [], {}
    if params.noise is not None:
        means = [read_npy(inputs[f"{STRIP}{strip}"][MEANS]) for strip in range(params.tiles)]
        whole = ended(inputs, params.noise, lambda strip: in_all(tracer, means[strip][:, 0]))
        parts, labels = [whole.part], whole.labels
        white, foreign = np.concatenate(means, axis=2).mean(axis=0)
    elif params.tiles:
        white, foreign = (stacked(inputs, params.tiles, name) for name in (WHITE, FOREIGN))
    else:
        white, foreign = white_rows(params, inputs, out)
    white, foreign = in_all(tracer, white), in_all(tracer, foreign)
    if tracer.camera.microlenses is not None:
        parts = [_crosstalk(white, foreign), *parts]
    write_image(out, "white", Rendered(white, tuple(parts), labels), params.exposure, tracer)


def _crosstalk(white: np.ndarray, foreign: np.ndarray) -> BandedPart:
    """The share of foreign light in each pixel."""
    total = float(foreign.sum() / white.sum()) if white.any() else math.nan
    share = np.divide(foreign, white, out=np.full_like(white, np.nan), where=white > 0)
    content = "share of the light that came through another microlens than that of the pixel's cell"
    return part_of("crosstalk", share, {"content": content, "of_all_light": total})
