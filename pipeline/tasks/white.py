"""Task `white`: the image of a white scene, i.e. vignetting and, for a plenoptic camera, the micro-images."""

import math
from pathlib import Path

import numpy as np

from pipeline.render.in_lights import in_all
from pipeline.tasks.artefacts.cameras import Inputs, stacked, tracer_alone
from pipeline.tasks.image import part_of, write_image
from pipeline.tasks.params.images import White as Params
from pipeline.tasks.white_tile import FOREIGN, WHITE, white_rows


def run(params: Params, inputs: Inputs, out: Path) -> None:
    """Write white.exr and white.png."""
    if params.tiles:
        white, foreign = (stacked(inputs, params.tiles, name) for name in (WHITE, FOREIGN))
    else:
        white, foreign = white_rows(params.exposure, inputs, out)
    tracer = tracer_alone(inputs, params.exposure.seed)
    white, foreign = in_all(tracer, white), in_all(tracer, foreign)
    if tracer.camera.microlenses is None:
        write_image(out, "white", white, params.exposure, tracer)
        return
    total = float(foreign.sum() / white.sum()) if white.any() else math.nan
    share = np.divide(foreign, white, out=np.full_like(white, np.nan), where=white > 0)
    content = "share of the light that came through another microlens than that of the pixel's cell"
    crosstalk = part_of("crosstalk", share, {"content": content, "of_all_light": total})
    write_image(out, "white", white, params.exposure, tracer, [crosstalk])
