"""Depth of each pixel: vision z of the first surface that its ray meets, an EXR file per frame."""

from functools import partial
from pathlib import Path

import numpy as np

from pipeline.exports.material import ExportCamera, Material
from pipeline.files.exr_bands import BandedPart, write_bands
from pipeline.formats import Cameras, Format, Origin, Reads, Unit
from pipeline.plugins.formats.maps.traced import about, traced
from pipeline.results.answers import SeenScene

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
            shape = pixels.rays.shape[:2]
            attributes = about(material, camera)
            for frame in material.frames[camera.name]:
                rows = partial(_rows, camera, scene, frame, pixels.rays)
                part = BandedPart(name="depth", shape=shape, channels=("Z",), rows=rows, attributes=attributes)
                write_bands(folder / camera.name / f"{frame:04d}.depth.exr", [part])


def _rows(camera: ExportCamera, scene: SeenScene, frame: int, rays: np.ndarray, first: int, end: int) -> np.ndarray:
    """Vision z of the first surfaces that the rays of rows of pixels meet, in the unit of the format."""
    origin, direction = np.array(rays[first:end].reshape(-1, 2, 3)).swapaxes(0, 1)
    z_mm = origin[:, 2] + scene.distance_mm(frame, camera.name, origin, direction) * direction[:, 2]
    return z_mm.reshape(end - first, -1) * camera.rays.convention.scale
