"""Task `positions`: J of every tangent plane of all targets in one frame, traced to the planes (method `image`).

Only where target points may be seen, unless the whole image is asked for: the candidates are those of method `direct`.
"""

from pathlib import Path
from typing import Any

import numpy as np

from pipeline.camera.micro_images import MicroImages
from pipeline.camera.tracer import Tracer, parallel_planes, target_plane
from pipeline.files.exr import Part, write_exr
from pipeline.tasks.cameras import Inputs, stretches, tracer_of
from pipeline.truth.candidates import candidates
from pipeline.truth.grid import fine_from_image


def run(params: dict[str, Any], inputs: Inputs, out: Path) -> None:
    """Params: planes (list of {name, vision_from_target, points_mm}), extent, supersampling, samples, square_px, ..."""
    tracer, images = tracer_of(inputs, params["seed"])
    names = ("extent", "supersampling", "samples", "seed", "weight", "footprint", "wavelength_nm")
    head = {name: params[name] for name in names}
    parts = []
    for plane in params["planes"]:
        wanted = None
        if params["extent"] == "tiles":
            wanted = tiles(tracer, images, np.array(plane["points_mm"]), params["supersampling"])
        pixels = position_image(tracer, images, np.array(plane["vision_from_target"]), params, wanted)
        attributes = {"frame": "frame of the tangent plane, mm: x right, y up, z = 0", **head}
        parts.append(
            Part(name=plane["name"], channels={"X": pixels[..., 0], "Y": pixels[..., 1]}, attributes=attributes)
        )
    write_exr(out / "positions.exr", parts)


def tiles(tracer: Tracer, images: MicroImages | None, points_mm: np.ndarray, supersampling: int) -> np.ndarray:
    """Fine positions where images of points (p, 3) may lie, with room for the search, (K h, K w) bool."""
    sensor, k = tracer.camera.sensor, supersampling
    wanted = np.zeros((sensor.height_px * k, sensor.width_px * k), bool)
    found = candidates(tracer, images, points_mm)
    centre = np.rint(fine_from_image(found.x_px, k)).astype(int)
    room = np.ceil(found.reach_px * k).astype(int) + 2
    for (column, row), far in zip(centre, room, strict=True):
        wanted[max(row - far, 0) : max(row + far + 1, 0), max(column - far, 0) : max(column + far + 1, 0)] = True
    return wanted


def position_image(
    tracer: Tracer,
    images: MicroImages | None,
    vision_from_target: np.ndarray,
    params: dict[str, Any],
    wanted: np.ndarray | None = None,
) -> np.ndarray:
    """J on the infinite plane of a target, in the target frame, (K h, K w, 2) float32 [mm]; NaN where not wanted."""
    sensor, k = tracer.camera.sensor, params["supersampling"]
    height, width = sensor.height_px * k, sensor.width_px * k
    planes = np.stack([target_plane(vision_from_target), parallel_planes(1.0, 2.0)[0]])
    result = np.full((height * width, 2), np.nan, np.float32)
    for piece in stretches(tracer, images, k, 0, sensor.height_px):
        here = slice(None) if wanted is None else wanted.ravel()[piece.index]
        arguments = piece.positions_mm[here], piece.lens[here], planes, params["samples"], piece.pixels[here]
        result[piece.index[here]] = tracer.moments(*arguments, params["square_px"])[:, :2]
    return result.reshape(height, width, 2)
