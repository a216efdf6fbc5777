"""Task `white`: the image of a white scene, i.e. vignetting and, for a plenoptic camera, the micro-images."""

import math
from pathlib import Path
from typing import Any

import numpy as np

from pipeline.files.exr import Part
from pipeline.render.imaging import irradiance_and_crosstalk
from pipeline.tasks.cameras import Inputs, tracer_of
from pipeline.tasks.image import write_image


def run(params: dict[str, Any], inputs: Inputs, out: Path) -> None:
    """Params: samples, seed, weight, wavelength_nm."""
    tracer, images = tracer_of(inputs, params["seed"])
    white, foreign = irradiance_and_crosstalk(tracer, images, params["samples"], None)
    if images is None:
        write_image(out, "white", white, params, tracer)
        return
    share = np.divide(foreign, white, out=np.full_like(white, np.nan), where=white > 0)
    total = float(foreign.sum() / white.sum()) if white.any() else math.nan
    content = "share of the light that came through another microlens than that of the pixel's cell"
    crosstalk = Part(name="crosstalk", channels={"Y": share}, attributes={"content": content, "of_all_light": total})
    write_image(out, "white", white, params, tracer, [crosstalk])
