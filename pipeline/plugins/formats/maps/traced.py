"""Rays of all pixels, for files with a value per pixel: a camera is traced once, and few rows of it are in memory."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pipeline.exports.material import ExportCamera, Material
from pipeline.exports.ray_patches import bands
from pipeline.results.answers import SeenScene

AT_ONCE = 1 << 16
"""Pixels of a band, unless the rows of its patches are more: their rays take some megabytes."""


@dataclass(frozen=True, slots=True)
class TracedPixels:
    """Rays (h, w, 6) of all pixels in a file: origin [mm], direction; microlenses (h, w, 2) of a plenoptic camera."""

    rays: np.ndarray
    microlenses: np.ndarray | None


@contextmanager
def traced(camera: ExportCamera, folder: Path) -> Iterator[TracedPixels]:
    """Rays of a camera, in a temporary file in the folder."""
    width, height = camera.size_px
    scratch = folder / f"{camera.name}.scratch.npy"
    rays = np.lib.format.open_memmap(scratch, "w+", np.float64, (height, width, 6))
    microlenses = None if camera.micro_images is None else np.zeros((height, width, 2), np.int32)
    try:
        for first, end in bands(height, AT_ONCE // width):
            rays[first:end], numbers = camera.rays.band(first, end)
            if microlenses is not None and numbers is not None:
                microlenses[first:end] = numbers
        yield TracedPixels(rays, microlenses)
    finally:
        del rays
        scratch.unlink()


def distances_mm(
    camera: ExportCamera, scene: SeenScene, frame: int, rays: np.ndarray, only: str | None = None
) -> np.ndarray:
    """Distances along the rays of all pixels to the first surface, (h, w)."""
    height, width = rays.shape[:2]
    parts = []
    for first, end in bands(height, AT_ONCE // width):
        origin, direction = np.array(rays[first:end].reshape(-1, 2, 3)).swapaxes(0, 1)
        parts.append(scene.distance_mm(frame, camera.name, origin, direction, only))
    return np.concatenate(parts).reshape(height, width)


def about(material: Material, camera: ExportCamera) -> dict[str, str | float | int]:
    """Attributes of a file: remarks line by line, and the first and the last pixel in the format's coordinates."""
    remarks = {f"remark{number}": line for number, line in enumerate(material.remarks)}
    (first_x, first_y), (last_x, last_y) = camera.rays.ends.tolist()
    return {**remarks, "first_x": first_x, "first_y": first_y, "last_x": last_x, "last_y": last_y}
