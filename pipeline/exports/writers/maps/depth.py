"""Depth of each pixel: how far before the camera the first surface is that its ray meets, an EXR file per frame."""

from pathlib import Path

import numpy as np

from pipeline.exports.cameras import ExportCamera
from pipeline.exports.material import Material, Scene
from pipeline.exports.ray_patches import bands
from pipeline.exports.writers.maps.header import about
from pipeline.files.exr import Part, write_exr
from pipeline.formats import Cameras, ExportError, Format, Origin, Reads, Unit

FORMAT = Format(
    consumer="robotics, compositors; OpenEXR",
    note="channel Z: how far before the centre of the stop the first surface is that the ray of a pixel meets",
    source="CONVENTIONS.md, The ray of a position",
    cameras=Cameras.ANY,
    reads=frozenset({Reads.RAYS, Reads.SCENE}),
    files=("<camera>/<frame>.depth.exr",),
    origin=Origin.ZERO,
    unit=Unit.MM,
)

_AT_ONCE = 1 << 16
"""Pixels of a band, unless the rows of its patches are more: their rays take some megabytes."""


def write(material: Material, folder: Path) -> None:
    """Write a file per camera and frame; the rays of a camera are traced once, and lie in a file meanwhile."""
    if material.scene is None:
        raise ExportError("this material has no scene to measure depth in", hint="export from a finished build")
    scene = material.scene()
    for camera in material.cameras:
        (folder / camera.name).mkdir()
        scratch = folder / f"{camera.name}.scratch.npy"
        rays = _traced(camera, scratch)
        try:
            for frame in material.frames:
                depth = _depth(camera, scene, frame, rays)
                part = Part(name="depth", channels={"Z": depth}, attributes=about(material, camera))
                write_exr(folder / camera.name / f"{frame:04d}.depth.exr", [part])
        finally:
            del rays
            scratch.unlink()


def _traced(camera: ExportCamera, scratch: Path) -> np.ndarray:
    """Rays of all pixels (h, w, 6), in our conventions, in a file."""
    width, height = camera.size_px
    rays = np.lib.format.open_memmap(scratch, "w+", np.float64, (height, width, 6))
    for first, end in bands(height, _AT_ONCE // width):
        band = camera.rays.band(first, end)
        rays[first:end, :, :3], rays[first:end, :, 3:] = band.origin_mm, band.direction
    return rays


def _depth(camera: ExportCamera, scene: Scene, frame: int, rays: np.ndarray) -> np.ndarray:
    """Places of the first surfaces along the view axis of the format, (h, w) float32."""
    height, width, _ = rays.shape
    depth = np.empty((height, width), np.float32)
    for first, end in bands(height, _AT_ONCE // width):
        origin, direction = np.array(rays[first:end].reshape(-1, 2, 3)).swapaxes(0, 1)
        along = scene.distance_mm(frame, camera.name, origin, direction)
        z_mm = origin[:, 2] + along * direction[:, 2]
        depth[first:end] = z_mm.reshape(-1, width) * camera.rays.convention.scale
    return depth
