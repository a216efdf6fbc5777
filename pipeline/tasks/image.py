"""Task `image`: the image of one camera in one frame, linear and as a preview."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from pipeline.files.exr import Part, write_exr
from pipeline.files.png import write_png
from pipeline.render.imaging import irradiance
from pipeline.render.light import TargetLight
from pipeline.render.spectra import srgb_preview
from pipeline.tasks.cameras import Inputs, tracer_of
from pipeline.tasks.surroundings import placed_occluders, placed_targets


def run(params: dict[str, Any], inputs: Inputs, out: Path) -> None:
    """Params: targets (list of {target, vision_from_target}), occluders, background, samples, seed, ..."""
    tracer, images = tracer_of(inputs, params["seed"])
    targets, occluders = placed_targets(params["targets"]), placed_occluders(params["occluders"])
    light = TargetLight(targets, params["background"], occluders)
    write_image(out, "image", irradiance(tracer, images, params["samples"], light.radiance), params, tracer)


def write_image(
    out: Path, name: str, pixels: np.ndarray, params: dict[str, Any], tracer: Any, more: Sequence[Part] = ()
) -> None:
    """Write `name`.exr, relative irradiance with its reference in the header, and `name`.png, an 8-bit preview."""
    by_area = tracer.camera.weight == "area"
    measure = "dA in the sampling plane" if by_area else "cos(theta) d omega"
    attributes = {
        "content": f"relative irradiance: integral of L {measure} over W_ref",
        "W_ref_mm2" if by_area else "W_ref_sr": tracer.reference_weight_sr,
        **{key: params[key] for key in ("weight", "wavelength_nm", "samples", "seed")},
    }
    write_exr(out / f"{name}.exr", [Part(name=name, channels={"Y": pixels}, attributes=attributes), *more])
    write_png(out / f"{name}.png", srgb_preview(pixels, 1.0))
