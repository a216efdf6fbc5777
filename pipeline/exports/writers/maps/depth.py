"""Depth of each pixel: how far before the camera the first surface is that its ray meets, an EXR file per frame."""

from pathlib import Path

import numpy as np

from pipeline.exports.cameras import ExportCamera
from pipeline.exports.errors import ExportError
from pipeline.exports.material import Material, Scene
from pipeline.exports.writers.maps.header import about
from pipeline.files.exr import Part, write_exr

_AT_ONCE = 1 << 16
"""Pixels whose rays are traced at once: their quadrature takes some hundred megabytes at most."""


def write(material: Material, folder: Path) -> None:
    """Write a file per camera and frame; the rays of a camera are traced once."""
    if material.scene is None:
        raise ExportError("this build has no scene")
    scene = material.scene()
    for camera in material.cameras:
        (folder / camera.name).mkdir()
        origin, direction = _rays(camera)
        for frame in material.frames:
            depth = _depth(camera, scene, frame, origin, direction)
            part = Part(name="depth", channels={"Z": depth}, attributes=about(material, camera))
            write_exr(folder / camera.name / f"{frame:04d}.depth.exr", [part])


def _rays(camera: ExportCamera) -> tuple[np.ndarray, np.ndarray]:
    """Rays of all pixels, in our conventions."""
    width, height = camera.size_px
    y, x = np.mgrid[0:height, 0:width].reshape(2, -1)
    parts = [slice(first, first + _AT_ONCE) for first in range(0, len(x), _AT_ONCE)]
    found = [camera.rays.traced(x[part], y[part]) for part in parts]
    origin, direction = (np.concatenate([getattr(one, name) for one in found]) for name in ("origin_mm", "direction"))
    return origin, direction


def _depth(camera: ExportCamera, scene: Scene, frame: int, origin: np.ndarray, direction: np.ndarray) -> np.ndarray:
    """Places of the first surfaces along the view axis of the format, (h, w)."""
    width, height = camera.size_px
    along = scene.distance_mm(frame, camera.name, origin, direction)
    points = camera.rays.points(origin + along[:, None] * direction)
    return np.asarray(points[:, 2].reshape(height, width))
