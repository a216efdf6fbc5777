"""Task `positions`: J of every target in one frame, traced to the targets' own planes (method `image`)."""

from pathlib import Path
from typing import Any

import numpy as np

from pipeline.camera.micro_images import MicroImages
from pipeline.camera.tracer import Tracer, parallel_planes, target_plane
from pipeline.files.exr import Part, write_exr
from pipeline.tasks.cameras import Inputs, stretches, tracer_of


def run(params: dict[str, Any], inputs: Inputs, out: Path) -> None:
    """Params: targets (list of {name, vision_from_target}), supersampling, samples, seed, weight, wavelength_nm."""
    tracer, images = tracer_of(inputs, params["seed"])
    head = {name: params[name] for name in ("supersampling", "samples", "seed", "weight", "wavelength_nm")}
    parts = []
    for target in params["targets"]:
        pixels = position_image(tracer, images, np.array(target["vision_from_target"]), params)
        attributes = {"frame": "target frame, mm: x right, y up, z = 0", **head}
        parts.append(
            Part(name=target["name"], channels={"X": pixels[..., 0], "Y": pixels[..., 1]}, attributes=attributes)
        )
    write_exr(out / "positions.exr", parts)


def position_image(
    tracer: Tracer, images: MicroImages | None, vision_from_target: np.ndarray, params: dict[str, Any]
) -> np.ndarray:
    """J on the infinite plane of a target, in the target frame, (K h, K w, 2) float32 [mm]."""
    sensor, k = tracer.camera.sensor, params["supersampling"]
    height, width = sensor.height_px * k, sensor.width_px * k
    planes = np.stack([target_plane(vision_from_target), parallel_planes(1.0, 2.0)[0]])
    result = np.empty((height * width, 2), np.float32)
    for piece in stretches(tracer, images, k, 0, sensor.height_px):
        moments = tracer.moments(piece.positions_mm, piece.lens, planes, params["samples"], piece.pixels)
        result[piece.index] = moments[:, :2]
    return result.reshape(height, width, 2)
