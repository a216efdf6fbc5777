"""Task `white`: the image of a white scene, i.e. vignetting and, for a plenoptic camera, the micro-images."""

from pathlib import Path
from typing import Any

from pipeline.render.imaging import irradiance
from pipeline.tasks.cameras import Inputs, tracer_of
from pipeline.tasks.image import write_image


def run(params: dict[str, Any], inputs: Inputs, out: Path) -> None:
    """Params: samples, seed, weight, wavelength_nm."""
    tracer, images = tracer_of(inputs, params["seed"])
    write_image(out, "white", irradiance(tracer, images, params["samples"], None), params, tracer)
