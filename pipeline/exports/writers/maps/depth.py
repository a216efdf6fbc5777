"""Depth of each pixel: how far before the camera the first surface is that its ray meets, an EXR file per frame."""

from pathlib import Path

import numpy as np

from pipeline.exports.material import ExportCamera, Material, Scene
from pipeline.exports.writers.maps.traced import TracedPixels, about, traced
from pipeline.files.exr import Part, write_exr
from pipeline.formats import Cameras, Format, Origin, Reads, Unit

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


def write(material: Material, folder: Path) -> None:
    """Write a file per camera and frame."""
    scene = material.scene()
    for camera in material.cameras:
        (folder / camera.name).mkdir()
        with traced(camera, folder) as pixels:
            for frame in material.frames:
                depth = _depth(camera, scene, frame, pixels)
                part = Part(name="depth", channels={"Z": depth}, attributes=about(material, camera))
                write_exr(folder / camera.name / f"{frame:04d}.depth.exr", [part])


def _depth(camera: ExportCamera, scene: Scene, frame: int, pixels: TracedPixels) -> np.ndarray:
    """Vision z of the first surfaces, in the unit of the format, (h, w) float32."""
    height, width, _ = pixels.rays.shape
    depth = np.empty((height, width), np.float32)
    for first, end in pixels.bands():
        origin, direction = np.array(pixels.rays[first:end].reshape(-1, 2, 3)).swapaxes(0, 1)
        z_mm = origin[:, 2] + scene.distance_mm(frame, camera.name, origin, direction) * direction[:, 2]
        depth[first:end] = z_mm.reshape(-1, width) * camera.rays.convention.scale
    return depth
